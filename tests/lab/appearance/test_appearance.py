"""What the tracker makes of worlds and recordings, and the page of both."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from collabslam.batch.engines import LOCAL
from collabslam.errors import DataError
from collabslam_lab.appearance import measure
from collabslam_lab.appearance.compare import compare_worlds, finding, within
from collabslam_lab.appearance.measure import Subject
from collabslam_lab.appearance.tracking import STATISTICS, Tracking
from collabslam_lab.cli import main as lab


class Camera:
    """Stands for an engine after a frame: where the updated filter has features."""

    def __init__(self, ids: np.ndarray, uv: np.ndarray) -> None:
        self.filter = SimpleNamespace(predict_pixels=lambda: SimpleNamespace(ids=ids, uv=uv))


def watched(errors: np.ndarray, miss: np.ndarray) -> Tracking:
    """Features (F) over frames (T) that are found ``errors`` (T, F, 2) off the filter and ``miss`` off what
    was expected; one more is searched in vain, one is refused."""
    watch, rng = Tracking(), np.random.default_rng(0)
    ids = np.arange(errors.shape[1])
    start = rng.uniform(100, 400, (len(ids), 2))
    for k, (error, missed) in enumerate(zip(errors, miss, strict=True)):
        true = start + np.array([3.0, 4.0]) * k
        found = true + error
        order = rng.permutation(len(ids))
        features = SimpleNamespace(
            ids=np.append(ids, [900, 901, 902]),
            predicted=np.vstack([found - missed, np.zeros((3, 2))]),
            found=np.vstack([found, np.full((3, 2), np.nan)]),
            states=["accepted"] * len(ids) + ["unlike", "rejected", "not searched"],
        )
        step: Any = SimpleNamespace(t=0.1 * k, started=True, features=features)
        watch(None, step, Camera(ids[order], true[order]))  # type: ignore[arg-type]
    return watch


def test_statistics_are_those_of_what_was_put_in() -> None:
    rng = np.random.default_rng(1)
    frames, features, keep = 400, 18, 0.9
    errors = np.zeros((frames, features, 2))
    errors[0] = rng.normal(0.0, 0.5, (features, 2))
    for k in range(1, frames):
        errors[k] = keep * errors[k - 1] + np.sqrt(1 - keep**2) * rng.normal(0.0, 0.5, (features, 2))
    said = watched(errors, rng.normal(0.0, 2.0, errors.shape)).statistics()
    assert set(said) == set(STATISTICS)
    assert said["features"] == features
    assert said["track_frames"] == frames
    assert said["track_seconds"] == pytest.approx(0.1 * (frames - 1))
    assert said["unlike"] == said["refused"] == pytest.approx(1.0 / 20.0)
    assert said["ambiguous"] == 0.0
    assert said["motion_px"] == pytest.approx(5.0, abs=0.1)
    assert said["innovation_px"] == pytest.approx(2.0, rel=0.05)
    assert said["residual_px"] == pytest.approx(0.5, rel=0.05)
    assert said["correlation_1"] == pytest.approx(keep, abs=0.03)
    assert said["correlation_10"] == pytest.approx(keep**10, abs=0.08)


def test_nothing_is_said_of_a_run_that_never_started() -> None:
    assert Tracking().statistics() == dict.fromkeys(STATISTICS)


def test_a_number_is_inside_or_it_is_not() -> None:
    assert within(1.0, (1.0, 2.0))
    assert not within(2.1, (1.0, 2.0))
    assert not within(None, (1.0, 2.0))
    assert not within(1.0, (None, None))


def numbers(value: float) -> dict[str, float | None]:
    return dict.fromkeys(STATISTICS, value)


def test_the_page_says_which_worlds_lie_among_the_recordings() -> None:
    groups = {
        "recordings": {"a": numbers(1.0), "b": numbers(3.0)},
        "worlds": {"in": numbers(2.0), "out": {**numbers(2.0), "features": 4.0}},
        "plain worlds": {"p": numbers(0.0)},
    }
    said = finding(groups).numbers
    assert said["ranges"]["features"] == (1.0, 3.0)
    assert said["inside"]["in"]["features"]
    assert not said["inside"]["out"]["features"]
    assert said["inside_share"]["features"] == 0.5
    assert said["inside_share"]["residual_px"] == 1.0


def test_the_command_writes_its_files_and_keeps_its_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "data" / "euroc_v101").mkdir(parents=True)
    asked: list[str] = []

    def track(subject: Subject) -> dict[str, float | None]:
        asked.append(subject.name)
        return numbers(1.0)

    monkeypatch.setattr(measure, "track", track)
    words = ["reproduce", "worlds", "--quick", "--jobs", "1", "--data", str(tmp_path / "data")]
    for _ in range(2):
        assert lab.main([*words, "--out", str(tmp_path)]) == 0
    assert sorted(asked) == sorted(
        ["euroc_v101", *(n for s in ("corridor-0", "turn90-0", "turn180-0", "a") for n in (s, f"{s}-life"))]
    )
    assert (tmp_path / "worlds.md").read_text() in capsys.readouterr().out
    assert (tmp_path / "worlds.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "worlds.json").read_text())["inside_share"]["features"] == 1.0


def test_recordings_are_asked_for_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert lab.main(["reproduce", "worlds", "--out", str(tmp_path)]) == 2
    assert "--data DIR" in capsys.readouterr().err
    with pytest.raises(DataError, match="holds none of the recordings"):
        compare_worlds(tmp_path, tmp_path, jobs=1, engine=LOCAL, progress=False)


def test_a_world_is_tracked_for_real() -> None:
    from collabslam_lab.worlds import recipe

    said = measure.track(Subject("w", recipe=recipe("turn90-3-life"), frames=12))
    assert 5.0 < (said["features"] or 0.0) < 80.0
    assert 0.0 < (said["residual_px"] or 0.0) < 2.0
