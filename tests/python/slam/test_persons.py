"""Several worn cameras in one engine: whose view is whose, what of them is told, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from collabslam import Slam
from collabslam.errors import InputError
from collabslam.types import Frame, WornView

NAMES = ("anna", "ben")


def engine(clip: Any) -> Slam:
    return Slam(clip.recording.camera, dict.fromkeys(NAMES, clip.recording.worn_camera))


def views(frame: Frame, *names: str, **changes: Any) -> list[WornView]:
    """The frame's view as if each of them had taken it."""
    assert frame.views
    return [replace(frame.views[0], who=name, **changes) for name in names]


def test_each_view_is_measured_with_the_camera_it_is_of(clip: Any) -> None:
    slam, alone = engine(clip), Slam(clip.recording.camera, clip.recording.worn_camera)
    assert list(slam.worn_cameras) == list(NAMES)
    for frame in [f for f in clip.frames if f.views][:4]:
        both = slam.step(frame.t, frame.image, views(frame, "ben", "anna"))
        one = alone.step(frame.t, frame.image, frame.views)
    assert set(both.worn) == set(NAMES)
    assert set(one.worn) == {""}
    for place in both.worn.values():
        assert place.measured
        off = np.linalg.norm(place.pose[:3, 3] - (both.pose @ frame.views[0].t_cf)[:3, 3])
        assert off < 0.3
        np.linalg.cholesky(place.covariance)
    assert both.diagnostics["cf_matches"] > 1.5 * one.diagnostics["cf_matches"]
    assert both.diagnostics["overlap"] == 2
    assert both.features.pairs.shape == (both.diagnostics["cf_matches"], 4)
    assert both.scale_sd < one.scale_sd
    kinds = [block.kind for block in slam.filter.blocks]
    assert kinds.count("Feature") == len(set(slam.landmarks().ids.tolist()))


def test_who_gives_no_view_is_where_nobody_knows(clip: Any) -> None:
    slam = engine(clip)
    for frame in [f for f in clip.frames if f.views][:3]:
        result = slam.step(frame.t, frame.image, views(frame, "ben"))
    assert list(result.worn) == ["ben"]
    assert slam.next_best_view("anna") is None
    assert slam.next_best_view("ben") is not None
    with pytest.raises(InputError, match="clara"):
        slam.next_best_view("clara")


def test_a_view_of_nobody_and_two_of_one_are_refused(clip: Any) -> None:
    slam, frame = engine(clip), clip.frames[0]
    for given, word in ((views(frame, "clara"), "clara"), (views(frame, "ben", "ben"), "one view of each")):
        with pytest.raises(InputError, match=word):
            slam.step(frame.t, frame.image, given)
    with pytest.raises(InputError, match="clara"):
        slam.add_worn(views(frame, "clara", t=frame.t)[0])
    assert slam.step(frame.t, frame.image, views(frame, *NAMES)).started


def test_views_that_come_between_frames_wait_for_each_person(clip: Any, tmp_path: Path) -> None:
    slam = engine(clip)
    frames = [f for f in clip.frames if f.views][:4]
    for frame in frames:
        for late, name in ((0.02, "anna"), (0.01, "anna"), (0.0, "ben")):
            slam.add_worn(views(frame, name, t=frame.t - late)[0])
        result = slam.step(frame.t, frame.image)
    assert set(result.worn) == set(NAMES)
    assert slam.worn_dropped == {"superseded": len(frames)}
    slam.save(tmp_path / "engine")
    again = Slam.load(tmp_path / "engine")
    following = clip.frames[clip.frames.index(frames[-1]) + 1]
    told = [one.step(following.t, following.image).pose for one in (slam, again)]
    assert np.array_equal(*told)


def test_a_person_whose_pose_is_wrong_is_degraded_alone(clip: Any) -> None:
    slam, said = engine(clip), []
    for frame in [f for f in clip.frames if f.views]:
        good, bad = views(frame, *NAMES)
        shifted = bad.t_cf.copy()
        shifted[:3, 3] += shifted[:3, :3] @ [0.0, 0.3, 0.0]
        said.append(slam.step(frame.t, frame.image, [good, replace(bad, t_cf=shifted)]))
    refused = [step.diagnostics["cf_refused"] for step in said]
    assert sum(refused[1:]) >= len(refused) // 2
    assert max(refused) == 1
    assert said[-1].worn["anna"].measured
