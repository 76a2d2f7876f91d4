"""Settings of the front end: names, defaults, ranges, units and when to change them, all in this one place.

A group is a frozen dataclass whose fields carry their own description.  :data:`FRONTEND` lists them by their
keys (``search.min_score``) for settings files, help texts and documentation.  A field without ``when`` is a
switch of the lab.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from operator import attrgetter
from typing import Any

from collabslam.settings.setting import Setting, Value


def _number(default: float, low: float, high: float, unit: str, doc: str, when: str = "") -> Any:
    kind = type(default).__name__
    return field(default=default, metadata={"rest": (kind, default, low, high, unit, (), doc, when)})


def _flag(default: bool, doc: str, when: str = "") -> Any:
    return field(default=default, metadata={"rest": ("bool", default, None, None, "", (), doc, when)})


def _name(default: str, choices: tuple[str, ...], doc: str, when: str = "") -> Any:
    return field(default=default, metadata={"rest": ("enum", default, None, None, "", choices, doc, when)})


@dataclass(frozen=True)
class DetectSettings:
    """Corners in an image: spread over it, and sharp enough to be tracked."""

    quality: float = _number(
        0.002,
        0,
        1,
        "",
        "Least corner response (smaller eigenvalue) as a share of the image's best.",
        "Lower it where clear corners are not found, raise it where noise is taken for corners.",
    )
    min_distance: float = _number(
        0.0125,
        0.002,
        0.2,
        "image width",
        "Least distance between corners, and from existing points, as a share of the image's width.",
    )
    cells: int = _number(
        8, 1, 64, "", "Cells along the image's longer side; new corners go to the emptiest cell first."
    )
    subpixel: bool = _flag(True, "Refine corners to sub-pixel precision.")


@dataclass(frozen=True)
class BlankImageSettings:
    """Blank images are not searched: the frame is only predicted."""

    min_contrast: float = _number(
        1.5,
        0,
        255,
        "grey levels",
        "Least standard deviation of an image averaged over squares of 8 pixels; blank below it.",
        "Lower it where dim or foggy images, in which features are still found, count as blank.",
    )


@dataclass(frozen=True)
class PatchSettings:
    """Landmark patches and their warping to another view."""

    min_area: float = _number(
        0.2, 0.01, 1, "", "Least change of area (view / reference) at which a patch is still warped."
    )
    max_area: float = _number(
        5.0, 1, 100, "", "Largest change of area (view / reference) at which a patch is still warped."
    )
    max_stretch: float = _number(
        4.0, 1, 100, "", "Largest ratio of the warp's two scales: a steeper view is refused."
    )


@dataclass(frozen=True)
class SearchSettings:
    """Active search: zero-normalised cross-correlation inside the predicted ellipse (METHOD section 7)."""

    max_radius: float = _number(
        48.0,
        4,
        400,
        "pixel",
        "Largest half side of the search window, which bounds the cost of a poor prediction.",
        "Raise it for large images or a low frame rate, where features move farther between frames.",
    )
    min_score: float = _number(
        0.78,
        -1,
        1,
        "",
        "Least correlation of the peak (1 is a perfect match); where few features are left, less by the "
        "share of noise in the patch.",
        "Lower it for blurred or compressed images, where features are lost.",
    )


@dataclass(frozen=True)
class FlowSettings:
    """Pyramidal optical flow from one frame to the next, as a guess for the search."""

    levels: int = _number(3, 0, 6, "", "Pyramid levels above the flow's own resolution.")


@dataclass(frozen=True)
class WornSettings:
    """Matches between the robot's view Cs and the worn camera's view Cf (METHOD sections 7 and 9)."""

    descriptor: str = _name(
        "warped-sift",
        ("warped-sift", "sift", "orb"),
        "Descriptor: SIFT on windows warped as Cf sees them, OpenCV's SIFT, or ORB.",
        "Take orb to save time where both cameras look the same way.",
    )
    ratio: float = _number(
        0.85,
        0.1,
        1,
        "",
        "Largest ratio of the best to the second best descriptor distance among the candidates in the gate.",
    )
    depth_floor: float = _number(
        0.1,
        0,
        1,
        "",
        "Least relative sd of a known inverse range, as maps are off by more than they claim.",
    )
    min_score: float = _number(
        0.7, -1, 1, "", "Least correlation of the warped patch of Cs at the match in Cf."
    )
    max_residual: float = _number(
        1.5,
        0.1,
        20,
        "pixel",
        "Largest epipolar residual of a match under the pose that all matches agree on.",
    )
    min_share: float = _number(
        0.35,
        0,
        1,
        "",
        "Least share of the matches that must agree on a pose; a smaller share may agree by chance.",
    )
    min_matches: int = _number(
        8, 1, 100, "", "Fewest matches that must agree on a pose; with fewer all are dropped."
    )
    body_radius: float = _number(
        0.3,
        0,
        2,
        "metre",
        "Radius of the body of the person who wears Cf. Where Cs sees it, nothing is searched and nothing is "
        "born. 0 if nobody wears it.",
        "Set it to 0 where Cf hangs on a wall or is on another robot, raise it for a rucksack.",
    )
    body_height: float = _number(
        2.0,
        0.3,
        3,
        "metre",
        "Height of that body, whose top is 0.2 m above Cf.",
        "Lower it for a child, raise it for a hat.",
    )
    next_best_view: bool = _flag(
        False,
        "Say after each frame where the person who wears Cf should look next.",
        "Switch it on to guide a person, or to see in frames.csv what a better view would have told.",
    )


@dataclass(frozen=True)
class GyroSettings:
    """A gyroscope beside the images (METHOD section 28)."""

    follow: bool = _flag(True, "Let the camera turn as it says.")


@dataclass(frozen=True)
class TargetSettings:
    """The start from a known target (METHOD section 10)."""

    withhold: bool = _flag(
        False, "Use the target's points in the first frame only, so that they check the pose afterwards."
    )
    plane_reach: float = _number(
        2.2,
        0,
        100,
        "target size",
        "Corners within the target's outline, grown by this factor, are taken to lie on its plane.",
        "Lower it to 1 for a target that stands free, raise it for one on a large flat wall.",
    )


@dataclass(frozen=True)
class FrontendSettings:
    """All settings of the front end, by group: the attribute ``search.min_score`` has the same key."""

    blank_image: BlankImageSettings = field(default_factory=BlankImageSettings)
    detect: DetectSettings = field(default_factory=DetectSettings)
    patch: PatchSettings = field(default_factory=PatchSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    flow: FlowSettings = field(default_factory=FlowSettings)
    worn: WornSettings = field(default_factory=WornSettings)
    gyro: GyroSettings = field(default_factory=GyroSettings)
    target: TargetSettings = field(default_factory=TargetSettings)

    def changed(self, key: str, value: Any) -> FrontendSettings | None:
        """The same settings with one value changed, by its dotted key; None if it is not allowed."""
        accepted = _BY_KEY[key].accepted(value)
        if accepted is None:
            return None
        group, name = key.split(".")
        return replace(self, **{group: replace(getattr(self, group), **{name: accepted})})

    def values(self) -> dict[str, Value]:
        """Every value by its dotted key."""
        return {setting.key: attrgetter(setting.key)(self) for setting in FRONTEND}


FRONTEND: list[Setting] = [
    Setting(f"{group.name}.{item.name}", *item.metadata["rest"])
    for group in fields(FrontendSettings)
    for item in fields(getattr(FrontendSettings(), group.name))
]
"""Every setting and switch, in the order of the groups and their fields."""

_BY_KEY = {setting.key: setting for setting in FRONTEND}
