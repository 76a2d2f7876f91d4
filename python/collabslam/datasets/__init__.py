"""Recordings: every supported layout becomes a :class:`collabslam.types.Recording`."""

from __future__ import annotations

from collabslam.datasets.calibration import load_camera
from collabslam.datasets.emulated.worn import attach_worn
from collabslam.datasets.opening import open_recording, recognised_layouts
from collabslam.datasets.recording_writer import RecordingWriter, write_recording
from collabslam.datasets.source import Source, WornSpec
from collabslam.datasets.wrapped import FirstFrames

__all__ = [
    "FirstFrames",
    "RecordingWriter",
    "Source",
    "WornSpec",
    "attach_worn",
    "load_camera",
    "open_recording",
    "recognised_layouts",
    "write_recording",
]
