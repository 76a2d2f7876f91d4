"""Faults in the stream: each has its answer, and leaves the filter in order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from collabslam.datasets.wrapped import WrappedRecording
from collabslam.errors import CollabslamError, InputError
from collabslam.geometry import se3_exp
from collabslam.results import StepResult
from collabslam.runs.report import unused_text
from collabslam.runs.runner import run
from collabslam.runs.summary import is_trusted
from collabslam.settings.frontend import BlankImageSettings
from collabslam.simulation import corridor_recording
from collabslam.simulation.held import HeldRecording
from collabslam.slam.engine import Slam
from collabslam.slam.tracking.blank_image import BlankImageDetector
from collabslam.types import Frame, Recording, Status
from collabslam_lab.reliability.attacks.streams import STREAMS
from collabslam_lab.reliability.faults import FAULTS, FaultyRecording, inject
from collabslam_lab.reliability.table import FaultRow, faults_markdown, measure_faults

PATCHES = {name: make for name, _, make in STREAMS if name in ("patch-moving", "patch-slow", "hood")}
BY_NAME = {fault.name: fault for fault in FAULTS}


@pytest.fixture(scope="module")
def walk() -> Recording:
    """The first 36 frames of the corridor, rendered once."""
    return HeldRecording(corridor_recording(0, length_m=5.4))


def slam_on(recording: Recording) -> Slam:
    return Slam(recording.camera, recording.worn_camera, mode="collab", start="worn")


def play(slam: Slam, recording: Recording, frames: int) -> StepResult:
    for i in range(frames):
        frame = recording.frame(i)
        last = slam.step(frame.t, frame.image, frame.views)
    return last


def state_of(slam: Slam) -> bytes:
    return slam.filter.mean.tobytes() + slam.filter.covariance.tobytes()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_every_fault_makes_a_recording_that_depends_on_the_seed_alone(walk: Recording, fault: object) -> None:
    one, two = (inject(walk, fault, 3) for _ in range(2))  # type: ignore[arg-type]
    np.testing.assert_array_equal(one.times, two.times)
    assert len(one) == len(one.times) == len(one.truth)
    for i in range(0, len(one), 5):
        try:
            a, b = one.frame(i), two.frame(i)
        except CollabslamError:
            continue
        assert a.index == i
        assert a.t == one.times[i]
        np.testing.assert_array_equal(a.image, b.image)
        assert (not a.views) == (not b.views)


def _with_patch(walk: Recording, name: str) -> Recording:
    return PATCHES[name](walk, np.random.default_rng(0))


@pytest.mark.parametrize("name", ["patch-moving", "patch-slow"])
def test_a_run_beside_a_moving_patch_is_degraded(walk: Recording, name: str) -> None:
    """Over 30 % of the image, 5 or 2 px a frame: its points are taken for a scene that stands still."""
    summary = run(_with_patch(walk, name)).summary
    assert summary["frames_degraded"] > 0.3 * len(walk)
    assert set(summary["degraded_by"]) == {"moving"}
    assert summary["false_ok_share"] <= 0.02
    assert not is_trusted(summary)


def test_what_is_fixed_to_the_camera_is_left_alone(walk: Recording) -> None:
    slam, hooded = slam_on(walk), _with_patch(walk, "hood")
    top = walk.camera.height - walk.camera.height // 3
    seen, fixed = [], 0
    for i in range(len(hooded)):
        frame = hooded.frame(i)
        step = slam.step(frame.t, frame.image, frame.views)
        used = [state == "accepted" for state in step.features.states]
        seen.append((int((step.features.found[used][:, 1] > top + 5).sum()), sum(used)))
        fixed += step.diagnostics.get("candidates_fixed", 0)
    on_hood, in_all = np.sum(seen[5:], axis=0)
    assert fixed > 10
    assert on_hood < 0.02 * in_all
    assert step.status is Status.OK
    again = Slam.from_state(slam.state())
    assert again.filter.candidates.tolist() == slam.filter.candidates.tolist()


def test_what_is_fixed_to_the_camera_is_said(walk: Recording) -> None:
    assert run(walk).summary["points_fixed_to_camera"] == 0
    result = run(_with_patch(walk, "hood")).summary
    assert result["points_fixed_to_camera"] > 10
    assert "something is fixed to it" in unused_text(result)
    assert is_trusted(result)
    assert result["false_ok_share"] == 0.0


def test_stamps_that_do_not_follow_are_left_out_and_counted(walk: Recording) -> None:
    faulty = inject(walk, BY_NAME["stamps-out-of-order"], 1)
    summary = run(faulty, mode="collab", start="worn").summary
    assert summary["frames_out_of_order"] > 0
    assert summary["frames"] + summary["frames_out_of_order"] == len(walk)
    assert summary["frames_ok"] == summary["frames"]


def test_the_engine_refuses_a_stamp_that_does_not_follow_and_goes_on(walk: Recording) -> None:
    slam = slam_on(walk)
    play(slam, walk, 5)
    before = state_of(slam)
    frame = walk.frame(5)
    for t in (walk.times[4], walk.times[2], float("nan"), 1e300):
        with pytest.raises(InputError):
            slam.step(t, frame.image, frame.views)
        assert state_of(slam) == before
    slam.step(frame.t, frame.image, frame.views)
    untroubled = slam_on(walk)
    play(untroubled, walk, 6)
    assert state_of(slam) == state_of(untroubled)


@pytest.mark.parametrize("shape", [(240, 360), (480, 719), (481, 720), (480, 720, 3), (0, 0)])
def test_an_image_of_another_size_is_refused_and_the_state_kept(
    walk: Recording, shape: tuple[int, ...]
) -> None:
    slam = slam_on(walk)
    play(slam, walk, 4)
    before = state_of(slam)
    with pytest.raises(InputError, match=r"grey image|pixels"):
        slam.step(float(walk.times[4]), np.zeros(shape, np.uint8))
    assert state_of(slam) == before


@pytest.mark.parametrize("kind", ["black", "white", "noise", "frozen"])
def test_an_image_that_shows_nothing_is_no_measurement(walk: Recording, kind: str) -> None:
    slam = slam_on(walk)
    last = play(slam, walk, 12)
    rng = np.random.default_rng(0)
    size = slam.filter.map_size
    for i in range(12, 18):
        image = {
            "black": np.zeros((480, 720), np.uint8),
            "white": np.full((480, 720), 255, np.uint8),
            "noise": np.clip(rng.normal(16.0, 3.0, (480, 720)), 0, 255).astype(np.uint8),
            "frozen": walk.image(11),
        }[kind]
        result = slam.step(float(walk.times[i]), image)
        assert result.diagnostics["unseen"] == 1
        lost = kind != "frozen" and i >= 14  # a frozen image says nothing of the camera
        assert result.status.value == ("LOST" if lost else "COASTING")
        assert np.trace(result.covariance) > np.trace(last.covariance)
        last = result
    assert slam.filter.map_size == size
    frame = walk.frame(18)
    result = slam.step(frame.t, frame.image, frame.views)
    assert result.status.value == "OK"
    assert result.diagnostics["unseen"] == 0


def test_an_image_that_comes_twice_is_as_good_as_the_last_for_a_tenth_of_a_second(walk: Recording) -> None:
    slam = slam_on(walk)
    play(slam, walk, 12)
    t = float(walk.times[11])
    status = [slam.step(t + dt, walk.image(11)).status.value for dt in (0.03, 0.09, 0.1, 0.13)]
    assert status == ["OK", "OK", "COASTING", "COASTING"]


def test_an_image_that_repeats_to_the_bit_is_frozen() -> None:
    image = np.random.default_rng(1).integers(0, 255, (480, 720)).astype(np.uint8)
    image = np.kron(image[::16, ::16], np.ones((16, 16), np.uint8))
    detector = BlankImageDetector(BlankImageSettings())
    assert [detector.judge(image), detector.judge(image)] == ["", "frozen"]


@pytest.mark.parametrize(
    "error", [[0, 0, 3.0, 0, 0, 0], [-2.0, 1.0, 0, 0, 0, 0], [0, 0, 0, 0, 0.6, 0], [1.0, 0, 1.0, 0.5, 0, 0]]
)
def test_a_gross_error_of_t_cf_is_not_used(walk: Recording, error: list[float]) -> None:
    def change(i: int, frame: Frame) -> Frame:
        if i != 6:
            return frame
        return replace(frame, views=tuple(replace(v, t_cf=v.t_cf @ se3_exp(error)) for v in frame.views))

    slam = slam_on(walk)
    result = play(slam, FaultyRecording(walk, change=change), 7)
    assert result.diagnostics["depth_rows"] == 0
    assert result.diagnostics["births_instant"] == 0
    assert result.status.value == "OK"


def test_a_singular_covariance_of_t_cf_is_refused_before_anything_changes(walk: Recording) -> None:
    slam = slam_on(walk)
    play(slam, walk, 3)
    before = state_of(slam)
    frame = walk.frame(3)
    assert frame.views
    for covariance in (np.zeros((6, 6)), -np.eye(6), np.full((6, 6), np.nan), np.eye(5)):
        with pytest.raises(InputError):
            slam.step(frame.t, frame.image, [replace(frame.views[0], covariance=covariance)])
        assert state_of(slam) == before


def test_a_bias_that_is_no_part_of_the_covariance_is_refused_before_anything_changes(walk: Recording) -> None:
    slam = slam_on(walk)
    play(slam, walk, 3)
    before = state_of(slam)
    frame = walk.frame(3)
    assert frame.views
    worn = frame.views[0]
    for bias in (1.01 * worn.covariance, -worn.covariance, np.full((6, 6), np.nan), np.eye(5)):
        with pytest.raises(InputError, match="bias"):
            slam.step(frame.t, frame.image, [replace(worn, bias=bias)])
        assert state_of(slam) == before
    slam.step(frame.t, frame.image, [replace(worn, bias=0.5 * worn.covariance)])


def test_the_table_has_a_row_for_what_goes_on_and_for_what_stops(walk: Recording) -> None:
    faults = [BY_NAME["t-cf-gross"], BY_NAME["file-cut-off"]]
    rows = measure_faults([0], faults=faults, length_m=4.5)
    assert rows[0].error_ratio is not None
    assert rows[0].error_ratio > 0.0
    assert rows[1].error_ratio is None
    assert "cut short" in rows[1].error
    text = faults_markdown(rows)
    assert text.count("\n") == 3
    assert "stops" in text.splitlines()[-1]
    assert rows[0].jsonable()["fault"] == "t-cf-gross"
    assert isinstance(rows[0], FaultRow)
    assert issubclass(FaultyRecording, WrappedRecording)
