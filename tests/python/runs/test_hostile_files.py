"""Files with a valid checksum and hostile content: every field of engines, checkpoints, maps is altered."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers.clip import Clip, Short
from helpers.stand_ins import FakeSlam, Walk

from collabslam import Camera, Output, SavedMap, Slam, Source, WornSpec, resume, run
from collabslam.errors import CollabslamError, DataError
from collabslam.formats import container
from collabslam.formats.trajectory import read_covariances
from collabslam.runs import checkpoint
from collabslam.runs.folder import CONFIG, MARK
from collabslam.runs.results import CHECKPOINT
from collabslam.runs.run_folder import RunFolder, read_frames
from collabslam.settings.table import Settings
from collabslam.slam.map import saved_map
from collabslam.slam.saving import CLASSES
from collabslam.types import Frame, Image, Target

pytestmark = pytest.mark.slow

SCALARS: list[Any] = [
    None,
    True,
    -1,
    2**70,
    float("nan"),
    1e300,
    "x",
    "\0",
    b"",
    [],
    {},
    (1, 2, 3),
    np.zeros(3),
]


def arrays(a: np.ndarray) -> list[Any]:
    """What may stand in an array's place."""
    out: list[Any] = [None, 0, a.astype(np.float32), a.ravel(), a[:0], a[..., None]]
    if a.dtype.kind == "f":
        out += [np.full_like(a, x) for x in (np.nan, 1e-8 * np.finfo(a.dtype).max, -1.0)]
    if len(a) > 1:
        out.append(a[1:])
    return out


def altered(tree: Any, path: str, seen: set[str]) -> Iterator[tuple[str, Any]]:
    """The tree with one thing changed, for each kind of place in it: numbers in the path do not count."""
    kind = re.sub(r"\d+", "*", path)
    if kind in seen and not isinstance(tree, dict | list | tuple):
        return
    seen.add(kind)
    if isinstance(tree, np.ndarray):
        yield from ((path, x) for x in arrays(tree))
        return
    yield from ((path, x) for x in SCALARS)
    if dataclasses.is_dataclass(tree):
        for field in dataclasses.fields(tree):
            for where, value in altered(getattr(tree, field.name), f"{path}.{field.name}", seen):
                yield where, dataclasses.replace(tree, **{field.name: value})  # type: ignore[type-var]
    elif isinstance(tree, dict):
        for key in list(tree)[: 3 if path.endswith(("[values]", "[switches]")) else 200]:
            if re.sub(r"\d+", "*", f"{path}[{key}]") in seen:
                continue
            yield f"{path} without {key}", {k: v for k, v in tree.items() if k != key}
            for where, value in altered(tree[key], f"{path}[{key}]", seen):
                yield where, {**tree, key: value}
        yield f"{path} with more", {**tree, "more": 1}
    elif isinstance(tree, list | tuple):
        for k in range(min(len(tree), 2)):
            for where, value in altered(tree[k], f"{path}[{k}]", seen):
                yield where, getattr(tree, "_make", type(tree))([*tree[:k], value, *tree[k + 1 :]])


def refused_or_used(name: str, use: Callable[[], Any]) -> str | None:
    """What went wrong: any error that is not ours."""
    try:
        use()
    except CollabslamError:
        return None
    except Exception as error:
        return f"{name}: {type(error).__name__}: {error}"
    return None


def half(camera: Camera) -> Camera:
    f_x, f_y, c_x, c_y = camera.intrinsics
    numbers = 0.5 * f_x, 0.5 * f_y, 0.5 * c_x - 0.25, 0.5 * c_y - 0.25
    return Camera(camera.model, camera.width // 2, camera.height // 2, numbers, camera.distortion)


def halved(image: Image) -> Image:
    height, width = image.shape
    return np.asarray(cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.uint8)


@pytest.fixture(scope="module")
def small(clip: Clip) -> tuple[Camera, Camera, list[Frame]]:
    """Both cameras and the first frames at half the resolution."""
    frames = [
        replace(
            frame,
            image=halved(frame.image),
            views=tuple(replace(view, image=halved(view.image)) for view in frame.views),
        )
        for frame in clip.frames[:6]
    ]
    return half(clip.recording.camera), half(clip.recording.worn_camera), frames


@pytest.fixture(scope="module")
def engine(small: tuple[Camera, Camera, list[Frame]]) -> Slam:
    """Of a few points, whose fields are those of many: it is made, and goes on, thousands of times."""
    *cameras, frames = small
    slam = Slam(*cameras, settings=Settings.default().replace({"filter.map.in_view": 12}))
    for frame in frames[:5]:
        slam.step(frame.t, frame.image, frame.views)
    slam.add_depth([[50.0, 50.0]], 3.0, 0.1)
    return slam


def test_every_field_of_an_engine(small: tuple[Camera, Camera, list[Frame]], engine: Slam) -> None:
    state = engine.state()
    points = np.array([[0.1 * i, 0.1 * j, 0.0] for i in range(3) for j in range(2)])
    patches = [np.full((9, 9), 40 * i, np.uint8) for i in range(6)]
    target = Target(points, patches, np.eye(4), np.eye(6) * 1e-4)
    state["start"] = "target"
    state["parts"]["start"] = {
        "_target": target,
        "_points_w": np.empty((0, 3)),
        "_patches": [],
        "_elsewhere": np.zeros(2),
    }

    frame = small[2][5]

    def use(altered_state: Any) -> None:
        slam = Slam.from_state(altered_state)
        slam.step(frame.t, frame.image, frame.views)
        slam.saved_map()
        slam.submaps()

    use(state)
    faults, count = [], 0
    for name, changed in altered(state, "state", set()):
        count += 1
        fault = refused_or_used(name, lambda changed=changed: use(changed))  # type: ignore[misc]
        faults += [] if fault is None else [fault]
    assert not faults, f"{len(faults)} of {count}:\n" + "\n".join(faults)
    assert count > 300


def test_every_field_of_a_checkpoint(clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DataError):
        run(Short(clip, ends=5), mode="collab", out=Output(tmp_path))
    content = container.read_container(tmp_path / CHECKPOINT, checkpoint.KIND, checkpoint.VERSION, CLASSES)
    walk = Short(clip, ends=6)
    reopen = Source(
        Path("walk"), worn=WornSpec("lag:0.5", noise=(0.1, 1.0, 1.0, 1.0), intervals=[(0.0, 1.0)])
    )
    content = {**content, "reopen": reopen.state(), "engine": {}}
    monkeypatch.setattr(Slam, "from_state", classmethod(lambda cls, state: FakeSlam(Walk())))
    monkeypatch.setattr(Source, "open", lambda self: walk)

    def use(tree: Any) -> None:
        container.write_container(tmp_path / CHECKPOINT, checkpoint.KIND, checkpoint.VERSION, tree, CLASSES)
        resume(tmp_path)

    with pytest.raises(DataError, match="disk is gone"):  # it goes on, for one frame
        use(content)
    faults, count = [], 0
    for name, changed in altered(content, "checkpoint", set()):
        if not name.startswith("checkpoint[engine]"):
            count += 1
            faults.append(refused_or_used(name, lambda changed=changed: use(changed)))  # type: ignore[misc]
    told = [fault for fault in faults if fault is not None]
    assert not told, f"{len(told)} of {count}:\n" + "\n".join(told)
    assert count > 300


def test_every_field_of_a_map(
    small: tuple[Camera, Camera, list[Frame]], engine: Slam, tmp_path: Path
) -> None:
    engine.saved_map().save(tmp_path / "good.map")
    kind = saved_map.KIND, saved_map.VERSION
    content = container.read_container(tmp_path / "good.map", *kind, saved_map.CLASSES)
    path, frame = tmp_path / "bad.map", small[2][5]
    used: list[str] = []

    def use(tree: Any) -> None:
        container.write_container(path, *kind, tree, saved_map.CLASSES)
        found = SavedMap.load(path)
        slam = Slam(small[0], mode="mono", start="map", map=found)
        slam.step(frame.t, frame.image)
        used.append("one")

    use(content)
    faults = [refused_or_used(name, lambda t=tree: use(t)) for name, tree in altered(content, "map", set())]  # type: ignore[misc]
    told = [fault for fault in faults if fault is not None]
    assert not told, f"{len(told)} of {len(faults)}:\n" + "\n".join(told)
    assert len(faults) > 100
    assert len(used) < 0.2 * len(faults)


def test_a_trajectory_that_nobody_writes_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / CONFIG).write_text(MARK)
    os.mkfifo(tmp_path / "trajectory.tum")
    with pytest.raises(DataError, match="not a regular file"):
        RunFolder(tmp_path).is_metric()


@pytest.mark.parametrize(
    "rows", ["index,t\n0,nan\n", "index,t\n0,1e308\n", "index,t\n0\n", "index,t\n0,1,2\n"]
)
def test_frames_that_are_damaged_are_told(tmp_path: Path, rows: str) -> None:
    path = tmp_path / "frames.csv"
    path.write_text(rows)
    with pytest.raises(DataError, match="is damaged"):
        read_frames(path)
    path.write_text("index,t\n0,0.5\n")
    assert read_frames(path) == [{"index": "0", "t": "0.5"}]


def test_negative_variances_are_told(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.cov"
    path.write_text("0.1" + " -1" * 21 + "\n")
    with pytest.raises(DataError, match="a variance is negative"):
        read_covariances(path)
