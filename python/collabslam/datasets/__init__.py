"""Recordings: every supported layout becomes a :class:`collabslam.types.Recording`."""

from __future__ import annotations

from collabslam.datasets.calibration import load_camera
from collabslam.datasets.emulated.worn import attach_worn
from collabslam.datasets.opening import open_recording, recognised_layouts
from collabslam.datasets.readers.collab import write_recording

__all__ = ["attach_worn", "load_camera", "open_recording", "recognised_layouts", "write_recording"]
