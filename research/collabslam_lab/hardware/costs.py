"""What a wrong focal length costs on the demo's corridor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collabslam import run
from collabslam._core import Camera
from collabslam.datasets.wrapped import FirstFrames, WrappedRecording
from collabslam.simulation import corridor_recording
from collabslam.types import Image, Recording
from collabslam_lab.report import markdown_table

FOCAL_PERCENT = (-10.0, -3.0, -1.0, 0.0, 1.0, 3.0, 10.0)


class OtherFocal(WrappedRecording):
    """A recording whose calibration of Cs has a focal length that is wrong by a share."""

    def __init__(self, base: Recording, share: float) -> None:
        super().__init__(base)
        lens = base.camera
        fx, fy, cx, cy = lens.intrinsics
        wrong = ((1.0 + share) * fx, (1.0 + share) * fy, cx, cy)
        self.camera = Camera(lens.model, lens.width, lens.height, wrong, lens.distortion)

    def image(self, i: int) -> Image:
        """The (H, W) uint8 image of Cs in frame ``i``."""
        return self._base.image(i)


def _row(label: str, recordings: Sequence[Recording]) -> list[str]:
    """Medians over recordings: position error over all frames, scale, sharpness, OK."""
    done = [run(recording).summary for recording in recordings]

    def median(key: str, form: str, factor: float = 1.0) -> str:
        values = [s[key] for s in done if s.get(key) is not None]
        return format(factor * float(np.median(values)), form) if values else "-"

    return [
        label,
        median("ate_pct_all_frames", ".2f"),
        median("scale_error", "+.2f", 100.0),
        median("sharpness_position", ".2f"),
        median("ok_share", ".0%"),
    ]


def costs(seeds: Sequence[int], frames: int | None = None) -> str:
    """A table in Markdown.

    Parameters
    ----------
    seeds : sequence of int
        Of the demo's noise.
    frames : int, optional
        Only so many from the first one on.
    """
    head = ["ATE over all frames, % of the way", "scale, %", "error over claimed sd", "frames OK"]

    def cut(recording: Recording) -> Recording:
        return recording if frames is None else FirstFrames(recording, frames)

    demos = [corridor_recording(seed) for seed in seeds]
    focal = [_row(f"{p:+g} %", [cut(OtherFocal(demo, p / 100.0)) for demo in demos]) for p in FOCAL_PERCENT]
    return markdown_table(["Cs's focal length is off by", *head], focal)
