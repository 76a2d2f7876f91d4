"""The demo's renderer is exact, and its recording is what the demo needs."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from collabslam._core import Camera
from collabslam.errors import InputError
from collabslam.geometry import pose_inverse, se3_log
from collabslam.simulation import SimulatedRecording, corridor_recording, demo_recording
from collabslam.simulation.conditions import HARD, PLAIN
from collabslam.simulation.recording import DEMO_METRES
from collabslam.simulation.rendered import Sensor
from collabslam.simulation.renderer import Renderer
from collabslam.simulation.trajectory import CorridorWalk, camera_pose
from collabslam.simulation.world import Panel, box, corridor, panel

Array = npt.NDArray[np.float64]

pytestmark = pytest.mark.usefixtures("drawn_anew")

RADTAN = Camera("radtan", 720, 480, (620.0, 620.0, 359.5, 239.5), (-0.06, 0.02, 0.0005, -0.0004))
WIDE = Camera("wideangle", 640, 480, (380.0, 380.0, 320.0, 240.0), (1.5e-6,))


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    return corridor_recording(seed=0)


def checker(width: float, height: float, square: float) -> tuple[npt.NDArray[np.uint8], Array]:
    """A checkerboard, 200 texels per metre, and its inner corners (N, 2); `square` and corners in metres."""
    y, x = np.mgrid[0 : round(height * 200), 0 : round(width * 200)]
    image = np.where((x // round(square * 200) + y // round(square * 200)) % 2, 220, 30).astype(np.uint8)
    grid = np.meshgrid(np.arange(square, width - 1e-9, square), np.arange(square, height - 1e-9, square))
    return image, np.stack([g.ravel() for g in grid], axis=1)


def to_camera(pose: Array, points: Array) -> Array:
    return np.asarray((points - pose[:3, 3]) @ pose[:3, :3])


def epipolar_distance(rays1: Array, rays2: Array, t_12: Array) -> Array:
    """Distance, in units of the first normalised image plane, of each point from its epipolar line."""
    x1, x2 = rays1 / rays1[:, 2:], rays2 / rays2[:, 2:]
    lines = np.cross(t_12[:3, 3], x2 @ t_12[:3, :3].T)
    return np.asarray(np.abs((x1 * lines).sum(axis=1)) / np.hypot(lines[:, 0], lines[:, 1]))


def sift_matches(a: npt.NDArray[np.uint8], b: npt.NDArray[np.uint8]) -> tuple[Array, Array]:
    sift = cv2.SIFT.create(1200)
    (ka, da), (kb, db) = sift.detectAndCompute(a, None), sift.detectAndCompute(b, None)
    pairs = [m for m, n in cv2.BFMatcher().knnMatch(da, db, k=2) if m.distance < 0.8 * n.distance]
    return np.array([ka[m.queryIdx].pt for m in pairs]), np.array([kb[m.trainIdx].pt for m in pairs])


def overlap(recording: SimulatedRecording, i: int) -> float:
    """Share of a grid of Cs's pixels whose surface lies inside Cf's picture."""
    f, (cx, cy) = recording.camera.intrinsics[:2], recording.camera.intrinsics[2:]
    coarse = Camera("pinhole", 36, 24, (f[0] / 20, f[1] / 20, cx / 20 - 0.475, cy / 20 - 0.475), ())
    v, u = np.mgrid[0:24, 0:36]
    rays = coarse.unproject(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    depth = recording.renderer.depth(recording.truth[i], coarse).reshape(-1, 1)
    in_f = to_camera(recording.true_t_cf(i), rays / rays[:, 2:] * depth)
    return float(recording.worn_camera.project(in_f).visible.mean())


@pytest.mark.parametrize("camera", [RADTAN, WIDE], ids=["radtan", "wideangle"])
@pytest.mark.parametrize(
    "pose",
    [
        camera_pose([0.0, 0.003, 0.002], 0.0, 0.0, 0.0),
        camera_pose([0.6, 0.9, 0.4], -0.35, -0.15, 0.1),
        camera_pose([1.0, -1.6, 0.2], 0.75, 0.0, -0.2),
    ],
    ids=["frontal", "oblique", "grazing"],
)
def test_corners_appear_where_the_camera_projects_them(camera: Camera, pose: Array) -> None:
    image, corners = checker(2.0, 1.6, 0.2)
    board = panel((3.0, 1.0, 0.8), (0.0, -2.0, 0.0), (0.0, 0.0, -1.6), image)
    world = board.origin + corners[:, :1] * board.u / 2.0 + corners[:, 1:] * board.v / 1.6
    there = camera.project(to_camera(pose, world))
    expected = there.uv
    seen = there.visible & ((expected > 12) & (expected < np.array([camera.width, camera.height]) - 13)).all(
        axis=1
    )
    assert seen.sum() >= 20
    found = expected[seen].astype(np.float32).reshape(-1, 1, 2) + np.float32(0.7)
    picture = Renderer([board]).render(pose, camera)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
    found = cv2.cornerSubPix(picture, found, (6, 6), (-1, -1), stop).reshape(-1, 2)
    error = found - expected[seen]
    assert np.abs(error.mean(axis=0)).max() < 0.02
    assert np.median(np.linalg.norm(error, axis=1)) < 0.06
    assert np.linalg.norm(error, axis=1).max() < 0.1


def test_depth_is_that_of_the_nearest_surface() -> None:
    image = checker(1, 1, 0.1)[0]
    far = panel((4.0, 5.0, 5.0), (0.0, -10.0, 0.0), (0.0, 0.0, -10.0), image)
    near = panel((2.0, 0.0, 0.5), (1.0, -0.8, 0.0), (0.0, 0.0, -1.0), image)
    pose = camera_pose([0.0, 0.0, 0.0], 0.0, 0.0, 0.0)
    for panels in ([far, near], [near, far]):
        renderer = Renderer(panels)
        depth = renderer.depth(pose, RADTAN)
        point = near.origin + 0.37 * near.u + 0.6 * near.v
        uv = RADTAN.project(to_camera(pose, point[None])).uv
        ray = RADTAN.unproject(np.rint(uv))[0]
        normal = np.cross(near.u, near.v)
        ray_w = pose[:3, :3] @ (ray / ray[2])
        assert depth[tuple(np.rint(uv[0]).astype(int)[::-1])] == pytest.approx(
            normal @ near.origin / (normal @ ray_w), abs=1e-6
        )
        assert depth[240, 100] == pytest.approx(4.0, abs=1e-9)
    assert np.isinf(Renderer([near]).depth(pose, RADTAN)[240, 100])


@pytest.mark.slow
def test_picture_and_depth_agree_on_what_hides_what() -> None:
    tones = (40, 120, 200)
    rng = np.random.Generator(np.random.PCG64(3))
    panels, owners = [], []
    for tone, x, y in zip(tones, (2.0, 2.6, 3.4), (-0.3, 0.25, 0.75), strict=True):
        for face in box(rng, (x, y), (0.6, 0.6, 1.2), angle=x, floor=-0.6):
            panels.append(Panel(face.origin, face.u, face.v, np.full((40, 40), tone, np.uint8)))
            owners.append(tone)
    pose = camera_pose([0.0, 0.1, 0.4], 0.0, -0.15, 0.05)
    depth = Renderer(panels).depth(pose, RADTAN)
    expected = np.zeros(depth.shape, np.uint8)
    for tone in tones:
        alone = Renderer([p for p, o in zip(panels, owners, strict=True) if o == tone]).depth(pose, RADTAN)
        expected[np.isfinite(alone) & (alone <= depth)] = tone
    assert set(np.unique(expected)) == {0, *tones}
    picture = Renderer(panels).render(pose, RADTAN)
    flat = cv2.erode(expected, np.ones((5, 5))) == cv2.dilate(expected, np.ones((5, 5)))
    assert flat.mean() > 0.9
    assert np.abs(picture[flat].astype(int) - expected[flat]).max() <= 3


def test_a_floor_that_reaches_behind_the_camera_is_clipped_not_mirrored() -> None:
    image, _ = checker(3.0, 8.0, 0.5)
    floor = panel((4.0, 1.5, 0.0), (0.0, -3.0, 0.0), (-8.0, 0.0, 0.0), image)
    pose = camera_pose([0.0, 0.0, 1.0], 0.0, 0.0, 0.0)
    picture = Renderer([floor]).render(pose, RADTAN)
    assert picture[:380].max() == 0  # the floor's far edge is 620 / 4 pixels below the horizon
    assert picture[400:, 360].min() > 20
    point = np.array([[2.75, 0.25, 0.0], [2.75, -0.25, 0.0], [3.25, -0.25, 0.0]])
    (u, v), (u2, v2), (u3, v3) = np.rint(RADTAN.project(to_camera(pose, point)).uv).astype(int)
    assert abs(int(picture[v, u]) - int(picture[v2, u2])) > 150
    assert abs(int(picture[v2, u2]) - int(picture[v3, u3])) > 150


def test_fine_stripes_far_away_melt_into_grey() -> None:
    stripes = np.tile(np.array([0, 255], np.uint8), (64, 2048))
    wall = panel((2.0, 1.0, 0.5), (20.0, 0.0, 0.0), (0.0, 0.0, -1.0), stripes)
    camera = Camera("pinhole", 720, 480, (620.0, 620.0, 359.5, 239.5), ())
    pose = camera_pose([0.0, 0.0, 0.0], 0.0, 0.0, 0.0)
    points = np.array([[x, 1.0, z] for x in np.linspace(12.0, 20.0, 40) for z in (-0.3, 0.0, 0.3)])
    uv = camera.project(to_camera(pose, points)).uv
    seen = Renderer([wall]).render(pose, camera)[np.rint(uv[:, 1]).astype(int), np.rint(uv[:, 0]).astype(int)]
    assert np.abs(seen.astype(float) - 127.5).max() < 12


@pytest.mark.slow
def test_the_corridor_has_no_holes(recording: SimulatedRecording) -> None:
    white = [Panel(p.origin, p.u, p.v, np.full((8, 8), 200, np.uint8)) for p in corridor(15.0)]
    renderer = Renderer(white)
    for i in (0, 47, 99):
        assert (renderer.render(recording.truth[i], recording.camera) == 200).all()


@pytest.mark.slow
def test_frames_repeat_in_any_order_and_follow_the_seed(recording: SimulatedRecording) -> None:
    first, again, other = recording, corridor_recording(seed=0), corridor_recording(seed=1)
    again.frame(44)
    a, b, c = first.frame(3), again.frame(3), other.frame(3)
    assert a.views
    assert b.views
    assert c.views
    assert a.index == 3
    assert a.t == pytest.approx(0.3)
    assert np.array_equal(a.image, b.image)
    assert np.array_equal(a.image, corridor_recording(seed=0).image(3))
    assert np.array_equal(a.views[0].image, b.views[0].image)
    assert np.array_equal(a.views[0].t_cf, b.views[0].t_cf)
    assert not np.array_equal(a.views[0].t_cf, c.views[0].t_cf)
    difference = a.image.astype(float) - c.image
    assert np.std(difference) == pytest.approx(np.sqrt(2) * 2.52, rel=0.02)
    assert abs(difference.mean()) < 0.05
    assert np.array_equal(first.truth, other.truth)


@pytest.mark.slow
def test_measured_pose_has_the_covariance_it_claims(
    recording: SimulatedRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    blank = np.zeros((480, 720), np.uint8)
    monkeypatch.setattr(Renderer, "render", lambda *_, **__: blank)
    errors = []
    claimed = []
    for seed in range(1, 41):
        noisy = corridor_recording(seed=seed)
        monkeypatch.setattr(noisy, "_expose", lambda *_: blank)
        for i in range(0, 10, 2):
            worn = noisy.frame(i).views[0]
            claimed.append(worn.covariance)
            errors.append(se3_log(pose_inverse(worn.t_cf) @ noisy.true_t_cf(i)))
    expected = np.array([0.03, 0.03, 0.03, *np.deg2rad([0.5, 1.0, 0.5])])
    assert np.allclose(claimed, np.diag(expected**2))
    assert np.allclose(np.std(errors, axis=0), expected, rtol=0.2)
    assert np.all(np.abs(np.mean(errors, axis=0)) < 4 * expected / np.sqrt(len(errors)))


def test_overlap_comes_and_goes(recording: SimulatedRecording) -> None:
    walk = CorridorWalk()
    sent = np.array([walk.looks_ahead(float(t)) for t in recording.times])
    assert len(recording) == 100
    assert sent[:10].all()
    assert 0.35 <= sent.mean() <= 0.45
    assert np.count_nonzero(np.diff(sent.astype(int)) == 1) == 2
    shares = np.array([overlap(recording, i) for i in range(0, 100, 3)])
    assert shares[sent[::3]].min() > 0.4
    assert np.median(shares[~sent[::3]]) == 0.0
    baselines = [float(np.linalg.norm(recording.true_t_cf(i)[:3, 3])) for i in range(100)]
    assert min(baselines) > 0.6
    assert max(baselines) < 1.2
    assert not recording.frame(30).views


@pytest.mark.slow
@pytest.mark.parametrize(
    "changed",
    [
        {"exposure": 0.02},
        {"exposure": 0.001, "readout": 0.03},
        {"sensor": Sensor(electrons=800.0)},
        {"exposure_step": 0.5},
        {"shake": (0.5, 0.01)},
        {"bare": 0.7},
        {"contrast": 0.5},
        {"alike": 0.9},
        {"furniture": 0.1},
    ],
    ids=lambda changed: "+".join(changed),
)
def test_each_condition_changes_the_picture(changed: dict[str, Any]) -> None:
    other = corridor_recording(length_m=3.0, conditions=replace(PLAIN, **changed)).image(19)
    same = corridor_recording(length_m=3.0).image(19)
    assert np.std(other.astype(float) - same) > 1.0  # the noise is drawn alike in both


@pytest.mark.slow
def test_a_dim_corridor_has_less_contrast_and_more_noise() -> None:
    plain, hard = (corridor_recording(length_m=3.0, conditions=c) for c in (PLAIN, HARD))
    assert np.std(hard.image(0)) < 0.8 * np.std(plain.image(0))
    again = corridor_recording(seed=1, length_m=3.0, conditions=HARD)
    assert np.std(hard.image(0).astype(float) - again.image(0)) > 1.2 * np.sqrt(2) * 2.52


@pytest.mark.slow
def test_the_demo_is_the_hard_corridor() -> None:
    demo = demo_recording()
    assert len(demo) == round(DEMO_METRES / 1.5 * 10.0)
    assert np.array_equal(demo.image(3), corridor_recording(length_m=DEMO_METRES, conditions=HARD).image(3))


def test_the_walk_is_smooth_and_of_the_asked_length(recording: SimulatedRecording) -> None:
    walk = CorridorWalk()
    path = np.stack([walk.robot(t)[:3, 3] for t in np.arange(0.0, 10.001, 0.01)])
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / 0.01
    assert speed.min() > 1.35
    assert speed.max() < 1.65
    assert path[-1, 0] - path[0, 0] == pytest.approx(15.0, abs=0.1)
    steps = [pose_inverse(a) @ b for a, b in pairwise(recording.truth)]
    turns = [np.linalg.norm(se3_log(step)[3:]) for step in steps]
    assert np.rad2deg(max(turns)) < 1.5


@pytest.mark.slow
def test_epipolar_geometry_holds_along_the_walk_and_across_the_cameras(recording: SimulatedRecording) -> None:
    cs, cf = recording.camera, recording.worn_camera
    for i in (0, 45, 85):
        frame = recording.frame(i)
        assert frame.views
        corners = cv2.goodFeaturesToTrack(frame.image, 3000, 0.01, 12)
        assert corners is not None
        assert len(corners) > 400
        a, b = sift_matches(frame.image, recording.image(i + 1))
        step = pose_inverse(recording.truth[i]) @ recording.truth[i + 1]
        distance = 620.0 * epipolar_distance(cs.unproject(a), cs.unproject(b), step)
        assert np.median(distance) < 0.2
        a, b = sift_matches(frame.image, frame.views[0].image)
        true = recording.true_t_cf(i)
        distance = 620.0 * epipolar_distance(cs.unproject(a), cf.unproject(b), true)
        assert (distance < 2.0).sum() > 60
        assert np.median(distance[distance < 2.0]) < 0.4
        turned = true.copy()
        turned[:3, :3] = true[:3, :3] @ cv2.Rodrigues(np.array([0.0, 0.0, 0.03]))[0]
        wrong = 620.0 * epipolar_distance(cs.unproject(a), cf.unproject(b), turned)
        assert (wrong < 1.0).sum() < 0.6 * (distance < 1.0).sum()


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"length_m": -1.0}, "length_m"),
        ({"length_m": 1000.0}, "200"),
        ({"speed": 0.0}, "speed"),
        ({"rate": float("nan")}, "rate"),
        ({"length_m": 0.1}, "frames"),
        ({"seed": -1}, "seed"),
    ],
)
def test_bad_options_are_named(options: dict[str, float], word: str) -> None:
    with pytest.raises(InputError, match=word):
        corridor_recording(**options)  # type: ignore[arg-type]


def test_a_frame_that_does_not_exist_is_named(recording: SimulatedRecording) -> None:
    with pytest.raises(InputError, match="frame 100"):
        recording.frame(100)
    with pytest.raises(InputError, match="frame -1"):
        recording.image(-1)
