"""Who wears a Cf: where they are once nothing is heard of them, and whether somebody is there at all."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import Camera, Settings, Slam
from collabslam.frontend.wearer_mask import OVER, Outline
from collabslam.geometry import pose_inverse, rotation_exp
from collabslam.settings.frontend import WornSettings
from collabslam.slam.worn.overlap import Overlap
from collabslam.slam.worn.wearers import HEARD, Wearers
from collabslam.types import Array, WornView

CAMERA = Camera("pinhole", 720, 480, (740.0, 740.0, 360.0, 240.0))
COVARIANCE = np.diag([0.03**2] * 3 + [0.01**2] * 3)
DOWN = np.array([0.0, 1.0, 0.0])


class _Core:
    """A filter of which nothing is asked but its pose."""

    started = True

    def __init__(self) -> None:
        self.pose = np.eye(4)


def _wearers(core: Any, **settings: float) -> Wearers:
    return Wearers(core, CAMERA, {"": CAMERA, "ben": CAMERA}, dataclasses.replace(WornSettings(), **settings))


def _at(place: Sequence[float], turn: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation_exp(turn), place
    return pose


def _heard(t_cf: Array, who: str = "", *, body: bool = True) -> Overlap:
    view = WornView(np.zeros((2, 2), np.uint8), t_cf, COVARIANCE, who=who, body=body)
    return Overlap(0, view, view, 0.0)


def test_somebody_goes_on_as_they_went_and_is_forgotten() -> None:
    core = _Core()
    wearers = _wearers(core)
    for k in range(20):  # both walk on at 1 m/s
        core.pose = _at([0.0, 0.0, 0.1 * k])
        near = wearers.look(0.1 * k, [_heard(_at([0.2, -0.7, 2.0]))], lost=False)[""]
    core.pose = _at([0.0, 0.0, 1.9], [0.0, 0.2, 0.0])  # Cs stands and turns, they walk on unheard
    later = wearers.look(2.9, [], lost=False)[""]
    there = pose_inverse(core.pose) @ np.array([0.2, -0.7, 4.9, 1.0])
    np.testing.assert_allclose(later.head, there[:3], atol=0.1)
    np.testing.assert_allclose(near.head, [0.2, -0.7, 2.0], atol=1e-9)
    assert later.off > near.off + 0.25
    assert wearers.look(1.9 + HEARD + 0.2, [], lost=False) == {}


def test_a_head_nods_and_the_body_stays_upright() -> None:
    wearers = _wearers(_Core())
    for k in range(60):
        nod = [0.4 * (-1) ** k, 0.0, 0.0]
        outline = wearers.look(0.1 * k, [_heard(_at([0.0, -0.7, 2.0], nod))], lost=False)[""]
    assert np.degrees(np.arccos(outline.down @ DOWN)) < 3.0


def test_a_body_hangs_down_where_an_accelerometer_says_which_way_that_is() -> None:
    up = np.array([0.1, -np.sqrt(0.98), 0.1])
    core = _Core()
    core.pose = _at([0.0, 0.0, 0.0], [0.0, 0.5, 0.0])
    worn = [_heard(_at([0.0, -0.7, 2.0], [0.3, 0.0, 0.0]))]
    outline = _wearers(core).look(0.0, worn, lost=False, up=up)[""]
    np.testing.assert_allclose(outline.down, -core.pose[:3, :3].T @ up, atol=1e-12)


@pytest.mark.parametrize(
    "worn",
    [
        _heard(_at([0.0, -0.1, 0.25])),  # Cs would be inside of them
        _heard(_at([0.2, -0.7, -2.0])),  # behind Cs
        _heard(_at([4.0, -0.7, 2.0])),  # beside the picture
        _heard(_at([0.0, -0.7, 2.0]), body=False),  # an emulated camera
    ],
)
def test_nobody_is_in_view(worn: Overlap) -> None:
    assert _wearers(_Core()).look(0.0, [worn], lost=False) == {}


def test_no_size_is_nobody() -> None:
    assert _wearers(_Core(), body_radius=0.0).look(0.0, [_heard(_at([0.0, -0.7, 2.0]))], lost=False) == {}


def test_a_lost_camera_knows_of_those_alone_who_are_heard_now() -> None:
    wearers = _wearers(_Core())
    assert wearers.look(0.0, [_heard(_at([0.0, -0.7, 2.0]))], lost=False)
    assert wearers.look(0.1, [], lost=True) == {}
    assert wearers.look(0.2, [_heard(_at([0.0, -0.7, 2.0]))], lost=True)


def test_one_person_is_left_out_of_the_pictures_of_another() -> None:
    core = _Core()
    wearers = _wearers(core)
    behind, ahead = _heard(_at([0.0, -0.7, 1.0])), _heard(_at([0.0, -0.7, 3.0]), "ben")
    outlines = wearers.look(0.0, [behind, ahead], lost=False)
    (hides,) = wearers.hidden_from("", behind.worn.t_cf, outlines)  # ben, 2 m ahead of the first
    middle = np.array([[360.0, 300.0], [40.0, 300.0]])
    np.testing.assert_array_equal(hides(middle), [True, False])
    assert wearers.hidden_from("ben", ahead.worn.t_cf, outlines) == [] or not any(
        hides(middle).any() for hides in wearers.hidden_from("ben", ahead.worn.t_cf, outlines)
    )


def test_what_is_seen_through_an_outline_says_that_nobody_is_there() -> None:
    wearers = _wearers(_Core())
    outlines = wearers.look(0.0, [_heard(_at([0.0, -0.7, 2.0]))], lost=False)
    assert len(wearers.hidden(outlines)) == 1
    wearers.saw("", found=30, tried=30, usual=0.9, by_chance=0.3, at_once=1.5)
    assert len(wearers.hidden(outlines)) == 1, "one frame says little"
    wearers.saw("", found=9, tried=10, usual=0.9, by_chance=0.3, at_once=1.5)
    assert wearers.hidden(outlines) == []
    assert wearers.counts(outlines) == {"wearers": 0, "wearers_unseen": 1}
    for _ in range(20):  # somebody is there after all
        wearers.saw("", found=0, tried=10, usual=0.9, by_chance=0.3)
    assert len(wearers.hidden(outlines)) == 1


def test_a_body_is_not_seen_through() -> None:
    wearers = _wearers(_Core())
    outlines = wearers.look(0.0, [_heard(_at([0.0, -0.7, 2.0]))], lost=False)
    for _ in range(8):
        wearers.saw("", found=3, tried=10, usual=0.8, by_chance=0.3)
    assert len(wearers.hidden(outlines)) == 1
    assert wearers.undecided(outlines) == {}


def test_what_is_remembered_can_be_saved() -> None:
    core = _Core()
    first, again = _wearers(core), _wearers(core)
    first.look(0.0, [_heard(_at([0.2, -0.7, 2.0]))], lost=False)
    first.saw("", found=3, tried=5, usual=0.9, by_chance=0.3)
    again.restore(first.state())
    a, b = (wearers.look(0.5, [], lost=False)[""] for wearers in (first, again))
    np.testing.assert_array_equal(a.head, b.head)
    assert first.state()["_through"] == again.state()["_through"]


def test_the_trunk_lies_within_the_outline() -> None:
    outline = Outline(np.array([0.2, -0.7, 2.0]), DOWN, 0.3, 2.0)
    v, u = np.mgrid[0:480:4, 0:720:4].astype(np.float64)
    uv = np.stack([u.ravel(), v.ravel()], axis=1)
    trunk, body = outline.trunk(CAMERA, uv), outline.hides(CAMERA, uv)
    assert 0 < trunk.sum() < 0.5 * body.sum()
    assert body[trunk].all()
    assert outline.seen_from(np.eye(4)).range == outline.range
    assert Outline(np.array([0.0, OVER - 0.1, 2.0]), DOWN, 0.3, 2.0).is_possible


def test_nobody_in_view_changes_no_bit(clip: Clip) -> None:
    """The person of the clip walks beside the robot, out of its view."""
    recording = clip.recording
    poses = []
    for radius in (0.0, 0.3):
        settings = Settings.default().replace({"frontend.worn.body_radius": radius})
        slam = Slam(recording.camera, recording.worn_camera, settings=settings)
        steps = [slam.step(f.t, f.image, f.views) for f in clip.frames]
        poses.append([np.concatenate([s.pose.ravel(), s.covariance.ravel()]) for s in steps])
    np.testing.assert_array_equal(*poses)
