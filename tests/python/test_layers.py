"""Who may import whom, what the package's front door costs, and that the core knows no Python."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import collabslam
import collabslam_lab

ROOT = Path(collabslam.__file__).parents[2]
SOURCES = {
    "collabslam": Path(collabslam.__file__).parent,
    "collabslam_lab": Path(collabslam_lab.__file__).parent,
}
BASE = {"_core", "errors", "types", "results", "geometry", "level", "extras"}

ALLOWED: dict[str, set[str]] = {
    # what stands alone
    "errors": set(),
    "version": {"_core"},
    "extras": {"errors"},
    "extension": {"_core", "errors"},
    "types": {"_core", "errors"},
    "geometry": {"_core", "errors", "types"},
    "level": {"geometry", "types"},
    "bound": {"types"},
    "results": {"_core", "types", "level", "bound"},
    "images": {"_core", "errors", "types"},
    # what the product is made of, from the bottom to the top
    "evaluation": BASE | {"bound"},
    "formats": BASE,
    "settings": BASE | {"formats"},
    "worn_pose": BASE,
    "targets": BASE,
    "frontend": BASE | {"settings", "targets"},
    "slam": BASE | {"images", "settings", "formats", "targets", "frontend"},
    "datasets": BASE | {"images", "formats", "worn_pose", "targets"},
    "runs": BASE | {"version", "settings", "formats", "evaluation", "targets", "slam", "datasets"},
    "batch": BASE | {"version", "settings", "formats", "datasets", "runs"},
    "live": BASE
    | {"version", "images", "worn_pose", "targets", "settings", "formats", "slam", "datasets", "runs"},
    "viz": BASE | {"formats", "evaluation", "slam", "runs"},
    "checks": BASE | {"targets", "frontend", "datasets", "runs"},
    "simulation": BASE | {"datasets"},
    "demo": BASE | {"settings", "formats", "datasets", "runs", "viz", "simulation"},
    "cli": BASE
    | {
        "version",
        "settings",
        "formats",
        "worn_pose",
        "targets",
        "datasets",
        "runs",
        "batch",
        "live",
        "viz",
        "checks",
        "simulation",
        "demo",
    },
    "__main__": {"cli"},
    "__init__": {
        "_core",
        "errors",
        "types",
        "results",
        "images",
        "settings",
        "targets",
        "slam",
        "datasets",
        "runs",
    },
}
"""Part of the package, and the parts that it may import."""

ENGINE = ("tracking", "targets", "worn", "submaps", "map", "recovery")
"""Folders of ``slam``, from the bottom to the top: a file imports from its own and from those before."""
OF_LOOP = {"engine", "frame_loop", "parts", "saving", "starts", "search", "verdict", "outcome", "degraded_by"}
"""Of the files beside them those that make the frame loop; the others are shared by all."""

PRODUCT = {f"collabslam.{part}" for part in ALLOWED}
LAB_ALLOWED: dict[str, set[str]] = {
    "__init__": set(),
    "report": set(),
    "program": set(),
    "kept": {"program"},
    "figures": {"report"},
    "switches": set(),
    "intervals": set(),
    "worn_sensors": set(),
    "worlds": {"worn_sensors"},
    "benchmark": {"report", "program", "switches", "intervals"},
    "peers": {"report", "benchmark"},
    "paper_simulation": {"figures", "switches", "worn_sensors"},
    "paper_worlds": {"figures", "kept", "worlds", "intervals"},
    "appearance": {"figures", "kept", "benchmark", "worlds"},
    "worn_cameras": {"figures", "paper_simulation"},
    "long_trajectories": {"kept", "report", "worlds"},
    "calibrated": {"figures", "intervals", "benchmark"},
    "reliability": {"report", "benchmark"},
    "gyro": {"report", "kept", "worlds"},
    "hardware": {"calibrated", "figures", "report", "worlds"},
    "learned": {"report", "benchmark"},
    "real_people": {"report"},
    "evidence": {"program"},
    "cli": {
        "benchmark",
        "calibrated",
        "evidence",
        "gyro",
        "hardware",
        "learned",
        "appearance",
        "long_trajectories",
        "real_people",
        "report",
        "paper_simulation",
        "paper_worlds",
        "peers",
        "worn_cameras",
        "reliability",
        "worlds",
    },
    "__main__": {"cli"},
}
"""Part of the lab, and the parts of the lab that it may import; it may import all of the product."""


def _module(path: Path, package: str) -> str:
    parts = path.relative_to(SOURCES[package]).with_suffix("").parts
    return ".".join([package, *parts]).removesuffix(".__init__")


FILES = {_module(p, package): p for package, root in SOURCES.items() for p in sorted(root.rglob("*.py"))}
KNOWN = {*FILES, "collabslam._core"}


@cache
def _imports(module: str) -> set[str]:
    """Modules of ours that a file imports, at its top or later."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(FILES[module].read_text())):
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {
                full if (full := f"{node.module}.{a.name}") in KNOWN else node.module for a in node.names
            }
    return {n for n in names if n.split(".")[0] in SOURCES} - {module}


def _part(module: str) -> str:
    package, _, rest = module.partition(".")
    return f"{package}.{rest.split('.')[0] or '__init__'}"


@pytest.mark.parametrize("module", sorted(FILES))
def test_a_file_imports_what_the_table_allows(module: str) -> None:
    part = _part(module)
    package, name = part.split(".")
    table = ALLOWED if package == "collabslam" else LAB_ALLOWED
    assert name in table, f"{module} lies outside the folders of the table"
    allowed = {f"{package}.{n}" for n in table[name]} | {part}
    if package == "collabslam_lab":
        allowed |= {f"collabslam.{n}" for n in (*ALLOWED, "_core")}
    assert {_part(m) for m in _imports(module)} <= allowed


@pytest.mark.parametrize("folder", ENGINE)
def test_a_folder_of_the_engine_imports_from_those_below(folder: str) -> None:
    below = ENGINE[: ENGINE.index(folder) + 1]
    for module in (m for m in FILES if m.startswith(f"collabslam.slam.{folder}.")):
        for other in (m.split(".")[2:] for m in _imports(module) if m.startswith("collabslam.slam.")):
            assert other[0] in below if len(other) > 1 else other[0] not in OF_LOOP, (module, other)


def test_the_table_names_folders_that_exist() -> None:
    assert {_part(m) for m in FILES} == PRODUCT | {f"collabslam_lab.{part}" for part in LAB_ALLOWED}


def test_no_file_imports_itself_in_a_circle() -> None:
    imports = {module: _imports(module) & set(FILES) for module in FILES}
    while leaves := {m for m, targets in imports.items() if not targets & set(imports)}:
        imports = {m: targets for m, targets in imports.items() if m not in leaves}
    assert not imports, sorted(imports)


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
        "import sys; from collabslam.cli import main as cli\n"
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


@pytest.mark.parametrize("first", ["collabslam.runs.runner", "collabslam.cli.main", "collabslam.cli.run"])
def test_run_is_a_function_whatever_is_imported_first(first: str) -> None:
    assert _python("-c", f"import collabslam, {first}; print(callable(collabslam.run))").strip() == "True"


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'collabslam' has no attribute 'filters'"):
        _ = collabslam.filters
