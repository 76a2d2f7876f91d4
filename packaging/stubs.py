"""The stub of the compiled module, from the Rust sources of the binding: writes python/collabslam/_core.pyi.

    python packaging/stubs.py [--check]

Names, defaults, types and docs are those of the `#[pyclass]`, `#[pymethods]`, `#[pyfunction]` and
`#[pymodule_export] const` items of crates/pycollab, as rustfmt writes them, and of the filter's table of
settings. What a Rust type of the binding is in Python stands in its own docs, in a line `Python: ...`;
`TYPES` has those of Rust's library and of PyO3.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / "crates" / "pycollab" / "src"
TABLE = ROOT / "crates" / "ekf-core" / "src" / "settings.rs"
OUT = ROOT / "python" / "collabslam" / "_core.pyi"
HEAD = """\
# Made by packaging/stubs.py from crates/pycollab.
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collabslam.frontend.patch import Patch

"""

TYPES = {
    **dict.fromkeys(("f32", "f64"), "float"),
    **dict.fromkeys(("i64", "u32", "u64", "usize"), "int"),
    "bool": "bool",
    **dict.fromkeys(("String", "str"), "str"),
    **dict.fromkeys(("[u8]", "PyBytes"), "bytes"),
    **dict.fromkeys(("PyAny", "PyTuple"), "object"),
    "()": "None",
}
NUMBERS = {"f32": "float32", "f64": "float64", "i64": "int64", "u8": "uint8", "bool": "bool_"}
"""What numpy calls the numbers of an array."""
HOLDERS = {"Bound", "Py", "PyRef", "PyResult"}
"""Types that Python does not see, but what they hold."""
VALUES = {"None": "None", "true": "True", "false": "False"}

DOCS = r"(?P<docs>(?:^ *(?:///.*|#\[[^\]]*\])\n)*)"
NAMED = re.compile(rf"{DOCS}^(?:pub\(\w+\) )?(?:type|enum|struct) (?P<name>\w+)(?P<of><[^>]*>)?", re.M)
CLASS = re.compile(
    rf"{DOCS}^pub\(\w+\) struct (?P<name>\w+)(?:;|\(.*\);| \{{\n(?P<fields>(?s:.*?))^\}})", re.M
)
METHODS = re.compile(r"^#\[pymethods\]\nimpl (?P<name>\w+) \{\n(?P<body>(?s:.*?))^\}", re.M)
FIELD = re.compile(r"^    (?:pub\(\w+\) )?(?:r#)?(?P<name>\w+): (?P<type>.*),$", re.M)
FUNCTION = re.compile(
    rf"{DOCS}^ *(?:pub\(\w+\) )?fn (?P<name>\w+)(?:<[^>(]*>)?"
    r"\((?P<parameters>[^{]*?)\)(?: -> (?P<result>[^{]*?))? \{$",
    re.M,
)
CONSTANT = re.compile(rf"{DOCS}^ *(?:pub\(\w+\) )?const (?P<name>\w+): (?P<type>[^=]+) =", re.M)
GROUP = re.compile(rf"{DOCS}^ +(?P<name>\w+): (?P<type>\w+) \{{\n(?P<body>(?s:.*?))^ +\}}$", re.M)
SETTING = re.compile(rf"{DOCS}^ +(?P<name>\w+): (?P<type>\w+) = ", re.M)
SIGNATURE = re.compile(r"#\[pyo3\(signature = \((.*?)\)\)\]", re.S)


class Stub:
    """The stub of some Rust sources.

    Raises
    ------
    SystemExit
        From `text`, for a type of which is not known what it is in Python.
    """

    def __init__(self, sources: Iterable[str], settings: str) -> None:
        self._sources = list(sources)
        self._groups = list(GROUP.finditer(settings[settings.index("macro_rules! filter_settings") :]))
        self._named = {}
        for item in self._items(NAMED):
            told = re.search(r"/// Python: (.*)", item["docs"])
            if "#[pyclass" in item["docs"]:
                self._named[item["name"]] = _name(item)
            elif told:
                self._named[item["name"]] = told[1]

    def _items(self, pattern: re.Pattern[str]) -> list[re.Match[str]]:
        return [item for source in self._sources for item in pattern.finditer(source)]

    def text(self) -> str:
        """The whole stub, before it is formatted."""
        constants = [c for c in self._items(CONSTANT) if "#[pymodule_export" in c["docs"]]
        classes = [c for c in self._items(CLASS) if "#[pyclass" in c["docs"]]
        functions = [f for f in self._items(FUNCTION) if "#[pyfunction" in f["docs"]]
        groups = [group["type"] for group in self._groups]
        exported = [*map(_name, classes), *groups, *(item["name"] for item in constants + functions)]
        return "".join(
            [
                HEAD,
                f"__all__ = {sorted(exported, key=_order)}\n",
                *(f"{c['name']}: {self._type(c['type'], '')}\n{_docs(c, '')}" for c in constants),
                *map(self._class, classes),
                *map(self._group, self._groups),
                *(self._function(f, "", "") for f in functions),
            ]
        )

    def _class(self, item: re.Match[str]) -> str:
        name, body = _name(item), []
        if "get_all" in item["docs"]:
            fields = [(f["name"], self._type(f["type"], name)) for f in FIELD.finditer(item["fields"])]
            body += [f"    @property\n    def {field}(self) -> {kind}: ...\n" for field, kind in fields]
        for methods in self._items(METHODS):
            if methods["name"] == item["name"]:
                functions = FUNCTION.finditer(methods["body"])
                body += [self._function(f, name, "    ") for f in functions]
        if name == "FilterSettings":
            body.append(_properties([(group, group["type"]) for group in self._groups]))
        if re.search(r"\beq\b", item["docs"].split("#[pyclass")[1]):
            body += [f"    def __{word}__(self, other: object, /) -> bool: ...\n" for word in ("eq", "ne")]
            body.append("    __hash__: None  # type: ignore[assignment]\n")
        return f"@final\nclass {name}:\n{_docs(item, '    ')}{''.join(body)}"

    def _group(self, group: re.Match[str]) -> str:
        """The class of a group of the filter's settings; what is not a number is one of a list of names."""
        fields = [(item, TYPES.get(item["type"], "str")) for item in SETTING.finditer(group["body"])]
        return f"@final\nclass {group['type']}:\n{_docs(group, '    ', prose=True)}{_properties(fields)}"

    def _function(self, item: re.Match[str], owner: str, indent: str) -> str:
        docs, name, first, lines = item["docs"], item["name"], ["self"] if owner else [], []
        if "#[new]" in docs:
            name, first = "__new__", ["cls"]
        if "#[staticmethod]" in docs:
            lines, first = [f"{indent}@staticmethod\n"], []
        if "#[getter]" in docs:
            lines = [f"{indent}@property\n"]
        parameters = ", ".join([*first, *self._parameters(item, owner)])
        result = self._type(item["result"] or "()", owner)
        told = _docs(item, indent + "    ")
        body = f"\n{told}" if told else " ...\n"
        return "".join([*lines, f"{indent}def {name}({parameters}) -> {result}:{body}"])

    def _parameters(self, item: re.Match[str], owner: str) -> list[str]:
        """The parameters as Python has them: in the order of the signature, with its defaults."""
        types = {}
        for parameter in _split(item["parameters"]):
            name, _, kind = parameter.partition(": ")
            if kind and not kind.startswith("Python<"):
                types[name] = self._type(kind, owner, taken=True)
        signature = SIGNATURE.search(item["docs"])
        out = []
        for parameter in _split(signature[1]) if signature else types:
            name, sign, default = parameter.partition(" = ")
            kind = f": {types[name.lstrip('*')]}" if name != "*" else ""
            out.append(f"{name}{kind}" + (f" = {_value(default)}" if sign else ""))
        return out

    def _type(self, rust: str, owner: str, *, taken: bool = False) -> str:
        """What a Rust type is in Python, as a result or, `taken`, as a parameter; `owner` is `Self`."""

        def inside(text: str) -> list[str]:
            return [self._type(one, owner, taken=taken) for one in _split(text)]

        rust = re.sub(r"^&('\w+ )?|(?<=<)'\w+(, )?", "", rust.strip()).removesuffix("<>").rsplit("::", 1)[-1]
        several = "Sequence" if taken else "list"
        name, _, of = rust.removesuffix(">").partition("<")
        if name in self._named:
            return re.sub(r"\bT\b", f"np.{NUMBERS.get(of)}", self._named[name])
        if name in HOLDERS:
            return inside(of)[0]
        if name == "Option":
            return f"{inside(of)[0]} | None"
        if name == "Vec":
            return f"{several}[{inside(of)[0]}]"
        if rust == "Self":
            return owner
        if rust in TYPES:
            return TYPES[rust]
        if rust.startswith("("):
            return f"tuple[{', '.join(inside(rust[1:-1]))}]"
        if rust.startswith("["):
            return f"{several}[{inside(rust[1:].split(';')[0])[0]}]"
        sys.exit(f"What is the Rust type {rust} in Python? Say it in its docs, in a line 'Python: ...'.")


def _name(item: re.Match[str]) -> str:
    """The name of an item in Python."""
    told = re.search(r'name = "(\w+)"', item["docs"])
    return told[1] if told else str(item["name"])


def _properties(items: list[tuple[re.Match[str], str]]) -> str:
    """Properties of settings or groups of them, each with its type."""
    heads = [f"    @property\n    def {item['name']}(self) -> {kind}:\n" for item, kind in items]
    docs = [_docs(item, " " * 8, prose=True) for item, _ in items]
    return "".join(head + told for head, told in zip(heads, docs, strict=True))


def _order(name: str) -> tuple[bool, bool, str]:
    """Constants, then classes, then the rest, as ruff wants them."""
    return not name.isupper(), not name[0].isupper(), name


def _value(rust: str) -> str:
    """A default in Python, `...` where Rust makes it."""
    number = re.fullmatch(r"-?[\d.]+(e-?\d+)?", rust)
    return rust if number else VALUES.get(rust, "...")


def _docs(item: re.Match[str], indent: str, *, prose: bool = False) -> str:
    """The docs of an item as a docstring; `prose` is wrapped anew."""
    lines = re.findall(r"^ *///(?: (.*))?$", item["docs"], re.M)
    if prose:
        lines = textwrap.wrap(" ".join(lines), 100 - len(indent))
    lines = [f"{indent}{line}".rstrip() for line in lines]
    if not lines:
        return ""
    return f'{indent}"""' + "\n".join(lines).strip() + (f"\n{indent}" if lines[1:] else "") + '"""\n'


def _split(text: str) -> list[str]:
    """The parts of a list between its commas, but for those within brackets."""
    parts, depth = [""], 0
    for sign in text:
        depth += (sign in "([<{") - (sign in ")]>}")
        if sign == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += sign
    return [part.strip() for part in parts if part.strip()]


def stub() -> str:
    """The stub of the binding."""
    paths = sorted(SOURCES.rglob("*.rs"), key=lambda path: (path.parent, path.name != "mod.rs", path))
    sources = [path.read_text(encoding="utf-8") for path in paths]
    text = Stub(sources, TABLE.read_text(encoding="utf-8")).text()
    ruff = [sys.executable, "-m", "ruff", "format", "--stdin-filename", str(OUT), "-"]
    return subprocess.run(ruff, cwd=ROOT, input=text, stdout=subprocess.PIPE, text=True, check=True).stdout


def main() -> None:
    """Write the file, or compare it with what it should be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; fail if the file is out of date")
    made = stub()
    if not parser.parse_args().check:
        OUT.write_text(made, encoding="utf-8")
    elif made != OUT.read_text(encoding="utf-8"):
        sys.exit(f"{OUT.name} is not that of these sources; write it anew with python {Path(__file__).name}.")


if __name__ == "__main__":
    main()
