"""Recordings that are rendered, not filmed: a small scene, a walk through it and two cameras."""

from __future__ import annotations

from collabslam.simulation.recording import SimulatedRecording, corridor_recording, demo_recording

__all__ = ["SimulatedRecording", "corridor_recording", "demo_recording"]
