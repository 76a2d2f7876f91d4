"""Recordings whose T_CF is along other camera axes than ours (x right, y down, z forward), turned to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collabslam.datasets.gate import tell
from collabslam.datasets.ordered import DiskRecording
from collabslam.datasets.poses import axes_of
from collabslam.types import WornView


def with_t_cf_turned(recording: DiskRecording, axes: str) -> DiskRecording:
    """The recording whose measured ``T_CF`` was between axes of both cameras that ``axes`` names.

    Raises
    ------
    SettingsError
        If there are no such axes.
    """
    turn = axes_of(axes)
    if axes == "optical":
        return recording
    tell("axes of T_CF", f"{axes} of both cameras, turned to optical ones", "--t-cf-axes")
    block = np.kron(np.eye(2), turn[:3, :3].T)

    def turned(view: WornView) -> WornView:
        bias = None if view.bias is None else block @ view.bias @ block.T
        t_cf, covariance = turn.T @ view.t_cf @ turn, block @ view.covariance @ block.T
        return replace(view, t_cf=t_cf, covariance=covariance, bias=bias)

    return replace(recording, worn={name: one.with_views(turned) for name, one in recording.worn.items()})
