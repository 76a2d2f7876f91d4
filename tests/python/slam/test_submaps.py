"""Submaps and loops: the graph against another program, and a camera that comes back to where it was."""

from __future__ import annotations

import os
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.clip import GLOBAL_SHUTTER
from helpers.waiting import LONGEST

import collabslam
from collabslam._core import Factor, PoseGraph
from collabslam.errors import DataError, FilterError, InputError
from collabslam.geometry import pose_inverse, se3_exp, se3_log
from collabslam.results import StepResult
from collabslam.simulation import SimulatedRecording, corridor_recording
from collabslam.slam.engine import Slam
from collabslam.slam.submaps.background_task import BackgroundTask
from collabslam.slam.submaps.whole_map import submap_poses
from collabslam.types import Array, Status

OUT = 26
"""Frames of the demo on the way out; the same ones backwards are the way back."""
SLOWLY = 8
"""Last of them, in which the camera comes to rest."""


def _walk(count: int) -> list[Array]:
    """Two laps of a round walk."""
    poses = []
    for i in range(count):
        angle = 4.0 * np.pi * i / count
        place = np.r_[np.cos(angle), 0.1 * np.sin(2.0 * angle), np.sin(angle)]
        pose = se3_exp(np.r_[0.0, 0.0, 0.0, 0.0, -angle, 0.05 * np.sin(angle)])
        pose[:3, 3] = 2.0 * place
        poses.append(pose)
    return poses


def _measured(count: int) -> tuple[list[Array], list[tuple[int, int, Array]], Array]:
    """Poses to begin with, measured relative poses (some of them loops), and their covariance."""
    generator = np.random.default_rng(3)
    truth = _walk(count)
    sd = np.array([0.01, 0.02, 0.01, 0.004, 0.006, 0.005])
    pairs = [(i, i + 1) for i in range(count - 1)] + [(k, k + count // 2) for k in (1, 4, 7)]
    links = []
    for i, j in pairs:
        noise = se3_exp(sd * generator.standard_normal(6))
        links.append((i, j, pose_inverse(truth[i]) @ truth[j] @ noise))
    start = [truth[0]]
    for _, _, relative in links[: count - 1]:
        start.append(start[-1] @ relative)
    return start, links, np.diag(sd**2)


def _graph(start: list[Array], links: list[tuple[int, int, Array]], covariance: Array) -> PoseGraph:
    factors = [Factor.of_pose(-1, 0, start[0], np.zeros((6, 6)))]
    factors += [Factor.of_pose(i, j, relative, covariance) for i, j, relative in links]
    factors += [Factor.of_transferred(i, 1e-4 * np.eye(7)) for i in range(len(start))]
    return PoseGraph(np.stack(start), np.zeros((len(start), 7)), factors)


def test_the_graph_agrees_with_gtsam() -> None:
    gtsam = pytest.importorskip("gtsam", reason="gtsam has no wheel for this platform")
    start, links, covariance = _measured(20)
    ours = _graph(start, links, covariance).solved()
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    order = [3, 4, 5, 0, 1, 2]  # it has the rotation first
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance[np.ix_(order, order)])
    fixed = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(start[0]), fixed))
    for i, j, relative in links:
        graph.add(gtsam.BetweenFactorPose3(i, j, gtsam.Pose3(relative), noise))
    for i, pose in enumerate(start):
        values.insert(i, gtsam.Pose3(pose))
    theirs = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    marginals = gtsam.Marginals(graph, theirs)
    moved = 0.0
    for i in range(20):
        off = se3_log(pose_inverse(ours.poses[i]) @ theirs.atPose3(i).matrix())
        # Its residual is the whole logarithm, ours METHOD 1's halves: they differ by their squares.
        assert np.abs(off).max() < 5e-4, i
        moved = max(moved, np.linalg.norm(ours.poses[i][:3, 3] - start[i][:3, 3]))
        p = marginals.marginalCovariance(i)[np.ix_(order, order)]
        if i:
            assert np.abs(ours.posed_node(i).covariance[:6, :6] - p).max() < 0.02 * np.abs(p).max(), i
    assert moved > 0.02
    keys = gtsam.KeyVector([4, 17])
    joint = marginals.jointMarginalCovariance(keys).fullMatrix()
    by = np.hstack([-gtsam.Pose3(ours.poses[17]).between(gtsam.Pose3(ours.poses[4])).AdjointMap(), np.eye(6)])
    p = (by @ joint @ by.T)[np.ix_(order, order)]
    _, own = ours.relative(4, 17)
    assert np.abs(own - p).max() < 0.02 * np.abs(p).max()


def test_a_graph_says_what_is_wrong_with_it() -> None:
    start, links, covariance = _measured(16)
    graph = _graph(start[:8], links[:7], covariance)
    with pytest.raises(InputError, match="no submap 8 among 8"):
        graph.posed_node(8)
    with pytest.raises(InputError, match="no submap 9"):
        graph.relative(0, 9)
    with pytest.raises(InputError, match="factor 0"):
        PoseGraph(np.stack(start[:2]), np.zeros((2, 7)), [Factor.of_pose(0, 5, np.eye(4), covariance)])
    with pytest.raises(InputError, match="rotation"):
        Factor.of_pose(0, 1, 2.0 * np.eye(4) - np.diag([0.0, 0.0, 0.0, 1.0]), covariance)
    with pytest.raises(FilterError, match="positive definite"):
        Factor.of_pose(0, 1, np.eye(4), -np.eye(6))
    loose = PoseGraph(np.stack(start[:2]), np.zeros((2, 7)), [Factor.of_pose(-1, 0, start[0], covariance)])
    with pytest.raises(FilterError, match="tied to nothing"):
        loose.solved()


def _times() -> Array:
    """When the frames of the walk are taken: the camera slows down before it turns back."""
    distance = np.abs(np.arange(2 * OUT - 1) - (OUT - 1)).astype(float)
    away = np.where(distance > SLOWLY, 0.5 * (distance + SLOWLY), np.sqrt(SLOWLY * distance))
    return 0.2 * np.cumsum(np.abs(np.diff(away, prepend=away[0])))


class Walk:
    """Out through the demo's corridor, and the same way back, looking ahead."""

    def __init__(self, recording: SimulatedRecording) -> None:
        self.recording = recording
        settings = collabslam.Settings.default().replace({"filter.map.max_features": 60, **GLOBAL_SHUTTER})
        self.slam = Slam(recording.camera, recording.worn_camera, settings=settings)
        self.order = [*range(OUT), *range(OUT - 2, -1, -1)]
        self.times = _times()
        self.steps: list[StepResult] = []

    def go(self, until: int | None = None) -> None:
        for k in range(len(self.steps), until or len(self.order)):
            frame = self.recording.frame(self.order[k])
            self.steps.append(self.slam.step(self.times[k], frame.image, frame.views))

    def truth(self, k: int) -> Array:
        truth = self.recording.truth
        return pose_inverse(truth[0]) @ truth[self.order[k]]


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    return corridor_recording()


@pytest.fixture(scope="module")
def walk(recording: SimulatedRecording) -> Walk:
    there_and_back = Walk(recording)
    there_and_back.go()
    return there_and_back


@pytest.mark.slow
def test_a_place_that_was_left_is_recognised_and_the_way_corrected(walk: Walk) -> None:
    submaps = walk.slam.submaps()
    assert len(submaps.times) == len(submaps.poses) >= 3
    ended = np.searchsorted(walk.times, submaps.times - 1e-9)
    assert (np.diff(ended) >= 10).all()
    assert submaps.loops
    for loop in submaps.loops:
        assert loop.first < loop.second
        assert loop.matches >= 8
        assert loop.chi2 < 27.9
        # The truth of it: where the camera was when both submaps ended.
        ends = [int(ended[k]) for k in (loop.first, loop.second)]
        pose, covariance = walk.slam.between_submaps(loop.first, loop.second)
        truth = pose_inverse(walk.truth(ends[0])) @ walk.truth(ends[1])
        error = se3_log(pose_inverse(pose) @ truth)
        assert np.linalg.norm(error[:3]) < 0.1
        assert error @ np.linalg.solve(covariance, error) < 30.0


@pytest.mark.slow
def test_the_pose_goes_on_as_odometry_and_the_map_pose_as_the_loops_say(walk: Walk) -> None:
    first = next(k for k, step in enumerate(walk.steps) if step.diagnostics["loops"])
    for step in walk.steps[:first]:
        assert step.pose_map.tobytes() == step.pose.tobytes()
        assert step.covariance_map.tobytes() == step.covariance.tobytes()
    step = walk.steps[first]
    assert (step.pose_map != step.pose).any()
    np.testing.assert_allclose(step.t_map_odom @ step.pose, step.pose_map, atol=1e-12)
    assert np.linalg.eigvalsh(step.covariance_map).min() > 0.0
    error = se3_log(pose_inverse(walk.steps[-1].pose_map) @ walk.truth(len(walk.steps) - 1))
    assert np.linalg.norm(error[:3]) < 0.15
    with pytest.raises(InputError, match="no submap"):
        walk.slam.between_submaps(0, 1000)


@pytest.mark.slow
def test_the_whole_map_has_what_the_filter_has_left_behind(walk: Walk, recording: SimulatedRecording) -> None:
    short = Walk(recording)
    short.go(1)
    while len(short.slam.submaps().times) < 3:
        short.go(len(short.steps) + 1)
    whole, window = short.slam.submaps().landmarks, short.slam.landmarks()
    assert len(set(whole.ids.tolist()) - set(window.ids.tolist())) > 5
    # A submap has just ended and there was no loop: what both have is where the filter has it.
    last = short.slam.filter.pose
    both = np.isin(window.ids, whole.ids)
    of = np.searchsorted(whole.ids, window.ids[both])
    depth = ((window.points[both] - last[:3, 3]) @ last[:3, :3])[:, 2]
    off = np.linalg.norm(whole.points[of] - window.points[both], axis=1)
    assert (np.sort(off / depth)[:40] < 1e-6).all()
    ratio = np.trace(whole.covariance[of], axis1=1, axis2=2) / np.trace(
        window.covariance[both], axis1=1, axis2=2
    )
    assert ((ratio > 0.5) & (ratio < 9.0)).all()
    # The loops of the whole walk leave it sound.
    all_of_it = walk.slam.submaps()
    assert (np.linalg.eigvalsh(all_of_it.landmarks.covariance)[:, 0] > 0.0).all()
    assert all_of_it.covariances.shape == (len(all_of_it.times), 6, 6)


@pytest.mark.slow
def test_a_singular_covariance_of_what_was_transferred_is_named(walk: Walk) -> None:
    chain = walk.slam._parts.submaps.chain()
    spoilt = replace(chain.submaps[1], transferred=chain.submaps[1].transferred + 1e9)
    with pytest.raises(FilterError, match="singular"):
        submap_poses(replace(chain, submaps=[chain.submaps[0], spoilt, *chain.submaps[2:]]))


@pytest.mark.slow
def test_a_loop_counts_ten_frames_after_the_end_of_the_submap(walk: Walk) -> None:
    submaps = walk.slam.submaps()
    counted = [k for k, step in enumerate(walk.steps) if step.diagnostics["loops"]]
    ends = np.searchsorted(walk.times, [loop.t_second - 1e-9 for loop in submaps.loops])
    assert counted == [k + 10 for k in ends if k + 10 < len(walk.steps)]


@pytest.mark.slow
def test_an_engine_of_a_file_finds_the_same_loops_however_long_that_takes(
    walk: Walk, recording: SimulatedRecording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = next(k for k, step in enumerate(walk.steps) if step.diagnostics["loops"])
    again = Walk(recording)
    monkeypatch.setattr(threading.Thread, "start", lambda thread: None)
    monkeypatch.setattr(threading.Thread, "join", lambda thread: None)
    again.go(first - 2)  # the loop's search has begun
    again.slam.save(tmp_path / "engine")
    again.slam = Slam.load(tmp_path / "engine")
    again.go()
    assert again.slam.submaps().loops == walk.slam.submaps().loops
    for one, two in zip(walk.steps, again.steps, strict=True):
        assert one.pose_map.tobytes() == two.pose_map.tobytes()
        assert one.covariance_map.tobytes() == two.covariance_map.tobytes()
    assert again.steps[-1].status is Status.OK
    state = again.slam.state()
    part = state["parts"]["submaps"]
    for wrong, message in (
        ({"poses": np.empty((0, 4, 4))}, "as many poses as submaps"),
        ({"submaps": part["_chain"]["submaps"][:-1]}, "as many poses as submaps"),
        ({"factors": [{**part["_chain"]["factors"][0], "weight": np.zeros((6, 19))}]}, "submaps transferred"),
        ({"factors": [{**part["_chain"]["factors"][1], "transferred": np.zeros(6)}]}, "submaps transferred"),
        ({"transferred": [np.zeros(13), *part["_chain"]["transferred"][1:]]}, "each submap transferred"),
        ({"transferred": np.zeros((len(part["_chain"]["submaps"]), 7))}, "a list"),
    ):
        bad = {**part, "_chain": {**part["_chain"], **wrong}}
        with pytest.raises(DataError, match=message):
            Slam.from_state({**state, "parts": {**state["parts"], "submaps": bad}})


@pytest.mark.slow
def test_a_chain_of_other_worn_cameras_than_the_filter_has_is_refused(walk: Walk) -> None:
    state = walk.slam.state()
    part = state["parts"]["submaps"]
    posed_node = {**part["_posed_node"], "transferred": np.zeros(13), "covariance": np.eye(19)}
    bad = {**state, "parts": {**state["parts"], "submaps": {**part, "_posed_node": posed_node}}}
    with pytest.raises(DataError, match="as many worn cameras as the filter"):
        Slam.from_state(bad)
    posed_node = {**part["_posed_node"], "covariance": np.eye(14)}
    bad = {**state, "parts": {**state["parts"], "submaps": {**part, "_posed_node": posed_node}}}
    with pytest.raises(DataError, match="13x13 array"):
        Slam.from_state(bad)


def test_of_two_persons_both_errors_are_transferred(recording: SimulatedRecording) -> None:
    slam = Slam(recording.camera, {"anna": recording.worn_camera, "ben": recording.worn_camera})
    for i in range(3):
        frame = recording.frame(i)
        views = [replace(view, who=who) for view in frame.views for who in ("anna", "ben")]
        slam.step(frame.t, frame.image, views)
    submap = slam._parts.submaps.chain().submaps[0]
    assert submap.transferred.shape == (13, 13)
    assert submap.with_transferred.shape == (3 * len(submap.ids), 13)
    saved = slam.saved_map()
    assert [len(numbers) for numbers in saved.submaps.transferred] == [13]


@pytest.mark.skipif(sys.platform != "linux", reason="niceness is a whole process's elsewhere")
def test_work_beside_gives_way_to_the_frames() -> None:
    def niceness() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    before, task = niceness(), BackgroundTask[int]()
    task.begin("one", niceness)
    assert task.result("one", niceness) == min(19, before + 8)
    assert niceness() == before


def test_work_beside_gives_what_it_gives_and_raises_what_it_raises() -> None:
    gone, calls = threading.Event(), []
    task: BackgroundTask[bool] = BackgroundTask()

    def waits() -> bool:
        calls.append(threading.current_thread())
        return gone.wait(LONGEST)

    for wanted in ("one", "another"):
        task.begin(wanted, waits)
        task.begin(wanted, waits)
    gone.set()
    assert task.result("another", waits)
    assert len(calls) == 2
    assert threading.current_thread() not in calls

    def fails() -> bool:
        raise FilterError("no")

    for _ in range(2):
        with pytest.raises(FilterError, match="no"):
            task.result("failing", fails)
