"""Settings of the front end: names, defaults, ranges and units, all in this one place.

Each group is a frozen dataclass whose fields carry their own range and description; :data:`FRONTEND` lists
them as flat dotted keys (``search.min_score``) for settings files, help texts and documentation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from collabslam.errors import SettingsError

Value = bool | int | float | str


def _setting(
    default: Value,
    doc: str,
    *,
    low: float | None = None,
    high: float | None = None,
    unit: str = "",
    choices: tuple[str, ...] = (),
) -> Any:
    """Dataclass field of one setting, with what a reader has to know of it."""
    return field(
        default=default, metadata={"doc": doc, "min": low, "max": high, "unit": unit, "choices": choices}
    )


@dataclass(frozen=True)
class DetectSettings:
    """Corners in an image: spread over it, and sharp enough to be tracked."""

    quality: float = _setting(
        0.002, "Least corner response (smaller eigenvalue) as a share of the image's best.", low=0.0, high=1.0
    )
    min_gradient: float = _setting(
        2.0,
        "Least root-mean-square gradient along a corner's weaker direction; keeps noise out of flat images.",
        low=0.0,
        high=100.0,
        unit="grey levels per pixel",
    )
    block: int = _setting(
        5, "Side of the window in which gradients are collected (odd).", low=3, high=15, unit="pixel"
    )
    min_distance: float = _setting(
        0.0125,
        "Least distance between corners, and from existing points, as a share of the image's width.",
        low=0.002,
        high=0.2,
        unit="image width",
    )
    cells: int = _setting(
        8, "Cells along the image's longer side; the emptiest cell is served first.", low=1, high=64
    )
    subpixel: bool = _setting(True, "Refine corners to sub-pixel precision.")


@dataclass(frozen=True)
class PatchSettings:
    """Landmark patches and their warping to another view."""

    size: int = _setting(15, "Side of the template that is correlated (odd).", low=7, high=31, unit="pixel")
    margin: int = _setting(
        14,
        "Pixels stored around the template's reach, so that rotating and shrinking it stays inside.",
        low=0,
        high=64,
        unit="pixel",
    )
    min_area: float = _setting(
        0.2, "Least change of area (view / reference) at which a patch is still warped.", low=0.01, high=1.0
    )
    max_area: float = _setting(
        5.0,
        "Largest change of area (view / reference) at which a patch is still warped.",
        low=1.0,
        high=100.0,
    )
    max_stretch: float = _setting(
        4.0, "Largest ratio of the warp's two scales: a steeper view is refused.", low=1.0, high=100.0
    )
    min_deviation: float = _setting(
        4.0,
        "Least standard deviation of a template; a flatter one cannot be located.",
        low=0.0,
        high=128.0,
        unit="grey levels",
    )


@dataclass(frozen=True)
class SearchSettings:
    """Active search: zero-normalised cross-correlation inside the predicted ellipse (METHOD section 7)."""

    gate: float = _setting(
        3.0, "Radius of the search ellipse in standard deviations of S.", low=1.0, high=6.0
    )
    min_radius: float = _setting(2.5, "Least radius of the search ellipse.", low=1.0, high=50.0, unit="pixel")
    large_radius: float = _setting(
        16.0,
        "Radius above which the ellipse is not searched whole when optical flow offers a guess inside it.",
        low=2.0,
        high=200.0,
        unit="pixel",
    )
    max_radius: float = _setting(
        48.0,
        "Cap of the search window's half side, which bounds the cost of a poor prediction.",
        low=4.0,
        high=400.0,
        unit="pixel",
    )
    guess_radius: float = _setting(
        6.0, "Half side of the window searched around a guess.", low=1.0, high=50.0, unit="pixel"
    )
    guess_gate: float = _setting(
        1.5, "Factor on the ellipse inside which a guess is believed.", low=1.0, high=10.0
    )
    min_score: float = _setting(
        0.78, "Least correlation of the peak (1 is a perfect match).", low=-1.0, high=1.0
    )
    ambiguity: float = _setting(
        0.94, "A second peak above this share of the best score makes a match ambiguous.", low=0.0, high=1.0
    )
    peak_distance: float = _setting(
        3.0, "Peaks nearer than this to the best one belong to it.", low=1.0, high=20.0, unit="pixel"
    )


@dataclass(frozen=True)
class FlowSettings:
    """Pyramidal optical flow from one frame to the next, as a guess for the search."""

    window: int = _setting(15, "Side of the flow's window (odd).", low=5, high=51, unit="pixel")
    levels: int = _setting(3, "Pyramid levels above the flow's own resolution.", low=0, high=6)
    max_error: float = _setting(
        1.5,
        "Largest distance between a point and itself tracked forth and back.",
        low=0.1,
        high=20.0,
        unit="pixel",
    )
    small_width: int = _setting(
        64,
        "Largest width of the small images from which the global motion is found.",
        low=20,
        high=400,
        unit="pixel",
    )


@dataclass(frozen=True)
class WornSettings:
    """Matches between the robot's view Cs and the worn camera's view Cf (METHOD sections 7 and 9)."""

    corners: int = _setting(
        500, "Most interest points searched in Cf's region of interest.", low=20, high=5000
    )
    corner_distance: float = _setting(
        0.008,
        "Least distance between them, as a share of the image's width.",
        low=0.002,
        high=0.1,
        unit="image width",
    )
    descriptor: str = _setting(
        "warped-sift",
        "Descriptor: SIFT on windows warped as Cf sees them, OpenCV's SIFT, or ORB.",
        choices=("warped-sift", "sift", "orb"),
    )
    support: float = _setting(
        36.0, "Side of the window that a descriptor covers.", low=12.0, high=128.0, unit="pixel"
    )
    ratio: float = _setting(
        0.85,
        "Largest ratio of the best to the second best descriptor distance among the candidates in the gate.",
        low=0.1,
        high=1.0,
    )
    max_distance: float = _setting(
        0.85, "Largest distance of two descriptors (unit vectors).", low=0.1, high=2.0
    )
    sigma: float = _setting(
        1.0, "Standard deviation of a corner's pixel, for the gates.", low=0.1, high=10.0, unit="pixel"
    )
    gate: float = _setting(
        3.0, "Radius of the epipolar and depth gates in standard deviations.", low=1.0, high=6.0
    )
    depth_floor: float = _setting(
        0.1,
        "Least relative standard deviation of a known inverse range: maps are off by more than they say.",
        low=0.0,
        high=1.0,
    )
    min_range: float = _setting(0.3, "Least distance of a point from Cs.", low=0.01, high=100.0, unit="metre")
    min_score: float = _setting(
        0.7, "Least correlation of the warped patch of Cs at the match in Cf.", low=-1.0, high=1.0
    )
    refine_radius: float = _setting(
        7.0, "Radius in which the correlation refines a match.", low=1.0, high=20.0, unit="pixel"
    )
    max_residual: float = _setting(
        1.5,
        "Largest epipolar residual of a match under the pose that all matches agree on.",
        low=0.1,
        high=20.0,
        unit="pixel",
    )
    min_share: float = _setting(
        0.35,
        "Least share of the matches tried that agree on a pose; fewer agree by chance, and are dropped.",
        low=0.0,
        high=1.0,
    )
    min_matches: int = _setting(
        8, "Fewest matches that agree on a pose; fewer vouch for nothing and are dropped.", low=1, high=100
    )


@dataclass(frozen=True)
class TargetSettings:
    """The start from a known target (METHOD section 10)."""

    radius: float = _setting(
        10.0, "Least radius in which a patch of the target is searched.", low=1.0, high=200.0, unit="pixel"
    )
    min_score: float = _setting(0.7, "Least correlation of a patch of the target.", low=-1.0, high=1.0)
    withhold: bool = _setting(
        False, "Use the target's points in the first frame only, so that they check the pose afterwards."
    )
    sigma: float = _setting(0.5, "Standard deviation of a located point.", low=0.01, high=10.0, unit="pixel")
    max_residual: float = _setting(
        3.0,
        "Largest distance of a point from its place under the pose found.",
        low=0.1,
        high=50.0,
        unit="pixel",
    )


@dataclass(frozen=True)
class FrontendSettings:
    """All settings of the front end, by group.

    Attributes
    ----------
    detect, patch, search, flow, worn, target
        One frozen dataclass each; the attribute ``search.min_score`` is the key ``search.min_score``.
    """

    detect: DetectSettings = field(default_factory=DetectSettings)
    patch: PatchSettings = field(default_factory=PatchSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    flow: FlowSettings = field(default_factory=FlowSettings)
    worn: WornSettings = field(default_factory=WornSettings)
    target: TargetSettings = field(default_factory=TargetSettings)

    @classmethod
    def from_flat(cls, values: Mapping[str, Any] | None = None) -> FrontendSettings:
        """Settings from a flat mapping of dotted keys; keys that are not given keep their default.

        Raises
        ------
        SettingsError
            If a key is unknown, or a value has the wrong type or lies outside its range.
        """
        groups: dict[str, dict[str, Value]] = {}
        for key, value in (values or {}).items():
            entry = _BY_KEY.get(key)
            if entry is None:
                raise SettingsError(
                    f"The front end has no setting '{key}'; it has {', '.join(sorted(_BY_KEY))}."
                )
            group, name = key.split(".", 1)
            groups.setdefault(group, {})[name] = _checked(entry, value)
        settings = cls()
        changed = {
            group: dataclasses.replace(getattr(settings, group), **fields) for group, fields in groups.items()
        }
        return dataclasses.replace(settings, **changed)


def _checked(entry: dict[str, Any], value: Any) -> Value:
    """``value`` as the entry's type, or a SettingsError that says what is allowed."""
    key, kind = entry["key"], entry["type"]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if kind == "bool" and isinstance(value, bool):
        return value
    if kind == "str" and isinstance(value, str):
        if entry["choices"] and value not in entry["choices"]:
            raise SettingsError(
                f"The setting '{key}' is '{value}'; it must be one of {', '.join(entry['choices'])}."
            )
        return value
    if kind in ("int", "float") and number and (kind == "float" or value == int(value)):
        low, high = entry["min"], entry["max"]
        if not (value == value and (low is None or value >= low) and (high is None or value <= high)):
            raise SettingsError(f"The setting '{key}' is {value}; it must lie between {low} and {high}.")
        if key in _ODD and int(value) % 2 == 0:
            raise SettingsError(f"The setting '{key}' is {value}; it must be odd.")
        return int(value) if kind == "int" else float(value)
    raise SettingsError(f"The setting '{key}' is {value!r}; it must be of the type {kind}.")


def _schema() -> list[dict[str, Any]]:
    """Flat list of every setting, in the order of the groups and their fields."""
    entries = []
    settings = FrontendSettings()
    for group in dataclasses.fields(settings):
        values = getattr(settings, group.name)
        for item in dataclasses.fields(values):
            default = getattr(values, item.name)
            entries.append(
                {
                    "key": f"{group.name}.{item.name}",
                    "type": type(default).__name__,
                    "default": default,
                    "min": item.metadata["min"],
                    "max": item.metadata["max"],
                    "unit": item.metadata["unit"],
                    "choices": list(item.metadata["choices"]),
                    "doc": item.metadata["doc"],
                }
            )
    return entries


_ODD = frozenset({"detect.block", "patch.size", "flow.window"})
FRONTEND: list[dict[str, Any]] = _schema()
_BY_KEY: dict[str, dict[str, Any]] = {entry["key"]: entry for entry in FRONTEND}
