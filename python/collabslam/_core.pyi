from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Camera",
    "Filter",
    "UpdateReport",
    "__version__",
    "affine_at",
    "affine_maps",
    "align_templates",
    "capture_windows",
    "corner_peaks",
    "describe_windows",
    "epipolar_residuals",
    "find_consensus",
    "match_pairs",
    "sample_templates",
    "search_templates",
    "settings_schema",
    "spread_corners",
    "warp_patches",
]

__version__: str

_Array = NDArray[np.float64]
_Ids = NDArray[np.int64]
_Worn = tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike, ArrayLike]
_Depths = tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike]

def search_templates(
    image: NDArray[np.uint8],
    templates: NDArray[np.uint8],
    uv: ArrayLike,
    s: ArrayLike,
    guess: ArrayLike,
    *,
    gate: float,
    min_radius: float,
    large_radius: float,
    max_radius: float,
    guess_radius: float,
    guess_gate: float,
    min_score: float,
    ambiguity: float,
    peak_distance: float,
    min_deviation: float,
    whole: bool = True,
) -> tuple[_Array, _Array, _Array, _Ids]: ...
def align_templates(
    image: NDArray[np.uint8], templates: NDArray[np.uint8], uv: ArrayLike
) -> tuple[_Array, _Array]: ...
def affine_maps(
    camera_ref: Camera,
    uv_ref: ArrayLike,
    camera_now: Camera,
    t_now_ref: ArrayLike,
    inverse_range: ArrayLike,
) -> tuple[_Array, _Array, NDArray[np.bool_]]: ...
def affine_at(
    camera_ref: Camera,
    uv_ref: ArrayLike,
    camera_now: Camera,
    t_now_ref: ArrayLike,
    inverse_range: ArrayLike,
    min_area: float,
    max_area: float,
    max_stretch: float,
) -> _Array: ...
def warp_patches(
    camera_ref: Camera,
    camera_now: Camera,
    patches: Sequence[Any],
    t_wc: ArrayLike,
    points: ArrayLike,
    size: int,
    min_area: float,
    max_area: float,
    max_stretch: float,
) -> tuple[NDArray[np.uint8], NDArray[np.bool_], _Array]: ...
def capture_windows(
    image: NDArray[np.uint8], uv: ArrayLike, half: int
) -> tuple[list[NDArray[np.uint8]], _Array]: ...
def corner_peaks(
    response: NDArray[np.float32], reach: int, border: int, quality: float, least: float
) -> _Array: ...
def spread_corners(
    peaks: ArrayLike,
    existing: ArrayLike,
    count: int,
    shape: tuple[int, int],
    cells: int,
    distance: float,
) -> _Ids: ...
def match_pairs(
    rays_s: ArrayLike,
    rays_f: ArrayLike,
    ranges: ArrayLike,
    known: Sequence[bool],
    described_s: NDArray[np.float32],
    depths: ArrayLike,
    described_f: NDArray[np.float32],
    t_cf: ArrayLike,
    covariance: ArrayLike,
    sigma: tuple[float, float],
    gate: float,
    ratio: float,
    max_distance: float,
) -> tuple[_Ids, _Ids, int, int, int]: ...
def sample_templates(
    image: NDArray[np.uint8], centres: ArrayLike, affine: ArrayLike, size: int
) -> tuple[NDArray[np.uint8], _Array]: ...
def describe_windows(
    image: NDArray[np.uint8], centres: ArrayLike, axes: ArrayLike, step: float
) -> NDArray[np.float32]: ...
def epipolar_residuals(
    rays_s: ArrayLike, rays_f: ArrayLike, t_cf: ArrayLike, focal: tuple[float, float]
) -> tuple[_Array, _Array]: ...
def find_consensus(
    rays_s: ArrayLike,
    rays_f: ArrayLike,
    t_cf: ArrayLike,
    covariance: ArrayLike,
    focal: tuple[float, float],
    sigma: float,
    limit: float,
    start: ArrayLike | None = None,
) -> tuple[_Array, _Array, NDArray[np.bool_]]: ...
def settings_schema() -> list[dict[str, Any]]: ...

@final
class Camera:
    def __new__(
        cls,
        model: str,
        width: int,
        height: int,
        intrinsics: Sequence[float],
        distortion: Sequence[float] = ...,
    ) -> Camera: ...
    @property
    def model(self) -> str: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def intrinsics(self) -> tuple[float, float, float, float]: ...
    @property
    def distortion(self) -> tuple[float, ...]: ...
    @property
    def matrix(self) -> _Array: ...
    def project(self, points: ArrayLike) -> tuple[_Array, NDArray[np.bool_]]: ...
    def unproject(self, uv: ArrayLike) -> _Array: ...
    def __getnewargs__(self) -> tuple[str, int, int, list[float], list[float]]: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    __hash__: None  # type: ignore[assignment]

@final
class UpdateReport:
    @property
    def bearings(self) -> list[str]: ...
    @property
    def pairs(self) -> list[str]: ...
    @property
    def depths(self) -> list[str]: ...
    @property
    def pair_births(self) -> _Ids: ...
    @property
    def depth_births(self) -> _Ids: ...
    @property
    def refused(self) -> str | None: ...
    @property
    def iterations(self) -> int: ...
    @property
    def nis(self) -> float: ...
    @property
    def dof(self) -> int: ...
    @property
    def order(self) -> int: ...
    @property
    def exact(self) -> bool: ...
    @property
    def believed(self) -> bool: ...
    @property
    def worn_error(self) -> _Array: ...

@final
class Filter:
    def __new__(
        cls,
        camera: Camera,
        worn_camera: Camera | None = None,
        *,
        settings: Mapping[str, bool | int | float | str] | None = None,
        switches: Mapping[str, bool | int | float | str] | None = None,
    ) -> Filter: ...
    @property
    def started(self) -> bool: ...
    @property
    def time(self) -> float | None: ...
    @property
    def map_size(self) -> int: ...
    @property
    def candidate_count(self) -> int: ...
    @property
    def candidates(self) -> _Ids: ...
    @property
    def pose(self) -> _Array: ...
    @property
    def pose_covariance(self) -> _Array: ...
    @property
    def velocity(self) -> _Array: ...
    @property
    def angular_velocity(self) -> _Array: ...
    @property
    def mean(self) -> _Array: ...
    @property
    def covariance(self) -> _Array: ...
    @property
    def blocks(self) -> list[tuple[int, str, int, int]]: ...
    def soundness(self) -> float: ...
    def check(self) -> None: ...
    def snapshot(self) -> bytes: ...
    @staticmethod
    def restore(data: bytes) -> Filter: ...
    def predict(self, t: float) -> None: ...
    def predict_pixels(self) -> dict[str, Any]: ...
    def predict_given(self, found: ArrayLike, uv: ArrayLike, ids: ArrayLike) -> tuple[_Array, _Array]: ...
    def update(
        self,
        searched: ArrayLike,
        ids: ArrayLike,
        uv: ArrayLike,
        *,
        worn: _Worn | None = None,
        worn_bias: ArrayLike | None = None,
        depths: _Depths | None = None,
        least: int = 0,
    ) -> UpdateReport: ...
    def relocalise(self, pose: ArrayLike, ids: ArrayLike, uv: ArrayLike) -> UpdateReport: ...
    def restart(self, worn: _Worn, worn_bias: ArrayLike | None = None) -> UpdateReport: ...
    def relocalise_in(
        self,
        landmarks: ArrayLike,
        covariance: ArrayLike,
        drift: ArrayLike,
        pose: ArrayLike,
        index: ArrayLike,
        uv: ArrayLike,
    ) -> tuple[UpdateReport, _Ids]: ...
    def known_map(self) -> dict[str, Any]: ...
    def start_from_map(self, landmarks: ArrayLike, covariance: ArrayLike, drift: ArrayLike) -> _Ids: ...
    def add_candidates(self, uv: ArrayLike) -> _Ids: ...
    def observe_candidates(self, ids: ArrayLike, uv: ArrayLike) -> tuple[list[str], _Ids]: ...
    def promote_candidates(self, ids: ArrayLike) -> _Ids: ...
    def drop_candidates(self, ids: ArrayLike) -> None: ...
    def add_undelayed(self, uv: ArrayLike) -> _Ids: ...
    def start_from_points(
        self, points: ArrayLike, noise: ArrayLike, shared: ArrayLike, covariance: ArrayLike
    ) -> _Ids: ...
    def manage_map(self) -> _Ids: ...
    def remove_features(self, ids: ArrayLike) -> None: ...
    def landmarks(self) -> dict[str, Any]: ...
    def check_worn(self, t_cf: ArrayLike, covariance: ArrayLike, bias: ArrayLike | None = None) -> None: ...
    def predict_overlap(self, t_cf: ArrayLike, covariance: ArrayLike) -> dict[str, Any] | None: ...
