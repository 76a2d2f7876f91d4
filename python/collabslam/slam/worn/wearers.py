"""Who wears a Cf and is in view: their outline is left out of the pictures (METHOD 29).

T_CF says where a head is; the body hangs below it.  Of somebody of whom nothing was heard for a moment the
outline goes on as they went.  Where what is behind an outline is seen through it, nobody is there: the camera
hangs on a wall, or on another robot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from collabslam._core import LAST_TIME, Camera, Filter
from collabslam.formats.schema import Check, array, instance, items, number, table, text
from collabslam.frontend.detect import Hidden
from collabslam.frontend.wearer_mask import Outline
from collabslam.geometry import pose_inverse
from collabslam.settings.frontend import WornSettings
from collabslam.slam.state import PersistentState
from collabslam.slam.worn.overlap import Overlap
from collabslam.types import Array, Mask, WornView

HEARD = 2.0
"""Seconds for which somebody goes on as they went when last heard of."""
_ANEW = 1.0
"""Seconds between two views after which they tell no velocity."""
_SMOOTH, _NOD = 0.5, 5.0
"""Seconds over which the velocity is averaged, and which way is down: a head nods."""
_FASTEST = 3.0
"""m/s; a person who seems faster is not where the last view was."""
_AWAY, _FARTHEST = 0.3, 0.3
"""Metres a second, and metres at most, by which an outline grows while nothing is heard."""
_SIGMAS = 2.0
"""Standard deviations of the place by which an outline is wider."""
SURE = 3.0
"""Logarithm of how much likelier nobody is there, or somebody, at which no more is asked."""
_BEHIND = 1.3
"""How much farther than a person what is behind them is."""
_GRID = 16
"""Pixels between those at which is asked whether an outline is in view."""


@dataclass(frozen=True)
class Heard:
    """Somebody as they were last heard of, along the axes of W.

    Attributes
    ----------
    since, t : float
        First, and last, seconds.
    place : (3,) float64
        Where Cf was, metres.
    velocity : (3,) float64
        m/s.
    down : (3,) float64
        Unit vector: F's y axis, averaged.
    sd : float
        Of the place, metres.
    """

    since: float
    t: float
    place: Array
    velocity: Array
    down: Array
    sd: float


_HEARD = instance(
    Heard,
    since=number(-LAST_TIME, LAST_TIME),
    t=number(-LAST_TIME, LAST_TIME),
    place=array("<f8", 3),
    velocity=array("<f8", 3),
    down=array("<f8", 3),
    sd=number(0.0),
)


class Wearers(PersistentState):
    """Remembers who was heard of, and whether somebody is where their camera is.

    Parameters
    ----------
    core : Filter
    camera : Camera
        Cs.
    worn_cameras : mapping of Camera
    settings : WornSettings
    """

    PERSISTENT: ClassVar[Mapping[str, Check]] = {
        "_heard": table(str, _HEARD),
        "_through": table(str, number(-SURE, SURE)),
        "_nobody": items(text()),
    }

    def __init__(
        self, core: Filter, camera: Camera, worn_cameras: Mapping[str, Camera], settings: WornSettings
    ) -> None:
        self._filter, self._camera, self._worn_cameras = core, camera, worn_cameras
        self._radius, self._height = settings.body_radius, settings.body_height
        self._heard: dict[str, Heard] = {}
        self._through: dict[str, float] = {}
        """By person: the logarithm of how much likelier what was seen is if nobody is there."""
        self._nobody: tuple[str, ...] = ()
        v, u = np.mgrid[0 : camera.height : _GRID, 0 : camera.width : _GRID].astype(np.float64)
        self._grid = np.stack([u.ravel(), v.ravel()], axis=1)

    def state(self) -> dict[str, Any]:
        """As `PersistentState.state`."""
        return {**self.attributes(), "_nobody": list(self._nobody)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """As `PersistentState.restore`."""
        super().restore(state)
        self._nobody = tuple(self._nobody)

    def look(
        self, t: float, worn: Sequence[Overlap], *, lost: bool, up: Array | None = None
    ) -> dict[str, Outline]:
        """The outlines that Cs may see in the frame at ``t``, by name, whether or not somebody is there.

        ``up`` (3,) is the direction of up in W, where that is known; else a body is upright as its head is.
        """
        if self._radius == 0.0:
            return {}
        views = [overlap.worn for overlap in worn if overlap.worn.body]
        if not self._filter.started or lost:
            self._heard = {}
            found = {view.who: self.of(view) for view in views}
            return self._in_view({name: one for name, one in found.items() if one is not None})
        pose = self._filter.pose
        heard = {name: one for name, one in self._heard.items() if t - one.t <= HEARD}
        heard |= {view.who: _heard_of(view, t, pose, heard.get(view.who)) for view in views}
        self._heard, here = heard, pose_inverse(pose)
        return self._in_view({name: self._later(one, t, here, up) for name, one in heard.items()})

    def of(self, worn: WornView) -> Outline | None:
        """The outline of whoever wears the camera of a view, where its T_CF is of; None of nobody."""
        if self._radius == 0.0 or not worn.body:
            return None
        off = _SIGMAS * _deviation(worn.covariance)
        return Outline(worn.t_cf[:3, 3], worn.t_cf[:3, 1], self._radius, self._height, off)

    def hidden(self, outlines: Mapping[str, Outline]) -> list[Hidden]:
        """What outlines hide of Cs, of those where somebody is."""
        return [_hides(one, self._camera) for name, one in outlines.items() if name not in self._nobody]

    def hidden_from(self, who: str, t_cf: Array, outlines: Mapping[str, Outline]) -> list[Hidden]:
        """What they hide of the picture of one person's Cf, whose own body it does not show."""
        camera, to_f = self._worn_cameras[who], pose_inverse(t_cf)
        others = [
            one.seen_from(to_f) for name, one in outlines.items() if name != who and name not in self._nobody
        ]
        return [_hides(one, camera) for one in others if one.is_possible]

    @property
    def nobody(self) -> tuple[str, ...]:
        """Those in whose place nobody is."""
        return self._nobody

    def undecided(self, outlines: Mapping[str, Outline]) -> dict[str, Outline]:
        """Those of whom is not known yet whether somebody is there."""
        return {name: one for name, one in outlines.items() if abs(self._through.get(name, 0.0)) < SURE}

    def counts(self, outlines: Mapping[str, Outline]) -> dict[str, int]:
        """Of the diagnostics: those in view who wear a Cf, and outlines in view where nobody is."""
        nobody = sum(name in self._nobody for name in outlines)
        return {"wearers": len(outlines) - nobody, "wearers_unseen": nobody}

    def behind(self, outline: Outline, uv: Array, rho: Array, rho_sd: Array) -> Mask:
        """(N,) bool: which points, by pixel and inverse range (1/m), a trunk hides if somebody is there."""
        far = rho + 2.0 * rho_sd < 1.0 / (_BEHIND * outline.range + self._radius)
        far[far] = outline.trunk(self._camera, uv[far])
        return np.asarray(far)

    def saw(
        self, who: str, *, found: int, tried: int, usual: float, by_chance: float, at_once: float = SURE
    ) -> None:
        """So many points behind an outline were found; ``usual`` is the share found elsewhere, ``by_chance``
        that of those that a body hides; it adds ``at_once`` at most: the next frame shows much the same."""
        if usual <= by_chance:
            return
        usual = min(usual, 0.99)
        seen, unseen = np.log(usual / by_chance), np.log((1.0 - usual) / (1.0 - by_chance))
        told = float(np.clip(found * seen + (tried - found) * unseen, -at_once, at_once))
        belief = float(np.clip(self._through.get(who, 0.0) + told, -SURE, SURE))
        self._through = {**self._through, who: belief}
        if belief == SURE and who not in self._nobody:
            self._nobody = (*self._nobody, who)
        elif belief < 0.0:
            self._nobody = tuple(name for name in self._nobody if name != who)

    def _later(self, one: Heard, t: float, here: Array, up: Array | None) -> Outline:
        """Somebody's outline as it should be some time after they were heard of."""
        age = t - one.t
        place = here[:3, :3] @ (one.place + age * one.velocity) + here[:3, 3]
        off = _SIGMAS * one.sd + min(_AWAY * age, _FARTHEST)
        down = here[:3, :3] @ (one.down if up is None else -up)
        return Outline(place, down, self._radius, self._height, off)

    def _in_view(self, outlines: Mapping[str, Outline]) -> dict[str, Outline]:
        return {
            name: one
            for name, one in outlines.items()
            if one.is_possible and one.hides(self._camera, self._grid).any()
        }


def _hides(outline: Outline, camera: Camera) -> Hidden:
    return lambda uv: outline.hides(camera, uv)


def _deviation(covariance: Array) -> float:
    """The largest standard deviation of a place, metres."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance[:3, :3])[-1], 0.0)))


def _heard_of(worn: WornView, t: float, pose: Array, before: Heard | None) -> Heard:
    """Somebody, after one more view of theirs."""
    place, down = pose[:3, :3] @ worn.t_cf[:3, 3] + pose[:3, 3], pose[:3, :3] @ worn.t_cf[:3, 1]
    velocity, sd = np.zeros(3), _deviation(worn.covariance)
    if before is not None and 0.0 < t - before.t <= _ANEW:
        dt = t - before.t
        velocity = before.velocity + min(1.0, dt / _SMOOTH) * ((place - before.place) / dt - before.velocity)
        velocity *= min(1.0, _FASTEST / max(float(np.linalg.norm(velocity)), 1e-9))
        down = before.down + dt / min(_NOD, t - before.since + dt) * (down - before.down)
        down = down / max(float(np.linalg.norm(down)), 1e-9)
        return Heard(before.since, t, place, velocity, down, sd)
    return Heard(t, t, place, velocity, down, sd)
