"""The border to the compiled core: bad input is a clear exception and leaves the filter as it was."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from collabslam import Camera, DepthMeasurement, Filter, FilterSettings, WornMeasurement
from collabslam.errors import InputError, SettingsError

CS = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5))
K = np.array([[50.0, 0.0, 32.0], [0.0, 51.0, 24.0], [0.0, 0.0, 1.0]])
CF = Camera("radtan", 640, 480, (480.0, 482.0, 321.0, 238.0), (-0.05, 0.01, 0.0003, -0.0002))
T_CF = np.eye(4)
T_CF[:3, 3] = 0.5, 0.0, 0.05
SIGMA = np.diag([0.01] * 3 + [0.005] * 3) ** 2
COUNT = 30
NO_IDS, NO_UV = np.empty(0, np.int64), np.empty((0, 2))
ONE_UV, NAN_UV = np.full((1, 2), 100.0), np.full((1, 2), np.nan)
UNKNOWN = np.array([10**6])
NAN_POSE, STRETCHED = np.where(np.eye(4) > 0, np.nan, 0.0), np.diag([2.0, 1.0, 1.0, 1.0])
TILTED = np.array([*np.eye(4)[:3], [0.0, 0.0, 1.0, 0.0]])
POINTS = np.random.Generator(np.random.PCG64(1)).uniform((-1.0, -0.8, 2.5), (1.2, 0.8, 5.0), (COUNT, 3))


def _worn(
    t_cf: Any = T_CF, covariance: Any = SIGMA, ids: Any = NO_IDS, uv: Any = NO_UV, uv_f: Any = NO_UV
) -> Any:
    return WornMeasurement(t_cf, covariance, ids, uv, uv_f)


def _started() -> Filter:
    """A filter with a map of COUNT features, at 0.1 s, with two candidates."""
    core = Filter(CS, CF)
    core.predict(0.0)
    new = np.full(COUNT, -1)
    uv, uv_f = CS.project(POINTS).uv, CF.project(POINTS - T_CF[:3, 3]).uv
    core.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(ids=new, uv=uv, uv_f=uv_f)])
    core.add_candidates(np.array([[50.0, 60.0], [500.0, 300.0]]))
    core.predict(0.1)
    return core


def _one(core: Filter) -> Any:
    return core.predict_pixels().ids[:1]


def _state(core: Filter) -> tuple[object, ...]:
    return (
        core.mean.tobytes(),
        core.covariance.tobytes(),
        core.time,
        core.started,
        core.blocks,
        core.candidates.tobytes(),
    )


CALLS: dict[str, tuple[Callable[[Filter], object], str]] = {
    "time back": (lambda f: f.predict(0.05), "time 0.05 s does not follow"),
    "time again": (lambda f: f.predict(0.1), "time 0.1 s does not follow"),
    "time nan": (lambda f: f.predict(np.nan), "time"),
    "time in nanoseconds": (lambda f: f.predict(1.6e18), "nanoseconds"),
    "time far": (lambda f: f.predict(1e300), "seconds"),
    "time after a day": (lambda f: f.predict(86400.0), "start a new filter"),
    "uv columns": (lambda f: f.update(NO_IDS, _one(f), np.zeros((1, 3))), r"uv has shape \[1, 3\]"),
    "uv rows": (lambda f: f.update(NO_IDS, _one(f), np.zeros((2, 2))), "uv has shape"),
    "uv nan": (lambda f: f.update(NO_IDS, _one(f), NAN_UV), "pixel"),
    "id unknown": (lambda f: f.update(NO_IDS, UNKNOWN, ONE_UV), "id 1000000"),
    "id searched unknown": (lambda f: f.update(UNKNOWN, NO_IDS, NO_UV), "id 1000000"),
    "id negative": (lambda f: f.update(NO_IDS, np.array([-1]), ONE_UV), "ids: -1 is not an id"),
    "id searched negative": (lambda f: f.update(np.array([-7]), NO_IDS, NO_UV), "searched: -7 is not an id"),
    "id dropped negative": (lambda f: f.drop_candidates(np.array([-2])), "ids: -2 is not an id"),
    "id too large": (lambda f: f.update(NO_IDS, np.array([2**63], np.uint64), ONE_UV), "is not an id"),
    "id with a fraction": (lambda f: f.update(NO_IDS, np.zeros(1), ONE_UV), "ids: an array of whole numbers"),
    "uv flat": (lambda f: f.update(NO_IDS, NO_IDS, np.zeros(2)), r"uv has shape \[2\]"),
    "uv words": (lambda f: f.add_undelayed([["a", "b"]]), "uv: an array of numbers"),
    "uv ragged": (lambda f: f.add_undelayed([[1.0], [2.0, 3.0]]), "uv: an array of numbers"),
    "uv complex": (lambda f: f.add_undelayed(ONE_UV * 1j), "uv: an array of numbers"),
    "worn id negative": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(ids=np.array([-3]), uv=ONE_UV, uv_f=ONE_UV)]),
        "give -1 for a new point",
    ),
    "worn pose last row": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(TILTED)]),
        "last row",
    ),
    "overlap pose last row": (lambda f: f.predict_overlap(TILTED, SIGMA), "last row"),
    "id twice": (lambda f: f.update(NO_IDS, np.repeat(_one(f), 2), np.zeros((2, 2))), "twice"),
    "worn pose shape": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(np.eye(3))]),
        "t_cf has shape",
    ),
    "worn pose nan": (lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(NAN_POSE)]), "t_cf"),
    "worn pose stretched": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(STRETCHED)]),
        "rotation matrix",
    ),
    "worn covariance shape": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(covariance=np.eye(5))]),
        "covariance has shape",
    ),
    "worn covariance nan": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(covariance=SIGMA * np.nan)]),
        "T_CF or its covariance",
    ),
    "worn covariance negative": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(covariance=-SIGMA)]),
        "covariance of T_CF",
    ),
    "worn uv half nan": (
        lambda f: f.update(
            NO_IDS, NO_IDS, NO_UV, views=[_worn(ids=_one(f), uv=np.array([[np.nan, 100.0]]), uv_f=ONE_UV)]
        ),
        "pixel",
    ),
    "worn uv nan of a new point": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(ids=np.array([-1]), uv=NAN_UV, uv_f=ONE_UV)]),
        "pixel",
    ),
    "worn uv_f nan": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(ids=_one(f), uv=ONE_UV, uv_f=NAN_UV)]),
        "pixel",
    ),
    "worn uv_f rows": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(ids=_one(f), uv=ONE_UV)]),
        "worn uv_f has shape",
    ),
    "worn id unknown": (
        lambda f: f.update(NO_IDS, NO_IDS, NO_UV, views=[_worn(ids=UNKNOWN, uv=ONE_UV, uv_f=ONE_UV)]),
        "id 1000000",
    ),
    "depth nan": (lambda f: _depth(f, np.array([np.nan]), np.ones(1)), "depth"),
    "depth negative": (lambda f: _depth(f, -np.ones(1), np.ones(1)), "depth"),
    "depth sigma zero": (lambda f: _depth(f, np.ones(1), np.zeros(1)), "depth"),
    "depth rows": (lambda f: _depth(f, np.ones(2), np.ones(1)), "depth has shape"),
    "depth sigma rows": (lambda f: _depth(f, np.ones(1), np.ones(2)), "sigma has shape"),
    "candidate nan": (lambda f: f.add_candidates(NAN_UV), "pixel"),
    "candidate columns": (lambda f: f.add_candidates(np.zeros((1, 3))), "uv has shape"),
    "candidate unknown": (lambda f: f.observe_candidates(UNKNOWN, ONE_UV), "candidate with id 1000000"),
    "candidate promoted unknown": (lambda f: f.promote_candidates(UNKNOWN), "candidate with id 1000000"),
    "candidate promoted twice": (lambda f: f.promote_candidates(f.candidates[[0, 0]]), "twice"),
    "candidate seen nan": (lambda f: f.observe_candidates(f.candidates[:1], NAN_UV), "pixel"),
    "candidate rows": (lambda f: f.observe_candidates(f.candidates[:1], NO_UV), "uv has shape"),
    "candidate twice": (lambda f: f.observe_candidates(f.candidates[[0, 0]], np.zeros((2, 2))), "twice"),
    "undelayed nan": (lambda f: f.add_undelayed(NAN_UV), "pixel"),
    "undelayed columns": (lambda f: f.add_undelayed(np.zeros((1, 3))), "uv has shape"),
    "remove unknown": (lambda f: f.remove_features(np.append(_one(f), UNKNOWN)), "id 1000000"),
    "overlap pose shape": (lambda f: f.predict_overlap(np.eye(3), SIGMA), "t_cf has shape"),
    "overlap covariance shape": (lambda f: f.predict_overlap(T_CF, np.eye(5)), "covariance has shape"),
    "overlap pose nan": (lambda f: f.predict_overlap(NAN_POSE, SIGMA), "t_cf"),
    "overlap pose stretched": (lambda f: f.predict_overlap(STRETCHED, SIGMA), "rotation matrix"),
    "overlap covariance nan": (lambda f: f.predict_overlap(T_CF, SIGMA * np.nan), "covariance"),
    "overlap covariance negative": (lambda f: f.predict_overlap(T_CF, -SIGMA), "covariance"),
}
"""A bad call on a started filter, and words of its message."""

STARTS: dict[str, tuple[dict[str, Any], str]] = {
    "points columns": ({"points": np.zeros((2, 2))}, "points has shape"),
    "points nan": ({"points": np.full((2, 3), np.nan)}, "points"),
    "noise rows": ({"noise": np.zeros((3, 3, 3))}, "noise"),
    "noise shape": ({"noise": np.zeros((2, 2, 3))}, "noise has shape"),
    "noise nan": ({"noise": np.full((2, 3, 3), np.nan)}, "noise"),
    "noise negative": ({"noise": np.tile(-np.eye(3), (2, 1, 1))}, "noise"),
    "points at the centre": ({"points": np.zeros((2, 3))}, "points"),
    "shared nan": ({"shared": np.full((2, 3, 6), np.nan)}, "shared"),
    "shared shape": ({"shared": np.zeros((2, 3, 5))}, "shared has shape"),
    "covariance shape": ({"covariance": np.eye(5)}, "covariance has shape"),
    "covariance nan": ({"covariance": np.full((6, 6), np.nan)}, "covariance"),
    "covariance negative": ({"covariance": -np.eye(6)}, "covariance"),
}
"""A bad argument of `add_points`, and words of its message."""


def _depth(core: Filter, depth: Any, sigma: Any) -> object:
    return core.update(NO_IDS, NO_IDS, NO_UV, depths=DepthMeasurement(_one(core), ONE_UV, depth, sigma))


def _points(core: Filter, **changes: Any) -> Any:
    arguments = {
        "points": POINTS[:2],
        "noise": np.tile(1e-4 * np.eye(3), (2, 1, 1)),
        "shared": np.zeros((2, 3, 6)),
        "covariance": 1e-4 * np.eye(6),
    }
    return core.add_points(**{**arguments, **changes})


def test_the_filter_under_test_is_started() -> None:
    core = _started()
    assert core.started
    assert core.map_size == COUNT
    assert core.candidate_count == 2
    assert core.soundness() > -1e-10


@pytest.mark.parametrize("name", CALLS)
def test_bad_call(name: str) -> None:
    call, words = CALLS[name]
    core = _started()
    before = _state(core)
    with pytest.raises(InputError, match=words):
        call(core)
    assert _state(core) == before
    core.predict(0.2)


@pytest.mark.parametrize("name", STARTS)
def test_bad_add_points(name: str) -> None:
    changes, words = STARTS[name]
    core = Filter(CS)
    before = _state(core)
    with pytest.raises(InputError, match=words):
        _points(core, **changes)
    assert _state(core) == before
    _points(core)
    assert core.started


def test_a_candidate_given_twice_does_not_panic_at_its_birth() -> None:
    core = Filter(CS, settings=FilterSettings({"birth.min_parallax": 0.5, "birth.min_baseline": 0.01}))
    start, step = CS.project(POINTS).uv, np.array([0.05, 0.0, 0.0])
    ids = _points(
        core, points=POINTS, noise=np.tile(1e-4 * np.eye(3), (COUNT, 1, 1)), shared=np.zeros((COUNT, 3, 6))
    )
    core.predict(0.0)
    candidates = core.add_candidates(start[:1])
    core.predict(0.1)
    uv = CS.project(POINTS - step).uv
    core.update(ids, ids, uv)
    with pytest.raises(InputError, match="twice"):
        core.observe_candidates(np.repeat(candidates, 2), np.repeat(uv[:1], 2, axis=0))
    assert core.observe_candidates(candidates, uv[:1]).born >= 0


def _wander(seed: int) -> tuple[object, ...]:
    core, rng = _started(), np.random.Generator(np.random.PCG64(seed))
    for frame in range(30):
        core.predict(0.2 + 0.1 * frame)
        seen = core.predict_pixels()
        core.update(seen.ids, seen.ids, seen.uv + rng.normal(0.0, 0.5, seen.uv.shape))
    return _state(core)


def test_two_threads_run_two_filters_as_one_does() -> None:
    alone = [_wander(seed) for seed in (1, 2)]
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(_wander, (1, 2))) == alone
    assert alone[0] != alone[1]


def test_before_the_start() -> None:
    core = Filter(CS)
    before = _state(core)
    with pytest.raises(InputError, match="not started"):
        core.add_candidates(ONE_UV)
    assert _state(core) == before


def test_a_worn_camera_that_is_missing() -> None:
    core = Filter(CS)
    before = _state(core)
    with pytest.raises(InputError, match="worn camera"):
        core.update(NO_IDS, NO_IDS, NO_UV, views=[_worn()])
    with pytest.raises(InputError, match="worn camera"):
        core.predict_overlap(T_CF, SIGMA)
    assert _state(core) == before


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"process.speed": 1.0}, "process.speed: there is no such setting"),
        ({"estimator.mode": "stereo"}, "estimator.mode: must be one of"),
        ({"worn.start_births": 0}, "worn.start_births: 0 is outside"),
        ({"worn.start_births": "many"}, "worn.start_births"),
        ({"worn.start_births": None}, "worn.start_births"),
        ({"worn.start_births": 2**70}, "worn.start_births"),
        ({"worn.start_births": 2.5}, "worn.start_births: a whole number"),
        ({"pixel.sigma_cs": float("nan")}, "pixel.sigma_cs: NaN"),
    ],
)
def test_bad_setting(values: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        FilterSettings(values)


def test_settings_are_one_frozen_value() -> None:
    settings = FilterSettings({"worn.late": 3, "worn.start_births": 9.0})
    assert (settings.worn.late, settings.worn.start_births) == (3.0, 9)
    assert settings.estimator.mode == "collab-tight"
    assert pickle.loads(pickle.dumps(settings)) == settings != FilterSettings()
    assert FilterSettings(settings.values()) == settings
    assert settings.changed("worn.late", 1) == FilterSettings({"worn.start_births": 9})
    assert settings.changed("worn.late", "soon") is None
    assert settings.changed("worn.never", 1) is None
    with pytest.raises(AttributeError):
        settings.worn.late = 2.0  # type: ignore[misc]


def test_arrays_of_other_types_are_converted() -> None:
    a, b = _started(), _started()
    ids = _one(a)
    uv = np.round(a.predict_pixels().uv[:1])
    a.update(ids, ids, uv)
    b.update(ids.astype(np.uint16), ids.tolist(), uv.astype(np.float32))
    assert _state(a) == _state(b)
    assert a.add_undelayed([[100, 200]]).tolist() == b.add_undelayed(np.array([[100.0, 200.0]])).tolist()
    assert a.add_candidates(np.empty((0, 2), bool)).tolist() == []
    np.testing.assert_array_equal(CS.project([[0, 0, 1]]).uv, CS.project(np.array([[0.0, 0.0, 1.0]])).uv)


def test_measurements_without_a_name_are_refused() -> None:
    core = _started()
    before = _state(core)
    with pytest.raises(TypeError, match="views"):
        core.update(NO_IDS, NO_IDS, NO_UV, views=[(T_CF, SIGMA, NO_IDS, NO_UV, NO_UV)])  # type: ignore[arg-type]
    assert _state(core) == before


class TestCamera:
    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (("stereo", 64, 48, (50, 50, 32, 24)), "camera model: `stereo`"),
            (("pinhole", 64, 48, (50, 50, 32, 24), (0.1,)), "camera distortion"),
            (("radtan", 64, 48, (50, 50, 32, 24), (0.1, 0.2)), "camera distortion"),
            (("fisheye", 64, 48, (50, 50, 32, 24), (0.1, np.nan, 0, 0)), "camera distortion"),
            (("pinhole", 64, 48, (np.inf, 50, 32, 24)), "camera intrinsics"),
            (("pinhole", 64, 48, (-50, 50, 32, 24)), "camera intrinsics"),
            (("pinhole", 0, 48, (50, 50, 32, 24)), "camera image size"),
        ],
    )
    def test_bad_calibration(self, arguments: Any, words: str) -> None:
        with pytest.raises(InputError, match=words):
            Camera(*arguments)

    @pytest.mark.parametrize(
        ("given", "named"),
        [
            (("plumb_bob", 64, 48, K, np.zeros((1, 5))), {}),
            (("radtan", np.int64(64), 48, K, [0.0] * 14), {}),
            (
                (),
                {"width": 64, "height": 48, "distortion_model": "plumb_bob", "K": K.ravel(), "D": [0.0] * 5},
            ),
            ((), {"width": 64, "height": 48, "distortion_model": "radtan", "k": K, "d": [0.0] * 8}),
            (
                (),
                {
                    "camera_model": "pinhole",
                    "intrinsics": [50, 51, 32, 24],
                    "distortion_model": "radtan",
                    "distortion_coeffs": [0.0] * 4,
                    "resolution": [64, 48],
                },
            ),
        ],
    )
    def test_names_and_matrices_of_other_programs(self, given: Any, named: Any) -> None:
        assert Camera(*given, **named) == Camera("radtan", 64, 48, (50, 51, 32, 24), (0, 0, 0, 0))

    def test_without_distortion_it_is_a_pinhole(self) -> None:
        for lens in ({}, {"D": [0.0] * 5}, {"distortion": None}):
            assert Camera(width=64, height=48, K=K, **lens) == Camera("pinhole", 64, 48, (50, 51, 32, 24))

    @pytest.mark.parametrize(
        ("given", "named", "words"),
        [
            ((420, 420, 320, 240), {}, "a name is needed, not 420; give a model, width and height"),
            ((), {"width": 64, "height": 48, "K": K, "rostopic": "/a"}, "no argument `rostopic`"),
            ((), {"width": 64, "height": 48, "K": K, "k": K}, "`k` was given beside another name"),
            ((), {"width": 64, "height": 48, "K": K, "D": [0.1, 0, 0, 0]}, "distortion and no model"),
            ((), {"width": 64, "resolution": [64, 48], "K": K}, "beside the resolution"),
            ((), {"camera_model": "omni", "resolution": [64, 48], "intrinsics": [1, 2, 3, 4]}, "`omni`"),
            (("pinhole", 64.5, 48, K), {}, "whole pixels are needed"),
            (("pinhole", 64, 48), {}, "intrinsics: there are none"),
            (("pinhole", 64, 48, K.T), {}, "row by row"),
            (("pinhole", 64, 48, K + 5.0 * np.eye(3, k=1)), {}, "row by row|skew"),
            (("pinhole", 64, 48, [1, 2, 3]), {}, "fx, fy, cx, cy or the 3x3 matrix K"),
            (("pinhole", 64, 48, "abc"), {}, "an array of numbers is needed"),
            (("radtan", 64, 48, K, {"k1": 1}), {}, "an array of numbers is needed"),
        ],
    )
    def test_what_is_no_camera_is_named(self, given: Any, named: Any, words: str) -> None:
        with pytest.raises(InputError, match=words):
            Camera(*given, **named)

    def test_bad_arrays(self) -> None:
        with pytest.raises(InputError, match="points has shape"):
            CS.project(np.zeros((2, 2)))
        with pytest.raises(InputError, match="uv has shape"):
            CS.unproject(np.zeros((2, 3)))

    def test_points_without_a_pixel_are_nan(self) -> None:
        there = CS.project(np.array([[0.0, 0.0, -1.0], [np.nan, 0.0, 1.0], [0.0, 0.0, 1.0]]))
        assert there.visible.tolist() == [False, False, True]
        np.testing.assert_array_equal(np.isfinite(there.uv).all(axis=1), there.visible)
        assert np.isnan(CS.unproject(NAN_UV)).all()

    def test_it_takes_any_memory_layout(self) -> None:
        spread = np.repeat(POINTS, 2, axis=0)[::2]
        expected = CF.project(POINTS).uv
        for points in (spread, np.asfortranarray(POINTS)):
            np.testing.assert_array_equal(CF.project(points).uv, expected)

    @pytest.mark.parametrize("camera", [CS, CF])
    def test_it_pickles_and_copies(self, camera: Camera) -> None:
        for again in (pickle.loads(pickle.dumps(camera)), copy.copy(camera), copy.deepcopy(camera)):
            assert again == camera
            np.testing.assert_array_equal(again.project(POINTS).uv, camera.project(POINTS).uv)
        assert CS != CF
