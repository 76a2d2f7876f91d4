"""Which frames of a broken stream are used."""

from __future__ import annotations

import numpy as np
import pytest

from collabslam.datasets.stamps import usable_frames


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ([0.0, 0.1, 0.2], [0, 1, 2]),
        ([0.0, 0.1, 0.1, 0.2], [0, 1, 3]),  # repeated: it was true of the first
        ([0.0, 0.2, 0.1, 0.3, 0.4], [0, 2, 3, 4]),
        ([0.0, 0.1, 1000.0, 0.3, 0.4, 0.5, 0.6], [0, 1, 3, 4, 5, 6]),
        ([0.0, np.nan, 0.2, np.inf, 0.4], [0, 2, 4]),
        ([5.0], [0]),
        ([], []),
        ([1.0, 1.0, 1.0, 1.0], [0]),
    ],
)
def test_as_few_frames_as_can_be_are_left_out(times: list[float], expected: list[int]) -> None:
    chosen, used = usable_frames(times)
    assert chosen.tolist() == expected
    assert used.tolist() == [times[i] for i in chosen]


@pytest.mark.parametrize("back", [0.35, 0.5, 3.0, 1e9])
def test_a_clock_that_was_set_back_is_set_forward_again(back: float) -> None:
    times = 0.1 * np.arange(50) + 100.0
    times[20:] -= back
    chosen, used = usable_frames(times)
    assert chosen.tolist() == list(range(50))
    np.testing.assert_allclose(np.diff(used), 0.1, atol=1e-6)


def test_twice_set_back_and_a_repeated_stamp() -> None:
    times = 0.1 * np.arange(60)
    times[20:] -= 1.0
    times[40:] -= 2.0
    times[50] = times[49]
    chosen, used = usable_frames(times)
    assert len(chosen) == 59
    assert np.all(np.diff(used) > 0.0)


@pytest.mark.parametrize("far", [1000.0, 25.0])
def test_a_stamp_far_from_all_others_at_an_end_is_left_out(far: float) -> None:
    times = 0.1 * np.arange(30)
    last, first = times.copy(), times.copy()
    last[-1] += far
    first[0] -= far
    assert usable_frames(last)[0].tolist() == list(range(29))
    assert usable_frames(first)[0].tolist() == list(range(1, 30))
    # a pause before three frames or more is a pause, and so is one of a slow camera
    paused = times.copy()
    paused[-3:] += far
    assert len(usable_frames(paused)[0]) == 30
    slow = 30.0 * np.arange(10)
    slow[-1] += far
    assert len(usable_frames(slow)[0]) == 10
