"""The recipes of every recording: fixed, so that anyone can make the same ones.

What a recipe leaves open is drawn from its own seed; nothing in it was chosen by a result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from collabslam.simulation.rendered import Sensor
from collabslam.targets.kinds import Board
from collabslam_lab.worlds.building import Style
from collabslam_lab.worlds.motion import Station

BESIDE: tuple[Station, ...] = ((0.0, 0.4, 0.7),)
AHEAD: tuple[Station, ...] = ((0.0, 0.4, 0.7), (0.2, 1.9, 0.6))
BEHIND: tuple[Station, ...] = ((0.0, 0.4, 0.7), (0.2, -0.9, 0.5))
ROUND: tuple[Station, ...] = ((0.0, 0.4, 0.7), (0.3, 1.6, 0.65), (0.65, -0.8, 0.55))
"""The person walks beside the robot, goes ahead and gets into its view, falls behind, or does all three.

Beside means half a step ahead of Cs: right beside it, between the arcs of both scanners, no laser sees legs.
"""

PLAIN = Style()
PLAIN_SENSOR = Sensor()

BOARD = Board(9, 6, 0.15)
WITH_BOARD = "-board"


@dataclass(frozen=True)
class Recipe:
    """One recording.

    Attributes
    ----------
    name : str
    route : str
        See `worlds.route.Route`.
    seed : int
        Of the scene, of gait, glances and shake.
    speed : float
        m/s.
    length : float or None
        Metres that the robot drives; the whole way if None.
    side : int
        1 if the person walks to the left of the robot, -1 to the right.
    stations : tuple of Station
        Where the person walks, for ``side`` 1.
    along : float
        Share of the time in which the person means to look along the way.
    style : Style
    light : float
        Level of the light, 1 for a lit corridor.
    exposure : float
        Seconds that each row of a picture is exposed.
    readout : float
        Seconds from the first row to the last one: the shutters roll where it is above 0.
    sensor : Sensor
        Noise of both cameras.
    exposure_step : float
        Stops by which the cameras' exposure jumps up or down, each by itself, every few seconds.
    shake : (float, float)
        See `worlds.motion.Drive`.
    passers : float
        People a minute who come the other way.
    shutter_lag : float
        Seconds by which Cf's shutter is later than Cs's and than the pose that is measured.
    board : float or None
        Metres along the way at which a checkerboard (`BOARD`) hangs, if there is one.
    """

    name: str
    route: str
    seed: int
    speed: float = 1.0
    length: float | None = None
    side: int = 1
    stations: tuple[Station, ...] = BESIDE
    along: float = 0.4
    style: Style = PLAIN
    light: float = 1.0
    exposure: float = 0.008
    readout: float = 0.0
    sensor: Sensor = PLAIN_SENSOR
    exposure_step: float = 0.0
    shake: tuple[float, float] = (0.0, 0.0)
    passers: float = 0.0
    shutter_lag: float = 0.0
    board: float | None = None


def _corridors() -> list[Recipe]:
    """Ten corridors of 15 m, walked through at 1.5 m/s (the paper's section 5.2)."""
    straight = Recipe("corridor", "S6", 0, speed=1.5, length=15.0, along=0.4)
    kinds = [
        replace(straight, style=Style("doors")),
        replace(straight, style=Style("posters")),
        replace(straight, side=-1),
        replace(straight, style=Style("repeated")),
        replace(straight, style=Style(reflective=True)),
        replace(straight, style=Style(dim=True), light=0.5, exposure=0.02),
        replace(straight, stations=AHEAD),
        replace(straight, stations=BEHIND, style=Style("doors", reflective=True)),
        replace(straight, stations=ROUND, side=-1, style=Style("posters")),
        replace(straight, style=Style("doors", dim=True), light=0.5, exposure=0.02),
    ]
    return [replace(r, name=f"corridor-{k}", seed=100 + k) for k, r in enumerate(kinds)]


def _turns(angle: int) -> list[Recipe]:
    """Ten close turns at 0.8 m/s (section 5.3): to either side, the person inside or outside."""
    out = []
    for k in range(10):
        way = "L" if k % 2 == 0 else "R"
        route, length = (f"S2 {way} S2", 8.0) if angle == 90 else (f"S1 {way} {way} S1", 8.0)
        side = 1 if (k // 2) % 2 == 0 else -1
        walls = ("mixed", "doors", "posters", "mixed", "mixed")[k // 2]
        stations = BEHIND if k >= 8 else BESIDE
        recipe = Recipe(f"turn{angle}-{k}", route, 10 * angle + k, 0.8, length, side, stations, 0.6)
        out.append(replace(recipe, style=Style(walls, reflective=k == 6)))
    return out


def _general() -> list[Recipe]:
    """Ten ways with straights and turns, and overlap of about the paper's shares (section 5.4, Table 2)."""
    rows = [
        ("a", "S3 L S3", 1, BESIDE, 0.23, Style()),
        ("b", "S4 R S2", -1, BESIDE, 0.32, Style("posters")),
        ("c", "S3 L S1 R S3", 1, BESIDE, 0.22, Style()),
        ("d", "S5 R S3", 1, BEHIND, 0.27, Style("doors")),
        ("e", "S3 R S3 R S4", -1, BESIDE, 0.38, Style()),
        ("f", "S4 L S3 R S2", 1, AHEAD, 0.37, Style(reflective=True)),
        ("g", "S3 L S4 L S3", -1, BESIDE, 0.58, Style("posters")),
        ("h", "S5 L S5", 1, BESIDE, 0.33, Style("repeated")),
        ("i", "S4 L S4 L S4 L S2", 1, ROUND, 0.49, Style()),
        ("j", "S3 R S3 L S3 R S2", -1, BESIDE, 0.44, Style(dim=True)),
    ]
    out = []
    for k, (name, route, side, stations, along, style) in enumerate(rows):
        recipe = Recipe(name, route, 300 + k, 1.0, None, side, stations, along, style)
        out.append(replace(recipe, light=0.5, exposure=0.02) if style.dim else recipe)
    return out


def _study() -> list[Recipe]:
    """Ten corridors with a person who always looks along: what varies is up to the study."""
    straight = Recipe("study", "S6", 0, speed=1.5, length=15.0, along=1.0)
    return [replace(straight, name=f"study-{k}", seed=500 + k, side=(1, -1)[k % 2]) for k in range(10)]


SETS: dict[str, tuple[Recipe, ...]] = {
    "corridor": tuple(_corridors()),
    "turn90": tuple(_turns(90)),
    "turn180": tuple(_turns(180)),
    "general": tuple(_general()),
    "study": tuple(_study()),
}
"""Every recording by set."""


def with_board(walk: Recipe) -> Recipe:
    """Some metres down a lit corridor, as fast as another recording, towards a board, beside its person.

    Who calibrates chooses where: on even ground, with nobody else about. The cameras' shutters roll as ever.
    """
    way = replace(walk, route="S4", length=6.5, along=1.0, stations=BESIDE, board=9.6)
    way = replace(way, sensor=PLAIN_SENSOR, exposure_step=0.0, shake=(0.0, 0.0), passers=0.0)
    return replace(way, name=walk.name + WITH_BOARD, style=Style(furniture=0.0), light=1.0, exposure=0.008)
