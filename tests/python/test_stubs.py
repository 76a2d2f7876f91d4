"""The stub of the compiled module says what the module has, no more and no less."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pytest

import collabslam
from collabslam import _core

STUB = ast.parse((Path(collabslam.__file__).parent / "_core.pyi").read_text())
CLASSES = {node.name: node for node in STUB.body if isinstance(node, ast.ClassDef)}
FUNCTIONS = {node.name: node for node in STUB.body if isinstance(node, ast.FunctionDef)}
KEPT = {"__version__", "__getnewargs__"}
"""Names with underscores that are part of the interface."""


def _public(names: object) -> set[str]:
    return {n for n in names if not n.startswith("_") or n in KEPT}  # type: ignore[attr-defined]


def _names(body: list[ast.stmt]) -> set[str]:
    found = {n.name for n in body if isinstance(n, ast.ClassDef | ast.FunctionDef)}
    return found | {
        n.target.id for n in body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)
    }


def _methods(name: str) -> dict[str, ast.FunctionDef]:
    return {n.name: n for n in CLASSES[name].body if isinstance(n, ast.FunctionDef)}


def _is_property(node: ast.FunctionDef) -> bool:
    return any(isinstance(d, ast.Name) and d.id == "property" for d in node.decorator_list)


def _stub_parameters(node: ast.FunctionDef) -> list[tuple[str, bool, bool]]:
    """(name, keyword only, has a default) of each parameter but ``self`` or ``cls``."""
    a = node.args
    positional = [*a.posonlyargs, *a.args]
    optional = len(positional) - len(a.defaults)
    out = [(p.arg, False, i >= optional) for i, p in enumerate(positional)]
    out += [(p.arg, True, d is not None) for p, d in zip(a.kwonlyargs, a.kw_defaults, strict=True)]
    return [p for p in out if p[0] not in ("self", "cls")]


def _real_parameters(function: object) -> list[tuple[str, bool, bool]]:
    parameters = inspect.signature(function).parameters.values()  # type: ignore[arg-type]
    return [
        (p.name, p.kind is p.KEYWORD_ONLY, p.default is not p.empty) for p in parameters if p.name != "self"
    ]


def test_module_has_the_same_names() -> None:
    assert _public(_names(STUB.body)) == _public(vars(_core))


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_class_has_the_same_members(name: str) -> None:
    assert _public(_names(CLASSES[name].body)) == _public(vars(getattr(_core, name)))


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_properties_are_properties(name: str) -> None:
    members = vars(getattr(_core, name))
    for member, node in _methods(name).items():
        if not member.startswith("_"):
            assert _is_property(node) == inspect.isgetsetdescriptor(members[member]), member


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_methods_have_the_same_parameters(name: str) -> None:
    cls = getattr(_core, name)
    for member, node in _methods(name).items():
        if member == "__new__":
            assert _stub_parameters(node) == _real_parameters(cls)
        elif not _is_property(node) and not member.startswith("_"):
            assert _stub_parameters(node) == _real_parameters(vars(cls)[member]), member


def test_functions_have_the_same_parameters() -> None:
    for name, node in FUNCTIONS.items():
        assert _stub_parameters(node) == _real_parameters(getattr(_core, name)), name
