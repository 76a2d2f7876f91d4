"""How the Rerun viewer arranges a run: space and pictures large, curves beside them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

CURVES = (
    ("status", "status (3 OK, 2 DEGRADED, 1 COASTING, 0 LOST, -1 NOT_STARTED)", ("status",)),
    ("features", "features", ("predicted", "accepted", "cf_matches", "map_size")),
    ("time", "ms a frame", ("ms_total",)),
    ("nis", "NIS of the bearings", ("nis",)),
    ("sigma", "sd of the position, m", ("position_sigma_m",)),
)
BEHIND, AHEAD = (1.5, -3.0, -4.0), (0.0, 0.0, 2.0)
"""Where the picture of space is seen from, and what it looks at, metres in W (x right, y down, z forward)."""
LOGGED = tuple(key for group in CURVES for key in group[2] if key not in ("status", "position_sigma_m"))


def curve(key: str) -> str:
    """Entity of a curve: those of one picture are below one entity."""
    return next(f"curves/{group}/{key}" for group, _, keys in CURVES if key in keys)


def picture_of(name: str) -> str:
    """Entity of a worn camera's picture, by the name of whoever wears it; "" is that of a single one."""
    return f"cf/{name}/image" if name else "cf/image"


def blueprint(names: Iterable[str]) -> Any:
    """The viewer's layout for the worn cameras of these names; needs the extra ``viz``."""
    import rerun.blueprint as rrb

    # From behind and above at the start, and from then on along with Cs: overlaps reach far beyond the map.
    eye = rrb.EyeControls3D(
        position=BEHIND, look_target=AHEAD, eye_up=(0.0, -1.0, 0.0), tracking_entity="/world/cs"
    )
    space = rrb.Spatial3DView(origin="world", name="map, path and cameras", eye_controls=eye)
    pictures = [
        rrb.Spatial2DView(origin="world/cs/image", name="Cs, the robot's camera"),
        *(
            rrb.Spatial2DView(
                origin=picture_of(name), name=f"Cf, worn by {name}" if name else "Cf, the worn camera"
            )
            for name in names
        ),
    ]
    curves = [rrb.TimeSeriesView(origin=f"curves/{group}", name=name) for group, name, _ in CURVES]
    left = rrb.Vertical(space, rrb.Horizontal(*pictures), row_shares=[3, 2])
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*curves), column_shares=[3, 1]), collapse_panels=True
    )
