"""Calibrations, lists of images, poses and settings with what parsers choke on."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from collabslam_lab.reliability.attacks.attack import (
    HELD,
    HELD_OR_TOLD,
    READ_OR_REFUSED,
    REFUSED,
    Attack,
    AttackOutcome,
    Deed,
)
from collabslam_lab.reliability.attacks.scene import Scene

Change = Callable[[str], str]
Row = tuple[str, str, Change | bytes, tuple[AttackOutcome, ...]]

ALIASES = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join(['*' + a] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
"""YAML whose last value is 9^9 words."""
OBJECT = "!!python/object/apply:os.system ['touch stolen']\n"


def _sub(old: str, new: str) -> Change:
    def change(text: str) -> str:
        if old not in text:
            raise LookupError(old)
        return text.replace(old, new)

    return change


def _line(number: int, change: Change) -> Change:
    def of_text(text: str) -> str:
        lines = text.splitlines()
        lines[number] = change(lines[number])
        return "\n".join(lines) + "\n"

    return of_text


def _field(number: int, value: str, line: int = 3) -> Change:
    def change(text: str) -> str:
        fields = text.split(",")
        fields[number] = value
        return ",".join(fields)

    return _line(line, change)


def _key(key: str, value: str) -> Change:
    """Another value of a key whose own is on the same line."""
    return lambda text: "\n".join(
        f"{key}: {value}" if line.startswith(f"{key}:") else line for line in text.splitlines()
    )


def _no_turn(text: str) -> str:
    for number in range(4, 8):
        text = _field(number, "0")(text)
    return text


def _reversed(text: str) -> str:
    head, *rows = text.splitlines()
    return "\n".join([head, *reversed(rows)]) + "\n"


def _doubled(text: str) -> str:
    head, *rows = text.splitlines()
    return "\n".join([head, *(row for row in rows for _ in range(2))]) + "\n"


def _one_stamp(text: str) -> str:
    head, *rows = text.splitlines()
    return "\n".join([head, *(f"{rows[0].split(',')[0]},{row.split(',')[1]}" for row in rows)]) + "\n"


def _long(text: str) -> str:
    head, *rows = text.splitlines()
    return "\n".join([head, *(f"{10**15 + i},{rows[0].split(',')[1]}" for i in range(200_000))]) + "\n"


ANY: tuple[Row, ...] = (
    ("empty", "empty", b"", REFUSED),
    ("binary", "random bytes", bytes(range(256)) * 20, REFUSED),
    ("utf16", "UTF-16", lambda text: text.encode("utf-16").decode("latin-1"), READ_OR_REFUSED),
    ("zeros", "a byte 0 in its first line", lambda text: text[:15] + "\0" + text[15:], READ_OR_REFUSED),
)
YAML: tuple[Row, ...] = (
    ("aliases", "aliases that stand for 400 million words", lambda text: ALIASES + text, READ_OR_REFUSED),
    ("nested", "lists nested 3000 deep", b"a: " + b"[" * 3000 + b"]" * 3000, REFUSED),
    ("object", "a tag that makes Python call the shell", lambda text: f"a: {OBJECT}{text}", REFUSED),
    ("list", "a list in place of keys", b"- 1\n- 2\n", REFUSED),
)
CALIBRATION: tuple[Row, ...] = (
    ("nan", "a focal length that is not a number", _key("intrinsics", "[.nan, 620, 359, 239]"), REFUSED),
    ("infinite", "an infinite focal length", _key("intrinsics", "[.inf, 620, 359, 239]"), REFUSED),
    ("zero", "focal length 0", _key("intrinsics", "[0, 620, 359, 239]"), REFUSED),
    ("negative", "a negative focal length", _key("intrinsics", "[-620, 620, 359, 239]"), REFUSED),
    ("enormous", "focal length 1e300", _key("intrinsics", "[1.0e+300, 620, 359, 239]"), REFUSED),
    ("words", "words for numbers", _key("intrinsics", "[six, hundred, and, twenty]"), REFUSED),
    ("three", "three intrinsics", _key("intrinsics", "[620, 620, 359]"), REFUSED),
    ("model", "a model of no camera", _key("camera_model", "pinhole-and-more"), REFUSED),
    ("few", "three coefficients of distortion", _key("distortion_coefficients", "[0.1, 0.1, 0.1]"), REFUSED),
    (
        "folded",
        "a distortion that folds the image",
        _key("distortion_coefficients", "[-5, 0, 0, 0]"),
        (*REFUSED, *HELD_OR_TOLD),
    ),
    ("wide", "10^9 columns", _key("resolution", "[1000000000, 480]"), REFUSED),
    ("swapped", "width and height swapped", _key("resolution", "[480, 720]"), REFUSED),
    ("nothing", "no pixel at all", _key("resolution", "[0, 0]"), REFUSED),
    ("bom", "a byte order mark before it", lambda text: "\ufeff" + text, HELD),
)
IMAGES: tuple[Row, ...] = (
    ("upwards", "a name that leads out of the recording", _field(1, "../../../etc/passwd"), REFUSED),
    ("absolute", "an absolute name", _field(1, "/etc/passwd"), REFUSED),
    ("endless-name", "a name of 5000 letters", _field(1, "a" * 5000 + ".png"), REFUSED),
    ("negative", "a negative stamp", _field(0, "-5"), REFUSED),
    ("digits", "a stamp of 5000 digits", _field(0, "9" * 5000), REFUSED),
    ("no-number", "a stamp that is not a number", _field(0, "nan"), REFUSED),
    ("repeated", "a stamp that comes twice", lambda t: _line(4, lambda row: t.splitlines()[3].split(",")[0]
     + "," + row.split(",")[1])(t), HELD),
    ("ahead", "a last stamp 1000 s ahead", lambda t: _field(0, "1000000000000", -1)(t), HELD),
    ("reversed", "the frames backwards", _reversed, READ_OR_REFUSED),
    ("doubled", "every frame twice", _doubled, READ_OR_REFUSED),
    ("standing", "one stamp for all", _one_stamp, READ_OR_REFUSED),
    ("one-column", "no names", lambda t: "\n".join(line.split(",")[0] for line in t.splitlines()), REFUSED),
    ("long", "200 000 frames, all of one image", _long, READ_OR_REFUSED),
    ("lines", "lines that end as in Windows", lambda t: t.replace("\n", "\r\n"), HELD),
)  # fmt: skip
RELATIVE: tuple[Row, ...] = (
    ("nan", "a T_CF that is not a number", _field(1, "nan"), HELD),
    ("far", "a T_CF of 1e300 m", _field(1, "1e300"), REFUSED),
    ("no-turn", "a quaternion of zeros", _no_turn, REFUSED),
    ("long-turn", "a quaternion of length 2", _field(4, "2"), REFUSED),
    ("negative", "a negative variance", _field(8, "-1"), REFUSED),
    ("enormous", "a variance of 1e300", _field(8, "1e300"), REFUSED),
    ("exact", "a variance of 0", _field(8, "0"), (*REFUSED, *HELD_OR_TOLD)),
    ("endless-line", "15 million columns", _line(3, lambda row: row + ",0" * 15_000_000), REFUSED),
    ("columns", "a column missing", _line(3, lambda row: row.rsplit(",", 1)[0]), REFUSED),
)  # fmt: skip
TRUTH: tuple[Row, ...] = (
    ("nan", "a true pose that is not a number", _field(1, "nan"), READ_OR_REFUSED),
    ("far", "a true pose at 1e300 m", _field(1, "1e300"), REFUSED),
    ("no-turn", "a quaternion of zeros", _no_turn, REFUSED),
    ("elsewhere", "true poses of other stamps", lambda t: "\n".join(
        line if line[0] == "#" else f"9{line}" for line in t.splitlines()), READ_OR_REFUSED),
)  # fmt: skip
SETTINGS: tuple[tuple[str, str, str, tuple[AttackOutcome, ...]], ...] = (
    ("unknown", "an unknown name", "filter: {pixel: {sigma_sc: 1.0}}\n", REFUSED),
    ("kind", "a word for a number", "filter: {map: {in_view: many}}\n", REFUSED),
    ("nan", "a setting that is not a number", "filter: {pixel: {sigma_cs: .nan}}\n", REFUSED),
    ("infinite", "an infinite setting", "filter: {pixel: {sigma_cs: .inf}}\n", REFUSED),
    ("negative", "a negative deviation", "filter: {pixel: {sigma_cs: -1.0}}\n", REFUSED),
    ("enormous", "10^18 features in view", "filter: {map: {in_view: 1000000000000000000}}\n", REFUSED),
    ("object", "a tag that makes Python call the shell", f"filter: {OBJECT}", REFUSED),
    ("aliases", "aliases that stand for 400 million words", ALIASES, REFUSED),
    ("nested", "mappings nested 3000 deep", "{a: " * 3000, REFUSED),
    ("nothing", "an empty file", "", READ_OR_REFUSED),
    ("list", "a list", "- 1\n", REFUSED),
    ("digits", "a number of 5000 digits", f"filter: {{map: {{in_view: {'9' * 5000}}}}}\n", REFUSED),
)
WORDS = (
    ("set-unknown", "an unknown name in --set", "pixel.nothing=1"),
    ("set-bare", "--set without a value", "filter.pixel.sigma_cs"),
    ("set-overflow", "--set to 1e999", "filter.pixel.sigma_cs=1e999"),
    ("set-object", "--set to a tag", "filter.pixel.sigma_cs=!!python/object/apply:os.abort []"),
)


def _sparse(path: Path) -> None:
    path.touch()
    os.truncate(path, 5_000_000_000)


SPECIAL: tuple[tuple[str, str, Callable[[Path], object]], ...] = (
    ("gone", "missing", lambda path: None),
    ("folder", "a folder", Path.mkdir),
    ("pipe", "a pipe that nobody writes to", os.mkfifo),
    ("device", "a link to /dev/zero", lambda path: path.symlink_to("/dev/zero")),
    ("sparse", "5 GB", _sparse),
)


def _spoilt(group: str, which: str, words: str, row: Row) -> Attack:
    name, what, change, good = row

    def make(scene: Scene) -> Deed:
        walk = scene.copy("short")
        path = walk / which
        data = (
            change if isinstance(change, bytes) else _encoded(change(path.read_text(encoding="utf-8")), name)
        )
        path.write_bytes(data)
        return scene.run(source=walk)

    return Attack(group, name, f"{words}: {what}", make, good)


def _encoded(text: str, name: str) -> bytes:
    return text.encode("latin-1" if name == "utf16" else "utf-8")


def _placed(place: tuple[str, str, Callable[[Path], object]]) -> Attack:
    name, what, put = place

    def make(scene: Scene) -> Deed:
        path = scene.copy("short") / "cam0" / "sensor.yaml"
        path.unlink()
        put(path)
        return scene.run(source=path.parents[1])

    return Attack("calibration", name, f"calibration of Cs: {what}", make)


def _settings(row: tuple[str, str, str, tuple[AttackOutcome, ...]]) -> Attack:
    name, what, text, good = row

    def make(scene: Scene) -> Deed:
        path = scene.folder / "settings.yaml"
        path.write_text(text, encoding="utf-8")
        return scene.run("--config", path)

    return Attack("settings", name, f"a settings file: {what}", make, good)


def _special_settings(place: tuple[str, str, Callable[[Path], object]]) -> Attack:
    def make(scene: Scene) -> Deed:
        place[2](scene.folder / "settings.yaml")
        return scene.run("--config", scene.folder / "settings.yaml")

    return Attack("settings", place[0], f"a settings file: {place[1]}", make, REFUSED, "settings.yaml")


def _attacks() -> Iterator[Attack]:
    files = (
        ("calibration", "cam0/sensor.yaml", "calibration of Cs", (*ANY, *YAML, *CALIBRATION)),
        ("list", "cam0/data.csv", "list of images", (*ANY, *IMAGES)),
        ("relative pose", "relpose/data.csv", "measured T_CF", (*ANY[1:], *RELATIVE)),
        ("truth", "groundtruth/data.csv", "true poses", (*ANY[1:], *TRUTH)),
    )
    for group, which, words, rows in files:
        yield from (_spoilt(group, which, words, row) for row in rows)
    yield from (_placed(place) for place in SPECIAL)
    yield from (_settings(row) for row in SETTINGS)
    yield from (_special_settings(place) for place in SPECIAL)
    for name, what, word in WORDS:
        yield Attack("settings", name, what, lambda scene, word=word: scene.run("--set", word))  # type: ignore[misc]


ATTACKS = tuple(_attacks())
