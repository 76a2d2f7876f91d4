"""Forged bags: indexes that name other files; tables, records and message types that are traps."""

from __future__ import annotations

import os
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np

from collabslam.datasets import open_recording
from collabslam.datasets.ros.writer import write_bag
from collabslam.live import messages
from collabslam_lab.reliability.attacks.attack import READ_OR_REFUSED, Attack, AttackOutcome, Deed
from collabslam_lab.reliability.attacks.bags import IMAGE, ROLES
from collabslam_lab.reliability.attacks.scene import Scene

ANY = (*READ_OR_REFUSED, AttackOutcome.TOLD)
_U64, _U32, _U16 = struct.Struct("<Q"), struct.Struct("<I"), struct.Struct("<H")
MAGIC = b"\x89MCAP0\r\n"


def _told(files: str, more: str = "") -> Callable[[Path], object]:
    """An index that names such files."""
    text = (
        "rosbag2_bagfile_information: {version: 5, storage_identifier: mcap, duration: {nanoseconds: 1}, "
        "starting_time: {nanoseconds_since_epoch: 0}, message_count: 9, compression_format: '', "
        f"compression_mode: '', topics_with_message_count: [], relative_file_paths: [{files}]{more}}}\n"
    )
    return lambda bag: (bag / "metadata.yaml").write_text(text)


def _changed(before: str, after: str) -> Callable[[Path], object]:
    def change(bag: Path) -> None:
        _told("bag.mcap")(bag)
        path = bag / "metadata.yaml"
        path.write_text(path.read_text().replace(before, after))

    return change


def _pipe(bag: Path) -> None:
    os.mkfifo(bag.parent / "pipe")
    _told("../pipe")(bag)


def _above(bag: Path) -> None:
    (bag / "bag.mcap").rename(bag.parent / "other.mcap")
    _told("../other.mcap")(bag)


def _indexed(name: str, what: str, change: Callable[[Path], object]) -> Attack:
    def make(scene: Scene) -> Deed:
        bag = scene.copy("bag")
        change(bag)
        return scene.run("--topics", ROLES, source=bag)

    return Attack("bag", name, f"metadata.yaml {what}", make, ANY)


INDEXED = (
    _indexed("index-above", "names a bag outside its folder", _above),
    _indexed("index-passwords", "names /etc/passwd", _told("/etc/passwd")),
    _indexed("index-device", "names /dev/zero", _told("/dev/zero")),
    _indexed("index-pipe", "names a pipe that nobody writes to", _pipe),
    _indexed("index-terminal", "names /dev/stdin", _told("/dev/stdin")),
    _indexed("index-itself", "names itself", _told("metadata.yaml")),
    _indexed("index-folder", "names its folder", _told(".")),
    _indexed("index-thousand", "names one file a thousand times", _told(", ".join(["bag.mcap"] * 1000))),
    _indexed("index-hundred-thousand", "names 100 000 files",
             _told(", ".join(f"{k}.mcap" for k in range(100_000)))),
    _indexed("index-empty-name", "names nothing", _told("''")),
    _indexed("index-numbers", "names numbers", _told("1, 2.5, null, [a], {b: c}")),
    _indexed("index-zero-byte", "names what no file can be called", _told('"a\\0b.mcap"')),
    _indexed("index-code", "asks for a program", _told("!!python/object/apply:os.system [touch pwned]")),
    _indexed("index-twice", "tells its version twice", _told("bag.mcap", ", version: 99")),
    _indexed("index-version", "is of version 99", _changed("version: 5", "version: 99")),
    _indexed("index-duration", "tells a duration that is no number",
             _changed("nanoseconds: 1", "nanoseconds: .nan")),
    _indexed("index-count", "tells 10^30 messages", _changed("message_count: 9", f"message_count: {10**30}")),
    _indexed("index-deep", "is 10 000 levels deep",
             _told("bag.mcap", ", custom_data: " + "[" * 10_000 + "]" * 10_000)),
)  # fmt: skip


_UNCHECKED = tuple(
    statement
    for table in ("topics", "messages")
    for statement in (
        f"CREATE TABLE copied AS SELECT * FROM {table}",
        f"DROP TABLE {table}",
        f"ALTER TABLE copied RENAME TO {table}",
    )
)
"""Tables in which anything may stand."""


def _database(name: str, what: str, *statements: str) -> Attack:
    def make(scene: Scene) -> Deed:
        bag = scene.folder / "walk"
        write_bag(open_recording(scene.ground.short), bag, storage="sqlite3")
        with closing(sqlite3.connect(bag / "walk.db3")) as database, database:
            for statement in (*_UNCHECKED, *statements):
                database.execute(statement)
        return scene.run("--topics", ROLES, source=bag)

    return Attack("bag", name, f"a database {what}", make, ANY)


def _journal(scene: Scene) -> Deed:
    """What a writer that was killed leaves: SQLite itself would write the pages of it into the bag."""
    bag = scene.folder / "walk"
    write_bag(open_recording(scene.ground.short), bag, storage="sqlite3")
    page = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7" + struct.pack(">IIIII", 1, 0, 9, 512, 4096)
    (bag / "walk.db3-journal").write_bytes(page.ljust(512, b"\0") + struct.pack(">I", 1) + bytes(4100))
    return scene.run("--topics", ROLES, source=bag)


def _name(scene: Scene) -> Deed:
    """A name that is an address with options to SQLite."""
    bag = scene.folder / "walk"
    write_bag(open_recording(scene.ground.short), bag, storage="sqlite3")
    odd = scene.folder / "file:x?mode=rwc&vfs=unix#%00.db3"
    (bag / "walk.db3").rename(odd)
    return scene.run("--topics", ROLES, source=odd)


DATABASES = (
    _database("null-data", "whose messages are NULL", "UPDATE messages SET data = NULL"),
    _database("text-data", "whose messages are text", "UPDATE messages SET data = 'x'"),
    _database("number-data", "whose messages are numbers", "UPDATE messages SET data = 7"),
    _database("orphans", "of messages of no topic", "UPDATE messages SET topic_id = 99"),
    _database("null-name", "whose topics have no name", "UPDATE topics SET name = NULL"),
    _database("number-name", "whose topics are called 7", "UPDATE topics SET name = 7"),
    _database("null-type", "whose topics have no type", "UPDATE topics SET type = NULL"),
    _database("path-type", "whose types are paths", "UPDATE topics SET type = '../../etc/msg/passwd'"),
    _database("line-type", "whose types have lines", "UPDATE topics SET type = 'a/msg/b' || char(10) || 'c'"),
    _database("far-times", "whose times are 2^63", "UPDATE messages SET timestamp = 9223372036854775807"),
    _database("negative-times", "whose times are negative", "UPDATE messages SET timestamp = -timestamp"),
    _database("real-times", "whose times are 1e300", "UPDATE messages SET timestamp = 1e300"),
    _database("many-topics", "of 50 000 topics", "INSERT INTO topics (name, type, serialization_format, "
              "offered_qos_profiles, type_description_hash) WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL "
              "SELECT i + 1 FROM n WHERE i < 50000) SELECT '/t' || i, 'std_msgs/msg/String', 'cdr', '', '' "
              "FROM n"),
    _database("trigger", "with a trigger",
              "CREATE TRIGGER t AFTER INSERT ON messages BEGIN DELETE FROM messages; END"),
    _database("no-index", "whose schema lies", "PRAGMA writable_schema = 1",
              "UPDATE sqlite_master SET rootpage = 1 WHERE name = 'messages'"),
    Attack("bag", "journal", "a database with the journal of a writer that was killed", _journal, ANY),
    Attack("bag", "options-name", "a database whose name is an address with options", _name, ANY),
)  # fmt: skip


def _text(value: bytes) -> bytes:
    return _U32.pack(len(value)) + value


def _record(kind: int, data: bytes, length: int | None = None) -> bytes:
    return bytes([kind]) + _U64.pack(len(data) if length is None else length) + data


def _schema(definition: bytes, number: int = 1, kind: bytes = IMAGE.encode()) -> bytes:
    return _record(3, _U16.pack(number) + _text(kind) + _text(b"ros2msg") + _text(definition))


def _channel(
    number: int = 1, schema: int = 1, topic: bytes = b"/cs/image_raw", more: bytes = _U32.pack(0)
) -> bytes:
    return _record(4, _U16.pack(number) + _U16.pack(schema) + _text(topic) + _text(b"cdr") + more)


def _said(data: bytes, channel: int = 1, at: int = 1) -> bytes:
    return _record(5, _U16.pack(channel) + _U32.pack(0) + _U64.pack(at) + _U64.pack(at) + data)


def _chunk(inner: bytes, kind: bytes = b"", size: int | None = None, length: int | None = None) -> bytes:
    size = len(inner) if size is None else size
    told = _U64.pack(len(inner) if length is None else length)
    return _record(
        6, _U64.pack(1) + _U64.pack(1) + _U64.pack(size) + _U32.pack(0) + _text(kind) + told + inner
    )


HEADER, END = _record(1, _text(b"ros2") + _text(b"x")), _record(15, _U32.pack(0))
ALMOST = b"uint8[] data\n"
"""Another type under the name of Image."""


def _image_type() -> bytes:
    return str(messages.store().generate_msgdef(IMAGE, ros_version=2)[0]).encode()


def _body() -> bytes:
    """A topic of images as it should be."""
    image = messages.raw_image(1.0, "cs", np.zeros((24, 32), np.uint8))
    return _schema(_image_type()) + _channel() + b"".join(_said(image, at=k) for k in range(1, 4))


def _mcap(*records: bytes, summary: int = 0, ends: bool = True) -> bytes:
    foot = _record(2, _U64.pack(summary) + _U64.pack(0) + _U32.pack(0))
    return MAGIC + HEADER + b"".join(records) + (END + foot + MAGIC if ends else b"")


def _typed(definition: bytes, data: bytes = b"\0\1\0\0" + bytes(64)) -> bytes:
    """Images of that type."""
    return _mcap(_schema(definition), _channel(), _said(data))


def _saying(data: bytes) -> bytes:
    """Images that are these bytes."""
    return _mcap(_schema(_image_type()), _channel(), _said(data))


def _deep(levels: int) -> bytes:
    inner = _body()
    for _ in range(levels):
        inner = _chunk(inner)
    return inner


def _many(each: Callable[[int], bytes]) -> bytes:
    return _mcap(_body(), b"".join(map(each, range(2, 60_000))))


def _nested(levels: int) -> bytes:
    """Types of which each holds eighteen of the next."""
    parts = [b"x/T0 a\n"]
    for k in range(levels):
        below = b"uint8" if k == levels - 1 else b"x/T%d" % (k + 1)
        parts.append(b"=" * 80 + b"\nMSG: x/T%d\n%s[9] a\n%s[9] b\n" % (k, below, below))
    return b"".join(parts)


ITSELF = b"sensor_msgs/Image a\n" + b"=" * 80 + b"\nMSG: sensor_msgs/Image\nsensor_msgs/Image a\n"
RECORDS: dict[str, tuple[str, Callable[[], bytes]]] = {
    "magic": ("its first bytes alone", lambda: MAGIC),
    "no-end": ("without an end", lambda: _mcap(_body(), ends=False)),
    "summary-itself": ("a summary that is its beginning", lambda: _mcap(_body(), summary=8)),
    "summary-beyond": ("a summary behind its end", lambda: _mcap(_body(), summary=1 << 62)),
    "record-endless": ("a record of 2^63 bytes", lambda: _mcap(_body(), _record(5, b"", 1 << 63))),
    "records-unknown": (
        "300 000 records that nobody knows", lambda: _mcap(_body(), _record(99, b"") * 300_000)),
    "chunk-size": ("a chunk that promises 2^62 bytes", lambda: _mcap(_chunk(_body(), size=1 << 62))),
    "chunk-length": ("a chunk of 2^62 bytes", lambda: _mcap(_chunk(_body(), length=1 << 62))),
    "chunk-kind": ("a chunk packed by nobody", lambda: _mcap(_chunk(_body(), b"secret9"))),
    "chunk-zstd": ("a chunk of zstd that is none", lambda: _mcap(_chunk(_body(), b"zstd"))),
    "chunk-lz4": ("a chunk of lz4 that is none", lambda: _mcap(_chunk(_body(), b"lz4"))),
    "chunk-in-chunk": ("chunks in chunks, 500 deep", lambda: _mcap(_deep(500))),
    "attachment": ("an attachment of 2^62 bytes", lambda: _mcap(
        _body(), _record(9, _U64.pack(0) * 2 + _text(b"x") + _text(b"y") + _U64.pack(1 << 62)))),
    "two-beginnings": ("two beginnings", lambda: _mcap(HEADER, _body(), MAGIC + HEADER, _body())),
    "channels-many": ("60 000 topics", lambda: _many(lambda k: _channel(k, topic=b"/t%d" % k))),
    "channel-twice": ("one topic's number for another", lambda: _mcap(_body(), _channel(topic=b"/other"))),
    "channel-none": ("messages of no topic", lambda: _mcap(_body(), _said(b"\0\1\0\0", 77))),
    "channel-name": ("a topic of a million letters", lambda: _mcap(
        _schema(_image_type()), _channel(topic=b"/" + b"x" * 1_000_000), _said(b"\0\1\0\0"))),
    "channel-lines": ("a topic of lines and bells", lambda: _mcap(
        _schema(_image_type()), _channel(topic=b"/a\n\x1b[2J\a"), _said(b"\0\1\0\0"))),
}  # fmt: skip
TYPES: dict[str, tuple[str, Callable[[], bytes]]] = {
    "almost": ("images without a format", lambda: _typed(ALMOST)),
    "itself": ("a type that holds itself", lambda: _typed(ITSELF)),
    "nested": ("types of 18^60 numbers", lambda: _typed(_nested(60))),
    "long": ("a type of 300 000 fields", lambda: _typed(
        b"".join(b"uint8 a%d\n" % k for k in range(300_000)))),
    "array": ("an array of 2^40 numbers", lambda: _typed(b"uint8[1099511627776] data\n")),
    "code": ("a field that is a program", lambda: _typed(
        b"uint8 a=__import__('os').system('touch pwned')\n")),
    "word": ("fields called as Python's own", lambda: _typed(b"uint8 import\nuint8 __class__\n")),
    "words": ("a height that is a word", lambda: _typed(
        _image_type().replace(b"uint32 height", b"string height"))),
    "bytes": ("a type that is no text", lambda: _typed(b"\xff\xfe\0\n")),
    "none": ("a topic of no type", lambda: _mcap(_channel(schema=9), _said(b"\0\1\0\0"))),
    "many": ("60 000 types", lambda: _many(lambda k: _schema(ALMOST, k, b"x/msg/T%d" % k))),
    "all-long": ("1000 topics of types of 60 kB each", lambda: _mcap(_body(), b"".join(
        _schema(b"uint8 a%d\n" % k + b"# x\n" * 15_000, k, b"x/msg/T%d" % k) + _channel(k, k, b"/t%d" % k)
        for k in range(2, 1000)))),
    "data-none": ("messages without a byte", lambda: _saying(b"")),
    "data-order": ("an order of bytes that there is not", lambda: _saying(b"\0\x77\0\0abcd")),
    "data-length": ("a text of 2^32 bytes", lambda: _saying(b"\0\1\0\0" + bytes(8) + b"\xff" * 4)),
}  # fmt: skip


def _forged(name: str, what: str, content: Callable[[], bytes]) -> Attack:
    def make(scene: Scene) -> Deed:
        path = scene.folder / "walk.mcap"
        path.write_bytes(content())
        alone = ("--start", "scale-free", "--mode", "mono")
        return scene.run("--topics", "cs=/cs/image_raw", *alone, source=path)

    return Attack("bag", name, f"an MCAP: {what}", make, READ_OR_REFUSED)


FORGED = tuple(
    _forged(f"{kind}-{name}", what, content)
    for kind, rows in (("mcap", RECORDS), ("type", TYPES))
    for name, (what, content) in rows.items()
)
ATTACKS = (*INDEXED, *DATABASES, *FORGED)
