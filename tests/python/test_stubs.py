"""The stub of the compiled module is made from the Rust sources, and leaves nothing undescribed."""

from __future__ import annotations

import ast
import importlib.util
import sys
from pathlib import Path

import pytest

import collabslam
from collabslam import _core, extension
from collabslam.cli.main import main
from collabslam.errors import DataError

STUB = Path(collabslam.__file__).parent / "_core.pyi"
MAKER = Path(__file__).parents[2] / "packaging" / "stubs.py"


def _functions(body: list[ast.stmt]) -> list[ast.FunctionDef]:
    inside = [f for node in body if isinstance(node, ast.ClassDef) for f in _functions(node.body)]
    return inside + [node for node in body if isinstance(node, ast.FunctionDef)]


def test_it_is_what_the_sources_make() -> None:
    spec = importlib.util.spec_from_file_location("stubs", MAKER)
    assert spec is not None
    assert spec.loader is not None
    stubs = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(stubs)
    assert STUB.read_text(encoding="utf-8") == stubs.stub()


def test_no_call_takes_more_than_eight_arguments() -> None:
    for function in _functions(ast.parse(STUB.read_text()).body):
        names = [a.arg for a in (*function.args.args, *function.args.kwonlyargs)]
        assert len([name for name in names if name not in ("self", "cls")]) <= 8, function.name


def test_everything_public_is_described() -> None:
    for node in ast.parse(STUB.read_text()).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            assert ast.get_docstring(node), node.name
        if isinstance(node, ast.ClassDef):
            told = ast.get_docstring(node) or ""
            for member in _functions(node.body):
                of_class = member.name.startswith("_") or member.name in told
                assert of_class or ast.get_docstring(member), f"{node.name}.{member.name}"


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("", "", None),
        ("\nclass Turn:", "\nclass Bend:", "Bend"),
        ("def born(self)", "def carried(self)", "CandidateReport.carried"),
        ("intrinsics: ArrayLike | None", "lens: ArrayLike | None", "Camera.__new__"),
        ("def skew(", "def skewed(", "skewed"),
    ],
)
def test_a_build_of_other_sources_is_told_from_this_one(old: str, new: str, named: str | None) -> None:
    stub = STUB.read_text(encoding="utf-8")
    assert old in stub
    assert extension.first_difference(_core, stub.replace(old, new, 1)) == named


def test_sources_without_their_build_say_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    extension.check_extension()
    extension.check_extension.cache_clear()
    (tmp_path / "_core.pyi").write_text(STUB.read_text(encoding="utf-8") + "\n@final\nclass Later:\n")
    monkeypatch.setattr(extension, "STUB", tmp_path / "_core.pyi")
    assert main(["info", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "'Later' differs" in said
    assert "pip install ." in said
    monkeypatch.setitem(sys.modules, "collabslam._core", None)
    with pytest.raises(DataError, match="is not there"):
        extension.check_extension()
