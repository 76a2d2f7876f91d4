"""Settings of the front end: names, defaults, ranges, units and when to change them, all in this one place.

A group is a frozen dataclass; each of its fields says all about itself.  :data:`FRONTEND` lists them by
their keys (``search.min_score``) for settings files, help texts and documentation.  A field without ``when``
is a switch of the lab.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from collabslam.settings.setting import Setting, Value


def _number(
    default: float, low: float, high: float, unit: str, doc: str, when: str = "", *, odd: bool = False
) -> Any:
    kind = type(default).__name__
    return field(default=default, metadata={"rest": (kind, default, low, high, unit, (), doc, when, odd)})


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
        "Lower it where corners in plain sight are not found, raise it where noise is taken for some.",
    )
    min_gradient: float = _number(
        2.0,
        0,
        100,
        "grey levels per pixel",
        "Least root-mean-square gradient along a corner's weaker direction, at the resolution at which "
        "corners are looked for; keeps noise out of flat images.",
    )
    block: int = _number(5, 3, 15, "pixel", "Side of the window in which gradients are collected.", odd=True)
    min_distance: float = _number(
        0.0125,
        0.002,
        0.2,
        "image width",
        "Least distance between corners, and from existing points, as a share of the image's width.",
        "Lower it where texture fills a small part of the picture only.",
    )
    cells: int = _number(
        8, 1, 64, "", "Cells along the image's longer side; the emptiest cell is served first."
    )
    subpixel: bool = _flag(True, "Refine corners to sub-pixel precision.")


@dataclass(frozen=True)
class SightSettings:
    """Images that show nothing new are not searched: the frame is only predicted."""

    min_contrast: float = _number(
        1.5,
        0,
        255,
        "grey levels",
        "Least standard deviation of an image averaged over squares of 8 pixels; others are black or white.",
        "Lower it where dim or foggy pictures, in which features are still found, are taken for blank ones.",
    )
    frozen: bool = _flag(True, "Leave out an image that equals the one before to the bit.")


@dataclass(frozen=True)
class PatchSettings:
    """Landmark patches and their warping to another view."""

    size: int = _number(15, 7, 31, "pixel", "Side of the template that is correlated.", odd=True)
    margin: int = _number(
        14,
        0,
        64,
        "pixel",
        "Pixels stored around the template's reach, so that rotating and shrinking it stays inside.",
    )
    min_area: float = _number(
        0.2, 0.01, 1, "", "Least change of area (view / reference) at which a patch is still warped."
    )
    max_area: float = _number(
        5.0, 1, 100, "", "Largest change of area (view / reference) at which a patch is still warped."
    )
    max_stretch: float = _number(
        4.0, 1, 100, "", "Largest ratio of the warp's two scales: a steeper view is refused."
    )
    min_deviation: float = _number(
        4.0, 0, 128, "grey levels", "Least standard deviation of a template; a flatter one cannot be located."
    )


@dataclass(frozen=True)
class SearchSettings:
    """Active search: zero-normalised cross-correlation inside the predicted ellipse (METHOD section 7)."""

    gate: float = _number(3.0, 1, 6, "", "Radius of the search ellipse in standard deviations of S.")
    min_radius: float = _number(2.5, 1, 50, "pixel", "Least radius of the search ellipse.")
    large_radius: float = _number(
        16.0,
        2,
        200,
        "pixel",
        "Radius above which the ellipse is not searched whole when optical flow offers a guess inside it.",
    )
    max_radius: float = _number(
        48.0,
        4,
        400,
        "pixel",
        "Cap of the search window's half side, which bounds the cost of a poor prediction.",
        "Raise it for large images or a low frame rate, where features jump farther than this.",
    )
    guess_radius: float = _number(6.0, 1, 50, "pixel", "Half side of the window searched around a guess.")
    guess_gate: float = _number(1.5, 1, 10, "", "Factor on the ellipse inside which a guess is believed.")
    min_score: float = _number(
        0.78,
        -1,
        1,
        "",
        "Least correlation of the peak (1 is a perfect match).",
        "Lower it for noisy or compressed images in which features are lost.",
    )
    ambiguity: float = _number(
        0.94, 0, 1, "", "A second peak above this share of the best score makes a match ambiguous."
    )
    peak_distance: float = _number(
        3.0, 1, 20, "pixel", "Peaks nearer than this to the best one belong to it."
    )


@dataclass(frozen=True)
class FlowSettings:
    """Pyramidal optical flow from one frame to the next, as a guess for the search."""

    window: int = _number(15, 5, 51, "pixel", "Side of the flow's window.", odd=True)
    levels: int = _number(3, 0, 6, "", "Pyramid levels above the flow's own resolution.")
    max_error: float = _number(
        1.5, 0.1, 20, "pixel", "Largest distance between a point and itself tracked forth and back."
    )
    small_width: int = _number(
        64, 20, 400, "pixel", "Largest width of the small images from which the global motion is found."
    )


@dataclass(frozen=True)
class WornSettings:
    """Matches between the robot's view Cs and the worn camera's view Cf (METHOD sections 7 and 9)."""

    corners: int = _number(500, 20, 5000, "", "Most interest points searched in Cf's region of interest.")
    corner_distance: float = _number(
        0.008, 0.002, 0.1, "image width", "Least distance between them, as a share of the image's width."
    )
    new_points: int = _number(120, 0, 2000, "", "Most new corners of Cs that are tried in Cf.")
    tries: int = _number(6, 1, 100, "", "New corners tried for each feature that the view lacks.")
    descriptor: str = _name(
        "warped-sift",
        ("warped-sift", "sift", "orb", "surf"),
        "Descriptor: SIFT on windows warped as Cf sees them, OpenCV's SIFT, ORB, or SURF (extra surf).",
        "Take orb where time is short and both cameras look the same way, surf to compare with the paper.",
    )
    support: float = _number(36.0, 12, 128, "pixel", "Side of the window that a descriptor covers.")
    ratio: float = _number(
        0.85,
        0.1,
        1,
        "",
        "Largest ratio of the best to the second best descriptor distance among the candidates in the gate.",
    )
    max_distance: float = _number(0.85, 0.1, 2, "", "Largest distance of two descriptors (unit vectors).")
    sigma: float = _number(1.0, 0.1, 10, "pixel", "Standard deviation of a corner's pixel, for the gates.")
    gate: float = _number(3.0, 1, 6, "", "Radius of the epipolar and depth gates in standard deviations.")
    depth_floor: float = _number(
        0.1,
        0,
        1,
        "",
        "Least relative standard deviation of a known inverse range: maps are off by more than they say.",
    )
    min_range: float = _number(0.3, 0.01, 100, "metre", "Least distance of a point from Cs.")
    min_score: float = _number(
        0.7, -1, 1, "", "Least correlation of the warped patch of Cs at the match in Cf."
    )
    fitted_score: float = _number(
        0.0,
        0,
        1,
        "",
        "Least correlation once the patch was stretched by an affine map to fit Cf, which also says where it "
        "is exactly; 0 fits nothing.",
        "Set it to 0.8 where both cameras look at walls along the way, at a slant.",
    )
    refine_radius: float = _number(7.0, 1, 20, "pixel", "Radius in which the correlation refines a match.")
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
        "Least share of the matches tried that agree on a pose; fewer agree by chance, and are dropped.",
    )
    min_matches: int = _number(
        8, 1, 100, "", "Fewest matches that agree on a pose; fewer vouch for nothing and are dropped."
    )
    max_correction: float = _number(
        2.5,
        0.5,
        100,
        "",
        "Largest correction of T_CF that the matches may ask for, in its standard deviations (RMS over its "
        "six numbers); a view that asks for more is not used.",
    )
    least_known: float = _number(
        0.2,
        0,
        1,
        "",
        "Least share of the map's points matched in Cf, relative to that of new points; where new ones match "
        "and those of the map do not, T_CF contradicts the map and the view is not used.",
    )
    body_radius: float = _number(
        0.0,
        0,
        2,
        "metre",
        "Radius of the body of whoever wears Cf: where Cs sees it, nothing is searched and nothing is born "
        "(0: nobody wears it).",
        "Set it to 0.3 where the person who wears Cf walks in view of Cs.",
    )


@dataclass(frozen=True)
class RelocaliseSettings:
    """Finding a lost camera again in its map."""

    every: float = _number(
        0.5, 0.01, 60, "second", "Time from one frame whose landmarks are kept as views to the next."
    )
    views: int = _number(
        3, 1, 20, "", "Views kept of a landmark beside its first, the latest ones: 2 kB of memory each."
    )
    corners: int = _number(500, 20, 5000, "", "Most corners of an image in which the camera is looked for.")
    corner_distance: float = _number(
        0.006, 0.002, 0.1, "image width", "Least distance between them, as a share of the image's width."
    )
    support: float = _number(36.0, 12, 128, "pixel", "Side of the window that a view's descriptor covers.")
    ratio: float = _number(
        0.9,
        0.1,
        1,
        "",
        "Largest ratio of the best to the second best descriptor distance; generous, as patches are searched "
        "afterwards.",
    )
    max_distance: float = _number(0.8, 0.1, 2, "", "Largest distance of two descriptors (unit vectors).")
    guess_radius: float = _number(
        0.08,
        0.01,
        1,
        "image width",
        "Radius, as a share of the image's width, around where a landmark is expected that is tried first.",
    )
    iterations: int = _number(300, 10, 100000, "", "Most samples of RANSAC.")
    min_descriptors: int = _number(5, 4, 1000, "", "Fewest descriptors that must agree on a pose.")
    corner_residual: float = _number(
        6.0, 0.5, 50, "pixel", "Largest distance of a corner from where the pose puts the landmark."
    )
    max_residual: float = _number(
        4.0, 0.5, 50, "pixel", "Largest distance of a patch found from where the pose puts its landmark."
    )
    radius: float = _number(
        10.0, 1, 100, "pixel", "Radius of the patches' search around where the pose puts the landmarks."
    )
    min_patches: int = _number(8, 4, 1000, "", "Fewest patches found that make a pose believed...")
    min_share: float = _number(
        0.3, 0, 1, "", "...and their least share of those that should be visible from it."
    )
    min_spread: float = _number(
        0.02, 0, 1, "image area", "Least area of the outline of the patches found; a huddle fixes no pose."
    )


@dataclass(frozen=True)
class TargetSettings:
    """The start from a known target (METHOD section 10)."""

    radius: float = _number(10.0, 1, 200, "pixel", "Least radius in which a patch of the target is searched.")
    min_score: float = _number(0.7, -1, 1, "", "Least correlation of a patch of the target.")
    withhold: bool = _flag(
        False, "Use the target's points in the first frame only, so that they check the pose afterwards."
    )
    sigma: float = _number(0.5, 0.01, 10, "pixel", "Standard deviation of a located point.")
    plane_reach: float = _number(
        2.2,
        0,
        100,
        "target size",
        "Corners inside the target's outline, grown by this factor, are taken to lie on its plane...",
        "Lower it to 1 for a target that stands free, raise it for one on a large flat wall.",
    )
    plane_sd: float = _number(
        0.03, 0.001, 1, "", "...with this standard deviation of their range, as a share of it."
    )
    elsewhere_sd: float = _number(
        0.5, 0.01, 5, "", "Standard deviation with which all others start at the target's depth, as a share."
    )
    max_residual: float = _number(
        3.0, 0.1, 50, "pixel", "Largest distance of a point from its place under the pose found."
    )


@dataclass(frozen=True)
class FrontendSettings:
    """All settings of the front end, by group: the attribute ``search.min_score`` has the same key."""

    sight: SightSettings = field(default_factory=SightSettings)
    detect: DetectSettings = field(default_factory=DetectSettings)
    patch: PatchSettings = field(default_factory=PatchSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    flow: FlowSettings = field(default_factory=FlowSettings)
    worn: WornSettings = field(default_factory=WornSettings)
    relocalise: RelocaliseSettings = field(default_factory=RelocaliseSettings)
    target: TargetSettings = field(default_factory=TargetSettings)

    @classmethod
    def from_flat(cls, values: Mapping[str, Value]) -> FrontendSettings:
        """Settings from dotted keys and values, which `Settings` has checked; others keep their default."""
        groups: dict[str, dict[str, Value]] = {}
        for key, value in values.items():
            group, name = key.split(".", 1)
            groups.setdefault(group, {})[name] = value
        settings = cls()
        changed = {
            group: dataclasses.replace(getattr(settings, group), **fields) for group, fields in groups.items()
        }
        return dataclasses.replace(settings, **changed)


FRONTEND: list[Setting] = [
    Setting(f"{group.name}.{item.name}", *item.metadata["rest"])
    for group in dataclasses.fields(FrontendSettings)
    for item in dataclasses.fields(getattr(FrontendSettings(), group.name))
]
"""Every setting and switch, in the order of the groups and their fields."""
