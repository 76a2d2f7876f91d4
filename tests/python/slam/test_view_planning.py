"""Where to look (METHOD section 24) on the demo: asked for, in every frame, and left out."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.clip import Clip

from collabslam import Settings, Slam, run
from collabslam.runs.results import FRAMES
from collabslam.simulation import corridor_recording
from collabslam.slam.worn.view_planning import DIAGNOSTICS, ViewPlan

KEY = "frontend.worn.next_best_view"
ASKED = Settings.default().replace({KEY: True})


def played(clip: Clip, count: int, settings: Settings | None = None) -> Slam:
    slam = Slam(clip.recording.camera, clip.recording.worn_camera, settings=settings)
    for frame in clip.frames[:count]:
        slam.step(frame.t, frame.image, frame.views)
    return slam


def answer(slam: Slam) -> ViewPlan:
    plan = slam.next_best_view()
    assert plan is not None
    return plan


def test_the_answer_is_a_view_of_what_cs_sees(clip: Clip) -> None:
    slam = played(clip, 5)
    plan = answer(slam)
    assert plan.gain > 0.05
    assert plan.matches > 8.0
    worn = clip.frames[4].views[0]
    np.testing.assert_allclose(plan.t_cf[:3, 3], worn.t_cf[:3, 3])
    assert plan.t_cf[2, 2] > 0.5, "Cs and Cf look the same way, or nearly"
    assert np.linalg.norm(plan.stand_at - worn.t_cf[:3, 3]) > 0.1
    # The turn leads from the present axis to that one.
    right, up = np.radians([plan.right_deg, plan.up_deg])
    axis = np.array([np.sin(right) * np.cos(up), -np.sin(up), np.cos(right) * np.cos(up)])
    np.testing.assert_allclose(worn.t_cf[:3, :3] @ axis, plan.t_cf[:3, 2], atol=1e-9)


def test_what_is_known_better_gains_less(clip: Clip) -> None:
    frame = clip.frames[5]
    slam = played(clip, 5)
    before = answer(slam).gain
    assert frame.views
    slam.step(frame.t, frame.image, frame.views)
    assert answer(slam).gain < before


def test_there_is_none_before_the_start_and_without_a_view(clip: Clip) -> None:
    camera, worn_camera = clip.recording.camera, clip.recording.worn_camera
    frame = clip.frames[0]
    assert Slam(camera, worn_camera).next_best_view() is None
    fresh = Slam(camera, worn_camera, settings=ASKED)
    step = fresh.step(frame.t, frame.image)
    assert fresh.next_best_view() is None
    assert all(np.isnan(step.diagnostics[name]) for name in DIAGNOSTICS)


def test_asking_changes_nothing_and_the_answer_survives_a_file(clip: Clip, tmp_path: Path) -> None:
    plain, asked = played(clip, 5), played(clip, 5, ASKED)
    assert answer(plain).gain == answer(asked).gain
    np.testing.assert_array_equal(plain.filter.covariance, asked.filter.covariance)
    asked.save(tmp_path / "engine.bin")
    again = answer(Slam.load(tmp_path / "engine.bin"))
    assert (again.gain, again.right_deg) == (answer(asked).gain, answer(asked).right_deg)


def test_a_changed_array_of_the_caller_is_not_the_answer(clip: Clip) -> None:
    frame = clip.frames[0]
    assert frame.views
    t_cf = frame.views[0].t_cf.copy()
    slam = Slam(clip.recording.camera, clip.recording.worn_camera)
    slam.step(frame.t, frame.image, [replace(frame.views[0], t_cf=t_cf)])
    before = answer(slam).gain
    t_cf[:3, 3] += 1.0
    assert answer(slam).gain == before


@pytest.mark.slow
@pytest.mark.parametrize("asked", [True, False])
def test_frames_csv_has_it_where_it_was_asked_for(tmp_path: Path, asked: bool) -> None:
    result = run(corridor_recording(length_m=1.2), settings=ASKED if asked else None, out=tmp_path / "out")
    assert result.folder is not None
    with (result.folder / FRAMES).open() as lines:
        rows = list(csv.DictReader(lines))
    assert ("next_view_gain" in rows[0]) is asked
    assert ("ms_view_planning" in rows[0]) is asked
    if asked:
        assert all(float(row["next_view_gain"]) > 0.0 for row in rows)
