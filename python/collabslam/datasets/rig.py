"""The second camera of a rigid rig in the part of Cf: always there, where its calibration says."""

from __future__ import annotations

from dataclasses import replace

from collabslam.datasets.emulated.pose_noise import RIG_NOISE
from collabslam.datasets.images import read_grey
from collabslam.datasets.recording import Rig
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.types import Frame, Recording, WornView


class RigRecording(WrappedRecording):
    """A recording with the views of its rig's second camera.

    The error of ``T_CF`` (2 mm, 0.05 degrees) is that of the calibration: all of it lasts.

    Parameters
    ----------
    base : Recording
    rig : Rig
    """

    def __init__(self, base: Recording, rig: Rig) -> None:
        super().__init__(base)
        self._rig = rig
        self.worn_camera = rig.camera
        self.rig_used = True

    def frame(self, i: int) -> Frame:
        """Frame ``i`` with the second camera's view."""
        frame = self._base.frame(i)
        if i not in self._rig.paths:
            return frame
        covariance = RIG_NOISE.covariance
        image = read_grey(self._rig.paths[i], self._rig.camera)
        return replace(frame, views=(WornView(image, self._rig.t_cf, covariance, covariance, body=False),))


def with_rig(recording: Recording) -> Recording:
    """The recording with its rig's second camera as Cf, where it has one and no Cf of its own."""
    rig = getattr(recording, "rig", None)
    if recording.worn_camera is not None or rig is None:
        return recording
    return RigRecording(recording, rig)
