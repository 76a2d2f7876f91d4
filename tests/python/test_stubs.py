"""The stub of the compiled module is made from the Rust sources, and leaves nothing undescribed."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

import collabslam

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
