"""T_CF surer than any sensor: a floor is taken and told; what states its error stays as it is."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import Slam
from collabslam.slam.worn.matcher import FLOOR, SUREST
from collabslam.types import Array, WornView


def engine(clip: Clip) -> Slam:
    return Slam(clip.recording.camera, clip.recording.worn_camera)


def stated(clip: Clip, covariance: Array) -> WornView:
    return replace(clip.frames[0].views[0], covariance=covariance, bias=None)


@pytest.mark.parametrize("variances", [[1e-9] * 6, [1e-14] * 6, [1e-4] * 5 + [1e-9], [1e-9] + [1e-2] * 5])
def test_a_placeholder_is_met_by_a_floor_and_told_once(clip: Clip, variances: list[float]) -> None:
    worn = engine(clip)._parts.worn
    view = stated(clip, np.diag(variances))
    with pytest.warns(UserWarning, match="surer than any sensor"):
        found = worn.require(view).covariance
    np.testing.assert_allclose(found, view.covariance + FLOOR**2 * np.eye(6))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        worn.require(view)


def test_what_a_sensor_can_tell_stays_to_the_bit(clip: Clip) -> None:
    worn = engine(clip)._parts.worn
    for scale in (1.01 * SUREST, 1e-3, 0.1):
        view = stated(clip, scale**2 * np.eye(6))
        assert worn.require(view).covariance.tobytes() == view.covariance.tobytes()
