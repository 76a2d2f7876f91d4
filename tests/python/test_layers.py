"""Who may import whom, what the package's front door costs, and that the core knows no Python."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import collabslam

PACKAGE = Path(collabslam.__file__).parent
ROOT = PACKAGE.parents[1]
TOP = {
    "engine", "runner", "cli", "commands", "checks", "demo_run", "reproduce", "benchmark", "report", "viz",
    "experiments",
}  # fmt: skip

FORBIDDEN = {
    "frontend": TOP | {"datasets", "evaluation", "results", "demo"},
    "checks": (TOP - {"checks"}) | {"demo"},
    "datasets": TOP | {"frontend", "evaluation", "results", "demo"},
    "evaluation": TOP | {"frontend", "datasets", "results", "demo"},
    "demo": TOP | {"frontend", "evaluation", "results"},
    "formats": TOP | {"frontend", "demo"},
    "viz": {"engine", "cli", "commands", "datasets", "frontend"},
    "reproduce": {
        "engine",
        "runner",
        "cli",
        "commands",
        "demo_run",
        "benchmark",
        "viz",
        "frontend",
        "datasets",
    },
    "worn_pose": TOP | {"frontend", "datasets", "evaluation", "results", "demo", "settings"},
    "experiments": {"cli", "commands", "benchmark", "frontend"},
    "worlds": TOP | {"frontend", "evaluation", "results", "datasets"},
    "engine.py": {"runner", "commands", "cli", "datasets", "evaluation", "results", "viz", "demo"},
    "depth_input.py": TOP | {"datasets", "evaluation", "results", "demo"},
    "features.py": TOP | {"datasets", "evaluation", "results", "demo"},
    "tracks.py": TOP | {"datasets", "evaluation", "results", "demo"},
    "overlap.py": TOP | {"datasets", "evaluation", "results", "demo"},
    "benchmark": {"cli", "commands", "reproduce"},
    "runner.py": {"cli", "commands", "demo_run", "benchmark", "frontend", "demo"},
    "types.py": TOP | {"datasets", "frontend", "evaluation", "results", "demo", "settings"},
    "geometry.py": TOP | {"datasets", "frontend", "evaluation", "results", "demo", "settings"},
}
"""Part of the package, and the parts that it must not import."""


def _imports(path: Path) -> set[str]:
    """Parts of collabslam that a file imports, at its top or later."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{a.name}" for a in node.names)}
    return {n.split(".")[1] for n in names if n.startswith("collabslam.")}


@pytest.mark.parametrize("part", sorted(FORBIDDEN))
def test_imports_go_one_way(part: str) -> None:
    files = [PACKAGE / part] if part.endswith(".py") else sorted((PACKAGE / part).rglob("*.py"))
    assert files
    for path in files:
        assert not _imports(path) & FORBIDDEN[part], path.relative_to(PACKAGE)


@pytest.mark.skipif(not (ROOT / "crates").is_dir(), reason="needs the source tree")
def test_the_core_knows_no_python() -> None:
    text = (ROOT / "crates" / "ekf-core" / "Cargo.toml").read_text()
    assert "pyo3" not in text
    assert "numpy" not in text


def _python(*arguments: str) -> str:
    done = subprocess.run([sys.executable, *arguments], check=True, capture_output=True, text=True)
    return done.stdout


def test_import_leaves_the_heavy_libraries_alone() -> None:
    code = "import sys, collabslam; print(sorted({'cv2', 'matplotlib'} & set(sys.modules)))"
    assert _python("-c", code).strip() == "[]"


def test_help_loads_next_to_nothing() -> None:
    """What makes it answer at once; the test of the wheel prints how soon."""
    code = (
        "import sys; from collabslam import cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print('LOADED', sum(m.split('.')[0] == 'collabslam' for m in sys.modules), *sys.modules)"
    )
    shown, loaded = _python("-c", code).split("LOADED ")
    assert "usage" in shown
    own, *modules = loaded.split()
    assert int(own) <= 20
    assert not {"numpy", "cv2", "yaml", "tqdm", "collabslam._core"} & set(modules)


def test_every_public_name_is_there() -> None:
    for name in collabslam.__all__:
        assert getattr(collabslam, name) is not None
    assert set(collabslam.__all__) <= set(dir(collabslam))


@pytest.mark.parametrize("first", ["collabslam.runner", "collabslam.cli", "collabslam.commands.run"])
def test_run_is_a_function_whatever_is_imported_first(first: str) -> None:
    assert _python("-c", f"import collabslam, {first}; print(callable(collabslam.run))").strip() == "True"


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'collabslam' has no attribute 'slam'"):
        _ = collabslam.slam
