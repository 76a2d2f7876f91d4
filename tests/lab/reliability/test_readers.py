"""Any file, however broken, is read or refused with an error of the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from collabslam import _core
from collabslam.datasets.images import decode
from collabslam.errors import CollabslamError, DataError, SettingsError
from collabslam.settings.table import Settings
from collabslam_lab.reliability.readers import TOKENS, damaged, fuzz_readers, read_one, readers

READERS = readers()
BOMB = "a: &a [1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"{new}: &{new} [{', '.join(['*' + old] * 8)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
"""A few lines that stand for 8^9 values."""
QUICK = settings(
    max_examples=25,
    deadline=None,
    database=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.mark.parametrize("name", sorted(set(READERS) - {"images-list"}))
def test_the_good_file_is_read(name: str, tmp_path: Path) -> None:
    assert read_one(READERS[name], tmp_path, READERS[name].good)


@pytest.mark.parametrize("name", sorted(READERS))
@QUICK
@given(start=st.integers(0, 60), piece=st.one_of(st.binary(max_size=40), st.sampled_from(TOKENS)))
def test_a_file_with_foreign_bytes_is_read_or_refused(
    name: str, tmp_path: Path, start: int, piece: bytes
) -> None:
    (tmp_path / "data").mkdir(exist_ok=True)
    good = READERS[name].good
    read_one(READERS[name], tmp_path, good[:start] + piece + good[start:])
    read_one(READERS[name], tmp_path, good[:start] + piece + good[start + len(piece) :])
    read_one(READERS[name], tmp_path, piece)


def test_damage_of_every_kind_finds_nothing() -> None:
    found = fuzz_readers(340, 7)
    assert found.findings == []
    assert 0 < found.refused < found.executions == 340


def test_the_driver_reports_what_it_finds() -> None:
    def break_(path: Path) -> None:
        raise ZeroDivisionError(path.name)

    reader = type(READERS["settings"])(break_, "a.yaml", b"a: 1")
    found = fuzz_readers(3, 0, which={"bad": reader})
    assert len(found.findings) == 3
    assert "ZeroDivisionError" in found.findings[0]
    rng = np.random.default_rng(0)
    assert any(damaged(b"a: 1\n" * 10, rng) != b"a: 1\n" * 10 for _ in range(5))


@pytest.mark.parametrize(
    "header",
    [
        b"P5\n60000 60000\n255\n",
        b"P5\n999999999999999999 2\n255\n",
        b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x7f\xff\xff\xff\x7f\xff\xff\xff\x08\x00\x00\x00\x00",
        b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x00\x00 \x00\x00\x00 \x08" + bytes(8) + b"\x7f\0\0\0IDAT",
        b"BM" + bytes(16) + (60000).to_bytes(4, "little") * 2 + bytes(30),
        b"\xff\xd8\xff\xc0\x00\x11\x08\xff\xff\xff\xff\x01\x01\x11\x00" + bytes(20) + b"\xff\xd9",
    ],
)
def test_a_header_that_promises_too_much_is_refused_before_memory_is_taken(header: bytes) -> None:
    with pytest.raises(DataError, match="larger than any that is read"):
        decode(header, "image")


@pytest.mark.parametrize(
    "text",
    [
        "[" * 5000,
        "a: " + "9" * 5000,
        "a: &a [*a]",
        BOMB,
        "a: !!python/object/apply:os.system ['true']",
        "a: 2001-99-99",
    ],
)  # fmt: skip
def test_yaml_that_blows_up_or_runs_code_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    with pytest.raises(SettingsError):
        Settings.load(path)


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("images-list", b"a.png", b"a" * 5000 + b".png"),
        ("images-list", b"1403636579763555584", b"9" * 5000),
        ("images-list", b"1403636579763555584", b"9" * 19),
        ("images-list", b"1403636579763555584", "²".encode()),
        ("calibration-euroc", b"0.1", b"9" * 400),
        ("settings", b"1.5", b"9" * 400),
    ],
)
def test_numbers_and_names_beyond_all_bounds_are_refused(
    name: str, before: bytes, after: bytes, tmp_path: Path
) -> None:
    (tmp_path / "data").mkdir()
    good = READERS[name].good
    assert read_one(READERS[name], tmp_path, good) or name == "images-list"  # whose images are not there
    assert before in good
    assert not read_one(READERS[name], tmp_path, good.replace(before, after))


NUMBERS = st.one_of(st.floats(width=64), st.sampled_from([0.0, 0.1, 100.0, 1e300, -1.0]))
ROWS = st.lists(st.tuples(NUMBERS, NUMBERS), max_size=4)
CALLS = st.lists(
    st.one_of(
        st.tuples(st.just("predict"), NUMBERS),
        st.tuples(st.sampled_from(["add_candidates", "add_undelayed", "update"]), ROWS),
        st.tuples(st.just("remove"), st.lists(st.integers(-2, 6), max_size=3)),
        st.tuples(st.just("manage"), st.none()),
        st.tuples(st.just("shape"), st.sampled_from([(3,), (2, 3), (0, 2), (1, 2, 1)])),
    ),
    max_size=12,
)


@settings(QUICK, max_examples=100)
@given(calls=CALLS)
def test_any_calls_leave_the_filter_sound(calls: list[tuple[str, object]]) -> None:
    camera = _core.Camera("pinhole", 320, 240, (200.0, 200.0, 160.0, 120.0), [])
    core = _core.Filter(camera, settings=_core.FilterSettings({"map.max_features": 8}))
    for name, argument in calls:
        before = core.mean.tobytes() + core.covariance.tobytes()
        try:
            if name == "predict":
                core.predict(argument)  # type: ignore[arg-type]
            elif name in ("add_candidates", "add_undelayed"):
                getattr(core, name)(np.reshape(argument, (-1, 2)))  # type: ignore[call-overload]
            elif name == "update":
                ids = core.predict_pixels().ids[: len(argument)]  # type: ignore[arg-type]
                core.update(ids, ids, np.reshape(argument, (-1, 2))[: len(ids)])  # type: ignore[call-overload]
            elif name == "remove":
                core.remove_features(argument)  # type: ignore[arg-type]
            elif name == "manage":
                core.manage_map()
            else:
                core.add_undelayed(np.zeros(argument))  # type: ignore[call-overload]
        except (CollabslamError, ValueError, TypeError, OverflowError):
            assert core.mean.tobytes() + core.covariance.tobytes() == before
        assert np.isfinite(core.mean).all()
        assert np.isfinite(core.covariance).all()
    assert core.soundness() > -1e-10
