"""The gate through which all comes that files and messages say: nothing of it is passed over in silence.

A reader takes keys from a `Keys`, names those that it knows and has no use for, and whatever is left is
refused by its name.  What was read, and from where, is told to whoever listens (`listening`), such as
``collabslam info``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import yaml

from collabslam.errors import DataError
from collabslam.formats.files import read_text
from collabslam.formats.yaml_text import load_yaml, once

_OF_PYTHON = "it is {}; write its numbers as text (YAML: camera_matrix, image_width, image_height, ...)"
_BINARY = {
    b"\x93NUMPY": _OF_PYTHON.format("an array of NumPy"),
    b"MATLAB ": _OF_PYTHON.format("a file of MATLAB"),
    b"\x89HDF": _OF_PYTHON.format("HDF5"),
    b"\x80": _OF_PYTHON.format("a pickle of Python"),
}
_REPORTS = (
    (r"^Calibration results", "it is Kalibr's report; give the camchain.yaml that is beside it"),
    (r"^\s*PPX:", "it is RealSense's list; write camera_matrix, distortion_coefficients, image_width, ..."),
    (r"^\s*fc\s*=\s*\[", "it is the MATLAB toolbox's; write fc and cc as camera_matrix, kc as dist_coeffs"),
)
"""What tells another program's text about a calibration, and what to do."""
_NAMED = (
    ("fx", "fy", "cx", "cy"),
    ("width", "height"),
    ("k1", "k2", "p1", "p2"),
    ("k1", "k2", "p1", "p2", "k3"),
)
"""Names of numbers, in their order, that a key may hold in place of a list of them."""
_PACKED = {b"\x1f\x8b": "gzip", b"PK": "zip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"(\xb5/\xfd": "zstd"}
_SHOWN = 12
"""Numbers of a value that are shown."""


class Fact(NamedTuple):
    """Something that was read: what it is, its value, and the file, message or rule that it comes from."""

    what: str
    value: str
    source: str


_listener: ContextVar[list[Fact] | None] = ContextVar("facts", default=None)


@contextmanager
def listening() -> Iterator[list[Fact]]:
    """All facts that are read meanwhile, in order, each once."""
    facts: list[Fact] = []
    token = _listener.set(facts)
    try:
        yield facts
    finally:
        _listener.reset(token)


def tell(what: str, value: object, source: object) -> None:
    """Say what was read, to whoever listens."""
    facts, fact = _listener.get(), Fact(what, _brief(value), str(source))
    if facts is not None and fact not in facts:
        facts.append(fact)


def _brief(value: object) -> str:
    if isinstance(value, Mapping):
        value = value.get("data", f"{len(value)} keys")
    if isinstance(value, list | tuple | np.ndarray):
        items = np.asarray(value, dtype=object).ravel().tolist()
        more = " .." if len(items) > _SHOWN else ""
        return " ".join(map(_brief, items[:_SHOWN])) + more
    return f"{value:g}" if isinstance(value, float) else str(value)


class Keys:
    """The keys of a file or a message; a context manager that refuses those which nobody asked for.

    Parameters
    ----------
    content : mapping
    where : str
        The file or message, for messages.
    prefix : str
        The key that holds this mapping, as ``cam0.``.
    """

    def __init__(self, content: Mapping[Any, Any], where: object, prefix: str = "") -> None:
        self.where, self._prefix = str(where), prefix
        self._content = {str(key): value for key, value in content.items()}
        self._left = dict.fromkeys(self._content)

    def __enter__(self) -> Keys:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None and self._left:
            named = ", ".join(f"'{self._prefix}{key}'" for key in self._left)
            raise DataError(
                f"{self.where} has what is not understood here: {named}; correct the name, or take it out if "
                "it says nothing of this recording."
            )

    def __iter__(self) -> Iterator[str]:
        return iter(self._content)

    def has(self, *names: str) -> bool:
        """Whether one of the keys has a value."""
        return any(self._content.get(name) is not None for name in names)

    def take(self, *names: str) -> Any:
        """The value of the first of these keys that has one; None if none has."""
        name = next(filter(self.has, names), None)
        for known in names if name is None else [name]:
            self._left.pop(known, None)
        if name is None:
            return None
        value = self._content[name]
        tell(f"{self._prefix}{name}", value, self.where)
        return value

    def peek(self, name: str) -> Mapping[str, Any]:
        """The mapping of a key that is still to be read; empty if it holds none."""
        value = self._content.get(name)
        return value if isinstance(value, Mapping) else {}

    def peek_number(self, *names: str) -> float | None:
        """The number of a key that is still to be read; None if there is none."""
        value = next((self._content[name] for name in names if self.has(name)), None)
        return float(value) if isinstance(value, int | float) else None

    def need(self, *names: str) -> Any:
        """As `take`; DataError naming the first if there is none."""
        value = self.take(*names)
        if value is None:
            raise DataError(f"{self.where} lacks the key '{self._prefix}{names[0]}'; add it.")
        return value

    def numbers(self, *names: str, count: Iterable[int] | None = None) -> list[float]:
        """The numbers of a key that is needed; DataError if it is none, or has none of the counts."""
        which = f"The key '{self._prefix}{next(filter(self.has, names), names[0])}' of {self.where}"
        value = self.need(*names)
        if isinstance(value, Mapping):
            named = next((names for names in _NAMED if set(names) == set(value)), None)
            value = value.get("data") if named is None else [value[name] for name in named]
        try:
            # PyYAML reads 1e-05 as text, hence float() of each item.
            found = [float(x) for x in np.asarray(value, dtype=object).ravel().tolist()]
        except (TypeError, ValueError, OverflowError) as error:
            raise DataError(f"{which} is not a list of numbers; correct it{_points(value)}.") from error
        if not np.isfinite(found).all():
            raise DataError(f"{which} holds a number that is not finite; correct it.")
        if count is not None and len(found) not in count:
            expected = " or ".join(map(str, count))
            points = " (decimal commas? write points)" if len(found) > max(count) else ""
            raise DataError(f"{which} has {len(found)} numbers; {expected} are needed{points}.")
        return found

    def number(self, *names: str) -> float:
        """The number of a key that is needed."""
        return self.numbers(*names, count=(1,))[0]

    def inside(self, name: str) -> Keys:
        """The mapping that a key holds, to be closed as well; empty if there is no such key."""
        content = self._content.get(name)
        self._left.pop(name, None)
        if content is not None and not isinstance(content, Mapping):
            raise DataError(f"The key '{name}' of {self.where} holds no 'key: value' lines; correct it.")
        return Keys(content or {}, self.where, f"{self._prefix}{name}.")

    def leave(self, *patterns: str, why: str = "says nothing here") -> None:
        """Pass over the keys that are left and fit one of the patterns (as file names do), by name."""
        known = [key for key in self._left if any(fnmatchcase(key, pattern) for pattern in patterns)]
        for key in known:
            del self._left[key]
        if known:
            tell("passed over", f"{', '.join(self._prefix + key for key in known)} ({why})", self.where)


def has_keys(path: Path) -> bool:
    """Whether a file has keys, in YAML, JSON or XML, or is lines of numbers alone."""
    return re.search(r"^[^#\n]*:|^\s*[{<]", text_of(path), re.MULTILINE) is not None


def read_keys(path: Path) -> Keys:
    """The keys of a YAML or JSON file; of OpenCV's FileStorage dialect, too.

    Raises
    ------
    DataError
        If the file is missing, neither YAML nor JSON, has a key twice, or is not a mapping.
    """
    text = text_of(path)
    try:
        if text.lstrip().startswith("<"):
            content: Any = _xml(text)
        elif re.match(r'\s*\{\s*"', text):
            content = json.loads(text, object_pairs_hook=once)
        else:
            content = _yaml(text)
    except (ValueError, RecursionError, yaml.YAMLError, ElementTree.ParseError) as error:
        reason = " ".join(str(error).split())
        if isinstance(error, json.JSONDecodeError) and error.msg == "Extra data":
            reason = "it has one object after the other: give a single one, or poses as lines of numbers"
        said = another_report(text) or f"is not valid YAML, JSON or OpenCV's XML ({reason}); correct it"
        raise DataError(f"The file {path} {said}.") from error
    if not isinstance(content, dict):
        raise DataError(f"The file {path} holds no 'key: value' lines; give it in YAML.")
    return Keys(content, path)


def another_report(text: str) -> str | None:
    """What to say of a file that is another program's text about a calibration; None if it is none known."""
    found = next((said for mark, said in _REPORTS if re.search(mark, text, re.MULTILINE)), None)
    return None if found is None else f"is no calibration that is read: {found}"


def _yaml(text: str) -> Any:
    # All but OpenCV's header and tag is YAML; its own parser writes beyond its memory in broken files.
    body = "\n".join(line for line in text.splitlines() if not line.startswith("%"))
    body = re.sub(r":\t+", ": ", body.replace("!!opencv-matrix", ""))
    parts = [part for part in re.split(r"(?m)^---\s*$", body) if part.strip()]
    if len(parts) < 2:
        return load_yaml(parts[0] if parts else "")
    # 'ros2 topic echo' writes one message after the other.
    first, *others = [load_yaml(part) for part in parts]
    alike = [{**one, "header": None} if isinstance(one, dict) else one for one in (first, *others)]
    if any(one != alike[0] for one in alike):
        raise ValueError("it holds several documents that differ: give one of them")
    return first


def _xml(text: str) -> dict[str, Any]:
    """OpenCV's FileStorage in XML: the keys of its elements, matrices as in its YAML."""
    if "<!" in text:
        raise ValueError("it has declarations")
    root = ElementTree.fromstring(text)
    if root.tag != "opencv_storage":
        raise ValueError(f"it is XML of another kind ('{root.tag}'); save it as OpenCV's, or as YAML")
    return once((child.tag, _xml_value(child)) for child in root)


def _xml_value(element: ElementTree.Element) -> Any:
    inner = {child.tag: (child.text or "").split() for child in element}
    text = (element.text or "").strip()
    return inner or (float(text) if is_number(text) else text.strip('"'))


def text_of(path: Path) -> str:
    """The text of a file; DataError if it cannot be read as such."""
    try:
        return read_text(path)
    except UnicodeDecodeError as error:
        packed = next((kind for head, kind in _PACKED.items() if error.object.startswith(head)), None)
        line = error.object.count(b"\n", 0, error.start) + 1
        why = f"it is packed ({packed}); unpack it" if packed else f"line {line} is not UTF-8; save it so"
        if path.suffix.lower() == ".npz":
            why = _OF_PYTHON.format("arrays of NumPy")
        why = next((said for head, said in _BINARY.items() if error.object.startswith(head)), why)
        raise DataError(f"The file {path} cannot be read as text: {why}.") from error
    except OSError as error:
        why = error.strerror or "no file"
        raise DataError(
            f"The file {path} cannot be read as text ({why}); give an existing text file."
        ) from error


LONGEST_LINE, MOST_COLUMNS = 1 << 14, 100
"""Letters of a line that is one of a table, and columns: a view's pose with two covariances has 80."""


def data_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Line numbers and fields of a text file, which commas, semicolons or blanks part; ``#``: a comment.

    Of a line longer than `LONGEST_LINE` only so much is parted: more fields than any table has, as those of
    the points in COLMAP's files.

    Raises
    ------
    DataError
        If the file cannot be read, its numbers have decimal commas, or a field has no end.
    """
    out = []
    for number, whole in enumerate(text_of(path).splitlines(), start=1):
        line = whole[:LONGEST_LINE].split("#", 1)[0]
        parts = [part for part in re.split(r"[;\s]+", line) if "," in part]
        if parts and all(re.fullmatch(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?", part) for part in parts):
            raise DataError(
                f"Line {number} of {path} has decimal commas ('{parts[0]}'); write numbers with points (or, "
                "if the comma parts two columns, put a blank after it)."
            )
        fields = re.sub(r'[,;"]', " ", line).split()
        if len(whole) > LONGEST_LINE and 0 < len(fields) <= MOST_COLUMNS:
            raise DataError(
                f"Line {number} of {path} has {len(whole)} letters in {len(fields)} columns; no number is so "
                "long: give the file that is meant."
            )
        if fields:
            out.append((number, fields))
    if len(out) > 1 and not any(map(is_number, out[0][1])) and any(map(is_number, out[1][1])):
        tell("passed over", f"line {out[0][0]} (names of columns)", path)
        out = out[1:]
    return out


def leave_columns(rows: Iterable[Sequence[str]], used: int, where: object) -> None:
    """Pass over what stands behind the first so many columns of a table, by name."""
    most = max(map(len, rows), default=0)
    if most > used:
        which = f"column {most}" if most == used + 1 else f"columns {used + 1} to {most}"
        tell("passed over", f"{which} (nothing is read of them)", where)


def _points(value: object) -> str:
    """What to say of a text with a decimal comma."""
    text = value if isinstance(value, str) else ""
    return " (it has a decimal comma: write a point)" if re.search(r"\d,\d", text) else ""


def is_number(text: str) -> bool:
    """Whether a text is a number; "nan" and "inf" are."""
    try:
        float(text)
    except ValueError:
        return False
    return True
