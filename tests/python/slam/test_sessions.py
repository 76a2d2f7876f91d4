"""Two runs at one place: the second finds itself in a submap of the first, far from where that one ended."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from collabslam._core import Camera
from collabslam.errors import DataError
from collabslam.geometry import pose_inverse, se3_log
from collabslam.simulation import SimulatedRecording, corridor_recording
from collabslam.slam.engine import Slam
from collabslam.slam.map.saved_map import SavedMap
from collabslam.slam.recovery.known_submaps import as_map
from collabslam.slam.submaps.chain import Chain
from collabslam.types import Status

FIRST, AGAIN = 44, range(4, 22)
"""Frames of the first run, and those of the second, the other way round."""


@pytest.fixture(scope="module")
def recording() -> SimulatedRecording:
    return corridor_recording()


@pytest.fixture(scope="module")
def first(recording: SimulatedRecording) -> Slam:
    slam = Slam(recording.camera, recording.worn_camera)
    for i in range(FIRST):
        frame = recording.frame(i)
        slam.step(frame.t, frame.image, frame.views)
    return slam


@pytest.fixture(scope="module")
def file(first: Slam, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sessions") / "corridor.map"
    first.saved_map().save(path)
    return path


def _upside_down(known: SavedMap) -> SavedMap:
    """With views of its landmarks by which none is recognised."""
    views = [[replace(v, pixels=np.ascontiguousarray(v.pixels[::-1])) for v in some] for some in known.views]
    return replace(known, views=views)


@pytest.mark.slow
def test_a_map_holds_the_submaps(first: Slam, file: Path) -> None:
    chain, loaded = first._parts.submaps.chain(), SavedMap.load(file).submaps
    assert len(loaded.submaps) == len(chain.submaps) >= 2
    for kept, submap in zip(loaded.submaps, chain.submaps, strict=True):
        np.testing.assert_array_equal(kept.covariance, submap.covariance)
        assert kept.pose.tobytes() == submap.pose.tobytes()
    alive = first.filter.known_map().ids.tolist()
    for kept, submap in zip(loaded.submaps, chain.submaps, strict=True):
        for new, old in zip(kept.ids.tolist(), submap.ids.tolist(), strict=True):
            assert new == alive.index(old) if old in alive else new < 0


@pytest.mark.slow
def test_a_second_run_is_found_in_one_of_them(
    recording: SimulatedRecording, file: Path, tmp_path: Path
) -> None:
    known = _upside_down(SavedMap.load(file))
    second = Slam(recording.camera, mode="mono", start="map", map=known)
    before = len(known.submaps.submaps)
    w, found, values = pose_inverse(recording.truth[0]), 0, []
    for k, i in enumerate(reversed(AGAIN)):
        step = second.step(0.1 * k, recording.image(i))
        found += step.diagnostics["relocalised"]
        if step.valid:
            off = se3_log(pose_inverse(step.pose) @ w @ recording.truth[i])
            values.append(off @ np.linalg.solve(step.covariance, off))
            assert np.linalg.norm(off[:3]) < 0.1
        if k == 3:  # what was found goes with a checkpoint
            second.save(tmp_path / "engine")
            second = Slam.load(tmp_path / "engine")
    assert found == 1
    assert step.status is Status.OK
    assert np.mean(values) < 12.6  # 95 % of six numbers: all poses rest on one submap
    way = second.submaps()
    assert len(way.poses) > before
    _, covariance = second.between_submaps(0, before)
    assert np.trace(covariance[:3, :3]) < 0.1**2
    # Without its submaps nothing of the map is recognised.
    bare = Slam(recording.camera, mode="mono", start="map", map=replace(known, submaps=Chain.empty()))
    assert not any(bare.step(0.1 * k, recording.image(i)).valid for k, i in enumerate(AGAIN[:3]))


@pytest.mark.slow
def test_two_runs_with_a_worn_camera_each_end_in_one_frame(
    first: Slam, recording: SimulatedRecording, file: Path, tmp_path: Path
) -> None:
    # Another person, whose measured poses err in another way, looks ahead at other times.
    other = corridor_recording(seed=7, glances=((0.5, 0.9), (1.3, 1.6)))
    frames = list(reversed(AGAIN))
    second = Slam(other.camera, other.worn_camera, start="map", map=_upside_down(SavedMap.load(file)))
    before, used = len(first.submaps().poses), 0
    for k, i in enumerate(frames):
        frame = other.frame(i)
        step = second.step(0.1 * k, frame.image, frame.views)
        used += step.diagnostics["overlap"]
        if k == 9:
            second.save(tmp_path / "engine")
            chain = second._parts.submaps.chain()
            second = Slam.load(tmp_path / "engine")
            again = second._parts.submaps.chain()
            assert len(again.submaps) == len(chain.submaps) >= before
            assert again.poses.tobytes() == chain.poses.tobytes()
            assert len(again.factors) == len(chain.factors)
    assert 2 <= used < len(frames) - 2
    assert step.status is Status.OK
    way = second.submaps()
    assert len(way.poses) > before
    # Submaps of both runs, in the frame of the first: there, and from one another.
    where = {t: k for k, t in enumerate(np.round(recording.times[:FIRST], 6).tolist())}
    ends = [where[round(t, 6)] for t in way.times[:before]]
    ends += [frames[round(10.0 * t)] for t in way.times[before:]]
    truth = [pose_inverse(recording.truth[0]) @ recording.truth[i] for i in ends]
    for k in range(before, len(ends)):
        off = se3_log(pose_inverse(way.poses[k]) @ truth[k])
        assert np.linalg.norm(off[:3]) < 0.1
        assert off @ np.linalg.solve(way.covariances[k], off) < 22.5  # 99.9 % of six numbers
        for early in range(before):
            pose, covariance = second.between_submaps(early, k)
            off = se3_log(pose_inverse(pose) @ pose_inverse(truth[early]) @ truth[k])
            assert off @ np.linalg.solve(covariance, off) < 22.5


@pytest.mark.slow
def test_another_camera_has_its_own_views_of_them(file: Path) -> None:
    other = Camera("radtan", 640, 400, (500.0, 505.0, 322.0, 199.0), (-0.04, 0.01, 0.0, 0.0005))
    known = SavedMap.load(file)
    seen = known.seen_by(other)
    for submap, before in zip(seen.submaps.submaps, known.submaps.submaps, strict=True):
        n = len(submap.ids)
        assert (n > 0) == (len(before.ids) > 0)
        assert len(submap.patches) == n
        assert submap.covariance.shape == (3 * n, 3 * n)
        assert submap.described


@pytest.mark.slow
def test_a_submap_as_a_map_says_what_the_submap_says(file: Path) -> None:
    submap = SavedMap.load(file).submaps.submaps[1]
    there = as_map(submap)
    theta, phi, rho = there.landmarks[:, 3:].T
    ray = np.stack([np.cos(phi) * np.sin(theta), -np.sin(phi), np.cos(phi) * np.cos(theta)], axis=1)
    np.testing.assert_allclose(there.landmarks[:, :3] + ray / rho[:, None], there.points, atol=1e-12)
    np.testing.assert_allclose(
        submap.points @ submap.pose[:3, :3].T + submap.pose[:3, 3], there.points, atol=1e-12
    )
    # The relative sd of a range is that of the inverse range.
    n = len(submap.ids)
    blocks = submap.covariance.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n)]
    ranges = np.linalg.norm(submap.points, axis=1)
    sd = np.sqrt(np.einsum("ni,nij,nj->n", submap.points, blocks, submap.points)) / ranges**2
    np.testing.assert_allclose(np.sqrt(np.diag(there.covariance)[5::6]) / rho, sd, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.eigvalsh(there.covariance).min(), 0.0, atol=1e-9)


@pytest.mark.slow
def test_submaps_that_cannot_be_recognised_are_refused(file: Path, tmp_path: Path) -> None:
    known = SavedMap.load(file)
    last = replace(known.submaps.submaps[-1], codes=np.empty((0, 128), np.uint8))
    chain = replace(known.submaps, submaps=[*known.submaps.submaps[:-1], last])
    replace(known, submaps=chain).save(tmp_path / "map")
    with pytest.raises(DataError, match="recognised"):
        SavedMap.load(tmp_path / "map")
