"""Between frames: where a gyroscope's samples and constant velocity carry the camera, and how surely."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import Slam
from collabslam.geometry import pose_inverse, rotation_exp, rotation_log, se3_exp
from collabslam.live.propagation import LONGEST, Motion, Propagated, Propagator
from collabslam.types import Array

R_CI = rotation_exp([0.3, -1.2, 0.4])
BIAS = np.array([0.01, -0.02, 0.015])
RATE = np.array([0.4, -0.7, 0.2])
TWIST = np.array([0.5, -0.1, 1.0, *RATE])
START = se3_exp([1.0, 2.0, 3.0, 0.2, -0.4, 0.1])
OFFSET = 0.007
STEP = 0.004


def motion(
    start: Array = START, twist: Array = TWIST, covariance: Array | None = None, **other: Array
) -> Motion:
    spread = np.eye(12) * 1e-4 if covariance is None else covariance
    return Motion(10.0, start, twist, spread, other.get("bias", BIAS), np.full(3, 1e-3), OFFSET)


def propagated(known: Motion, seconds: float, *, noise: tuple[float, float] = (0.0, 0.0)) -> list[Propagated]:
    """Answers to samples of a constant rate, from before the frame until so much later."""
    through = Propagator(R_CI, *noise, 100.0)
    through.motion = known
    stamps = 10.0 - OFFSET + STEP * np.arange(-10, int(seconds / STEP) + 1)
    answers = [through.add(float(t), R_CI.T @ RATE + BIAS) for t in stamps]
    return [one for one in answers if one is not None]


def test_it_goes_where_the_camera_went() -> None:
    answers = propagated(motion(), 0.2)
    assert np.diff([a.t for a in answers]) == pytest.approx(
        0.012
    )  # of samples at 250 Hz, 100 poses a second at most
    last = answers[-1]
    dt = last.t - 10.0
    np.testing.assert_allclose(last.pose[:3, :3], START[:3, :3] @ rotation_exp(RATE * dt), atol=1e-9)
    np.testing.assert_allclose(last.pose[:3, 3], START[:3, 3] + dt * START[:3, :3] @ TWIST[:3], atol=1e-9)
    np.testing.assert_allclose(last.twist[3:], RATE, atol=1e-9)
    np.testing.assert_allclose(last.pose[:3, :3] @ last.twist[:3], START[:3, :3] @ TWIST[:3], atol=1e-9)


def test_its_covariance_is_that_of_its_errors() -> None:
    draw = np.random.default_rng(2)
    root = draw.normal(size=(12, 12)) * np.repeat([2e-3, 1e-3, 4e-3, 1e-3], 3)[:, None]
    told = propagated(motion(covariance=root @ root.T), 0.3)[-1]
    errors = []
    for k in range(15):  # points about the mean whose covariance is the one given, that of the bias included
        for sign in (-1.0, 1.0):
            unit = sign * np.sqrt(15.0) * np.eye(15)[k]
            xi = root @ unit[:12]
            wrong = motion(START @ se3_exp(xi[:6]), TWIST + xi[6:], bias=BIAS - unit[12:] * 1e-3)
            moved = propagated(wrong, 0.3)[-1]
            assert moved.t == told.t
            error = pose_inverse(told.pose) @ moved.pose
            errors.append([*error[:3, 3], *rotation_log(error[:3, :3])])
    found = np.cov(np.array(errors).T, bias=True)
    np.testing.assert_allclose(found, told.covariance, atol=2e-5 * np.abs(told.covariance).max())


def test_noise_and_time_make_it_less_sure() -> None:
    quiet, loud = (propagated(motion(), 0.3, noise=noise) for noise in ((0.0, 0.0), (0.05, 2.0)))
    assert (np.diff([np.trace(a.covariance) for a in loud]) > 0.0).all()
    dt, more = loud[-1].t - 10.0, loud[-1].covariance - quiet[-1].covariance
    assert more[0, 0] == pytest.approx(4.0 * dt**3 / 3.0, rel=1e-6)
    assert more[4, 4] == pytest.approx(0.05**2 * dt, rel=1e-6)


def test_what_is_not_known_is_not_told() -> None:
    answers = propagated(motion(), LONGEST + 0.5)
    assert answers[-1].t - 10.0 <= LONGEST
    through = Propagator(R_CI, 0.0, 0.0, 100.0)
    assert through.add(9.99, RATE) is None  # there was no frame
    through.motion = motion()
    assert through.add(10.02, RATE) is not None
    assert through.add(10.2, RATE) is None  # the samples have a gap
    late = Propagator(R_CI, 0.0, 0.0, 100.0)
    late.motion = motion()
    assert late.add(10.3, RATE) is None  # nothing tells how it turned since the frame


def test_the_filter_tells_twist_and_covariance(clip: Clip) -> None:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    for frame in clip.frames[:9]:
        slam.step(frame.t, frame.image, frame.views)
    core = slam.filter
    joint = core.pose_and_twist_covariance
    np.testing.assert_allclose(joint[:6, :6], core.pose_covariance, rtol=1e-12, atol=1e-18)
    turn = core.pose[:3, :3]
    np.testing.assert_allclose(core.twist, [*(turn.T @ core.velocity), *core.angular_velocity], atol=1e-12)
    true = clip.recording.robot
    (before, after), dt = (true(clip.frames[8].t + d) for d in (-0.05, 0.05)), 0.1
    seen = pose_inverse(before) @ after
    error = core.twist - [*seen[:3, 3] / dt, *rotation_log(seen[:3, :3]) / dt]
    assert error @ np.linalg.solve(joint[6:, 6:], error) < 22.5  # chi-square, 6 degrees of freedom, 99.9 %
    assert np.linalg.eigvalsh(joint)[0] > -1e-12
