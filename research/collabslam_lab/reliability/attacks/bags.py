"""ROS bags that are broken, that unpack without end, or whose messages lie."""

from __future__ import annotations

import bz2
import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from collabslam.datasets import open_recording
from collabslam.datasets.ros.writer import TOPICS, write_bag
from collabslam_lab.reliability.attacks.attack import READ_OR_REFUSED, REFUSED, Attack, AttackOutcome, Deed
from collabslam_lab.reliability.attacks.scene import Scene
from collabslam_lab.reliability.attacks.text_files import ALIASES

ROLES = ",".join(f"{role}={topic}" for role, topic in TOPICS.items())
STORE = get_typestore(Stores.ROS2_HUMBLE)
IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
BOMB = 2 << 30


def _spoil(
    name: str, what: str, change: Callable[[Path], object], good: tuple[AttackOutcome, ...] = REFUSED
) -> Attack:
    def make(scene: Scene) -> Deed:
        bag = scene.copy("bag")
        change(bag)
        return scene.run("--topics", ROLES, source=bag)

    return Attack("bag", name, f"a bag: {what}", make, good)


def _cut(path: Path, share: float) -> None:
    os.truncate(path, int(path.stat().st_size * share))


def _scrambled(path: Path) -> None:
    data = bytearray(path.read_bytes())
    noise = np.random.default_rng(1)
    for at in noise.integers(200, len(data) - 200, 50):
        data[at] ^= 255
    path.write_bytes(data)


def _packed(bag: Path) -> None:
    """The bag as rosbag2 compresses whole files, its content two gigabytes of nothing."""
    zstd = import_module("rosbags.rosbag2.reader").zstd
    with zstd.open(bag / "bag.mcap.zstd", "wb") as stream:
        for _ in range(BOMB >> 20):
            stream.write(bytes(1 << 20))
    (bag / "bag.mcap").unlink()
    text = (bag / "metadata.yaml").read_text()
    text = text.replace("compression_format: ''", "compression_format: zstd")
    text = text.replace("compression_mode: ''", "compression_mode: FILE").replace("bag.mcap", "bag.mcap.zstd")
    (bag / "metadata.yaml").write_text(text)


def _old_bag(scene: Scene) -> Deed:
    """A ROS 1 bag whose chunk unpacks to two gigabytes."""
    packed = bz2.compress(bytes(1 << 20)) * (BOMB >> 20)
    path = scene.folder / "old.bag"
    fields = {b"compression": b"bz2", b"op": b"\x05", b"size": BOMB.to_bytes(8, "little")[:4]}
    head = {b"op": b"\x03", b"index_pos": bytes(8), b"conn_count": bytes(4), b"chunk_count": b"\x01\0\0\0"}
    content = b"#ROSBAG V2.0\n" + _record(head, b" " * 4000) + _record(fields, packed)
    path.write_bytes(content)
    return scene.run("--topics", ROLES, source=path)


def _record(fields: dict[bytes, bytes], data: bytes) -> bytes:
    parts = [key + b"=" + value for key, value in fields.items()]
    head = b"".join(len(part).to_bytes(4, "little") + part for part in parts)
    return len(head).to_bytes(4, "little") + head + len(data).to_bytes(4, "little") + data


def _database(scene: Scene) -> Deed:
    bag = scene.folder / "walk"
    bag.mkdir()
    sqlite3.connect(bag / "walk.db3").execute("create table topics (id, name)").connection.close()
    (bag / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {version: 5, relative_file_paths: [walk.db3]}\n"
    )
    return scene.run("--topics", ROLES, source=bag)


_ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT"


def _computed(table: str, column: str, by: str) -> tuple[str, ...]:
    """A table in which one column is computed when it is read."""
    return (
        f"ALTER TABLE {table} RENAME TO before",
        f"CREATE TABLE {table} AS SELECT * FROM before",
        f"ALTER TABLE {table} DROP COLUMN {column}",
        f"ALTER TABLE {table} ADD COLUMN {column} GENERATED ALWAYS AS ({by}) VIRTUAL",
    )


COMPUTED: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("endless-view", "a version that is counted without end", ("DROP TABLE schema",
     f"CREATE VIEW schema AS {_ENDLESS} count(*) AS schema_version FROM n")),
    ("endless-rows", "types of messages without end", ("DROP TABLE message_definitions",
     f"CREATE VIEW message_definitions AS {_ENDLESS} i AS id, 'a' AS topic_type, 'ros2msg' AS encoding,"
     " 'int8 a' AS encoded_message_definition, '' AS type_description_hash FROM n")),
    ("computed-data", "messages of 260 MB that are computed",
     _computed("messages", "data", "zeroblob(260000000)")),
    ("computed-names", "names of topics of 800 MB that are computed",
     _computed("topics", "name", "hex(zeroblob(400000000))")),
)  # fmt: skip


def spoil_database(path: Path, statements: tuple[str, ...]) -> None:
    """Has a SQLite bag's file compute what is read of it."""
    with closing(sqlite3.connect(path)) as database, database:
        for statement in statements:
            database.execute(statement)


def _computing(name: str, what: str, statements: tuple[str, ...]) -> Attack:
    def make(scene: Scene) -> Deed:
        bag = scene.folder / "walk"
        write_bag(open_recording(scene.ground.short), bag, storage="sqlite3")
        spoil_database(bag / "walk.db3", statements)
        return scene.run("--topics", ROLES, source=bag)

    return Attack("bag", name, f"a database: {what}", make, REFUSED, "cannot be read")


def _message(
    name: str,
    what: str,
    image: dict[str, Any],
    info: dict[str, Any] | None = None,
    good: tuple[AttackOutcome, ...] = REFUSED,
) -> Attack:
    """A bag of one's own whose messages say what they should not."""

    def make(scene: Scene) -> Deed:
        header_type, time_type = (
            STORE.types[k] for k in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
        )
        grey = np.random.default_rng(0).integers(0, 255, 32 * 24).astype(np.uint8)
        with Writer(scene.folder / "walk", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topics = {kind: writer.add_connection(topic, kind, typestore=STORE)
                      for topic, kind in (("/cs/camera_info", INFO), ("/cs/image_raw", IMAGE))}  # fmt: skip
            for k in range(6):
                stamp = 10**18 + 10**8 * k
                header = header_type(time_type(10**9, 10**8 * k), "cs")
                k_matrix = np.array([30.0, 0, 15.5, 0, 30.0, 11.5, 0, 0, 1.0])
                region = STORE.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
                told = {"height": 24, "width": 32, "distortion_model": "plumb_bob", "d": np.zeros(5),
                        "k": k_matrix, "r": np.eye(3).ravel(), "p": np.zeros(12), "binning_x": 0,
                        "binning_y": 0, "roi": region, **(info or {})}  # fmt: skip
                shown = {"height": 24, "width": 32, "encoding": "mono8", "is_bigendian": 0, "step": 32,
                         "data": grey, **image}  # fmt: skip
                for kind, content in ((INFO, told), (IMAGE, shown)):
                    message = STORE.types[kind](header, **content)
                    writer.write(topics[kind], stamp, STORE.serialize_cdr(message, kind))
        return scene.run("--start", "scale-free", "--mode", "mono", source=scene.folder / "walk")

    return Attack("bag", name, f"messages of a bag: {what}", make, good)


ATTACKS = (
    _spoil("no-metadata", "metadata.yaml is gone", lambda bag: (bag / "metadata.yaml").unlink(),
            READ_OR_REFUSED),
    _spoil("metadata", "metadata.yaml is empty", lambda bag: (bag / "metadata.yaml").write_text("")),
    _spoil("aliases", "metadata.yaml has aliases that stand for 400 million words",
           lambda bag: (bag / "metadata.yaml").write_text(ALIASES)),
    _spoil("gone", "its file is gone", lambda bag: (bag / "bag.mcap").unlink()),
    _spoil("cut", "its file is cut off", lambda bag: _cut(bag / "bag.mcap", 0.5)),
    _spoil("empty", "its file is empty", lambda bag: _cut(bag / "bag.mcap", 0.0)),
    _spoil("scrambled", "fifty bytes turned over", lambda bag: _scrambled(bag / "bag.mcap"),
           (*READ_OR_REFUSED, AttackOutcome.TOLD)),
    _spoil("zstd", "2 GB of zeros in some kilobytes of zstd", _packed),
    Attack("bag", "bz2", "a ROS 1 bag with 2 GB of zeros in a chunk of bz2", _old_bag),
    Attack("bag", "database", "a database that is not a bag", _database),
    *(_computing(*row) for row in COMPUTED),
    Attack("bag", "topics", "a role that there is not", lambda scene: scene.run(
        "--topics", "eye=/cs/image_raw", source=scene.ground.bag), REFUSED, "eye"),
    Attack("bag", "topic", "a topic that there is not", lambda scene: scene.run(
        "--topics", "cs=/nowhere", source=scene.ground.bag), REFUSED, "/nowhere"),
    _message("wide", "images of 2^31 columns", {"width": 1 << 31}),
    _message("short", "images with half of their pixels", {"data": np.zeros(300, np.uint8)}),
    _message("step", "rows of no length", {"step": 0}, good=(*READ_OR_REFUSED, AttackOutcome.TOLD)),
    _message("encoding", "pixels of an unknown kind", {"encoding": "secret9"}),
    _message("no-lens", "a calibration of zeros", {}, {"k": np.zeros(9)}),
    _message("lens-nan", "a calibration that is not a number", {}, {"k": np.full(9, np.nan)}),
    _message("lens-model", "a distortion that there is not", {}, {"distortion_model": "bottle"}),
    _message("lens-size", "a calibration for another size", {}, {"width": 64}),
)  # fmt: skip
