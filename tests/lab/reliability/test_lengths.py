"""T_CF whose length changes: the covariance holds both lengths, and the table says what does not."""

from __future__ import annotations

from collabslam_lab.reliability.lengths import CHANGES, LengthRow, lengths_markdown, measure_lengths


def test_a_length_that_jumps_is_never_wrong_and_sure_for_long() -> None:
    changes = [change for change in CHANGES if change[0] in ("none", "30 % longer", "5 % longer")]
    rows = measure_lengths([1], changes=changes)
    assert [(row.change, row.told) for row in rows] == [
        (name, told) for name, _ in changes for told in (True, False)
    ]
    assert max(share for row in rows for share in row.false_ok) <= 0.02
    assert all(row.ok[0] > 0.95 for row in rows if row.change == "none")


def test_the_table_marks_what_is_trusted_all_the_same() -> None:
    rows = [
        LengthRow("twice", True, [0.12, 0.0], [0.4, 1.0], [False, True]),
        LengthRow("twice", False, [0.0, 0.01], [1.0, 0.9], [False, True]),
    ]
    last = lengths_markdown(rows).splitlines()[-1]
    assert [cell.strip() for cell in last.strip("|").split("|")] == [
        "twice", "12, **0**", "40, 100", "0, **1**", "100, 90",
    ]  # fmt: skip
