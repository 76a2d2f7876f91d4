"""The rendered worlds: what their recipes promise, and that files of them replay to the last bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from collabslam._core import Camera
from collabslam.datasets import open_recording, write_recording
from collabslam.datasets.ros.bag import Bag
from collabslam.datasets.ros.writer import TOPICS, write_bag
from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import InputError
from collabslam.geometry import pose_inverse, se3_exp, se3_log
from collabslam.runs.runner import run
from collabslam.settings.table import Settings
from collabslam.simulation.conditions import HARD
from collabslam.simulation.rendered import Sensor
from collabslam.simulation.renderer import Renderer, Shutter
from collabslam.simulation.trajectory import camera_pose
from collabslam.simulation.world import Panel, panel
from collabslam.types import Frame
from collabslam_lab.worlds import SETS, WorldRecording, recipe, world_recording
from collabslam_lab.worlds.building import Style, build
from collabslam_lab.worlds.life import RANGES
from collabslam_lab.worlds.recording import LEAD
from collabslam_lab.worlds.route import CELL, Route
from collabslam_lab.worlds.sensors import readings_of

EVERY = [r.name for rows in SETS.values() for r in rows]
SOME = ["corridor-8", "turn90-3", "turn180-2", "i"]
PINHOLE = Camera("pinhole", 180, 120, (160.0, 160.0, 89.5, 59.5), ())


@pytest.fixture(scope="module")
def corridor() -> WorldRecording:
    return world_recording("corridor-2")


def test_a_route_bends_where_it_says() -> None:
    route = Route("S2 L R S1")
    place, heading = route.along(np.array([0.0, route.length]))
    assert np.allclose(place[0], 0.0, atol=1e-9)
    assert np.allclose(place[1], [4.0 * CELL, CELL], atol=0.15)
    assert np.allclose(heading, 0.0, atol=1e-2)
    assert route.cells[2:6] == [(0, 0), (1, 0), (2, 0), (2, 1)]
    with pytest.raises(InputError, match="S3 L S2"):
        Route("S2 T")


@pytest.mark.parametrize("name", SOME)
def test_nobody_walks_through_walls_or_each_other(name: str) -> None:
    world = world_recording(name)
    walls = world.building.plan
    for t in world.times[::3]:
        robot, person = world.robot(t)[:2, 3], world.person(t)[:2, 3]
        for place in (robot, person):
            a, b = walls[:, 0], walls[:, 1]
            along = np.clip(((place - a) * (b - a)).sum(axis=1) / ((b - a) ** 2).sum(axis=1), 0.0, 1.0)
            assert np.linalg.norm(a + along[:, None] * (b - a) - place, axis=1).min() > 0.2
        assert np.linalg.norm(robot - person) > 0.45


@pytest.mark.parametrize("name", SOME)
def test_the_robot_drives_smoothly_at_its_speed(name: str) -> None:
    world = world_recording(name)
    steps = [se3_log(pose_inverse(a) @ b) for a, b in zip(world.truth, world.truth[1:], strict=False)]
    speed = 10.0 * np.linalg.norm(np.array(steps)[:, :3], axis=1)
    assert speed[0] < 0.1
    assert np.median(speed) == pytest.approx(world.recipe.speed, rel=0.1)
    assert np.degrees(np.linalg.norm(np.array(steps)[:, 3:], axis=1)).max() < 8.0
    way = np.linalg.norm(np.diff(world.truth[:, :3, 3], axis=0), axis=1).sum()
    assert way == pytest.approx(world.scene.drive.length, rel=0.03)


def test_every_recipe_has_its_own_name_and_seed() -> None:
    recipes = [r for rows in SETS.values() for r in rows]
    assert len({r.name for r in recipes}) == len({r.seed for r in recipes}) == len(recipes) == 50
    assert all(len(rows) == 10 for rows in SETS.values())


def test_frames_repeat_in_any_order(corridor: WorldRecording) -> None:
    again = world_recording("corridor-2")
    again.frame(5)
    a, b = corridor.frame(3), again.frame(3)
    assert np.array_equal(a.image, b.image)
    assert a.views
    assert b.views
    assert np.array_equal(a.views[0].image, b.views[0].image)
    assert np.array_equal(a.views[0].t_cf, b.views[0].t_cf)
    assert not np.array_equal(a.image, world_recording("corridor-2", seed=1).image(3))
    with pytest.raises(InputError, match="no world 'corridor-99'"):
        world_recording("corridor-99")


def test_the_optics_are_those_of_the_papers_camera(corridor: WorldRecording) -> None:
    for camera in (corridor.camera, corridor.worn_camera):
        corners = camera.unproject(np.array([[0.0, 0.0], [719.0, 479.0]]))
        cosine = corners[0] @ corners[1] / np.linalg.norm(corners, axis=1).prod()
        assert np.degrees(np.arccos(cosine)) == pytest.approx(58.0, abs=1.0)


def test_the_person_hides_what_is_behind() -> None:
    world = world_recording("corridor-6")
    t = float(world.times[60])
    empty = world.scene.renderer.render(world.robot(t), world.camera)
    full = world.scene.renderer.render(world.robot(t), world.camera, world.scene._movers(0, t))
    changed = cv2.erode((np.abs(empty.astype(int) - full) > 8).astype(np.uint8), np.ones((3, 3)))
    columns = np.flatnonzero(changed.any(axis=0))
    waist = world.person(t)[:3, 3] - [0, 0, 0.5] - world.robot(t)[:3, 3]
    uv = world.camera.project(waist[None] @ world.robot(t)[:3, :3]).uv
    assert columns.min() - 20 < uv[0, 0] < columns.max() + 20
    assert 0.03 < changed.mean() < 0.4


def _sweep(yaw: float, pitch: float, *, readout: float = 0.0) -> Shutter:
    """A camera that turns while its shutter is open, radians in all."""
    return Shutter(se3_exp([0.0, 0.0, 0.0, pitch, yaw, 0.0]), 0.01, readout)


def test_an_open_shutter_blurs_along_the_motion() -> None:
    stripes = np.tile(np.repeat(np.array([40, 220], np.uint8), 16), (256, 16))
    board = [panel((3.0, 2.0, 1.5), (0.0, -4.0, 0.0), (0.0, 0.0, -3.0), stripes)]
    pose = camera_pose([0.0, 0.0, 0.0], 0.0, 0.0, 0.0)
    renderer = Renderer(board)
    still = renderer.render(pose, PINHOLE).astype(float)
    across = renderer.render(pose, PINHOLE, (), _sweep(0.05, 0.0)).astype(float)
    along = renderer.render(pose, PINHOLE, (), _sweep(0.0, 0.05)).astype(float)
    middle = (slice(40, 80), slice(60, 120))
    assert across[middle].std() < 0.75 * still[middle].std()
    assert along[middle].std() > 0.95 * still[middle].std()
    assert across[middle].mean() == pytest.approx(still[middle].mean(), abs=12)


def test_a_rolling_shutter_sees_each_row_from_where_the_camera_is_then() -> None:
    rng = np.random.Generator(np.random.PCG64(1))
    texture = cv2.GaussianBlur(rng.integers(0, 256, (300, 400)).astype(np.uint8), (0, 0), 4.0)
    board = [panel((3.0, 2.0, 1.5), (0.0, -4.0, 0.0), (0.0, 0.0, -3.0), np.asarray(texture, np.uint8))]
    pose, renderer = camera_pose([0.0, 0.0, 0.0], 0.0, 0.0, 0.0), Renderer(board)
    turn = np.array([0.1, -0.05, 0.02, 0.03, 0.06, 0.02])
    rolled = renderer.render(pose, PINHOLE, (), Shutter(se3_exp(turn), 1e-6, 0.03)).astype(float)
    together = renderer.render(pose, PINHOLE, (), Shutter(se3_exp(turn), 1e-6)).astype(float)
    for row in (15, 60, 105):
        share = row / 119.0 - 0.5
        then = renderer.render(pose @ se3_exp(share * turn), PINHOLE).astype(float)
        columns = slice(20, 160)
        missed = np.abs(rolled[row, columns] - then[row, columns]).mean()
        assert missed < 1.5
        if row != 60:
            assert np.abs(together[row, columns] - then[row, columns]).mean() > 4.0 * missed


def test_light_has_a_noise_of_its_own() -> None:
    world = WorldRecording(replace(recipe("corridor-2"), sensor=Sensor(2.0, 500.0)))
    for level in (40, 160):
        grey = np.full((480, 720), level, np.uint8)
        seen = world._sensed(grey, 0, 1.0, np.random.default_rng(3))[200:280, 320:400].astype(float)
        assert seen.std() == pytest.approx(np.sqrt(4.0 + 255.0 * level / 500.0), rel=0.06)


def test_the_exposure_jumps_by_its_step_and_stays_between() -> None:
    still, jumping = recipe("corridor-2"), replace(recipe("corridor-2"), exposure_step=0.5)
    one, other = WorldRecording(still), WorldRecording(jumping)
    times = np.arange(1.0, 10.0, 0.1)
    stops = np.array([np.log2(other._light[0].at(t) / one._light[0].at(t)) for t in times])
    assert set(np.round(stops, 6)) <= {-0.5, 0.0, 0.5}
    assert 1 <= np.count_nonzero(np.diff(stops)) <= 5


def test_tiles_that_are_alike_and_walls_that_fade() -> None:
    track = np.array([[0.0, 0.0]])

    def floor(style: Style) -> np.ndarray:
        rng = np.random.Generator(np.random.PCG64(4))
        return build(rng, [(0, 0)], style, track).panels[0].image.astype(float)

    same, plain, faded = floor(Style(alike=1.0)), floor(Style()), floor(Style(contrast=0.3))
    tile = round(0.325 * 320)
    assert np.abs(same[:, tile:] - same[:, :-tile]).max() <= 1.0
    assert np.abs(plain[:, tile:] - plain[:, :-tile]).mean() > 10.0
    assert faded.std() == pytest.approx(0.3 * plain.std(), rel=0.05)


def test_the_demo_is_in_the_middle_of_what_life_is_drawn_from() -> None:
    demo = {key: getattr(HARD, key) for key in RANGES if hasattr(HARD, key)}
    demo["electrons"] = HARD.sensor.electrons
    demo["shake_degrees"], demo["shake_metres"] = HARD.shake
    assert RANGES.keys() - demo.keys() == {"passers"}  # nobody walks past
    assert demo == pytest.approx({key: float(np.sqrt(np.prod(RANGES[key]))) for key in demo}, rel=0.04)


def test_life_is_drawn_within_its_ranges_and_long() -> None:
    lived = [recipe(name + "-life") for name in EVERY]
    for r in lived:
        values = {
            **{key: getattr(r, key) for key in ("exposure", "readout", "exposure_step", "passers")},
            **{key: getattr(r.style, key) for key in ("bare", "contrast", "alike", "furniture")},
            "electrons": r.sensor.electrons,
            "shake_degrees": r.shake[0],
            "shake_metres": r.shake[1],
        }
        assert values.keys() == RANGES.keys()
        assert all(RANGES[key][0] <= value <= RANGES[key][1] for key, value in values.items())
    assert len({r.exposure for r in lived}) == len(lived)
    ways = [
        r.length or Route(r.route).length for r in lived if r.name.startswith("corridor") or len(r.name) == 6
    ]
    assert len(ways) == 20
    assert min(ways) >= 50.0
    assert max(ways) == pytest.approx(200.0, abs=2.0)


def test_those_who_walk_past_meet_nobody_and_are_seen_by_all() -> None:
    world = WorldRecording(replace(recipe("turn90-3-life"), passers=20.0))
    assert len(world.scene.passers) >= 2
    walls, near = world.building.plan, 0
    for t in world.times[::3]:
        now = float(t) - LEAD
        there = [p for p in world.scene.passers if p.there(now)]
        near = max(near, len(there))
        assert world.shins(t).shape == (2 + 2 * len(there), 3)
        assert len(world.scene._movers(0, t)) == 3 + 3 * len(there)
        for p in there:
            place = p.trunk(now)
            a, b = walls[:, 0], walls[:, 1]
            along = np.clip(((place - a) * (b - a)).sum(axis=1) / ((b - a) ** 2).sum(axis=1), 0.0, 1.0)
            inside = 0.0 < world.scene.drive.progress(now) < world.scene.drive.route.length
            if inside and np.linalg.norm(place - world.robot(t)[:2, 3]) < 5.0:
                assert np.linalg.norm(a + along[:, None] * (b - a) - place, axis=1).min() > 0.2
            assert np.linalg.norm(place - world.robot(t)[:2, 3]) > 0.4
            assert np.linalg.norm(place - world.person(t)[:2, 3]) > 0.4
    assert near >= 1


def test_a_glossy_floor_mirrors_the_scene() -> None:
    white = np.full((8, 8), 250, np.uint8)
    wall = Panel(np.array([4.0, 0.3, 0.8]), np.array([0.0, -0.6, 0.0]), np.array([0.0, 0.0, -0.6]), white)
    grey = np.full((8, 8), 90, np.uint8)

    edge = np.array([-8.0, 0.0, 0.0])

    def floor(gloss: float) -> Panel:
        return Panel(np.array([8.0, 3.0, 0.0]), np.array([0.0, -6.0, 0.0]), edge, grey, gloss)

    pose = camera_pose([0.0, 0.0, 1.0], 0.0, -0.2, 0.0)
    dull, shining = (Renderer([wall, floor(g)]).render(pose, PINHOLE).astype(int) for g in (0.0, 0.5))
    mirrored = np.array([[4.0, 0.0, -0.5]]) - [0.0, 0.0, 1.0]
    (u, v), *_ = np.rint(PINHOLE.project(mirrored @ pose[:3, :3]).uv).astype(int)
    assert shining[v, u] - dull[v, u] > 40
    assert abs(shining[v, 5] - dull[v, 5]) < 3


class First(WrappedRecording):
    """The first frames of a recording."""

    def __init__(self, base: WorldRecording, count: int) -> None:
        super().__init__(base)
        self.times = base.times[:count]
        self.truth = base.truth[:count]

    def __len__(self) -> int:
        return len(self.times)

    def frame(self, i: int) -> Frame:
        return self._base.frame(i)


def test_our_layout_and_a_bag_replay_to_the_last_bit(corridor: WorldRecording, tmp_path: Path) -> None:
    short = First(corridor, 8)
    readings = readings_of(corridor, 0)
    folder = write_recording(short, tmp_path / "layout")
    write_bag(short, tmp_path / "bag", scans=readings.scans, attitudes=readings.attitudes)
    layout = open_recording(folder)
    bag = open_recording(tmp_path / "bag", topics=TOPICS)
    for i in range(len(short)):
        a, b, live = layout.frame(i), bag.frame(i), short.frame(i)
        assert a.t == b.t == live.t
        assert np.array_equal(a.image, b.image)
        assert np.array_equal(a.image, live.image)
        assert a.views
        assert b.views
        assert np.array_equal(a.views[0].image, b.views[0].image)
        assert np.array_equal(a.views[0].t_cf, b.views[0].t_cf)
        assert np.array_equal(a.views[0].covariance, b.views[0].covariance)
    # A pose's message has no place for what lasts of its error; that nothing does, settings say.
    white = Settings.default().replace({"filter.worn.bias_share": 0.0, "filter.worn.length_sd": 0.0})
    runs = [run(r, mode="collab", start="worn", settings=white).record for r in (layout, bag)]
    assert np.array_equal(runs[0].poses, runs[1].poses)
    assert np.array_equal(runs[0].covariances, runs[1].covariances)
    assert runs[0].start == 0
    read = Bag(tmp_path / "bag")
    front = [s for s in readings.scans if s.scanner == "front"]
    scans, imu = read.scans("/front/scan"), read.imu("/cf/imu")
    assert np.array_equal(scans.ranges, [s.ranges for s in front], equal_nan=True)
    assert np.allclose(
        scans.angles, front[0].angle_min + front[0].angle_increment * np.arange(133), atol=1e-5
    )
    worn = [a.q_xyzw for a in readings.attitudes if a.where == "worn"]
    assert np.array_equal(imu.orientation[:, [1, 2, 3, 0]], worn)
    read.close()
