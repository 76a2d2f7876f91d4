"""What a gyroscope is worth in rendered worlds."""

from __future__ import annotations

from collabslam_lab.gyro.study import study_gyro

__all__ = ["study_gyro"]
