"""The lab's clocks: what lateness and offsets cost is measured, written and drawn."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from collabslam.errors import SettingsError
from collabslam.geometry import pose_inverse
from collabslam_lab.cli.main import main
from collabslam_lab.hardware import clocks
from collabslam_lab.hardware.free_running import WornClock
from collabslam_lab.hardware.offset_tables import found_table, offset_table
from collabslam_lab.hardware.wrong_stamps import KNOWN, WrongStamps, side_by_side


def test_an_offset_is_of_the_image_and_of_t_cf() -> None:
    way = side_by_side("turn90-0", 0, 4)
    world, sds = way.world, KNOWN["5 mm, 0.2 degrees"]
    wrong = WrongStamps(way, 0.05, sds)
    frame, right = wrong.frame(3), WrongStamps(way, 0.0, sds).frame(3)
    assert frame.views
    assert right.views
    t = frame.t + 0.05
    true = pose_inverse(world.robot(t)) @ world.person(t)
    off = pose_inverse(true) @ frame.views[0].t_cf
    assert np.linalg.norm(off[:3, 3]) < 0.03
    assert np.trace(off[:3, :3]) > 1.0 + 2.0 * np.cos(np.radians(2.0))
    assert np.array_equal(frame.image, right.image)
    assert not np.array_equal(frame.views[0].image, right.views[0].image)


def test_views_of_any_time_tell_as_much_and_are_consistent_about_it() -> None:
    # What their error is over many draws of the noise, the core's own test says: here a draw counts for more.
    rows = list(clocks.clock_rows([0, 1], clocks.FEW_CLOCKS, 40))
    scores = {
        clock: clocks.pooled(
            [
                row
                for row in rows
                if row["rate_hz"] == clock.rate
                and row["late_s"] == clock.late
                and row["phase_s"] == clock.phase
            ]
        )
        for clock in (clocks.TOGETHER, *clocks.FEW_CLOCKS)
    }
    together = scores[clocks.TOGETHER]
    for clock, score in scores.items():
        fewer = np.sqrt(max(1.0, clocks.TOGETHER.rate / clock.rate))
        assert score.claimed < 1.2 * fewer * together.claimed, clock
        assert 0.2 < score.nees < 9.0, clock  # 6 is expected
    assert min(row["ok_share"] for row in rows) > 0.7  # views that are 0.95 s late start a filter so late


def test_scores_are_pooled_over_frames() -> None:
    rows = [
        {"frames": 1, "sum_square_m2": 9.0, "sum_variance_m2": 4.0, "sum_nees": 5.0},
        {"frames": 3, "sum_square_m2": 7.0, "sum_variance_m2": 0.0, "sum_nees": 3.0},
    ]
    assert clocks.pooled(rows) == clocks.Pooled(2.0, 1.0, 2.0)
    assert np.isnan(clocks.pooled([]).error)


def test_the_page_says_what_an_offset_costs_and_whether_it_is_noticed() -> None:
    row = {"way": "lively", "seed": 0, "t_cf": "1 cm", "frames": 4, "sum_variance_m2": 1.0, "sum_nees": 24.0}
    right = {"offset_ms": 0.0, "told": False, "sum_square_m2": 4e-4, "ok_share": 1.0, "degraded_share": 0.0}
    wrong = {
        "offset_ms": 50.0,
        "told": False,
        "sum_square_m2": 36e-4,
        "ok_share": 0.25,
        "degraded_share": 0.5,
    }
    rows = [row | right, row | wrong, row | wrong | {"told": True, "sum_square_m2": 16e-4}]
    table = offset_table(rows).markdown()
    assert "| lively | 1 cm | 0 ms | 1.0 cm (1.00) | 6.0 | 100% | 0% | - | - | - | - |" in table
    assert "| 50 ms | 3.0 cm (3.00) | 6.0 | 25% | 50% | 2.0 cm (2.00) |" in table
    found = {"way": "lively", "seed": 0, "t_cf": "1 cm", "offset_ms": 50.0, "found_ms": 51.7, "sd_ms": 3.2}
    assert "| 50 ms | 52 +- 3 ms |" in found_table([found]).markdown()


def test_the_command_writes_its_page(tmp_path: Path) -> None:
    assert main(["clocks", "--quick", "--seeds", "0", "--out", str(tmp_path)]) == 0
    numbers = json.loads((tmp_path / "clocks.json").read_text())
    assert len(numbers["clocks"]) == 1 + len(clocks.FEW_CLOCKS)
    assert all(row["frames"] > 0 for row in numbers["clocks"] + numbers["offsets"])
    page = (tmp_path / "clocks.md").read_text()
    assert "| 7 Hz | 50 ms | - | - |" in page
    assert "| corridor | 5 mm, 0.2 degrees | 20 ms |" in page
    assert "finds of it by a run and the views" in page
    assert (tmp_path / "clocks.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "clocks.csv").read_text().count("\n") == 1 + len(numbers["clocks"])


def test_an_impossible_clock_is_refused() -> None:
    for numbers in ((0.0,), (10.0, -1.0), (10.0, 0.0, -1.0), (float("nan"),)):
        with pytest.raises(SettingsError):
            WornClock(*numbers)
