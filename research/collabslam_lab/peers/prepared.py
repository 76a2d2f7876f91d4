"""A recording as files that another system's script reads, and what it leaves there."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError
from collabslam.types import Array, Image, Recording
from collabslam_lab.peers.systems import SCRIPTS, Peer

COLMAP_FEATURES = 4000
WIDE = 1000
"""Pixels from which on ORB-SLAM3 gets 2000 features, as its own settings for KITTI do; below it is 1000."""
_LOG = "log.txt"

Positions = dict[int, list[float]]
Arrays = dict[int, Array]


@dataclass(frozen=True)
class SystemResult:
    """What a system found.

    Attributes
    ----------
    live : dict of frame to position
        As told when the frame came; empty for what works offline.
    final : dict of frame to position
        Put right by later frames; empty for what does not do that.
    cpu : float
        Seconds of all threads.
    wall : list of float
        Seconds of each frame; empty for what works offline.
    turns : dict of frame to (3, 3) float64
        R_WC, of the poses by which its authors would judge it; empty where it told none.
    covariances : dict of frame to (6, 6) float64
        Of these poses, over (translation, rotation), tangent on the right; of what is held fixed, zero.
    residual_px : float or None
        RMS of one coordinate's residual where the covariance takes all pixels to err by one.
    """

    live: Positions
    final: Positions
    cpu: float
    wall: list[float] = field(default_factory=list)
    turns: Arrays = field(default_factory=dict)
    covariances: Arrays = field(default_factory=dict)
    residual_px: float | None = None

    @property
    def best(self) -> Positions:
        """The positions by which its authors would judge it."""
        return self.final or self.live


def write_job(
    recording: Recording,
    folder: Path,
    *,
    right: Sequence[Image] | None = None,
    baseline: float = 0.0,
    vocabulary: Path | None = None,
    few: int = 100,
) -> list[int]:
    """Writes images and what else a script needs; returns the frames for systems that work offline.

    Parameters
    ----------
    recording : Recording
        Without distortion.
    folder : Path
        Is made.
    right : sequence of (H, W) uint8, optional
        The other images of rectified pairs.
    baseline : float
        Of the pairs, metres; 0 without.
    vocabulary : Path, optional
        For systems that need one.
    few : int
        Frames at most for systems that work offline, evenly spread.
    """
    folder.mkdir(parents=True)
    count, camera = len(recording), recording.camera
    np.save(folder / "left.npy", np.stack([recording.image(i) for i in range(count)]))
    if right is not None:
        np.save(folder / "right.npy", np.stack(right))
    times = np.asarray(recording.times) - recording.times[0]
    spread = list(range(0, count, -(-count // few)))
    job = {
        "intrinsics": camera.intrinsics,
        "times": times.tolist(),
        "baseline": baseline,
        "vocabulary": None if vocabulary is None else str(vocabulary.absolute()),
        "few": spread,
        "features": COLMAP_FEATURES,
    }
    (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
    (folder / "settings.yaml").write_text(_settings(camera, times, baseline), encoding="utf-8")
    return spread


def _settings(camera: Camera, times: Array, baseline: float) -> str:
    """ORB-SLAM3's own file of settings, in the form without a version.

    It ends the process where a number has no decimal point, and dies on rectified pairs in the newer form.
    """
    fx, fy, cx, cy = camera.intrinsics
    rate = (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 30.0
    values: dict[str, Any] = {
        "Camera.type": '"PinHole"',
        **{f"Camera.{k}": float(x) for k, x in zip(("fx", "fy", "cx", "cy"), (fx, fy, cx, cy), strict=True)},
        **{f"Camera.{k}": 0.0 for k in ("k1", "k2", "p1", "p2")},
        "Camera.width": camera.width,
        "Camera.height": camera.height,
        "Camera.fps": float(rate),
        "Camera.bf": float(fx * baseline),
        "Camera.RGB": 1,
        "ThDepth": 40.0,
        "ORBextractor.nFeatures": 2000 if camera.width > WIDE else 1000,
        "ORBextractor.scaleFactor": 1.2,
        "ORBextractor.nLevels": 8,
        "ORBextractor.iniThFAST": 20,
        "ORBextractor.minThFAST": 7,
        "Viewer.KeyFrameSize": 0.05,  # of a window that is never opened
        "Viewer.KeyFrameLineWidth": 1.0,
        "Viewer.GraphLineWidth": 0.9,
        "Viewer.PointSize": 2.0,
        "Viewer.CameraSize": 0.08,
        "Viewer.CameraLineWidth": 3.0,
        "Viewer.ViewpointX": 0.0,
        "Viewer.ViewpointY": -0.7,
        "Viewer.ViewpointZ": -1.8,
        "Viewer.ViewpointF": 500.0,
    }
    return "%YAML:1.0\n---\n" + "".join(f"{key}: {value}\n" for key, value in values.items())


def run_script(peer: Peer, python: Path, folder: Path, seconds: float) -> SystemResult:
    """What a system finds in a prepared folder, in a process of its own environment.

    Raises
    ------
    DataError
        If it breaks down, takes longer than so many seconds, or leaves nothing that can be read.
    """
    with (folder / _LOG).open("wb") as log:
        try:
            words = [python, SCRIPTS / peer.script, folder.absolute()]
            code = subprocess.run(
                words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd=folder, timeout=seconds
            ).returncode
        except subprocess.TimeoutExpired as error:
            raise DataError(f"It took longer than {seconds:g} s.") from error
        except OSError as error:
            raise DataError(f"It cannot be run: {error}.") from error
    if code:
        said = (folder / _LOG).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        raise DataError(f"It ended with the code {code}{': ' + said[-1] if said else ''}")
    try:
        told = json.loads((folder / "found.json").read_text(encoding="utf-8"))
        return SystemResult(
            _positions(told.get("live", {})),
            _positions(told.get("final", {})),
            float(told["cpu"]),
            [float(x) for x in told.get("wall", [])],
            _arrays(told.get("turns", {}), (3, 3)),
            _arrays(told.get("covariances", {}), (6, 6)),
            None if told.get("residual_px") is None else float(told["residual_px"]),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(f"It left nothing that can be read ({type(error).__name__}: {error}).") from error


def _positions(told: Mapping[str, Sequence[float]]) -> Positions:
    positions = {int(k): [float(x) for x in position] for k, position in told.items()}
    return {k: p for k, p in positions.items() if len(p) == 3 and np.isfinite(p).all()}


def _arrays(told: Mapping[str, Sequence[Sequence[float]]], shape: tuple[int, int]) -> Arrays:
    arrays = {int(k): np.asarray(array, np.float64) for k, array in told.items()}
    return {k: a for k, a in arrays.items() if a.shape == shape and np.isfinite(a).all()}
