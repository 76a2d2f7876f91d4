"""The plan of an evaluation: recordings, how their worn cameras are made, modes, seeds, levers to switch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from collabslam.batch.plan import mapping_of
from collabslam.errors import SettingsError
from collabslam.formats.yaml_text import load_yaml
from collabslam.settings.modes import MODES, STARTS
from collabslam.settings.table import Settings, flatten
from collabslam_lab.benchmark.altered import ALTERATIONS
from collabslam_lab.switches import with_switches

RENDERED = ("demo",)
"""Scenes that need no folder."""
PLAN = "evaluate.yaml"
"""A plan of this name in the folder of recordings goes before the package's own."""


@dataclass(frozen=True)
class Reference:
    """What another system reached on the same images.

    Attributes
    ----------
    system : str
    ate_sim3_pct : float
        ATE after a Sim(3) alignment, percent of the path.
    poses : int or None
        Frames that it tracked.
    lost : bool
        Whether it lost its way.
    """

    system: str
    ate_sim3_pct: float
    poses: int | None = None
    lost: bool = False


@dataclass(frozen=True)
class Entry:
    """One recording of a plan.

    Attributes
    ----------
    name : str
    folder : str
        Relative to the folder of recordings; the name if it is not given.
    rendered : str or None
        A scene of `RENDERED` in place of a folder.
    worn : str or None
        How the worn camera is emulated (`collabslam.attach_worn`); None takes the recording as it is.
    truth : str or None
        A file in the folder with stamped poses of Cs in TUM's order, in place of the recording's own truth.
    view_poses : str or None
        A file in the folder with stamped poses of the images of ``views:FOLDER``, in TUM's order; they are
        of Cs, and their names are their stamps.
    altered : str or None
        One of `altered.ALTERATIONS`: it is made of the recording in the folder.
    available, period : float
        Share of each period, and its seconds, during which the worn camera is there.
    noise : tuple of float or None
        Standard deviation of ``T_CF``: metres, then degrees of roll, pitch and yaw.
    start : str
    modes : tuple of str
    independent : tuple of str
        Modes that are also run with an error of ``T_CF`` of its own in each frame, which averages out; all
        are run with one error for each block of overlap, as it is in life.
    draws : tuple of str
        Folders with measured ``T_CF`` (``data.csv``) of a recording in the two-camera layout: seed k takes
        the k-th in place of the recording's own, and there are as many seeds.
    scored : bool
        Whether its truth is good enough to judge by; if not, it serves the worn camera only.
    calibration_sd : tuple of float or None
        Deliberate errors of Cs's calibration, standard deviations: focal length as a share, centre in pixels,
        first coefficient of the distortion. Drawn with the seed.
    settings : mapping
        Changes of the default settings and switches, by full dotted keys.
    reference : Reference or None
    """

    name: str
    folder: str
    rendered: str | None = None
    worn: str | None = None
    truth: str | None = None
    view_poses: str | None = None
    altered: str | None = None
    available: float = 1.0
    period: float = 5.0
    noise: tuple[float, ...] | None = None
    start: str = "worn"
    modes: tuple[str, ...] = ("mono", "collab", "collab-tight")
    independent: tuple[str, ...] = ()
    draws: tuple[str, ...] = ()
    scored: bool = True
    calibration_sd: tuple[float, ...] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    reference: Reference | None = None

    @property
    def noisy(self) -> bool:
        """Whether noise of ``T_CF`` is drawn for it."""
        return self.worn is not None and self.worn not in ("recorded", "none")

    @property
    def seeded(self) -> bool:
        """Whether anything in it depends on the seed."""
        made = self.rendered is not None or self.calibration_sd is not None
        return self.noisy or made or bool(self.draws)

    def seeds(self, given: Sequence[int]) -> Sequence[int]:
        """The seeds of those given that make a difference: one of each draw, or one if nothing is drawn."""
        if self.draws:
            return [seed for seed in given if seed < len(self.draws)]
        return given if self.seeded else given[:1]


@dataclass(frozen=True)
class Ablation:
    """Levers to switch one at a time.

    Attributes
    ----------
    levers : mapping
        The changed settings of each, by its name.
    seeds, modes : tuple
    code : mapping
        By the name of a lever, the project's files that serve the rule that it takes away and nothing else.
    unchanged : bool
        Whether the runs with nothing changed belong to it.
    """

    levers: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seeds: tuple[int, ...] = (0, 1, 2)
    modes: tuple[str, ...] = ("collab",)
    code: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    unchanged: bool = True


@dataclass(frozen=True)
class Plan:
    """What is to be run."""

    recordings: tuple[Entry, ...]
    seeds: tuple[int, ...] = tuple(range(10))
    ablation: Ablation = field(default_factory=Ablation)
    origin: str = "the package's own plan"


def find_plan(data: Path, given: Path | None) -> Plan:
    """The plan that is given, or the folder's own, or the package's.

    Raises
    ------
    SettingsError
        If it cannot be read or has faults.
    """
    path = given or (data / PLAN if (data / PLAN).is_file() else None)
    if path is None:
        return parse_plan(files(__package__).joinpath("recordings.yaml").read_text(encoding="utf-8"))
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f"The plan {path} cannot be read: {error}.") from error
    return parse_plan(text, str(path))


def parse_plan(text: str, origin: str = "the package's own plan") -> Plan:
    """A plan from YAML.

    Raises
    ------
    SettingsError
        Naming the entry and what is wrong with it.
    """
    try:
        tree = load_yaml(text)
    except yaml.YAMLError as error:
        raise SettingsError(f"{origin} is not valid YAML: {' '.join(str(error).split())}.") from error
    top = mapping_of(tree, origin, ("seeds", "defaults", "recordings", "ablation"))
    shared = mapping_of(top.get("defaults") or {}, f"{origin}, defaults", tuple(_FIELDS))
    recordings = mapping_of(top.get("recordings") or {}, f"{origin}, recordings", None)
    if not recordings:
        raise SettingsError(f"{origin} names no recordings; list them under 'recordings'.")
    entries = tuple(
        _entry(str(name), {**shared, **mapping_of(given or {}, f"{origin}, {name}", tuple(_FIELDS))}, origin)
        for name, given in recordings.items()
    )
    seeds = parse_seeds(top["seeds"], origin) if "seeds" in top else Plan.seeds
    return Plan(entries, seeds, _ablation(top.get("ablation") or {}, f"{origin}, ablation"), origin)


def parse_seeds(value: Any, where: str) -> tuple[int, ...]:
    """``0-4``, a number, or a list of numbers."""
    seeds = value if isinstance(value, list) else [value]
    if isinstance(value, str):
        first, dash, last = value.partition("-")
        if dash and first.strip().isdigit() and last.strip().isdigit():
            seeds = list(range(int(first), int(last) + 1))
    if not seeds or not all(type(seed) is int and seed >= 0 for seed in seeds):
        raise SettingsError(f"{where}: {value!r} are not seeds; give 0-4 or [0, 2, 5].")
    return tuple(dict.fromkeys(seeds))


def _entry(name: str, given: Mapping[str, Any], origin: str) -> Entry:
    where = f"{origin}, {name}"
    values = {key: _FIELDS[key](value, f"{where}, {key}") for key, value in given.items()}
    values["folder"] = values.get("folder") or name
    entry = Entry(name=name, **values)
    if not entry.noisy:
        if entry.noise is not None and "noise" not in given:
            values["noise"] = None
        values["independent"] = ()
        entry = Entry(name=name, **values)
    if entry.rendered is not None and entry.worn is not None:
        raise SettingsError(f"{where}: a rendered scene brings its own worn camera; leave out 'worn'.")
    if entry.altered is not None and not (entry.worn or "").startswith(("lag:", "none")):
        raise SettingsError(
            f"{where}: an altered recording keeps the images of Cs alone; give worn: lag:SECONDS."
        )
    return entry


def _ablation(tree: Any, where: str) -> Ablation:
    given = mapping_of(tree, where, ("seeds", "modes", "levers", "code"))
    levers = mapping_of(given.get("levers") or {}, f"{where}, levers", None)
    code = mapping_of(given.get("code") or {}, f"{where}, code", tuple(map(str, levers)))
    return Ablation(
        {str(name): _settings(changes, f"{where}, {name}") for name, changes in levers.items()},
        parse_seeds(given["seeds"], where) if "seeds" in given else Ablation.seeds,
        _modes(given["modes"], f"{where}, modes") if "modes" in given else Ablation.modes,
        {str(name): tuple(map(str, paths)) for name, paths in code.items()},
    )


def _text(value: Any, where: str) -> str | None:
    if value is not None and not isinstance(value, str):
        raise SettingsError(f"{where} is {value!r}; give a text.")
    return value


def _choice(choices: Sequence[str]) -> Callable[[Any, str], Any]:
    def check(value: Any, where: str) -> Any:
        if value is not None and value not in choices:
            raise SettingsError(f"{where} is {value!r}; give one of {', '.join(choices)}.")
        return value

    return check


def _number(value: Any, where: str) -> float:
    try:
        if not isinstance(value, bool) and isinstance(value, int | float):
            return float(value)
    except OverflowError:
        pass
    raise SettingsError(f"{where} is {value!r}; give a number.")


def _modes(value: Any, where: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(mode in MODES for mode in value):
        raise SettingsError(f"{where} is {value!r}; give a list of {', '.join(MODES)}.")
    return tuple(dict.fromkeys(value))


def _names(value: Any, where: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise SettingsError(f"{where} is {value!r}; give a list of folders.")
    return tuple(value)


def _flag(value: Any, where: str) -> bool:
    if not isinstance(value, bool):
        raise SettingsError(f"{where} is {value!r}; give true or false.")
    return value


def _noise(value: Any, where: str) -> tuple[float, ...] | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 4:
        raise SettingsError(f"{where} is {value!r}; give metres and degrees of roll, pitch and yaw.")
    return tuple(_number(x, where) for x in value)


def _calibration(value: Any, where: str) -> tuple[float, ...] | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 3:
        raise SettingsError(f"{where} is {value!r}; give a share, pixels, and a coefficient of distortion.")
    return tuple(_number(x, where) for x in value)


def _settings(value: Any, where: str) -> dict[str, Any]:
    """Flat changes of settings and switches, checked; nested groups may be written as mappings."""
    try:
        changes = dict(flatten(value or {}))
        settings = with_switches(Settings.default(), changes)
        return {key: settings[key] for key in changes}
    except (SettingsError, AttributeError) as error:
        raise SettingsError(f"{where}: {error}") from error


def _reference(value: Any, where: str) -> Reference | None:
    if value is None:
        return None
    given = mapping_of(value, where, ("system", "ate_sim3_pct", "poses", "lost"))
    if "system" not in given or "ate_sim3_pct" not in given:
        raise SettingsError(f"{where} needs 'system' and 'ate_sim3_pct'.")
    poses = None if given.get("poses") is None else int(_number(given["poses"], where))
    ate = _number(given["ate_sim3_pct"], where)
    return Reference(str(given["system"]), ate, poses, bool(given.get("lost", False)))


_FIELDS: dict[str, Callable[[Any, str], Any]] = {
    "folder": _text,
    "rendered": _choice(RENDERED),
    "worn": _text,
    "truth": _text,
    "view_poses": _text,
    "altered": _choice(ALTERATIONS),
    "available": _number,
    "period": _number,
    "noise": _noise,
    "start": _choice(STARTS),
    "modes": _modes,
    "independent": _modes,
    "draws": _names,
    "scored": _flag,
    "calibration_sd": _calibration,
    "settings": _settings,
    "reference": _reference,
}
"""Options of a recording, and how each is read; their meaning is that of `Entry`'s attributes."""
