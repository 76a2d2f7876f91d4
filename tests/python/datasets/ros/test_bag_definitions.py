"""Message types as bags define them: none is taken for ROS's that is another, and none costs minutes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from collabslam import DataError
from collabslam.datasets.ros.bag import IMAGE_TYPES, Bag
from collabslam.live import messages

IMAGE = IMAGE_TYPES[0]


def bag_of(folder: Path, definition: str, *more: str) -> Path:
    """A bag of one image, whose type has this definition, and of topics of other types."""
    plain = "\n".join(line for line in definition.splitlines() if line != "#") + "\n"
    message = messages.raw_image(1.0, "cs", np.zeros((4, 6), np.uint8))
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topic = bag.add_connection("/image", IMAGE, msgdef=definition, rihs01=digest(plain, IMAGE))
        for k, text in enumerate(more):
            name = f"x/msg/T{k}"
            bag.add_connection(
                f"/other{k}", name, msgdef=text, rihs01=digest(text.partition("\n")[0] + "\n", name)
            )
        bag.write(topic, 1, message)
    return folder / "bag"


def digest(definition: str, name: str) -> str:
    """What a bag says of its types, whatever they are."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, name))
    return str(store.hash_rihs01(name))


def image_type() -> str:
    return str(messages.store().generate_msgdef(IMAGE, ros_version=2)[0])


def test_what_ros_has_is_read(tmp_path: Path) -> None:
    with Bag(bag_of(tmp_path, image_type())) as bag:
        ((_, message),) = bag.messages("/image", IMAGE)
    assert (message.height, message.width) == (4, 6)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("uint32 height", "string height"),
        ("uint32 height", "uint32 high"),
        ("string encoding", "string[] encoding"),
        ("uint8[] data", "uint8[3] data"),
        ("string frame_id", "uint8 frame_id"),
    ],
)
def test_another_type_of_that_name_is_told(tmp_path: Path, before: str, after: str) -> None:
    """Or what reads it would end where it asks for what is not there."""
    assert before in image_type()
    with pytest.raises(DataError, match="otherwise than ROS does"):
        Bag(bag_of(tmp_path, image_type().replace(before, after)))


@pytest.mark.parametrize(("fields", "count"), [(9000, 1), (5000, 18)])
def test_types_that_are_too_long_are_not_parsed(tmp_path: Path, fields: int, count: int) -> None:
    texts = ["".join(f"uint8 a{k}_{n}\n" for n in range(fields)) for k in range(count)]
    with pytest.raises(DataError, match="longer than any message"):
        Bag(bag_of(tmp_path, image_type(), *texts))


def test_a_message_names_some_of_many_topics(tmp_path: Path) -> None:
    with Bag(bag_of(tmp_path, image_type(), *["uint8 a\n"] * 60)) as bag:
        assert bag.listing().endswith("and 21 more")


def test_comments_are_no_part_of_a_type(tmp_path: Path) -> None:
    commented = image_type().replace(
        "uint32 height\n", "# rows" + "\n#" * 70_000 + "\nuint32 height # rows\n"
    )
    with Bag(bag_of(tmp_path, commented)) as bag:
        assert [message.width for _, message in bag.messages("/image", IMAGE)] == [6]
