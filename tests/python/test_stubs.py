"""The stub of the compiled module says what the module has, with the same signatures and the same words."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pytest

import collabslam
from collabslam import _core

STUB = ast.parse((Path(collabslam.__file__).parent / "_core.pyi").read_text())
CLASSES = {n.name: n for n in STUB.body if isinstance(n, ast.ClassDef) and not n.name.startswith("_")}
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


NO_DEFAULT = object()


def _stub_default(node: ast.expr | None) -> object:
    """A default's value, `...` where the stub leaves it open."""
    return NO_DEFAULT if node is None else ast.literal_eval(node)


def _stub_parameters(node: ast.FunctionDef) -> list[tuple[str, bool, object]]:
    """(name, keyword only, default) of each parameter but ``self`` or ``cls``."""
    a = node.args
    positional = [*a.posonlyargs, *a.args]
    defaults = [None] * (len(positional) - len(a.defaults)) + [*a.defaults]
    out = [(p.arg, False, _stub_default(d)) for p, d in zip(positional, defaults, strict=True)]
    out += [(p.arg, True, _stub_default(d)) for p, d in zip(a.kwonlyargs, a.kw_defaults, strict=True)]
    return [p for p in out if p[0] not in ("self", "cls")]


def _real_parameters(function: object) -> list[tuple[str, bool, object]]:
    parameters = inspect.signature(function).parameters.values()  # type: ignore[arg-type]
    return [
        (p.name, p.kind is p.KEYWORD_ONLY, NO_DEFAULT if p.default is p.empty else p.default)
        for p in parameters
        if p.name != "self"
    ]


def _same_parameters(node: ast.FunctionDef, function: object) -> None:
    """The same names in the same order, and the same defaults where the stub tells them."""
    stub, real = _stub_parameters(node), _real_parameters(function)
    assert [p[:2] for p in stub] == [p[:2] for p in real], node.name
    for (name, _, told), (_, _, default) in zip(stub, real, strict=True):
        assert (told is NO_DEFAULT) == (default is NO_DEFAULT), name
        assert told is ... or told is NO_DEFAULT or told == default, name


def _words(thing: object) -> str:
    return inspect.cleandoc(getattr(thing, "__doc__", None) or "")


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
            real = members[member]
            assert _is_property(node) == (
                inspect.isgetsetdescriptor(real) or inspect.ismemberdescriptor(real)
            )


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_methods_have_the_same_parameters(name: str) -> None:
    cls = getattr(_core, name)
    for member, node in _methods(name).items():
        if member == "__new__":
            _same_parameters(node, cls)
        elif not _is_property(node) and not member.startswith("_"):
            _same_parameters(node, vars(cls)[member])


def test_functions_have_the_same_parameters() -> None:
    for name, node in FUNCTIONS.items():
        _same_parameters(node, getattr(_core, name))


def test_no_call_takes_more_than_eight_arguments() -> None:
    methods = [node for name in CLASSES for node in _methods(name).values()]
    for node in [*FUNCTIONS.values(), *methods]:
        assert len(_stub_parameters(node)) <= 8, node.name


def test_functions_are_described_in_the_same_words() -> None:
    for name, node in FUNCTIONS.items():
        words = ast.get_docstring(node)
        assert words, name
        assert words == _words(getattr(_core, name)), name


@pytest.mark.parametrize("name", sorted(CLASSES))
def test_classes_are_described_in_the_same_words(name: str) -> None:
    cls = getattr(_core, name)
    assert ast.get_docstring(CLASSES[name]) == _words(cls)
    for member, node in _methods(name).items():
        if member.startswith("_"):
            continue
        words = ast.get_docstring(node)
        assert words or f"{member}" in _words(cls), member
        assert (words or "") == _words(getattr(cls, member)), member
