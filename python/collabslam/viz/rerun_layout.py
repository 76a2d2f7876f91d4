"""How the Rerun viewer arranges a run: space and pictures large, curves beside them."""

from __future__ import annotations

from typing import Any

CURVES = (
    ("status", "status (3 OK, 2 DOUBTFUL, 1 COASTING, 0 LOST)", ("status",)),
    ("features", "features", ("predicted", "accepted", "cf_matches", "map_size")),
    ("time", "ms a frame", ("ms_total",)),
    ("nis", "NIS of the bearings", ("nis",)),
    ("sigma", "sd of the position, m", ("position_sigma_m",)),
)
LOGGED = tuple(key for group in CURVES for key in group[2] if key not in ("status", "position_sigma_m"))


def curve(key: str) -> str:
    """Entity of a curve: those of one picture are below one entity."""
    return next(f"curves/{group}/{key}" for group, _, keys in CURVES if key in keys)


def blueprint() -> Any:
    """The viewer's layout; needs the extra ``viz``."""
    import rerun.blueprint as rrb

    space = rrb.Spatial3DView(origin="world", name="map, path and cameras")
    pictures = [
        rrb.Spatial2DView(origin="world/cs/image", name="Cs, the robot's camera"),
        rrb.Spatial2DView(origin="cf/image", name="Cf, the worn camera"),
    ]
    curves = [rrb.TimeSeriesView(origin=f"curves/{group}", name=name) for group, name, _ in CURVES]
    left = rrb.Vertical(space, rrb.Horizontal(*pictures), row_shares=[3, 2])
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*curves), column_shares=[3, 1]), collapse_panels=True
    )
