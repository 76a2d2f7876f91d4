"""After frames in which a camera saw nothing it does not go faster than it usually does (METHOD 28)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import InputError, Slam
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.usual_speed import UsualSpeed
from collabslam.types import Array


class _Core(SimpleNamespace):
    """Of a filter what tells how the camera goes; its axes are those of W."""

    def __init__(self, velocity: Array, sd: float = 0.1, **others: Any) -> None:
        super().__init__(velocity=velocity, sd=sd, **others)

    @property
    def twist(self) -> Array:
        return np.concatenate([self.velocity, np.zeros(3)])

    @property
    def pose_and_twist_covariance(self) -> Array:
        return self.sd**2 * np.eye(12)


def _went(frames: int, *, gyro: bool = True) -> UsualSpeed:
    """A camera that went at 1 m/s, 10 frames a second, until the time 0."""
    core = _Core(np.array([0.6, 0.0, 0.8]), followed_gyro=gyro, follows_gyro=gyro)
    speed = UsualSpeed(core)  # type: ignore[arg-type]
    for k in range(frames):
        speed.take(0.1 * (k - frames), accepted=True, lost=False, trusted=True)
    return speed


def test_the_speed_is_bounded_for_a_while_after_a_frame_that_was_refused() -> None:
    speed = _went(60)
    assert speed.most(0.0) is None
    speed.take(0.0, accepted=False, lost=False, trusted=False)
    assert speed.most(4.9) == pytest.approx(1.25)
    assert speed.most(5.1) is None
    speed.take(0.1, accepted=False, lost=True, trusted=False)
    assert speed.most(0.2) is None


def _waited() -> UsualSpeed:
    """A camera that stood, but for what its estimate wanders, and has started."""
    speed = _went(0)
    for k, at in enumerate(np.random.default_rng(0).normal(0.0, 0.01, (60, 3))):
        speed._filter.velocity = at  # type: ignore[misc]
        speed.take(0.1 * (k - 60), accepted=True, lost=False, trusted=True)
    return speed


def _started(frames: int = 5) -> UsualSpeed:
    """A camera that went at 1 m/s, and has become faster in its last frames."""
    speed = _went(60)
    speed._filter.velocity *= 1.5  # type: ignore[misc]
    for k in range(frames):
        speed.take(0.001 * (k - frames), accepted=True, lost=False, trusted=True)
    return speed


def test_the_very_last_frame_before_a_lapse_may_be_wrong() -> None:
    speed = _started(frames=2)
    speed.take(0.0, accepted=False, lost=False, trusted=False)
    assert speed.most(0.1) == pytest.approx(1.25)


@pytest.mark.parametrize("speed", [_went(40), _went(60, gyro=False), _waited(), _started()])
def test_it_is_not_where_too_little_is_known(speed: UsualSpeed) -> None:
    speed.take(0.0, accepted=False, lost=False, trusted=False)
    assert speed.most(0.1) is None


def test_what_is_seen_while_it_is_bounded_tells_no_usual_speed() -> None:
    speed = _went(60)
    speed.take(0.0, accepted=False, lost=False, trusted=False)
    speed._filter.velocity *= 1.4  # type: ignore[misc]
    for k in range(1, 40):
        speed.take(0.1 * k, accepted=True, lost=False, trusted=True)
    assert speed.most(4.0) == pytest.approx(1.25)


@pytest.mark.parametrize(("spread", "sd"), [(0.0, 0.1), (0.5, 0.5 / np.sqrt(12.0))])
def test_after_it_saw_nothing_the_filter_is_told_how_it_goes(spread: float, sd: float) -> None:
    told: list[tuple[Array, Array]] = []
    core = _Core(np.zeros(3), started=True, followed_gyro=True, follows_gyro=True)
    core.expect_velocity = lambda *velocity: told.append(velocity)
    speed = UsualSpeed(core)  # type: ignore[arg-type]
    for k, share in enumerate(np.linspace(-0.5, 0.5, 101)):
        core.velocity = np.array([1.0 + spread * share, 0.0, 0.0])
        speed.take(0.1 * (k - 101), accepted=True, lost=False, trusted=True)
    core.velocity = np.array([1.0, 0.0, 0.0])
    speed.expect(0.0)
    assert told == []
    speed.take(0.0, accepted=False, lost=False, trusted=False)
    assert speed.doubts(4.9)
    assert not speed.doubts(5.1)
    speed.expect(0.1)
    np.testing.assert_allclose(told[0][0], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(told[0][1], [sd, 0.1, 0.1], rtol=0.02)
    core.followed_gyro = False  # a gap
    speed.expect(0.2)
    assert len(told) == 1
    core.follows_gyro = False
    assert not speed.doubts(0.1)


def test_a_camera_that_was_seen_to_stop_does_not_go_as_usual() -> None:
    told: list[tuple[Array, Array]] = []
    speed = _went(60)
    core: Any = speed._filter
    core.started, core.expect_velocity = True, lambda *velocity: told.append(velocity)
    speed.take(0.0, accepted=False, lost=False, trusted=False)
    usual = core.velocity
    for k, (share, sd, expected) in enumerate(
        [(0.8, 0.15, True), (0.7, 0.1, False), (0.0, 0.5, False), (0.9, 0.1, False), (1.1, 0.1, True)]
    ):
        core.velocity, core.sd = share * usual, sd
        speed.take(0.1 * k + 0.1, accepted=True, lost=False, trusted=True)
        told.clear()
        speed.expect(0.1 * k + 0.2)
        assert (len(told) == 1) is speed.doubts(0.1 * k + 0.2) is expected
        assert speed.most(0.1 * k + 0.2) == pytest.approx(1.25)  # it may go on, but not faster
        refused = speed.doubts(0.1 * k + 0.2)
        speed.take(0.1 * k + 0.15, accepted=False, lost=False, trusted=False)
        assert speed.doubts(0.1 * k + 0.2) is refused
    speed.take(6.0, accepted=True, lost=False, trusted=True)
    assert not speed._slower


def test_features_that_say_it_is_too_fast_are_deleted(clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    for frame in clip.frames[:4]:
        slam.step(frame.t, frame.image, frame.views)
    before = set(slam.filter.features.tolist())
    monkeypatch.setattr(UsualSpeed, "most", lambda *_: 0.1)
    monkeypatch.setattr(Relocaliser, "attempt", lambda *_: None)
    frame = clip.frames[4]
    result = slam.step(frame.t, frame.image)
    assert result.diagnostics["accepted"] == 0
    gone = before - set(slam.filter.features.tolist())
    found = result.features.ids[~np.isnan(result.features.found[:, 0])]
    assert gone == set(found.tolist())
    assert len(gone) > 20
    monkeypatch.undo()
    again = [slam.step(f.t, f.image, f.views) for f in clip.frames[5:9]]
    assert again[-1].valid


def test_a_speed_is_usual_within_a_band_of_those_before() -> None:
    speed = _went(60)
    assert [speed.is_usual(v) for v in (0.8, 0.9, 1.1, 1.2)] == [False, True, True, False]
    assert _went(40).is_usual(1.0) is None


def test_a_frame_that_would_make_it_faster_is_refused(clip: Clip) -> None:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    for frame in clip.frames[:4]:
        slam.step(frame.t, frame.image, frame.views)
    core = slam.filter
    core.predict(clip.frames[4].t)
    expected, pose, covariance = core.predict_pixels(), core.pose, core.pose_covariance
    seen = expected.ids, expected.ids, expected.uv
    refused = core.update(*seen, max_speed=0.1)
    assert (refused.accepted, refused.too_fast) == (False, True)
    np.testing.assert_array_equal(core.pose, pose)
    np.testing.assert_array_equal(core.pose_covariance, covariance)
    used = core.update(*seen, max_speed=100.0)
    assert (used.accepted, used.too_fast) == (True, False)
    assert np.trace(core.pose_covariance) < np.trace(covariance)


@pytest.mark.parametrize("most", [-1.0, np.nan])
def test_a_bound_that_is_none_is_refused(clip: Clip, most: float) -> None:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    slam.step(clip.frames[0].t, clip.frames[0].image, clip.frames[0].views)
    empty = np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 2))
    with pytest.raises(InputError, match="max_speed: it is negative"):
        slam.filter.update(*empty, max_speed=most)
