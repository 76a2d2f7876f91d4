"""Section 3.3: the paper's ranks as it computed them, and what they do and do not show (METHOD 13)."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction as Q
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from collabslam.types import Array
from collabslam_lab.figures import style
from collabslam_lab.figures.finding import Finding, Table
from collabslam_lab.paper_simulation import planar_rows, worn_bias_rows
from collabslam_lab.paper_simulation.monte_carlo import Study
from collabslam_lab.paper_simulation.rank import TOLERANCE, exact_rank, numeric_nullity, singular_values
from collabslam_lab.paper_simulation.spatial_rows import observability_matrix

Spectra = dict[str, dict[str, Array]]

CAMERA, VELOCITY = (Q(1, 3), Q(-1, 5)), (Q(1, 2), Q(1, 7))
TIMES = tuple(Q(k, 2) for k in range(8))
"""Of the frames that stand for all orders, seconds."""
PATHS: dict[str, tuple[Callable[[int], Q], Callable[[int], Q]]] = {
    "straight path, flat wall": (lambda k: Q(0), lambda i: Q(4)),
    "wiggly path, flat wall": (lambda k: Q((-1) ** k * (k % 4 + 1), 7), lambda i: Q(4)),
    "wiggly path, wall with relief": (
        lambda k: Q((-1) ** k * (k % 4 + 1), 7),
        lambda i: Q(4) + Q((i * i) % 5 - 2, 11),
    ),
}
"""Distance of the camera from its line by frame, and of a landmark from that line by its number, metres."""
_FRAMES_6 = 9
_FEATURES_6 = 6


def make(study: Study) -> Finding:
    """Everything is exact or numeric and takes seconds; only the seed of the 6-DoF scene is used of the
    study."""
    spectra: Spectra = {"paper": {}, "2-DoF": {}, "6-DoF": {}, "wall": {}}
    numbers = {
        "tolerance": TOLERANCE,
        "paper_ranks": _paper(spectra["paper"]),
        "two_dof_nullities": _planar(spectra["2-DoF"]),
        "six_dof_nullities": _spatial(spectra["6-DoF"], study.seed),
        "flat_wall_nullities": _walls(spectra["wall"]),
        "worn_bias_nullities": _worn_bias(study.seed),
    }
    rows = [
        [panel, case, i + 1, float(value)]
        for panel, cases in spectra.items()
        for case, values in cases.items()
        for i, value in enumerate(values)
    ]
    return Finding(
        title="Observability",
        figure=_figure(spectra),
        tables=_tables(numbers),
        verdict=_VERDICT,
        numbers=numbers,
        columns=("panel", "case", "index", "singular_value"),
        rows=rows,
    )


def features(count: int) -> list[planar_rows.Anchor]:
    """Features in general position, with rational anchors, directions and depths."""
    return [
        planar_rows.Anchor(
            origin=(Q(i, 3) - Q(1, 2), Q((i * i) % 5, 10)),
            direction=planar_rows.direction(Q(2 * i + 3, 8)),
            rho=Q(2, 7 + (3 * i) % 5),
        )
        for i in range(count)
    ]


def _paper(spectra: dict[str, Array]) -> dict[str, Any]:
    """Eq. 13 with 0, 1 and 2 depths, four landmarks; exact. Then the same system with all orders and no
    depth."""
    four = features(4)
    out: dict[str, Any] = {"columns": 10}
    for depths in range(3):
        rows = planar_rows.lie_rows(CAMERA, VELOCITY, four, depths)
        out[f"{depths}_depths"] = {"rank": exact_rank(rows), "rows": len(rows)}
        spectra[f"{depths} depths, {len(rows)} rows"] = _spectrum(rows)
    rows = planar_rows.moving_rows(CAMERA, VELOCITY, TIMES, four, parameters="rho", ranges=0)
    out["0_depths_all_orders"] = {"rank": exact_rank(rows), "rows": len(rows)}
    spectra["0 depths, all orders"] = _spectrum(rows)
    return out


def _planar(spectra: dict[str, Array]) -> dict[str, Any]:
    """2-DoF, constant velocity, nothing known beforehand; exact."""
    out: dict[str, Any] = {}
    count = 4
    for parameters in ("point", "anchor"):
        cases = {}
        for ranges in range(3):
            rows = planar_rows.moving_rows(
                CAMERA, VELOCITY, TIMES, features(count), parameters=parameters, ranges=ranges
            )
            nullity = len(rows[0]) - exact_rank(rows)
            # An anchor and a direction describe a point in two ways too many.
            cases[f"{ranges}_ranges"] = nullity - (2 * count if parameters == "anchor" else 0)
            if parameters == "point":
                spectra[f"{ranges} ranges"] = _spectrum(rows)
        out[parameters] = cases
    out["redundant_per_anchored_feature"] = 2
    return out


def _spatial(spectra: dict[str, Array], seed: int) -> dict[str, Any]:
    """6-DoF, constant velocity; numeric."""
    out: dict[str, Any] = {}
    for parameters, redundant in (("euclidean", 0), ("inverse-depth", 3)):
        cases = {}
        for points in range(3):
            matrix = observability_matrix(
                seed,
                features=_FEATURES_6,
                frames=_FRAMES_6,
                points=points,
                parameters=parameters,
                quaternion=False,
            )
            cases[f"{points}_points"] = numeric_nullity(matrix) - redundant * _FEATURES_6
            if parameters == "euclidean":
                spectra[f"{points} 3D points"] = singular_values(matrix)
        out[parameters] = cases
    matrix = observability_matrix(
        seed, features=_FEATURES_6, frames=_FRAMES_6, points=0, parameters="euclidean", quaternion=True
    )
    out["quaternion_0_points"] = numeric_nullity(matrix)
    out["redundant_per_inverse_depth_feature"] = 3
    return out


def _walls(spectra: dict[str, Array]) -> dict[str, int]:
    """2-DoF, poses free, landmarks on a wall; exact."""
    out = {}
    for name, (aside, relief) in PATHS.items():
        cameras = [(Q(k, 2), aside(k)) for k in range(8)]
        points = [(Q(3 * i, 5) - 1, relief(i)) for i in range(9)]
        rows = planar_rows.free_rows(cameras, points)
        out[name] = len(rows[0]) - exact_rank(rows)
        spectra[name] = _spectrum(rows)
    return out


def _worn_bias(seed: int) -> dict[str, dict[str, int]]:
    """6-DoF, poses free, T_CF with an error that lasts and a clock that is off; numeric."""
    return {
        name: {
            "views_alone": worn_bias_rows.untold(motion, seed, known_length=False),
            "with_a_known_length": worn_bias_rows.untold(motion, seed, known_length=True),
        }
        for name, motion in worn_bias_rows.MOTIONS.items()
    }


def _spectrum(rows: list[planar_rows.Row]) -> Array:
    return singular_values(np.array([[float(v) for v in row] for row in rows]))


def _tables(numbers: dict[str, Any]) -> list[Table]:
    paper, planar = numbers["paper_ranks"], numbers["two_dof_nullities"]
    spatial, wall = numbers["six_dof_nullities"], numbers["flat_wall_nullities"]
    ranks = [
        [
            f"{d} pseudo-stereo depths",
            note,
            str(8 + d),
            str(paper[f"{d}_depths"]["rank"]),
            str(paper[f"{d}_depths"]["rows"]),
        ]
        for d, note in (
            (0, "8 rows cannot have a rank of 10"),
            (1, "one row more, one rank more"),
            (2, "one row more, one rank more"),
        )
    ]
    all_orders = paper["0_depths_all_orders"]
    ranks.append(
        [
            "0 depths, all orders", "full rank without any depth: the known anchors hold the scale", "-",
            str(all_orders["rank"]), str(all_orders["rows"]),
        ]
    )  # fmt: skip
    truth = [
        ["2-DoF, bearings", "2", str(planar["point"]["0_ranges"]), "translation 2, rotation 1, scale 1"],
        ["2-DoF, one range", "1", str(planar["point"]["1_ranges"]), "translation 2, rotation 1"],
        ["2-DoF, two ranges", "0", str(planar["point"]["2_ranges"]), "the same: no range gives a pose"],
        ["2-DoF, anchors as states, 0, 1, 2 ranges", "-", _list(planar["anchor"]), "2 spare a feature"],
        ["6-DoF, pixels", "-", str(spatial["euclidean"]["0_points"]), "pose 6, scale 1"],
        ["6-DoF, one 3D point", "-", str(spatial["euclidean"]["1_points"]), "pose 6"],
        ["6-DoF, two 3D points", "-", str(spatial["euclidean"]["2_points"]), "the same"],
        ["6-DoF, inverse depth, 0, 1, 2 points", "-", _list(spatial["inverse-depth"]), "3 spare a feature"],
        ["6-DoF, pixels, quaternion", "-", str(spatial["quaternion_0_points"]), "one more: its norm"],
        *[[f"2-DoF, poses free, {name}", "-", str(n), "general position has 4"] for name, n in wall.items()],
    ]  # fmt: skip
    return [
        Table(
            "Rank of the paper's observability matrix (four landmarks, anchors known, 10 columns), exact:",
            ("case", "what it shows", "paper", "ours", "rows"), ranks,
        ),
        Table(
            "Dimension of what cannot be observed, nothing known beforehand (2-DoF exact; 6-DoF by "
            f"singular values below {TOLERANCE:g} of the largest):",
            ("case", "what it is", "paper", "ours"), [[c, what, *n] for c, *n, what in truth],
        ),
        Table(
            "Beyond the paper: how many of the seven numbers of T_CF's time-correlated error and Cf's clock "
            "(METHOD 26) are not told, by how both cameras move:",
            ("motion", "by views of Cf alone", "with a known length"),
            [[name, *map(str, n.values())] for name, n in numbers["worn_bias_nullities"].items()],
        ),
    ]  # fmt: skip


def _list(cases: dict[str, int]) -> str:
    return ", ".join(map(str, cases.values()))


_VERDICT = (
    "The paper's ranks 8, 9 and 10 are right, but they are the numbers of its rows, which are all "
    "independent; they do not show that scale cannot be observed without depth, since its anchors, fixed "
    "at known places, hold metric baselines, and with higher orders the same system has full rank without "
    "any depth. What may be claimed: with nothing known beforehand, bearings leave pose and scale open; "
    "in general position one metric depth on a connected map makes scale observable, and more add "
    "nothing; the pose in the world never is. Constant velocity fixes no scale. A flat wall seen from "
    "free poses is worse than the general case: it is a critical configuration. (Eq. 10 and 11 differ by "
    "pi, and Eq. 12 is the depth from the anchor; here the bearing points at the landmark and the range "
    "is the present one, except in the paper's own matrix.)"
)


def _figure(spectra: Spectra) -> Any:
    figure, panels = style.canvas(
        1, 4, (16.0, 4.9), "Observability: singular values, and how many of them are zero", sharey=True
    )
    titles = (
        "the paper's matrix (10 columns)", "2-DoF, nothing known (14)", "6-DoF, nothing known (30)",
        "2-DoF wall, poses free (42)",
    )  # fmt: skip
    for axes, title, cases in zip(panels[0], titles, spectra.values(), strict=True):
        _spectra(axes, cases)
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("number, from the largest")
    panels[0, 0].set_ylabel("singular value / largest")
    return figure


def _spectra(axes: Axes, cases: dict[str, Array]) -> None:
    colours = (style.MONO, style.COLLAB, style.COLOURS["gauge"], style.GREY)
    for k, ((case, values), colour) in enumerate(zip(cases.items(), colours, strict=False)):
        zeros = int((values < TOLERANCE).sum())
        shown = np.maximum(values, 1e-17)
        label = f"{case}: {zeros} zero" if zeros else f"{case}: none zero"
        axes.semilogy(
            np.arange(1, len(shown) + 1) + 0.12 * k, shown, marker="osD^"[k], markersize=4.5, linewidth=0.8,
            color=colour, label=label,
        )  # fmt: skip
    axes.axhline(TOLERANCE, color=style.INK, linewidth=1.0, linestyle=":")
    axes.set_ylim(1e-18, 5.0)
    style.legend(axes, "lower left")
