"""ROS 1 and ROS 2 bags (``.bag``, sqlite3, MCAP), without ROS; needs the extra ``ros``."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.deep_range import SAMPLED, common_range
from collabslam.datasets.gate import tell
from collabslam.datasets.image_names import natural
from collabslam.datasets.mosaic import LOOKED_AT, MOSAIC_TOLD, mosaic_of
from collabslam.datasets.ros import messages as m
from collabslam.datasets.ros.bounded import bound_databases, bound_decompression, leave_qos_alone
from collabslam.datasets.ros.cut_mcap import as_far_as_whole
from collabslam.datasets.ros.definitions import bound_definitions, check_fields
from collabslam.datasets.ros.transform_tree import TransformTree
from collabslam.errors import DataError
from collabslam.extras import needs
from collabslam.formats.files import require_regular
from collabslam.geometry import pose_inverse
from collabslam.types import Array, Image

SUFFIXES = (".bag", ".mcap", ".db3")
IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA_TYPE = "sensor_msgs/msg/CameraInfo"
POSE_TYPES = ("geometry_msgs/msg/PoseWithCovarianceStamped", "nav_msgs/msg/Odometry")
TRUTH_TYPES = (
    *POSE_TYPES,
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
)
TF_TYPE = "tf2_msgs/msg/TFMessage"
_TF_TYPES = (TF_TYPE, "tf/msg/tfMessage")
SCAN_TYPE, IMU_TYPE = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Imu"
TWIST_TYPES = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped")
_READ = (*IMAGE_TYPES, CAMERA_TYPE, *TRUTH_TYPES, *_TF_TYPES, SCAN_TYPE, IMU_TYPE, *TWIST_TYPES)
LATEST = 1 << 62
"""Nanoseconds before which messages are recorded: 2116."""
_LISTED, _SHOWN = 40, 300
"""Topics that a message names, and characters of a name, or of what rosbags says."""


_LARGEST_METADATA = 1 << 21
"""Bytes of a ``metadata.yaml``: a thousand topics have a quarter of it."""
_MEND_FOLDER = "'ros2 bag reindex' mends its metadata"
_MEND = {
    ".bag": "'rosbag reindex' mends what can be mended",
    ".mcap": "'mcap recover' mends what can be mended",
    ".db3": "'sqlite3 FILE .recover' mends what can be mended",
}
"""What to do about a broken file of each kind."""


class Topic(NamedTuple):
    """What a bag holds of one topic: its name, the type and the number of its messages."""

    name: str
    type: str
    messages: int


def shorter(said: object) -> str:
    """What somebody else says, as far as a sentence can hold it."""
    text = str(said)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


def is_bag(path: Path) -> bool:
    """Whether ``path`` is a bag: a file with a bag's ending, or a folder of such files."""
    return path.suffix in SUFFIXES if path.is_file() else path.is_dir() and bool(_files(path))


def _files(folder: Path) -> list[Path]:
    """The folder itself if it says what it holds; else the files of a bag in it, all of one kind."""
    if (folder / "metadata.yaml").is_file():
        return [folder]
    found = sorted((p for p in folder.iterdir() if p.suffix in SUFFIXES), key=natural)
    return found if len({p.suffix for p in found}) == 1 else []


class Bag:
    """A bag, open for reading until it is closed or no longer used; a context manager too.

    Parameters
    ----------
    path : Path
        A ``.bag``, ``.mcap`` or ``.db3`` file, or a folder of them, with ``metadata.yaml`` or without.  An
        MCAP file that is cut is read as far as it is whole.

    Raises
    ------
    DataError
        If it is not a bag or broken, or the extra ``ros`` is not installed.  Methods raise it where a topic
        is missing, empty or of another type, naming the topics that there are.
    """

    def __init__(self, path: Path) -> None:
        with needs("ros"):
            from rosbags.highlevel import AnyReader
        self.path = path
        for file in path.iterdir() if path.is_dir() else [path]:
            require_regular(file)
        bound_decompression()
        bound_databases()
        leave_qos_alone()
        bound_definitions()
        told = path / "metadata.yaml"
        if told.is_file() and told.stat().st_size > _LARGEST_METADATA:
            raise DataError(
                f"{told} has {told.stat().st_size >> 20} MB, which no bag needs; take it away, or give one "
                "of the bag's files."
            )
        paths = [as_far_as_whole(p) for p in (_files(path) if path.is_dir() else [path])]
        kind = paths[0].suffix if paths else path.suffix
        store = _typestore("ROS1_NOETIC" if kind == ".bag" else "ROS2_HUMBLE")
        try:
            self._reader = AnyReader(paths, default_typestore=store)
            self._reader.open()
            self._close = weakref.finalize(self, self._reader.close)
            check_fields(self._reader.typestore.fielddefs, store.fielddefs, _READ)
        except Exception as error:  # rosbags raises many kinds for broken files
            raise DataError(
                f"The bag {path} cannot be read ({shorter(error)}); {_MEND.get(kind, _MEND_FOLDER)}."
            ) from error

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        self._close()

    @property
    def topics(self) -> list[Topic]:
        """Every topic, by name."""
        found = self._reader.topics.items()
        return sorted(Topic(name, info.msgtype or "several types", info.msgcount) for name, info in found)

    def of_type(self, *types: str) -> list[Topic]:
        """The topics of some types that have messages."""
        return [t for t in self.topics if t.type in types and t.messages]

    def listing(self) -> str:
        """The topics in words, for messages."""
        topics = self.topics
        named = [f"{shorter(t.name)} ({shorter(t.type)}, {t.messages})" for t in topics[:_LISTED]]
        more = [f"and {len(topics) - _LISTED} more"] if len(topics) > _LISTED else []
        return "; ".join(named + more) or "none"

    def messages(self, topic: str, *types: str, start: int | None = None) -> Iterator[tuple[int, Any]]:
        """(time of recording in ns, message) of a topic in order of recording, from ``start`` (ns) on."""
        info = self._reader.topics.get(topic)
        if info is None:
            raise DataError(f"The bag {self.path} has no topic {topic}; its topics are: {self.listing()}.")
        if types and info.msgtype not in types:
            wanted = " or ".join(types)
            raise DataError(f"The topic {topic} of {self.path} is a {info.msgtype}; a {wanted} is needed.")
        if not info.msgcount:
            raise DataError(
                f"The topic {topic} of {self.path} is empty; record it again, or give another one of: "
                f"{self.listing()}."
            )
        return self._read(topic, info.connections, start)

    def _read(self, topic: str, connections: list[Any], start: int | None) -> Iterator[tuple[int, Any]]:
        count = 0
        with self._broken():
            for connection, received, data in self._reader.messages(connections, start=start):
                if not (isinstance(received, int) and abs(received) < LATEST):
                    raise DataError(f"a message of {topic} was recorded at {str(received)[:40]!r}")
                yield received, self._reader.deserialize(data, connection.msgtype)
                count += 1
        if not count and start is None:
            raise DataError(
                f"The bag {self.path} is broken (its index tells of messages of {topic}, there are none); "
                "record it again or reindex it."
            )

    def all_messages(self, topics: Iterable[str]) -> Iterator[tuple[str, Any]]:
        """(topic, message) of several topics in order of recording; of those that the bag has."""
        found = [self._reader.topics[name] for name in topics if name in self._reader.topics]
        connections = [c for info in found for c in info.connections]
        with self._broken():
            for connection, _, data in self._reader.messages(connections):
                yield connection.topic, self._reader.deserialize(data, connection.msgtype)

    @contextmanager
    def _broken(self) -> Iterator[None]:
        """Says what to do about a broken bag, whatever rosbags raises for it."""
        try:
            yield
        except DataError:
            raise
        except Exception as error:  # rosbags raises many kinds for broken files
            raise DataError(
                f"The bag {self.path} is broken ({shorter(error)}); record it again or reindex it."
            ) from error

    def stamped(self, topic: str, *types: str) -> Iterator[tuple[float, Any]]:
        """(stamp in seconds, message): the header's stamp, or the time of recording where it has none."""
        return ((m.stamp_seconds(message, t), message) for t, message in self.messages(topic, *types))

    def camera(self, topic: str, images: str = "") -> Camera:
        """Camera of a topic's CameraInfo; whether ``images`` are rectified, their topic says.

        Raises
        ------
        DataError
            If it cannot be used, or is another one later: zooms and focus change the lens.
        """
        where, first = f"{topic} in {self.path}", None
        for _, message in self.messages(topic, CAMERA_TYPE):
            lens = m.lens_numbers(message)
            first = (message, lens) if first is None else first
            if lens.shape != first[1].shape or not np.allclose(lens, first[1], rtol=1e-3, atol=1e-6):
                raise DataError(
                    f"The CameraInfo of {where} changes during the recording; fix zoom and focus, or give "
                    "--camera FILE if it does not hold."
                )
        assert first is not None  # a topic that is listed has messages
        return m.camera_of(first[0], where, images)

    def poses(self, topic: str) -> tuple[Array, Array, Array]:
        """Stamps (N,), poses (N, 4, 4) and covariances (N, 6, 6) on the right tangent, sorted by stamp."""
        where = f"{topic} in {self.path}"
        rows = [(t, *m.pose_and_covariance_of(p, where)) for t, p in self.stamped(topic, *POSE_TYPES)]
        rows.sort(key=lambda row: row[0])
        tell("poses", f"{len(rows)} with covariance", topic)
        return tuple(np.asarray(column) for column in zip(*rows, strict=True))  # type: ignore[return-value]

    def track(self, topic: str) -> tuple[Array, Array]:
        """Stamps (N,) and poses (N, 4, 4) of stamped poses of any kind, sorted by stamp."""
        rows = []
        for t, message in self.stamped(topic, *TRUTH_TYPES):
            pose = getattr(message, "transform", None) or message.pose
            rows.append((t, m.pose_of(getattr(pose, "pose", pose), f"{topic} in {self.path}")))
        return _sorted(rows)

    def transforms(self, parent: str, child: str, topic: str = "/tf") -> tuple[Array, Array]:
        """Stamps (N,) and transforms (N, 4, 4) that map points of ``child`` into ``parent``, from tf.

        Only a direct link of the two frames is found, in either direction.
        """
        rows, pairs = [], set()
        for received, message in self.messages(topic, *_TF_TYPES):
            for link in message.transforms:
                ends = (link.header.frame_id.lstrip("/"), link.child_frame_id.lstrip("/"))
                pairs.add(ends)
                if ends in ((parent, child), (child, parent)):
                    matrix = m.pose_of(link.transform, f"{topic} in {self.path}")
                    t = m.stamp_seconds(link, received)
                    rows.append((t, matrix if ends == (parent, child) else pose_inverse(matrix)))
        if not rows:
            known = ", ".join(f"{a} > {b}" for a, b in sorted(pairs))
            raise DataError(f"{topic} in {self.path} does not link {parent} and {child}; it links {known}.")
        return _sorted(rows)

    def transform_tree(self) -> TransformTree:
        """All that ``/tf_static`` and ``/tf`` say, as far as the bag has them."""
        tree = TransformTree(kept=None)
        for topic in ("/tf_static", "/tf"):
            if any(known.name == topic for known in self.of_type(*_TF_TYPES)):
                for _, message in self.messages(topic, *_TF_TYPES):
                    tree.take(message, static=topic == "/tf_static")
        return tree

    def scans(self, topic: str) -> m.Scans:
        """Laser scans of a topic."""
        return m.scans_of(self.stamped(topic, SCAN_TYPE))

    def imu(self, topic: str) -> m.ImuSamples:
        """Inertial samples of a topic."""
        return m.imu_of(self.stamped(topic, IMU_TYPE))


@cache
def _typestore(name: str) -> Any:
    """Message types for bags that do not bring theirs; making one takes a tenth of a second."""
    with needs("ros"):
        from rosbags.typesys import Stores, get_typestore
    return get_typestore(Stores[name])


def _sorted(rows: list[tuple[float, Array]]) -> tuple[Array, Array]:
    rows.sort(key=lambda row: row[0])
    return np.asarray([t for t, _ in rows]), np.asarray([pose for _, pose in rows])


class BagImages:
    """The images of one topic by number; quick in order, by seeking otherwise.

    Attributes
    ----------
    stamps : list of int
        Nanoseconds, of each image, in order.
    """

    def __init__(self, bag: Bag, topic: str) -> None:
        self._bag, self._topic = bag, topic
        rows, extents, grey = [], [], []
        count = sum(t.messages for t in bag.topics if t.name == topic)
        every, seldom = (max(1, count // of) for of in (SAMPLED, LOOKED_AT))
        for k, (received, message) in enumerate(bag.messages(topic, *IMAGE_TYPES)):
            rows.append((_nanoseconds(message, received), received, k))
            if k % every == 0 or not m.is_compressed(message):
                extents.append(m.extent_in(message))
            if k % seldom == 0:
                grey.append(m.said_to_be_grey(message, topic))
        rows.sort()
        self._used = common_range(extents)
        if any(extent.largest for extent in extents):
            tell("depth of pixels", f"{self._used}, by the values of all", topic)
        self._mosaic = mosaic_of([picture for picture in grey if picture is not None])
        if self._mosaic is not None:
            tell("pixels", MOSAIC_TOLD, topic)
        self.stamps = [stamp for stamp, _, _ in rows]
        tell("stamps", f"{len(rows)}, of the headers (of recording where one has none)", topic)
        self._received = [received for _, received, _ in rows]
        self._next = -1
        self._ahead: Iterator[tuple[int, Any]] = iter(())

    def read(self, k: int) -> Image:
        """Image ``k`` in order of the stamps."""
        return m.image_of(self._message(k), self._where(k), self._used, self._mosaic)

    def read_depth(self, k: int, per_metre: float) -> Array:
        """Image ``k`` as a depth image, (H, W) metres; ``per_metre`` counts, if it counts."""
        return m.depth_of(self._message(k), self._where(k), per_metre)

    def _where(self, k: int) -> str:
        return f"{k} of {self._topic} in {self._bag.path}"

    def _message(self, k: int) -> Any:
        message = self._take(k) if k == self._next else None
        if message is None:
            self._ahead = self._bag.messages(self._topic, *IMAGE_TYPES, start=self._received[k])
            message = self._take(k)
        self._next = k + 1
        if message is None:
            raise DataError(f"The image {self._where(k)} cannot be found again; the bag has changed.")
        return message

    def _take(self, k: int) -> Any:
        """Message ``k`` if it is among the next ones recorded at its time, else None."""
        for received, message in self._ahead:
            if received > self._received[k]:
                break
            if received == self._received[k] and _nanoseconds(message, received) == self.stamps[k]:
                return message
        return None


def _nanoseconds(message: Any, received: int) -> int:
    return round(m.stamp_seconds(message, received) * 10**9)
