"""A bag as a recording: images of Cs, and where they are given, of Cf with the measured ``T_CF``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from collabslam._core import Camera
from collabslam.datasets.calibration import check_size, of_stamped, read_calibration
from collabslam.datasets.depth_image import MILLIMETRES, depth_points, depth_scale
from collabslam.datasets.overrides import Given
from collabslam.datasets.poses import interpolate_track
from collabslam.datasets.printed_pose import printed_source, with_printed_poses
from collabslam.datasets.readers.stamped import match_stamps, own_time, views_of_frames
from collabslam.datasets.recorded_worn import RecordedWorn, WornImages
from collabslam.datasets.ros.bag import CAMERA_TYPE, IMAGE_TYPES, Bag, BagImages, is_bag
from collabslam.datasets.ros.sensors import EstimatedPoses
from collabslam.datasets.ros.worn_pose_source import T_CF_ROLE, WornPoses, worn_poses
from collabslam.datasets.stream import StreamRecording
from collabslam.datasets.units import seconds
from collabslam.errors import DataError
from collabslam.types import Array, DepthPoints, WornView, person_name

LAYOUT = "a ROS bag (.bag, .mcap, .db3, or the folder of a ROS 2 bag)"
ROLES = {
    "cs": "images of the robot's camera; the only image topic if left out",
    "cf": "images of the worn camera",
    "t_cf": T_CF_ROLE,
    "depth": "depth images registered to Cs, of its size: 16UC1 (see --depth-scale) or 32FC1 (metres)",
    "cs_info": "CameraInfo of Cs; the one beside its images if left out",
    "cf_info": "CameraInfo of Cf; the one beside its images if left out",
    "truth": "true pose of Cs in a world, to score and to emulate Cf; or tf:WORLD:CAMERA",
}
WORN_ROLES = ("cf", "cf_info", "t_cf")
"""Roles that each of several persons has, as ``cf.anna``."""
_TOLERANCE, _TOGETHER = 10_000_000, 20_000_000


def matches(path: Path) -> bool:
    """Whether ``path`` is a bag."""
    return is_bag(path)


def open(path: Path, given: Given) -> StreamRecording:
    """Open a bag; ``given.topics`` says which topic is what, see `ROLES`."""
    topics = dict(given.topics)
    persons = _persons(topics)
    unknown = sorted(set(topics) - set(ROLES) - {role for own in persons.values() for role in own.roles})
    if unknown:
        raise DataError(
            f"There is no topic's role '{unknown[0]}'; the roles are {', '.join(ROLES)}, and of several "
            "persons cf.NAME, cf_info.NAME, t_cf.NAME."
        )
    bag = Bag(path)
    topic = topics["cs"] = topics.get("cs") or only_images(bag)
    images = BagImages(bag, topic)
    times = np.asarray([seconds(s) for s in images.stamps])
    own = None
    if given.camera is not None:
        own = of_stamped(read_calibration(given.camera, topic=topic), given.camera)
    camera = _camera(bag, topic, topics.get("cs_info")) if own is None else own.camera
    recording = StreamRecording(
        name=path.stem,
        source=str(path),
        camera=camera,
        times=times,
        read=images.read,
        truth=_truth(bag, topics["truth"], times) if "truth" in topics else None,
    )
    if "depth" in topics:
        depths = BagImages(bag, topics["depth"])
        stated = None if own is None else own.depth_scale
        scale = depth_scale(given.depth_scale, stated, MILLIMETRES, topics["depth"])
        recording = replace(recording, read_depth=_depths(recording, images.stamps, depths, scale))
    return _with_worn(recording, bag, images.stamps, persons, replace(given, topics=topics))


@dataclass(frozen=True)
class _Person:
    """The topics of a worn camera: its images, its CameraInfo and what tells T_CF, if they are given."""

    name: str
    images: str
    info: str | None
    t_cf: str | None

    @property
    def roles(self) -> set[str]:
        return {f"{role}.{self.name}" if self.name else role for role in WORN_ROLES}


def _persons(topics: Mapping[str, str]) -> dict[str, _Person]:
    """Whose images of a worn camera there are, by name; "" is a single one's."""
    out = {}
    for role in topics:
        kind, dot, name = role.partition(".")
        if kind == "cf":
            if dot:
                person_name(name, DataError)
            images, info, t_cf = (topics.get(f"{of}.{name}" if dot else of) for of in WORN_ROLES)
            out[name] = _Person(name, str(images), info, t_cf)
    if "" in out and len(out) > 1:
        raise DataError("Of several worn cameras each is a person's; give cf.NAME in place of cf, too.")
    return out


def _with_worn(
    recording: StreamRecording, bag: Bag, stamps: list[int], persons: Mapping[str, _Person], given: Given
) -> StreamRecording:
    """With the views of the worn cameras, all with T_CF from printed targets, or none."""
    sources = {name: printed_source(person.t_cf) for name, person in persons.items()}
    targets = next(iter(sources.values()), [])
    if any(source != targets for source in sources.values()):
        raise DataError(
            "Printed targets tell T_CF of all worn cameras or of none; give all the same t_cf.NAME."
        )
    worn: dict[str, RecordedWorn] = {}
    unposed: dict[str, WornImages] = {}
    worn_pose = "measured"
    for name, person in persons.items():
        images = BagImages(bag, person.images)
        if targets:
            pairs = match_stamps(stamps, images.stamps, _TOLERANCE)
            read = {i: partial(images.read, k) for i, k in pairs.items()}
            unposed[name] = _camera(bag, person.images, person.info), read
            continue
        poses = worn_poses(bag, person.t_cf, given.camera, (given.topics["cs"], person.images))
        worn_pose = "estimated" if isinstance(poses, EstimatedPoses) else worn_pose
        camera = poses.camera or _camera(bag, person.images, person.info)
        worn[name] = RecordedWorn(camera, _views(bag, stamps, images, poses))
    if targets:
        return with_printed_poses(recording, unposed, targets)
    return replace(recording, worn=worn, worn_pose=worn_pose)


def _depths(
    recording: StreamRecording, stamps: list[int], depths: BagImages, per_metre: float
) -> Callable[[int], DepthPoints | None]:
    pairs = match_stamps(stamps, depths.stamps, _TOGETHER)
    if not pairs:
        raise DataError(
            f"No depth image in {recording.source} is within 20 ms of one of Cs; check the clocks."
        )

    def read_depth(i: int) -> DepthPoints | None:
        if i not in pairs:
            return None
        metres = depths.read_depth(pairs[i], per_metre)
        check_size(recording.camera, (metres.shape[1], metres.shape[0]), f"(depth) of frame {i}")
        return depth_points(metres, (depths.stamps[pairs[i]] - stamps[i]) / 10**9)

    return read_depth


def _view(
    images: BagImages, k: int, t_cf: Array, covariance: Array, bias: Array | None, t: float | None
) -> WornView:
    return WornView(images.read(k), t_cf, covariance, bias, t)


def only_images(bag: Bag) -> str:
    """The topic of a bag's images; DataError if there is not just one."""
    found = bag.of_type(*IMAGE_TYPES)
    if len(found) == 1:
        return found[0].name
    if not found:
        raise DataError(f"The bag {bag.path} has no images; its topics are: {bag.listing()}.")
    names = ", ".join(t.name for t in found)
    raise DataError(
        f"The bag {bag.path} has {len(found)} image topics ({names}); say which is which with --topics "
        "cs=TOPIC, and for the worn camera cf=TOPIC,t_cf=TOPIC (of several cf.NAME=TOPIC,t_cf.NAME=TOPIC)."
    )


def _camera(bag: Bag, images: str, info: str | None) -> Camera:
    """Camera of the CameraInfo that is given, beside the images, or the only one."""
    found = [t.name for t in bag.of_type(CAMERA_TYPE)]
    above = images.removesuffix("/compressed").rsplit("/", 1)[0]
    beside = [name for name in found if name.rsplit("/", 1)[0] == above] or found
    if info is None and len(beside) != 1:
        raise DataError(
            f"The bag {bag.path} has {len(found)} CameraInfo topics for {images}; give --camera FILE (from "
            "collabslam init BAG --board), or say which with --topics cs_info=TOPIC (cf_info for the worn "
            f"camera): {', '.join(found) or 'none'}."
        )
    return bag.camera(info or beside[0], images)


def _views(
    bag: Bag, stamps: list[int], images: BagImages, poses: WornPoses | EstimatedPoses
) -> dict[int, Callable[[], WornView]]:
    """How the view of each frame with one and a pose is read; its stamp is by the clock of Cs."""
    shift = round(poses.shift * 10**9)
    taken = [s + shift for s in images.stamps]
    pairs = views_of_frames(stamps, taken, _TOLERANCE)
    times = np.asarray([seconds(taken[k]) for k in pairs.values()])
    rows = zip(pairs.items(), *poses.at(times), strict=True)
    out: dict[int, Callable[[], WornView]] = {
        i: partial(_view, images, k, t_cf, covariance, bias, own_time(taken[k], stamps[i]))
        for (i, k), t_cf, covariance, bias in rows
        if np.isfinite(t_cf).all()
    }
    if not out:
        raise DataError(
            f"No image of Cf in {bag.path} is between two of its measured poses, with one of Cs after "
            "it; put all three on the same clock."
        )
    return out


def _truth(bag: Bag, topic: str, times: Array) -> Array:
    kind, *frames = topic.split(":")
    track = bag.transforms(*frames) if kind == "tf" and len(frames) == 2 else bag.track(topic)
    truth = interpolate_track(*track, times)
    if not np.isfinite(truth).any():
        raise DataError(f"The poses of {topic} in {bag.path} and the images share no time; check the clocks.")
    return truth
