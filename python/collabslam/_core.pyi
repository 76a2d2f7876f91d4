# Made by packaging/stubs.py from crates/pycollab.
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from collabslam.frontend.patch import Patch

__all__ = [
    "DESCRIPTOR_SAMPLES",
    "FASTEST_RATE",
    "FEWEST_MATCHES",
    "GYRO_GAP",
    "LARGEST_PIXEL",
    "LAST_TIME",
    "LONGEST_GAP",
    "MAX_RANGE_RATIO",
    "MOST_KEPT_POSES",
    "ODOMETRY_GAP",
    "SURE_LEVEL",
    "TOLD_INFORMATION",
    "UNKNOWN_SPEED",
    "UNKNOWN_TURN",
    "AffineMaps",
    "BirthSettings",
    "Block",
    "CalibrationSettings",
    "Camera",
    "CandidateReport",
    "CandidateViews",
    "ConditionalPrediction",
    "Consensus",
    "DepthMeasurement",
    "Edge",
    "EpipolarResiduals",
    "EstimatorSettings",
    "ExpectedPixels",
    "Factor",
    "Filter",
    "FilterSettings",
    "ImuSettings",
    "KnownMap",
    "Landmarks",
    "LostSettings",
    "MapRelocalisation",
    "MapSettings",
    "MatchNoise",
    "MeasurementOutcomes",
    "OdometrySettings",
    "OverlapPrediction",
    "OverlapSettings",
    "PairMatches",
    "PairOptions",
    "PairPoints",
    "PeakTest",
    "PixelSettings",
    "PoseGraph",
    "PosedNode",
    "Prediction",
    "ProcessSettings",
    "ProjectedPoints",
    "SampledTemplates",
    "SearchResult",
    "SearchWindow",
    "Submap",
    "SubmapLandmarks",
    "SubmapPnp",
    "Turn",
    "UpdateReport",
    "ValidateSettings",
    "WarpLimits",
    "WarpedPatches",
    "Windows",
    "WornMeasurement",
    "WornSettings",
    "__version__",
    "adjoint",
    "affine_at",
    "affine_maps",
    "capture_windows",
    "chi2_quantile",
    "corner_peaks",
    "describe_windows",
    "epipolar_residuals",
    "find_consensus",
    "fixed_to_tangent",
    "interpolate_pose",
    "is_rotation",
    "left_jacobian",
    "match_pairs",
    "pose_inverse",
    "quaternion_wxyz",
    "ray_angles",
    "rotation_exp",
    "rotation_from_quaternion",
    "rotation_log",
    "sample_templates",
    "se3_exp",
    "se3_log",
    "search_templates",
    "settings_schema",
    "skew",
    "spread_corners",
    "tangent_to_fixed",
    "warp_patches",
]
__version__: str
DESCRIPTOR_SAMPLES: int
"""Samples along the side of a window that is described."""
FEWEST_MATCHES: int
"""Fewest matches that tell one pose."""
FASTEST_RATE: float
"""Largest rate about an axis that a gyroscope is believed, rad/s: twice what common sensors can measure."""
LONGEST_GAP: float
"""Longest silence between two stamps of one source, seconds; beyond it they are taken to be wrong."""
GYRO_GAP: float
"""Longest time between two samples of a gyroscope that the rate is known in, seconds."""
ODOMETRY_GAP: float
"""Longest time that one sample of odometry tells of, seconds."""
LARGEST_PIXEL: float
"""Largest coordinate of a pixel that is taken, pixels."""
LAST_TIME: float
"""Largest time stamp that is taken, seconds: some thousand years."""
MAX_RANGE_RATIO: float
"""Largest relative error of a landmark's range with which it is kept, or helps to find the camera."""
MOST_KEPT_POSES: int
"""Most frames whose poses the filter keeps for views of Cf of another time."""
TOLD_INFORMATION: float
"""Information of a direction, over what was thought possible, from which on it counts as told: its
standard deviation falls to a third.
"""
SURE_LEVEL: float
"""Level of a test that calls something impossible: right ones fail it once in ten thousand."""
UNKNOWN_SPEED: float
"""Standard deviation of each component of the velocity of Cs where nothing tells it, m/s."""
UNKNOWN_TURN: float
"""The same of its angular velocity, rad/s."""

@final
class ProjectedPoints:
    """Where points lie in an image.

    Attributes
    ----------
    uv : (N, 2) float64
        Pixels; NaN where the point has none.
    visible : (N,) bool
        In front of the camera, within the model's range, and inside the image.
    """
    @property
    def uv(self) -> NDArray[np.float64]: ...
    @property
    def visible(self) -> NDArray[np.bool_]: ...

@final
class Camera:
    """A calibrated camera: `Camera("radtan", 640, 480, K, D)`, or by the names of ROS or Kalibr.

    Parameters
    ----------
    model : str
        Distortion model (METHOD 4): "pinhole", none; "radtan", OpenCV's radial-tangential; "fisheye",
        equidistant; "wideangle", Davison's one parameter.  Or by another name of them, as "plumb_bob",
        "rational_polynomial", "equidistant"; `models` has all.  "pinhole" if left out without distortion.
    width, height : int
        Image size, px.
    intrinsics : (4,) or (3, 3) array_like
        ``fx, fy, cx, cy``, px, or the matrix K.
    distortion : array_like
        ``[]``, ``[k1, k2, p1, p2(, k3(, k4, k5, k6))]``, ``[k1, k2, k3, k4]`` or ``[K]``, of any shape;
        zeros behind them are left out.
    **others : array_like or str
        The same by other names: ``K`` or ``k`` (intrinsics), ``D``, ``d`` or ``distortion_coeffs``
        (distortion), ``distortion_model`` (model), ``resolution`` (width and height), and Kalibr's
        ``camera_model="pinhole"``.

    Raises
    ------
    InputError
        For an unknown model, a wrong number or type of parameters, or impossible values.
    """
    def __new__(
        cls,
        model: str | None = None,
        width: int | None = None,
        height: int | None = None,
        intrinsics: ArrayLike | None = None,
        distortion: ArrayLike | None = None,
        **others: ArrayLike | None,
    ) -> Camera: ...
    @staticmethod
    def models() -> list[tuple[str, str]]:
        """Our model of distortion by each name that it has elsewhere, in lower case."""
    @property
    def model(self) -> str:
        """Name of the distortion model."""
    @property
    def width(self) -> int:
        """Image width, px."""
    @property
    def height(self) -> int:
        """Image height, px."""
    @property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """``(fx, fy, cx, cy)``, px."""
    @property
    def distortion(self) -> tuple[float, ...]:
        """Parameters of the distortion model."""
    @property
    def matrix(self) -> NDArray[np.float64]:
        """The (3, 3) matrix K, px."""
    def project(self, points: ArrayLike) -> ProjectedPoints:
        """Pixels of points.

        Parameters
        ----------
        points : (N, 3) float64
            Points in the camera frame, metres.

        Returns
        -------
        ProjectedPoints

        Raises
        ------
        InputError
            For a wrong shape.
        """
    def unproject(self, uv: ArrayLike) -> NDArray[np.float64]:
        """Unit rays of pixels.

        Parameters
        ----------
        uv : (N, 2) float64
            Pixels.

        Returns
        -------
        (N, 3) float64
            Unit rays in the camera frame; NaN where the model has none.

        Raises
        ------
        InputError
            For a wrong shape.
        """
    def __repr__(self) -> str: ...
    def __getnewargs__(self) -> tuple[str, int, int, list[float], list[float]]: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    __hash__: None  # type: ignore[assignment]

@final
class Factor:
    """What was measured of one or two submaps' poses, weighted by its covariance.

    Parameters
    ----------
    first : int
        Submap that it is measured from; -1 is W.
    second : int
        Submap that is measured.
    pose : (4, 4) float64
        Of the second from the first, metres.
    transferred : (K,) float64
        What the first was found to transfer; none where the factor does not speak of it.
    weight : (R, 6 + K + L) float64
        Makes the residual white: of the pose, of what the first transferred, and of the L numbers that
        the second transfers, if the factor speaks of them.

    Raises
    ------
    InputError
        For wrong shapes, or a pose that is none.
    """
    def __new__(
        cls, first: int, second: int, pose: ArrayLike, transferred: ArrayLike, weight: ArrayLike
    ) -> Factor: ...
    @staticmethod
    def between(first: int, second: int, edge: Edge) -> Factor:
        """What the filter says of two submaps that follow one another.

        Parameters
        ----------
        first, second : int
        edge : Edge

        Returns
        -------
        Factor

        Raises
        ------
        FilterError
            If its covariance is none.
        """
    @staticmethod
    def of_pose(first: int, second: int, pose: ArrayLike, covariance: ArrayLike) -> Factor:
        """A pose measured by itself.

        Parameters
        ----------
        first : int
            -1 is W.
        second : int
        pose : (4, 4) float64
        covariance : (6, 6) float64
            Right tangent, m^2 and rad^2.

        Returns
        -------
        Factor

        Raises
        ------
        InputError
            For wrong shapes, or a pose that is none.
        FilterError
            If the covariance is none.
        """
    @staticmethod
    def of_transferred(submap: int, covariance: ArrayLike) -> Factor:
        """How well the filter knows what a submap transfers, where none of the same map follows it.

        Parameters
        ----------
        submap : int
        covariance : (K, K) float64

        Returns
        -------
        Factor

        Raises
        ------
        InputError
            For a wrong shape.
        FilterError
            If the covariance is none.
        """
    @staticmethod
    def of_submap_pnp(first: int, second: int, pnp: SubmapPnp) -> Factor:
        """What PnP in an earlier submap says.

        Parameters
        ----------
        first : int
            The submap that is seen.
        second : int
            The submap at whose end it is seen.
        pnp : SubmapPnp

        Returns
        -------
        Factor

        Raises
        ------
        InputError
            If its information is not finite.
        """
    @property
    def first(self) -> int: ...
    @property
    def second(self) -> int: ...
    @property
    def pose(self) -> NDArray[np.float64]: ...
    @property
    def transferred(self) -> NDArray[np.float64]: ...
    @property
    def weight(self) -> NDArray[np.float64]: ...

@final
class PoseGraph:
    """A graph of submaps' poses.

    Parameters
    ----------
    poses : (N, 4, 4) float64
        Of each submap in W, metres.
    transferred : sequence of N (K,) float64
        By how much what each transferred is wrong, as many numbers as it transferred.
    factors : list of Factor

    Raises
    ------
    InputError
        For wrong shapes, numbers that are not finite, or a factor of a submap that is not there or hands
        on other numbers.
    """
    def __new__(
        cls, poses: ArrayLike, transferred: Sequence[ArrayLike], factors: Sequence[Factor]
    ) -> PoseGraph: ...
    def solved(self) -> PoseGraph:
        """The graph whose poses all factors agree with best.

        Returns
        -------
        PoseGraph

        Raises
        ------
        FilterError
            If a submap is tied to nothing.
        """
    @property
    def poses(self) -> NDArray[np.float64]:
        """(N, 4, 4) float64, see the class."""
    @property
    def transferred(self) -> list[NDArray[np.float64]]:
        """List of N (K,) float64, see the class."""
    def posed_node(self, submap: int) -> PosedNode:
        """A submap in W, as all factors have it.

        Parameters
        ----------
        submap : int

        Returns
        -------
        PosedNode

        Raises
        ------
        InputError
            If there is no such submap.
        FilterError
            If a submap is tied to nothing.
        """
    def relative(self, first: int, second: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pose of one submap from another, and its covariance (right tangent, m^2 and rad^2).

        Parameters
        ----------
        first, second : int

        Returns
        -------
        pose : (4, 4) float64
        covariance : (6, 6) float64

        Raises
        ------
        InputError
            If there is no such submap.
        FilterError
            If a submap is tied to nothing.
        """
    def distance(self, factor: Factor) -> float:
        """Chi-square of a factor before it is believed, of as many degrees of freedom as it measures.

        Parameters
        ----------
        factor : Factor

        Returns
        -------
        float

        Raises
        ------
        InputError
            If it is of a submap that is not there, or of other numbers than the submaps transfer.
        FilterError
            If a submap is tied to nothing.
        """

@final
class PosedNode:
    """A pose in W with what is transferred there, and how well both are known.

    Parameters
    ----------
    pose : (4, 4) float64
        Metres.
    transferred : (K,) float64
        By how much what is transferred there is wrong.
    covariance : (6 + K, 6 + K) float64
        Joint, of the pose (right tangent, m and rad) and what is transferred.

    Raises
    ------
    InputError
        For wrong shapes, or a pose that is none.
    """
    def __new__(cls, pose: ArrayLike, transferred: ArrayLike, covariance: ArrayLike) -> PosedNode: ...
    @property
    def pose(self) -> NDArray[np.float64]: ...
    @property
    def transferred(self) -> NDArray[np.float64]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    def onward(self, edge: Edge) -> PosedNode:
        """Where the way from here ends, corrected by what the errors transferred here are now known to be.

        Parameters
        ----------
        edge : Edge

        Returns
        -------
        PosedNode

        Raises
        ------
        InputError
            If other numbers were transferred where the way begins.
        FilterError
            If the covariance of the way is none.
        """

@final
class FilterSettings:
    """All settings of the filter and all switches of the lab, checked; nothing of it can be changed.

    A group is an attribute, and a setting one of its group: ``settings.worn.late`` has the key
    ``worn.late``.

    Parameters
    ----------
    values : dict, optional
        Dotted key to value, over the defaults.

    Raises
    ------
    SettingsError
        For an unknown key or an impossible value.
    """
    def __new__(cls, values: Mapping[str, bool | int | float | str] | None = None) -> FilterSettings: ...
    def changed(self, key: str, value: object) -> FilterSettings | None:
        """The same settings with one value changed.

        Parameters
        ----------
        key : str
            Dotted key.
        value : object

        Returns
        -------
        FilterSettings or None
            None if the setting cannot have this value, or there is no such setting.
        """
    def values(self) -> dict[str, bool | int | float | str]:
        """Every value by its dotted key."""
    def __getnewargs__(self) -> tuple[dict[str, bool | int | float | str]]: ...
    @property
    def estimator(self) -> EstimatorSettings:
        """Which estimator."""
    @property
    def process(self) -> ProcessSettings:
        """The motion model: constant velocity with white acceleration (METHOD 3)."""
    @property
    def odometry(self) -> OdometrySettings:
        """Odometry as motion input (METHOD 23)."""
    @property
    def imu(self) -> ImuSettings:
        """A gyroscope, and an accelerometer beside it, as motion input (METHOD 28): what their data
        sheet or an Allan variance says.
        """
    @property
    def calibration(self) -> CalibrationSettings:
        """How well Cs is calibrated. A calibration's error is the same in every frame, so that no
        number of features averages it out: the filter considers it and does not estimate it, but
        for the readout (METHOD 4). All zero: the calibration is exact.
        """
    @property
    def pixel(self) -> PixelSettings:
        """Noise of pixel measurements (METHOD 4)."""
    @property
    def birth(self) -> BirthSettings:
        """How features are born (METHOD 5)."""
    @property
    def worn(self) -> WornSettings:
        """The worn camera Cf and the error of its pose (METHOD 6)."""
    @property
    def validate(self) -> ValidateSettings:
        """Validation of a frame's matches (METHOD 8)."""
    @property
    def map(self) -> MapSettings:
        """Upkeep of the map (METHOD 7, step 8)."""
    @property
    def lost(self) -> LostSettings:
        """When the camera counts as lost."""
    @property
    def overlap(self) -> OverlapSettings:
        """Prediction of the overlap of both views (METHOD 9)."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    __hash__: None  # type: ignore[assignment]

@final
class Edge:
    """The way from where a submap began, as the filter knows it; of :meth:`Filter.since_submap`.

    Attributes
    ----------
    pose : (4, 4) float64
        Of its end from its beginning, metres.
    revised : (K,) float64
        By how much the estimate of what the beginning transferred has changed since.
    covariance : (6 + K + L, 6 + K + L) float64
        Joint, of the pose (right tangent, m and rad), the K numbers that the beginning transferred
        and the L that the end transfers, where it has ended.
    """
    @property
    def pose(self) -> NDArray[np.float64]: ...
    @property
    def revised(self) -> NDArray[np.float64]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...

@final
class Submap:
    """A submap that has ended; of :meth:`Filter.end_submap`.

    Attributes
    ----------
    edge : Edge or None
        The way since the last one ended; None of the first one in a map.
    pose : (4, 4) float64
        T_WC where it ended, metres.
    pose_covariance : (6, 6) float64
        Right tangent, m^2 and rad^2.
    transferred : (K, K) float64
        Covariance of what it transfers: the logarithm of the scale, and of each worn camera the
        time-correlated error of T_CF, m and rad along the axes of C.
    ids : (N,) int64
        Landmarks in view.
    points : (N, 3) float64
        From the camera, metres.
    covariance : (3 N, 3 N) float64
        Their joint covariance as they stand to the camera, m^2.
    with_transferred : (3 N, K) float64
        Their covariance with what is transferred.
    map_drift : float
        Standard deviation of map drift while all that is in view is exchanged once, radians.
    """
    @property
    def edge(self) -> Edge | None: ...
    @property
    def pose(self) -> NDArray[np.float64]: ...
    @property
    def pose_covariance(self) -> NDArray[np.float64]: ...
    @property
    def transferred(self) -> NDArray[np.float64]: ...
    @property
    def ids(self) -> NDArray[np.int64]: ...
    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    @property
    def with_transferred(self) -> NDArray[np.float64]: ...
    @property
    def map_drift(self) -> float: ...

@final
class SubmapPnp:
    """Where the camera is in an earlier submap; of :meth:`SubmapLandmarks.pnp`.

    Attributes
    ----------
    pose : (4, 4) float64
        Of the camera in the frame of the submap's end, metres.
    accepted : (N,) bool
        The matches that it rests on.
    chi2 : float
        Their squared residual against all noise.
    dof : int
        Its degrees of freedom.
    """
    @property
    def pose(self) -> NDArray[np.float64]: ...
    @property
    def accepted(self) -> NDArray[np.bool_]: ...
    @property
    def chi2(self) -> float: ...
    @property
    def dof(self) -> int: ...

@final
class SubmapLandmarks:
    """The landmarks of a submap, to be seen again.

    Parameters
    ----------
    points, covariance, with_transferred, transferred : ndarray
        As :class:`Submap` has them.

    Raises
    ------
    InputError
        For wrong shapes.
    """
    def __new__(
        cls, points: ArrayLike, covariance: ArrayLike, with_transferred: ArrayLike, transferred: ArrayLike
    ) -> SubmapLandmarks: ...
    def pnp(
        self,
        camera: Camera,
        sigma: float,
        map_drift: float,
        landmarks: ArrayLike,
        uv: ArrayLike,
        guess: ArrayLike,
        least: int,
    ) -> SubmapPnp | None:
        """Pose of a camera that sees the submap, from matches with its landmarks and their covariance.

        The worst match is taken out until each agrees with the others and all together pass, by chi-square.

        Parameters
        ----------
        camera : Camera
        sigma : float
            Standard deviation of a pixel.
        map_drift : float
            Of what all matches share, radians, as :class:`Submap` has it.
        landmarks : (N,) int64
            Of each match, by its place among the points.
        uv : (N, 2) float64
            Its pixel.
        guess : (4, 4) float64
            The pose to begin with, as PnP gives it.
        least : int
            Fewest matches that must be left.

        Returns
        -------
        SubmapPnp or None
            None if too few matches agree.

        Raises
        ------
        InputError
            For wrong shapes, numbers that are not finite, or a landmark that is not there.
        """

@final
class Turn:
    """One at a time, and nobody waits: whoever comes second is told so.

    Used as a context manager.

    Raises
    ------
    BusyError
        On entering, if somebody is inside, another thread or a call further up in the same one.
    """
    def __new__(cls) -> Turn: ...
    def __enter__(self) -> None: ...
    def __exit__(self, *_error: object) -> None: ...

@final
class Filter:
    """The Extended Kalman Filter without images: predict, look up what should be seen, update.

    One filter serves one thread at a time; two threads may run two filters.

    Parameters
    ----------
    camera : Camera
        Cs.
    worn_cameras : Camera or sequence of Camera, optional
        Cf, one of each person's, numbered from 0; needed to take their pixels.
    settings : FilterSettings, optional
        The defaults if left out.

    Raises
    ------
    BusyError
        From every method and attribute, while another thread changes the filter; it stays as it was.
    """
    def __new__(
        cls,
        camera: Camera,
        worn_cameras: Camera | Sequence[Camera] | None = None,
        *,
        settings: FilterSettings | None = None,
    ) -> Filter: ...
    @property
    def started(self) -> bool:
        """Whether the filter has a map to localise in."""
    @property
    def time(self) -> float | None:
        """Time of the last prediction, seconds, or None."""
    @property
    def map_size(self) -> int:
        """Number of features in the map."""
    @property
    def features(self) -> NDArray[np.int64]:
        """Ids of the features, (N,) int64, in order."""
    @property
    def candidate_count(self) -> int:
        """Number of candidates that wait for parallax."""
    @property
    def candidates(self) -> NDArray[np.int64]:
        """Ids of the candidates that are alive, (N,) int64."""
    @property
    def pose(self) -> NDArray[np.float64]:
        """T_WC, (4, 4) float64, metres: maps points of Cs into W."""
    @property
    def pose_covariance(self) -> NDArray[np.float64]:
        """(6, 6) float64, covariance of the pose over (translation m, rotation rad), right tangent of T_WC
        (METHOD 1).
        """
    @property
    def scale_sd(self) -> float | None:
        """Relative standard deviation of the scale, or None without a map: by how much all distances from the
        camera to the features may be too long or too short together. It is P's word; where the unit is
        arbitrary it says how far that has drifted since the start.
        """
    @property
    def readout(self) -> tuple[float, float] | None:
        """Time from the first row of an image of Cs to the last one, as far as the filter knows, and the
        standard deviation of that, seconds; None for a shutter that is known not to roll (METHOD 4).
        """
    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity in W, (3,) float64, m/s."""
    @property
    def angular_velocity(self) -> NDArray[np.float64]:
        """Angular velocity in C, (3,) float64, rad/s."""
    @property
    def twist(self) -> NDArray[np.float64]:
        """Velocity of Cs and angular velocity, both along its own axes, (6,) float64, m/s and rad/s."""
    @property
    def pose_and_twist_covariance(self) -> NDArray[np.float64]:
        """(12, 12) float64, covariance of the pose, as in :attr:`pose_covariance`, and of :attr:`twist`."""
    @property
    def mean(self) -> NDArray[np.float64]:
        """The whole state vector, (n,) float64: camera (13), then the blocks of :attr:`blocks`."""
    @property
    def covariance(self) -> NDArray[np.float64]:
        """The covariance that is told, (n, n) float64, what lasts of errors included (METHOD 20)."""
    @property
    def blocks(self) -> list[Block]:
        """Layout of the state after the camera: a list of `Block`, in the state's order."""
    def soundness(self) -> float:
        """Least eigenvalue of the diagonal-scaled P: P is sound above -1e-10 (METHOD 3). O(n^3)."""
    def check(self) -> None:
        """Checks that the filter is sound (METHOD 3): mean and P finite, variances positive, quaternions of
        unit length, and `soundness` above -1e-10. O(n^3).

        Raises
        ------
        FilterError
            Saying what is wrong.
        """
    def snapshot(self) -> bytes:
        """The filter as bytes, for :meth:`restore`: cameras, settings, mean, P, candidates and counters, with
        version and checksum. The filter restored goes on bit for bit as this one does.
        """
    @staticmethod
    def restore(data: bytes) -> Filter:
        """A new filter from the bytes of :meth:`snapshot`.

        Parameters
        ----------
        data : bytes

        Raises
        ------
        DataError
            If the bytes are cut short, altered or of another version.
        """
    def checkpoint(self) -> None:
        """Remembers the filter as it is, for :meth:`rollback`, in memory of its own; an earlier checkpoint is
        forgotten. A copy of P's stored triangle, about a hundredth of a frame.
        """
    def rollback(self) -> None:
        """Makes the filter what it was at the last :meth:`checkpoint`, bit for bit; this may be repeated.

        Raises
        ------
        InputError
            If there has been no checkpoint.
        """
    def __copy__(self) -> Filter: ...
    def __deepcopy__(self, _memo: object) -> Filter: ...
    def __reduce__(self) -> str: ...
    def add_candidates(self, uv: ArrayLike) -> NDArray[np.int64]:
        """Starts candidates for delayed births at pixels of the present view.

        Parameters
        ----------
        uv : (N, 2) float64
            Pixels in Cs.

        Returns
        -------
        (N,) int64
            Their ids.

        Raises
        ------
        InputError
            For a wrong shape, NaN, or before the start.
        """
    def observe_candidates(self, ids: ArrayLike, uv: ArrayLike) -> CandidateReport:
        """Observes candidates (METHOD 5, delayed).

        Parameters
        ----------
        ids, uv : (N,) int64, (N, 2) float64
            Candidates found in Cs and their pixels.

        Returns
        -------
        CandidateReport

        Raises
        ------
        InputError
            For wrong shapes, NaN, unknown ids, an id given twice; the filter stays as it was.
        """
    def promote_candidates(self, ids: ArrayLike, *, alike: bool = False) -> NDArray[np.int64]:
        """Candidates that shall wait for parallax no longer are born with a vague depth, as features of their
        first view.

        Parameters
        ----------
        ids : (N,) int64
        alike : bool
            Whether half of the variance of their depths is common to all: then their number does not tell
            how large the scene is.

        Returns
        -------
        (N,) int64
            Feature ids, -1 where that gives no feature.

        Raises
        ------
        InputError
            For unknown ids, or an id given twice.
        """
    def drop_candidates(self, ids: ArrayLike) -> None:
        """Forgets candidates that were lost.

        Parameters
        ----------
        ids : (N,) int64
            Those that are not candidates any more do not count.
        """
    def add_undelayed(self, uv: ArrayLike) -> NDArray[np.int64]:
        """Starts features with a vague depth at pixels of the present view; the filter too, in an arbitrary
        unit, if it has not started.

        Parameters
        ----------
        uv : (N, 2) float64
            Pixels in Cs.

        Returns
        -------
        (N,) int64
            Feature ids, -1 where the pixel has no ray.

        Raises
        ------
        InputError
            For a wrong shape or NaN.
        """
    def start_from_views(self, times: ArrayLike, views: ArrayLike) -> NDArray[np.int64]:
        """The scale-free start: at the last of several views of one camera, if they tell how it has moved
        (METHOD 5).

        W is the first view; the unit is such that the mean inverse depth is ``birth.undelayed_rho``.

        Parameters
        ----------
        times : (K,) float64
            Of the views, seconds, increasing.
        views : (K, N, 2) float64
            Pixels in Cs of the same N points in each of them.

        Returns
        -------
        (N,) int64
            Feature ids, -1 for a point that gives none; all are -1 where the views do not tell it yet: the
            filter has not started then.

        Raises
        ------
        InputError
            For wrong shapes, NaN, fewer than two views or more than 20, more than 500 points, times that do
            not increase, or a filter that has
            started; it stays as it was.
        """
    def add_points(
        self, points: ArrayLike, noise: ArrayLike, shared: ArrayLike, covariance: ArrayLike
    ) -> NDArray[np.int64]:
        """Adds a rigid target in view: points of known position in C (METHOD 10). A filter that has not
        started does so from them.

        Later bearings of them are metric: what they do not share is all that their distances can be wrong by.

        Parameters
        ----------
        points : (N, 3) float64
            Metres in C.
        noise : (N, 3, 3) float64
            Covariance of each point by itself, m^2.
        shared : (N, 3, 6) float64
            Derivative of each point by the 6-number error of the target's pose.
        covariance : (6, 6) float64
            Covariance of that error.

        Returns
        -------
        (N,) int64
            Feature ids.

        Raises
        ------
        InputError
            For wrong shapes, NaN, a covariance that is none, or a point at the camera.
        """
    def set_imu(self, r_ci: ArrayLike, time_offset: float) -> None:
        """Says that there is a gyroscope and how it sits, before the start; the settings say how good it is.

        Parameters
        ----------
        r_ci : (3, 3) float64
            Maps the axes of the sensor into those of C.
        time_offset : float
            To be added to its stamps for those of the frames, seconds.

        Raises
        ------
        InputError
            If that is not a rotation or no offset, once the filter has started, or if there is one already.
        """
    def add_gyro(self, t: float, rate: ArrayLike) -> None:
        """Gives a rate of the gyroscope, for predictions to follow.

        Parameters
        ----------
        t : float
            Seconds by its own clock, later than the last one's.
        rate : (3,) float64
            Along its axes, rad/s.

        Raises
        ------
        InputError
            For NaN, an impossible rate, a time that does not follow, if too many samples wait for a frame, or
            without :meth:`set_imu`; nothing is kept then.
        """
    @staticmethod
    def check_gyro(rate: ArrayLike) -> None:
        """Checks that a rate could be given to :meth:`add_gyro`, but for its time.

        Parameters
        ----------
        rate : (3,) float64
            As there.

        Raises
        ------
        InputError
            Saying why it could not.
        """
    @property
    def gyro_time(self) -> float | None:
        """Stamp of the last rate by the gyroscope's clock, seconds, or None."""
    @property
    def gyro_bias(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The gyroscope's bias as it is estimated, along its axes, rad/s, and its covariance: (3,) and (3, 3)
        float64.  None without a gyroscope.
        """
    @property
    def gyro_clock(self) -> tuple[float, float] | None:
        """What is to be added to the gyroscope's stamps for those of the frames, as it is estimated, and the
        standard deviation of that, seconds.  None without a gyroscope.
        """
    @property
    def followed_gyro(self) -> bool:
        """Whether the gyroscope told how the camera turned in the last prediction, for most of its time;
        until a frame is measured.
        """
    def expect_velocity(self, velocity: ArrayLike, sd: ArrayLike) -> None:
        """Says how the camera usually goes.  What is known less well than that is measured, to be known as
        well, where the map in view does not tell it (METHOD 28).

        Parameters
        ----------
        velocity, sd : (3,) array
            Along its own axes, m/s, and the standard deviation of each.

        Raises
        ------
        InputError
            Before the start, and for numbers that are no velocity.
        """
    @property
    def follows_gyro(self) -> bool | None:
        """Whether the gyroscope is followed where it says something; False once it was dropped.  None without
        one.
        """
    def drop_gyro(self) -> None:
        """Stops following the gyroscope, for good: its rates are not the camera's."""
    def gyro_agrees(self, since: float, before: ArrayLike, now: ArrayLike) -> bool | None:
        """Whether the turn that the last two images show is what the gyroscope told of it; None if they show
        none, or no gyroscope told one.

        To be asked before the frame is measured.

        Parameters
        ----------
        since : float
            Time of the first of the images, seconds: the frame of the last checkpoint.
        before, now : (N, 2) float64
            Where points were in it and are now, pixels of Cs.

        Raises
        ------
        InputError
            For wrong shapes or NaN.
        """
    def keep_pose(self, lateness: float) -> bool:
        """Keeps the camera's pose for views of Cf that come up to ``lateness`` seconds late, at most
        ``worn.late``; True if it did.

        To be called at the end of a frame. It does nothing before the start, and so soon after the last pose
        that there is none to gain.
        """
    @property
    def kept_times(self) -> NDArray[np.float64]:
        """Times of the frames whose poses are kept, (K,) float64, seconds, increasing."""
    def kept_pose(self, t: float) -> NDArray[np.float64]:
        """T_WC of a frame whose pose is kept, or of the present one, as it is known now, (4, 4) float64.

        Parameters
        ----------
        t : float
            The frame's time, seconds.

        Raises
        ------
        InputError
            If no pose of that time is kept.
        """
    def view_timing(self, t: float, *, who: int = 0) -> str:
        """What can be done with a view of Cf that was taken at ``t`` (seconds), now that the filter is at its
        frame's time.

        Parameters
        ----------
        t : float
        who : int
            The worn camera's number.

        Returns
        -------
        str
            ``present`` (of the frame's instant, within ``worn.tolerance``), ``late`` (between poses that are
            kept), ``reordered`` (late, and older than one that was measured); or why it is refused:
            ``repeated`` (measured before), ``stale`` (older than what is kept), ``future`` (after the frame).
        """
    def carry_worn(
        self, t_cf: ArrayLike, covariance: ArrayLike, t: float, frame: float, *, who: int = 0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """T_CF of a view carried to a frame of another time: what matching the two images starts from.

        Parameters
        ----------
        t_cf : (4, 4) float64
            Measured pose of Cf relative to Cs when the view was taken: maps points of F into C, metres.
        covariance : (6, 6) float64
            Of it over (translation m, rotation rad), tangent on the right.
        t, frame : float
            When the view was taken; the frame's time, which is the present one or one of `kept_times`.
            Seconds.
        who : int
            The worn camera's number.

        Returns
        -------
        t_cf : (4, 4) float64
            Maps points of F, when the view was taken, into C at the frame's time.
        covariance : (6, 6) float64
            Of it, that of the motion of Cs between included.

        Raises
        ------
        InputError
            For a view that `view_timing` refuses, a frame whose pose is not kept, or an impossible pose.
        """
    def worn_clock(self, *, who: int = 0) -> tuple[float, float] | None:
        """How late the images of a worn camera were taken, as far as the filter knows (METHOD 26).

        Parameters
        ----------
        who : int
            The worn camera's number.

        Returns
        -------
        tuple of (float, float) or None
            Seconds after their stamps by the clock of Cs, and the standard deviation of that; None where
            the clock is exact (``worn.clock_sd`` is 0), or there is no such camera.
        """
    def forget_time(self) -> None:
        """Forgets the time before the start, which nothing depends on: a filter may start from an old frame.

        Raises
        ------
        InputError
            If the filter has started.
        """
    def go_on_at(self, velocity: ArrayLike) -> None:
        """Lets a camera that is lost go on at a velocity, without turning; what it was taken to do before may
        be right, too, so the square of what lies between them joins the covariance (METHOD 3).

        Parameters
        ----------
        velocity : (3,) array
            In W, m/s.

        Raises
        ------
        InputError
            For numbers that are not finite, and before the start.
        """
    def landmarks(self) -> Landmarks:
        """The map, without features that have no point yet (rho <= 0).

        Returns
        -------
        Landmarks
        """
    def manage_map(self, keep: ArrayLike | None = None) -> NDArray[np.int64]:
        """Deletes failing features, the longest unseen of too many, candidates that are too old, and clones
        nobody needs.

        Parameters
        ----------
        keep : (K,) int64, optional
            Features that stay, however long they were not seen, if they do not fail: landmarks that are known
            again for certain. They do not count for ``map.max_features``.

        Returns
        -------
        (N,) int64
            The deleted features.

        Raises
        ------
        InputError
            For a wrong shape, or ids that are none.
        """
    def remove_features(self, ids: ArrayLike) -> None:
        """Removes features.

        Parameters
        ----------
        ids : (N,) int64

        Raises
        ------
        InputError
            For unknown ids; the filter stays as it was.
        """
    def end_submap(self, seen: ArrayLike) -> Submap:
        """Ends the present submap and begins the next one; no estimate changes.

        Parameters
        ----------
        seen : (N,) int64
            Features measured in this frame; those of good depth are taken down.

        Returns
        -------
        Submap

        Raises
        ------
        InputError
            Before the start, or for unknown ids; the filter stays as it was.
        """
    def since_submap(self) -> Edge | None:
        """The way since the last submap ended, or None where none has in this map.

        Returns
        -------
        Edge or None
        """
    def known_map(self) -> KnownMap:
        """The map to start another filter in.

        Returns
        -------
        KnownMap
        """
    def start_from_map(
        self, landmarks: ArrayLike, covariance: ArrayLike, place: ArrayLike
    ) -> NDArray[np.int64]:
        """Starts in a map, not knowing where the camera is; :meth:`relocalise` is to follow.

        Parameters
        ----------
        landmarks : (N, 6) float64
            ``x y z theta phi rho`` of each in W (METHOD 2): metres, radians, 1/m.
        covariance : (6 N, 6 N) float64
            Their joint covariance.
        place : (6, 6) float64
            Covariance of the map's place in W, (translation m, rotation rad).

        Returns
        -------
        (N,) int64
            Feature ids, in the map's order.

        Raises
        ------
        InputError
            For wrong shapes, NaN, a covariance that is none, or a filter that has started; it stays as it
            was.
        """
    def set_odometry_frame(self, t_bc: ArrayLike) -> None:
        """Says where Cs sits in the odometry's frame, before there is any; the identity unless told.

        Parameters
        ----------
        t_bc : (4, 4) float64
            Maps points of C into the odometry's frame B, metres.

        Raises
        ------
        InputError
            For an impossible pose, or once there was odometry.
        """
    def add_odometry(self, t: float, twist: ArrayLike, covariance: ArrayLike) -> None:
        """Gives the mean twist of the odometry's frame since the sample before, for predictions to follow.

        Parameters
        ----------
        t : float
            Its end, seconds, later than the last one's.
        twist : (6,) float64
            Velocity and angular velocity along the axes of the odometry's frame, m/s and rad/s.
        covariance : (6, 6) float64
            Of it, as independent from sample to sample; positive definite.

        Raises
        ------
        InputError
            For NaN, impossible numbers, a time that does not follow, or if too many samples wait for a
            frame; nothing is kept then.
        """
    @staticmethod
    def check_odometry(twist: ArrayLike, covariance: ArrayLike) -> None:
        """Checks that a sample could be given to :meth:`add_odometry`, but for its time.

        Parameters
        ----------
        twist, covariance
            As there.

        Raises
        ------
        InputError
            Saying why it could not.
        """
    @property
    def odometry_time(self) -> float | None:
        """Stamp of the last sample, seconds, or None."""
    @property
    def odometry_scale(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Errors of the odometry's scales as they are estimated, of translation and of turns, relative, and
        their covariance: (2,) and (2, 2) float64.  None before the first motion that odometry told, and where
        the settings take the scales as exact.
        """
    @property
    def followed_odometry(self) -> bool:
        """Whether the last prediction followed odometry, for most of its time; until a frame is measured."""
    def contradicts_odometry(self, found: ArrayLike, uv: ArrayLike, least: int) -> bool:
        """Whether what Cs shows contradicts the odometry that the last prediction followed.

        Parameters
        ----------
        found, uv : (N,) int64, (N, 2) float64
            Features found in Cs and their pixels.
        least : int
            Fewer than these contradict it, too.

        Raises
        ------
        InputError
            For wrong shapes, NaN, unknown ids, an id given twice.
        """
    def distrust_odometry(self) -> None:
        """Takes the last motion as if the wheels may have slipped: P reaches from what odometry tells to what
        the camera's own velocity does, and features are looked for in wider places.
        """
    def trust_odometry(self) -> None:
        """Takes `distrust_odometry` back, before anything was measured."""
    def predict(self, t: float) -> None:
        """Predicts to time ``t`` (seconds). Before the start only the time is noted.

        Raises
        ------
        InputError
            If ``t`` does not follow the last time (a step of zero is none), or is more than an hour after
            it.
        """
    def predict_again(self, since: float, before: ArrayLike, now: ArrayLike) -> bool:
        """Predicts the present frame again, from the checkpoint of the frame before, with the turn that is
        seen in the images (METHOD 27).

        To be asked where the frame has measured nothing: what was done since the checkpoint is undone.

        Parameters
        ----------
        since : float
            Time of the frame before, seconds.
        before, now : (N, 2) float64
            Pixels of points that were followed, there and in the present frame.

        Returns
        -------
        bool
            False, and nothing changed, where the images do not tell the turn, the last checkpoint is not of
            that frame, or odometry told the motion.

        Raises
        ------
        InputError
            For wrong shapes or NaN; nothing changes then.
        """
    def predict_pixels(self) -> Prediction:
        """Every feature that should be visible in Cs.

        Returns
        -------
        Prediction
        """
    def predict_conditional(self, found: ArrayLike, uv: ArrayLike, ids: ArrayLike) -> ConditionalPrediction:
        """Where features are expected once others of the same frame have been found (METHOD 7).

        Those found tell the camera's motion since the last frame, which is most of what a prediction does
        not know. Those that contradict most of the others do not count. The filter stays as it is.

        Parameters
        ----------
        found, uv : (N,) int64, (N, 2) float64
            Features found in Cs and their pixels.
        ids : (M,) int64
            Others.

        Returns
        -------
        ConditionalPrediction
            One row for each of ``ids``.

        Raises
        ------
        InputError
            For wrong shapes, NaN, unknown ids, an id given twice.
        """
    def predict_overlap(
        self, t_cf: ArrayLike, covariance: ArrayLike, *, who: int = 0
    ) -> OverlapPrediction | None:
        """Predicts whether Cs and Cf overlap (METHOD 9).

        Parameters
        ----------
        t_cf : (4, 4) float64
            Measured pose of Cf relative to Cs: maps points of F into C, metres.
        covariance : (6, 6) float64
            Of it over (translation m, rotation rad), tangent on the right.
        who : int
            The worn camera's number.

        Returns
        -------
        OverlapPrediction or None
            None where they do not.

        Raises
        ------
        InputError
            For wrong shapes, NaN, a pose or a covariance that is none, or a filter without a worn camera.
        """
    def check_worn(
        self, t_cf: ArrayLike, covariance: ArrayLike, bias: ArrayLike | None = None, *, who: int = 0
    ) -> None:
        """Checks that a view of Cf with this pose can be measured.

        Parameters
        ----------
        t_cf, covariance
            As for :meth:`predict_overlap`.
        bias : (6, 6) float64, optional
            The part of the covariance that lasts from frame to frame.
        who : int
            The worn camera's number.

        Raises
        ------
        InputError
            Saying why it cannot.
        """
    def doubt_length(self, who: int, sd: float) -> None:
        """Takes it that all lengths of T_CF of a worn camera may be off, for good (METHOD 22).

        So may what is in view, which follows them.  It is told in covariances; the estimate stays as it is.

        Parameters
        ----------
        who : int
            The worn camera's number.
        sd : float
            Standard deviation of the logarithm of its lengths, from 0 to 1; less than before says nothing.

        Raises
        ------
        InputError
            For an unknown worn camera, or no such number.
        """
    @staticmethod
    def check_depths(depth: ArrayLike, sigma: ArrayLike) -> None:
        """Checks that depths can be measured.

        Parameters
        ----------
        depth, sigma : (N,) float64
            Along the optical axis of Cs, and their standard deviations, metres.

        Raises
        ------
        InputError
            Saying why one cannot.
        """
    def update(
        self,
        searched: ArrayLike,
        ids: ArrayLike,
        uv: ArrayLike,
        *,
        views: Sequence[WornMeasurement] = ...,
        depths: DepthMeasurement | None = None,
        min_inliers: int = 0,
        max_speed: float | None = None,
        followed: tuple[float, ArrayLike, ArrayLike] | None = None,
    ) -> UpdateReport:
        """Validates a frame's matches, updates once, and starts features that have depth (METHOD 5-8).

        Measurements that would break the filter (S not positive definite, a result that is not finite, a
        negative variance) are refused: the report says so and the filter stays as it was.

        Parameters
        ----------
        searched : (S,) int64
            Features that were looked for.
        ids, uv : (N,) int64, (N, 2) float64
            Features found in Cs and their pixels.
        views : sequence of WornMeasurement
            Measured pose and matched pixels of each worn camera: the first is measured together with
            what Cs found, each other after all before it. A new point of several of them, at the same
            pixel of the same frame of Cs, is one.
        depths : DepthMeasurement, optional
            Depths from any other sensor.
        min_inliers : int
            Fewest accepted bearings with which the frame is used; with fewer nothing of it is.
        max_speed : float, optional
            Greatest speed, m/s, with which the frame is used: if the camera would be faster after it
            nothing of it is.
        followed : (float, (K, 2) float64, (K, 2) float64), optional
            Time of the frame before, seconds, and pixels of points that were followed from there into the
            present one: if the turn that they show excludes the one that the camera would have made (METHOD
            27), nothing of the frame is used.

        Returns
        -------
        UpdateReport

        Raises
        ------
        InputError
            For wrong shapes, NaN, unknown ids, an impossible pose or covariance; the filter stays as it
            was.
        """
    def worn_pose(self, worn: WornMeasurement) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where a worn camera was, as its stated T_CF and the camera's pose have it: of a view that was not
        measured.

        Parameters
        ----------
        worn : WornMeasurement
            Its matches are not looked at.

        Returns
        -------
        pose : (4, 4) float64
            T_WF: maps points of F into W, metres.
        covariance : (6, 6) float64
            Of it over (translation m, rotation rad), right tangent.

        Raises
        ------
        InputError
            Before the start, and what `carry_worn` and `check_worn` say.
        """
    def relocalise(
        self,
        pose: ArrayLike,
        ids: ArrayLike,
        uv: ArrayLike,
        *,
        least: int | None = None,
        predicted: bool = False,
    ) -> UpdateReport:
        """Puts a lost camera where matches with the map say, and forgets what was believed about it.

        The pose gives the point of linearisation only; the covariance is that of the matches and the map.
        Velocities start anew. The pose is taken if enough of the matches pass the batch test.

        Parameters
        ----------
        pose : (4, 4) float64
            T_WC that explains the matches, as PnP gives it, metres.
        ids, uv : (N,) int64, (N, 2) float64
            Features and their pixels in Cs.
        least : int, optional
            Matches that have to pass, 4 or more; ``lost.min_matches`` if left out.  Fewer do for points that
            say themselves which they are, as the corners of a printed tag.
        predicted : bool
            Whether prediction counts for something: where it excludes the pose, either is wrong, and half the
            square of what lies between them joins the covariance of the map's place (METHOD 17).

        Returns
        -------
        UpdateReport
            ``accepted`` says whether the pose was taken; otherwise the filter is as it was.

        Raises
        ------
        InputError
            For wrong shapes, NaN, unknown ids, an impossible pose, a ``least`` below 4, or before the start;
            the filter stays as it was.
        """
    def restart(self, worn: WornMeasurement, gone: ArrayLike) -> UpdateReport:
        """Starts a new map from a view of Cf, where the camera is predicted to be; the map of before is gone.

        What is left of the pose's certainty becomes that of the new map's place in W: it is part of
        `pose_covariance` and of the landmarks' covariance. Take `known_map` before, to come back to the map
        with `relocalise_in`.

        Parameters
        ----------
        worn : WornMeasurement
            All its ids -1.
        gone : (3, 3) float64
            Square, in m^2, of the way in W that the camera went in a map that may be of the wrong size: half
            of it joins the covariance of the new map's place.

        Returns
        -------
        UpdateReport
            ``accepted`` says whether the map was started (``worn.start_births``); otherwise the filter is
            as it was.

        Raises
        ------
        InputError
            For NaN, an id that is not -1, an impossible pose, covariance or square, or before the start; the
            filter stays as it was.
        """
    def relocalise_in(
        self,
        landmarks: ArrayLike,
        covariance: ArrayLike,
        place: ArrayLike,
        pose: ArrayLike,
        index: ArrayLike,
        uv: ArrayLike,
        *,
        least: int | None = None,
        predicted: bool = False,
    ) -> MapRelocalisation:
        """Puts a lost camera into another map, where its matches with that say, and forgets the present one.

        Parameters
        ----------
        landmarks : (M, 6) float64
            ``x y z theta phi rho`` of each in W (METHOD 2): metres, radians, 1/m.
        covariance : (6 M, 6 M) float64
            Their joint covariance.
        place : (6, 6) float64
            Covariance of the map's place in W, (translation m, rotation rad).
        pose : (4, 4) float64
            T_WC that explains the matches, as PnP gives it, metres.
        index, uv : (N,) int64, (N, 2) float64
            Landmarks by their place in the map, and their pixels in Cs.
        least, predicted
            As with `relocalise`.

        Returns
        -------
        MapRelocalisation

        Raises
        ------
        InputError
            For wrong shapes, NaN, a covariance that is none, an impossible pose, a ``least`` below 4, or
            before the start; the filter stays as it was.
        """
    @property
    def pose_and_scale_covariance(self) -> NDArray[np.float64] | None:
        """(7, 7) float64, covariance of the pose over (translation m, rotation rad), right tangent of T_WC,
        and of the scale's logarithm, as `scale_sd` has it; None without a map.
        """
    def next_best_view(
        self,
        t_cf: ArrayLike,
        covariance: ArrayLike,
        bias: ArrayLike | None = None,
        *,
        least: int = 0,
        who: int = 0,
    ) -> tuple[CandidateViews, CandidateViews]:
        """Views of Cf that a person could offer next, and how much each would tell (METHOD 24).

        Parameters
        ----------
        t_cf : (4, 4) float64
            Where the person is and looks: maps points of F into C, metres.
        covariance : (6, 6) float64
            Of the next measured T_CF over (translation m, rotation rad), tangent on the right; along the axes
            of Cs it is taken to be the same whichever way Cf looks.
        bias : (6, 6) float64, optional
            The part of it that lasts from frame to frame; ``worn.bias_share`` of it if left out.
        least : int
            Fewest matches with which a view is used.
        who : int
            The worn camera's number.

        Returns
        -------
        here : CandidateViews
            From where Cf is, by direction, those with the most matches first.
        elsewhere : CandidateViews
            From places around, each looking at the middle of what Cs sees. None of both before the start, and
            where Cs sees nothing of known depth.

        Raises
        ------
        InputError
            As `check_worn`.
        """

@final
class Block:
    """One block of the state after the camera's.

    Attributes
    ----------
    id : int
        Feature id.
    kind : str
        ``Feature``, ``Point`` and the like.
    offset, size : int
        Its first row in the mean and in P, and its number of rows.
    """
    @property
    def id(self) -> int: ...
    @property
    def kind(self) -> str: ...
    @property
    def offset(self) -> int: ...
    @property
    def size(self) -> int: ...
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    __hash__: None  # type: ignore[assignment]

@final
class CandidateReport:
    """What became of candidates that were observed.

    Attributes
    ----------
    born : (N,) int64
        Feature id of those that became features, -1 elsewhere.
    off_arc : (N,) float64
        Of those that were given up as they are where no point at rest would be: by how many times as much
        as noise and the poses allow; 0 elsewhere.
    held : (N,) bool
        Those that wait where they were first seen: they may be fixed to the camera.
    fixed : (N,) bool
        Those that were given up as they are fixed to the camera.
    """
    @property
    def born(self) -> NDArray[np.int64]: ...
    @property
    def off_arc(self) -> NDArray[np.float64]: ...
    @property
    def held(self) -> NDArray[np.bool_]: ...
    @property
    def fixed(self) -> NDArray[np.bool_]: ...

@final
class Landmarks:
    """The map with the uncertainty of each landmark.

    Attributes
    ----------
    ids : (N,) int64
    points : (N, 3) float64
        In W, metres.
    covariance : (N, 3, 3) float64
        Of each point, m^2.
    rho_ratio : (N,) float64
        Relative standard deviation of its inverse range, sd(rho) / rho.
    """
    @property
    def ids(self) -> NDArray[np.int64]: ...
    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    @property
    def rho_ratio(self) -> NDArray[np.float64]: ...

@final
class KnownMap:
    """A map for another filter to start in; see :meth:`Filter.start_from_map`.

    Attributes
    ----------
    ids : (N,) int64
        Features of the filter that made it.
    landmarks : (N, 6) float64
        ``x y z theta phi rho`` of each in W (METHOD 2): metres, radians, 1/m.
    covariance : (6 N, 6 N) float64
        Their joint covariance.
    place : (6, 6) float64
        Covariance of the map's place in W, (translation m, rotation rad).
    """
    @property
    def ids(self) -> NDArray[np.int64]: ...
    @property
    def landmarks(self) -> NDArray[np.float64]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    @property
    def place(self) -> NDArray[np.float64]: ...

@final
class WornMeasurement:
    """The worn camera's part of a frame: its measured pose, points that both cameras see, and features
    that it sees alone.

    Parameters
    ----------
    t_cf : (4, 4) float64
        Measured pose of Cf relative to Cs when the view was taken: maps points of F into C, metres.
    covariance : (6, 6) float64
        Of it over (translation m, rotation rad), tangent on the right.
    ids : (M,) int64
        Feature of each pair, -1 for a new point.
    uv, uv_f : (M, 2) float64
        Its pixels in Cs and in Cf. NaN in ``uv`` are features that Cf alone sees, as the corners of a
        printed tag: the mode ``collab-tight`` measures them.
    bias : (6, 6) float64, optional
        The part of the covariance that lasts from frame to frame; ``worn.bias_share`` of it if left
        out.
    capture : (t, frame), optional
        When the view was taken, and the time of the frame of Cs whose image ``uv`` are of (the present one,
        or one of `Filter.kept_times`), seconds; at the frame's own time if left out (METHOD 21).
    who : int
        The worn camera's number: its place in the list that the filter was made with.

    Raises
    ------
    InputError
        For wrong shapes, and ids that are none. `Filter.update` checks the values.
    """
    def __new__(
        cls,
        t_cf: ArrayLike,
        covariance: ArrayLike,
        ids: ArrayLike,
        uv: ArrayLike,
        uv_f: ArrayLike,
        *,
        bias: ArrayLike | None = None,
        capture: tuple[float, float] | None = None,
        who: int = 0,
    ) -> WornMeasurement: ...
    def with_rate(self, rate: ArrayLike) -> WornMeasurement:
        """The same with what a gyroscope of Cf's own tells of how it turned (METHOD 6).

        Parameters
        ----------
        rate : (3,) float64
            Angular velocity of Cf when the view's middle row was taken, along the axes of F, rad/s.

        Returns
        -------
        WornMeasurement

        Raises
        ------
        InputError
            For a wrong shape, and numbers that are not finite. `Filter.update` checks their sizes.
        """
    def __len__(self) -> int: ...

@final
class DepthMeasurement:
    """Depths of points in Cs, from any other sensor.

    Parameters
    ----------
    ids : (K,) int64
        Feature of each depth, -1 for a new point.
    uv : (K, 2) float64
        Its pixel in Cs.
    depth, sigma : (K,) float64
        Depth along the optical axis of Cs and its standard deviation, metres.

    Raises
    ------
    InputError
        For wrong shapes, and ids that are none. `Filter.update` checks the values.
    """
    def __new__(
        cls, ids: ArrayLike, uv: ArrayLike, depth: ArrayLike, sigma: ArrayLike
    ) -> DepthMeasurement: ...
    def __len__(self) -> int: ...

@final
class Prediction:
    """Features that should be visible in Cs.

    Attributes
    ----------
    ids : (N,) int64
    uv : (N, 2) float64
        Pixels where they are expected.
    s : (N, 2, 2) float64
        Innovation covariance of those, measurement noise included, px^2.
    points : (N, 3) float64
        In W, metres.
    rho, rho_sd : (N,) float64
        Inverse distance from Cs now and its standard deviation, 1/m.
    """
    @property
    def ids(self) -> NDArray[np.int64]: ...
    @property
    def uv(self) -> NDArray[np.float64]: ...
    @property
    def s(self) -> NDArray[np.float64]: ...
    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def rho(self) -> NDArray[np.float64]: ...
    @property
    def rho_sd(self) -> NDArray[np.float64]: ...
    def subset(self, which: NDArray[np.bool_] | NDArray[np.int64] | slice) -> Prediction:
        """Some of the features.

        Parameters
        ----------
        which : (N,) bool, (M,) int64 or slice
            A mask, or rows.

        Returns
        -------
        Prediction

        Raises
        ------
        InputError
            If it is none of these, or there is no such row.
        """
    def __len__(self) -> int: ...

@final
class ConditionalPrediction:
    """Where features are expected once others of the frame have been found.

    Attributes
    ----------
    uv : (M, 2) float64
        Pixels in Cs; NaN where nothing is expected of a feature.
    s : (M, 2, 2) float64
        Their covariances, measurement noise included, px^2.
    agree : (N,) bool
        Of those found: the feature agrees with the others.
    """
    @property
    def agree(self) -> NDArray[np.bool_]: ...
    @property
    def uv(self) -> NDArray[np.float64]: ...
    @property
    def s(self) -> NDArray[np.float64]: ...

@final
class OverlapPrediction:
    """Where the views of Cs and Cf overlap (METHOD 9).

    Attributes
    ----------
    roi_s, roi_f : (u0, v0, u1, v1) floats
        Region of interest in Cs and in Cf, pixels.
    d_max : float
        Largest depth at which a match is of use, metres.
    baseline : float
        Distance of the cameras, metres.
    """
    @property
    def roi_s(self) -> tuple[float, float, float, float]: ...
    @property
    def roi_f(self) -> tuple[float, float, float, float]: ...
    @property
    def d_max(self) -> float: ...
    @property
    def baseline(self) -> float: ...

@final
class MeasurementOutcomes:
    """What became of one kind of measurement in a frame.

    ``names`` says it of each: ``pixel`` (accepted as two pixel rows), ``depth`` (as three metric rows),
    ``rate`` (a worn camera's rate was), ``replaced`` (its feature was measured by a better form of the
    same match), ``born``, ``too-uncertain`` (a pixel predicted no better than somewhere in the image; a
    pair not worth more than its bearing), ``not-visible``, ``rejected-gate`` (its own chi-square),
    ``rejected-batch`` (the batch test), ``rejected-conditional`` (contradicted by the others), ``unused``
    (in this mode), ``refused`` (with the whole frame).
    """
    @property
    def accepted(self) -> NDArray[np.bool_]:
        """(N,) bool: the measurement of a known feature was used, as rows of its own or of a better form of
        the same match.
        """
    @property
    def born(self) -> NDArray[np.int64]:
        """(N,) int64: id of the feature born from each, -1 for none."""
    @property
    def names(self) -> list[str]:
        """(N,) list of str: see the class."""
    @property
    def pixel_rows(self) -> int:
        """How many were accepted as two pixel rows."""
    @property
    def depth_rows(self) -> int:
        """How many were accepted as three metric rows."""
    @property
    def too_uncertain(self) -> int:
        """How many were too uncertain to say anything."""
    @property
    def rejected_gate(self) -> int:
        """How many failed their own chi-square gate."""
    @property
    def rejected_batch(self) -> int:
        """How many the batch test left out."""
    @property
    def rejected_conditional(self) -> int:
        """How many contradicted the other accepted ones."""
    def __len__(self) -> int: ...

@final
class UpdateReport:
    """What one update did.

    Attributes
    ----------
    bearings, depths : MeasurementOutcomes
        What became of the pixels in Cs and of the depths, in the order they were given.
    views : list of MeasurementOutcomes
        What became of the pairs of each view.
    rates : MeasurementOutcomes
        What became of the rate of each view, ``unused`` where none was told.
    accepted : bool
        Whether the frame was used: False if fewer bearings than asked for passed the tests.
    refused : str or None
        Why the whole frame was refused: its update would have broken the filter, which is as it was
        before.
    nis : float
        Normalised innovation squared of the accepted batch.
    dof : int
        Its degrees of freedom.
    order : int
        Matches that the batch test left out.
    exact : bool
        Whether the batch test finished its exact search.
    worn_error : (6,) float64
        Estimated error of T_CF of the first view after the update, (translation m, rotation rad), right
        tangent.
    worn_error_covariance : (6, 6) float64
        What is left of its covariance after the update, in the filter's own model.
    worn_error_of_map : (6, 6) float64
        Covariance of what errors of the map that last may have put into it, which that model does not know of
        (METHOD 20).
    worn_poses : dict of int to (pose, covariance)
        Where the worn cameras were whose views were measured, by their numbers: T_WF (4, 4), metres, and
        its covariance (6, 6) over (translation m, rotation rad), right tangent.
    too_fast : bool
        Whether it was not used as the camera would have been faster than it may be.
    turn_excluded : bool
        Whether it was not used as the images show another turn.
    jumped : bool
        Of a relocalisation: whether prediction excludes where it found the camera, whatever is not known of
        the map.
    """
    @property
    def bearings(self) -> MeasurementOutcomes: ...
    @property
    def depths(self) -> MeasurementOutcomes: ...
    @property
    def views(self) -> list[MeasurementOutcomes]: ...
    @property
    def rates(self) -> MeasurementOutcomes: ...
    @property
    def accepted(self) -> bool: ...
    @property
    def refused(self) -> str | None: ...
    @property
    def nis(self) -> float: ...
    @property
    def dof(self) -> int: ...
    @property
    def order(self) -> int: ...
    @property
    def exact(self) -> bool: ...
    @property
    def worn_error(self) -> NDArray[np.float64]: ...
    @property
    def worn_error_covariance(self) -> NDArray[np.float64]: ...
    @property
    def worn_error_of_map(self) -> NDArray[np.float64]: ...
    @property
    def worn_poses(self) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]: ...
    @property
    def too_fast(self) -> bool: ...
    @property
    def turn_excluded(self) -> bool: ...
    @property
    def jumped(self) -> bool: ...

@final
class MapRelocalisation:
    """Whether a camera was put into another map.

    Attributes
    ----------
    report : UpdateReport
        ``accepted`` says whether the pose was taken; otherwise the filter is as it was.
    ids : (M,) int64
        The new feature ids of the map's landmarks, in its order; none where the pose was not taken.
    """
    @property
    def report(self) -> UpdateReport: ...
    @property
    def ids(self) -> NDArray[np.int64]: ...

@final
class CandidateViews:
    """Views that Cf could offer.

    Attributes
    ----------
    t_cf : (N, 4, 4) float64
        Pose of Cf relative to Cs: maps points of F into C, metres.
    matches : (N,) float64
        Matches to be expected.
    gain : (N,) float64
        Expected decrease of half the logarithm of the determinant of the covariance of the pose and the
        scale's logarithm, nats.
    best : int or None
        The view of the largest gain; None where nothing is gained.
    """
    @property
    def t_cf(self) -> NDArray[np.float64]: ...
    @property
    def matches(self) -> NDArray[np.float64]: ...
    @property
    def gain(self) -> NDArray[np.float64]: ...
    @property
    def best(self) -> int | None: ...

@final
class EpipolarResiduals:
    """Sampson residuals of pairs of rays.

    Attributes
    ----------
    residual : (M,) float64
        In units of the pixel noise: its standard deviation is that of one pixel coordinate.
    jacobian : (M, 6) float64
        By (translation, rotation) on the right of T_CF, pixels per metre and per radian.
    """
    @property
    def residual(self) -> NDArray[np.float64]: ...
    @property
    def jacobian(self) -> NDArray[np.float64]: ...

@final
class MatchNoise:
    """How accurate matches are.

    Parameters
    ----------
    focal : (float, float)
        Focal lengths of Cs and Cf, pixels per radian.
    sigma : float
        Standard deviation of a right match's residual, pixels.
    limit : float
        Largest residual of a match that agrees, pixels.
    """
    @property
    def focal(self) -> tuple[float, float]: ...
    @property
    def sigma(self) -> float: ...
    @property
    def limit(self) -> float: ...
    def __new__(cls, focal: tuple[float, float], sigma: float, limit: float) -> MatchNoise: ...

@final
class Consensus:
    """Pose that matches agree on.

    Attributes
    ----------
    t_cf : (4, 4) float64
        Maps points of F into C, metres.
    covariance : (6, 6) float64
        Of it, over (translation m, rotation rad), tangent on the right.
    agree : (M,) bool
        Matches whose residual is within the limit under the pose.
    """
    @property
    def t_cf(self) -> NDArray[np.float64]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    @property
    def agree(self) -> NDArray[np.bool_]: ...

@final
class PairPoints:
    """Points of Cs for which partners in Cf are wanted.

    Parameters
    ----------
    rays : (N, 3) float64
        Unit rays in C.
    ranges : (N, 2) float64
        Least and largest inverse range of each, 1/m.
    known : (N,) bool
        Points that have one descriptor, the first, whatever the depth of a pair.
    descriptors : (D, N, K) float32
        Made at each of the depths; unit vectors, K is a multiple of 32.
    depths : (D,) float64
        Inverse ranges, increasing, 1/m.

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """
    def __new__(
        cls,
        rays: ArrayLike,
        ranges: ArrayLike,
        known: ArrayLike,
        descriptors: NDArray[np.float32],
        depths: ArrayLike,
    ) -> PairPoints: ...
    def __len__(self) -> int: ...

@final
class PairOptions:
    """When points are partners.

    Parameters
    ----------
    sigma : (float, float)
        Standard deviations of a pixel of Cs and of Cf, radians.
    gate : float
        Radius of the gates in standard deviations.
    ratio : float
        Largest ratio of the best to the second best distance of descriptors.
    max_distance : float
        Largest distance of descriptors.
    """
    @property
    def sigma(self) -> tuple[float, float]: ...
    @property
    def gate(self) -> float: ...
    @property
    def ratio(self) -> float: ...
    @property
    def max_distance(self) -> float: ...
    def __new__(
        cls, *, sigma: tuple[float, float], gate: float, ratio: float, max_distance: float
    ) -> PairOptions: ...

@final
class PairMatches:
    """Partners, and why other points of Cs have none.

    Attributes
    ----------
    index_s, index_f : (K,) int64
        Rows of the points matched.
    alone : int
        Points without any pair that is allowed.
    indistinct : int
        Points whose best partner is unlike, or hardly better than the next.
    one_sided : int
        Points whose best partner has a better one.
    """
    @property
    def index_s(self) -> NDArray[np.int64]: ...
    @property
    def index_f(self) -> NDArray[np.int64]: ...
    @property
    def alone(self) -> int: ...
    @property
    def indistinct(self) -> int: ...
    @property
    def one_sided(self) -> int: ...

@final
class Windows:
    """Windows cut out of an image.

    Attributes
    ----------
    windows : list of N (2 half + 1, 2 half + 1) uint8
    inside : (N, 4) float64
        First and last column and row of each that hold image (u0, v0, u1, v1); the rest repeats its
        edge.
    """
    @property
    def windows(self) -> list[NDArray[np.uint8]]: ...
    @property
    def inside(self) -> NDArray[np.float64]: ...

@final
class SampledTemplates:
    """Templates sampled from an image.

    Attributes
    ----------
    templates : (N, size, size) uint8
        Bilinear samples; where the map shrinks, each pixel is the mean of 2 x 2 of them.
    reach : (N, 2) float64
        Largest distance in u and v between a sample and its centre, image pixels.
    """
    @property
    def templates(self) -> NDArray[np.uint8]: ...
    @property
    def reach(self) -> NDArray[np.float64]: ...

@final
class WarpedPatches:
    """Templates of patches seen from another pose.

    Attributes
    ----------
    templates : (N, size, size) uint8
        Zeros where there is none.
    ok : (N,) bool
        False where the change of area or the stretch is out of bounds, or the warp leaves the stored
        window.
    affine : (N, 2, 2) float64
        Maps pixel offsets at capture to pixel offsets now; the identity where there is none.
    """
    @property
    def templates(self) -> NDArray[np.uint8]: ...
    @property
    def ok(self) -> NDArray[np.bool_]: ...
    @property
    def affine(self) -> NDArray[np.float64]: ...

@final
class ExpectedPixels:
    """Where templates are expected in an image.

    Parameters
    ----------
    uv : (N, 2) float64
        Predicted pixels; NaN where there is none.
    s : (N, 2, 2) float64
        Covariance of each, pixel noise included, px^2.
    guess : (N, 2) float64, optional
        Where something else says that the point is; NaN where it does not say.

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """
    def __new__(cls, uv: ArrayLike, s: ArrayLike, guess: ArrayLike | None = None) -> ExpectedPixels: ...
    def __len__(self) -> int: ...

@final
class SearchWindow:
    """How far around a predicted pixel a template is searched.

    Parameters
    ----------
    gate : float
        Radius of the ellipse in standard deviations.
    min_radius : float
        Least radius of the ellipse, pixels.
    large_radius : float
        Radius above which it is not searched whole if a guess lies in it, pixels.
    max_radius : float
        Cap of the window's half side, pixels.
    guess_radius : float
        Half side of the window around a guess, pixels.
    guess_gate : float
        How generously a guess lies in the ellipse: a factor on ``gate``.
    """
    @property
    def gate(self) -> float: ...
    @property
    def min_radius(self) -> float: ...
    @property
    def large_radius(self) -> float: ...
    @property
    def max_radius(self) -> float: ...
    @property
    def guess_radius(self) -> float: ...
    @property
    def guess_gate(self) -> float: ...
    def __new__(
        cls,
        *,
        gate: float,
        min_radius: float,
        large_radius: float,
        max_radius: float,
        guess_radius: float,
        guess_gate: float,
    ) -> SearchWindow: ...

@final
class PeakTest:
    """Which peak of the correlation is a match.

    Parameters
    ----------
    min_score : float
        Least correlation.
    ambiguity : float
        Largest share of the best peak that another may reach.
    peak_distance : float
        Peaks nearer than this to the best one belong to it, pixels.
    min_deviation : float
        Least standard deviation of a template's grey values.
    scarce : bool
        Whether less correlation is asked for, by the share of a template that is noise (METHOD 7).
    """
    @property
    def min_score(self) -> float: ...
    @property
    def ambiguity(self) -> float: ...
    @property
    def peak_distance(self) -> float: ...
    @property
    def min_deviation(self) -> float: ...
    @property
    def scarce(self) -> bool: ...
    def __new__(
        cls,
        *,
        min_score: float,
        ambiguity: float,
        peak_distance: float,
        min_deviation: float,
        scarce: bool = False,
    ) -> PeakTest: ...

@final
class SearchResult:
    """What a search found.

    Parameters
    ----------
    uv : (N, 2) float64
        Sub-pixel position of the best peak; NaN where there is none.
    score : (N,) float64
        Its correlation; -1 where there is none.
    second : (N,) float64
        Correlation of the next best peak that does not belong to it; -1 where there is none.
    code : (N,) int64
        0 found, 1 score too low, 2 ambiguous, 3 outside of the image, 4 not searched as not ``whole``.

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """
    @property
    def uv(self) -> NDArray[np.float64]: ...
    @property
    def score(self) -> NDArray[np.float64]: ...
    @property
    def second(self) -> NDArray[np.float64]: ...
    @property
    def code(self) -> NDArray[np.int64]: ...
    def __new__(cls, uv: ArrayLike, score: ArrayLike, second: ArrayLike, code: ArrayLike) -> SearchResult: ...
    def subset(self, which: NDArray[np.bool_] | NDArray[np.int64] | slice) -> SearchResult:
        """Some of the rows.

        Parameters
        ----------
        which : (N,) bool, (M,) int64 or slice
            A mask, or rows.

        Returns
        -------
        SearchResult

        Raises
        ------
        InputError
            If it is none of these, or there is no such row.
        """
    def __len__(self) -> int: ...

@final
class WarpLimits:
    """Which warps of a patch are allowed.

    Parameters
    ----------
    min_area, max_area : float
        Least and largest change of area.
    max_stretch : float
        Largest ratio of the two scales.
    """
    @property
    def min_area(self) -> float: ...
    @property
    def max_area(self) -> float: ...
    @property
    def max_stretch(self) -> float: ...
    def __new__(cls, *, min_area: float, max_area: float, max_stretch: float) -> WarpLimits: ...

@final
class AffineMaps:
    """Predicted pixels in another view, and the maps of pixel offsets into it.

    Attributes
    ----------
    uv : (N, 2) float64
        Predicted pixel; NaN where the landmark is not in front of the camera.
    affine : (N, 2, 2) float64
        ``offset_now = affine @ offset_ref``; the identity where there is none.
    ok : (N,) bool
        Whether there is one that keeps its orientation.
    """
    @property
    def uv(self) -> NDArray[np.float64]: ...
    @property
    def affine(self) -> NDArray[np.float64]: ...
    @property
    def ok(self) -> NDArray[np.bool_]: ...

@final
class EstimatorSettings:
    """Which estimator."""
    @property
    def mode(self) -> str:
        """What the worn camera is used for and how features are born."""
    @property
    def consistency(self) -> str:
        """What keeps the filter from gaining information that no measurement holds: gauge (the
        covariance moves with rotation and scale, the directions that no camera can see) or none
        (the plain EKF).
        """

@final
class ProcessSettings:
    """The motion model: constant velocity with white acceleration (METHOD 3)."""
    @property
    def velocity(self) -> str:
        """Whether the velocity is constant in W, or along the camera's own axes, as on a robot with
        wheels.
        """
    @property
    def acceleration_density(self) -> float:
        """Spectral density (its root) of the camera's random acceleration."""
    @property
    def angular_acceleration_density(self) -> float:
        """The same of its angular acceleration."""
    @property
    def start_velocity_sd(self) -> float:
        """Standard deviation of each component of the velocity at the start; ten times the median
        range a second at most.
        """
    @property
    def start_angular_velocity_sd(self) -> float:
        """Standard deviation of each component of the angular velocity at the start."""
    @property
    def map_drift(self) -> float:
        """How much of the error that landmarks in view share shows in their innovations: a new view
        stands beside an old one with this many times the part of the innovations that is beyond a
        patch's own noise, by angle (METHOD 20); 0 for errors that are as the noise of the pixels
        says.
        """

@final
class OdometrySettings:
    """Odometry as motion input (METHOD 23)."""
    @property
    def scale_sd(self) -> float:
        """Standard deviation of the scale of its translation, relative: of a wheel's radius, and of
        the slip that lasts.
        """
    @property
    def turn_scale_sd(self) -> float:
        """The same of its turns."""
    @property
    def scale_time(self) -> float:
        """For how long such an error lasts."""

@final
class ImuSettings:
    """A gyroscope, and an accelerometer beside it, as motion input (METHOD 28): what their data sheet
    or an Allan variance says.
    """
    @property
    def gyro_noise(self) -> float:
        """Spectral density (its root) of the white noise of the gyroscope's rates."""
    @property
    def gyro_bias_sd(self) -> float:
        """Standard deviation of the gyroscope's bias along each axis at the start."""
    @property
    def gyro_bias_walk(self) -> float:
        """Spectral density (its root) of the walk of that bias."""
    @property
    def gyro_scale_sd(self) -> float:
        """Standard deviation of the gyroscope's scale, relative. It is considered, not estimated."""
    @property
    def mount_sd(self) -> float:
        """Standard deviation of each of the three angles of the sensor's mounting. It is considered,
        not estimated.
        """
    @property
    def time_offset_sd(self) -> float:
        """Standard deviation of what is left of the offset between the clocks of the sensor and of Cs."""
    @property
    def accel_noise(self) -> float:
        """Spectral density (its root) of the white noise of the accelerometer."""
    @property
    def accel_bias_sd(self) -> float:
        """Standard deviation of the accelerometer's bias along each axis."""

@final
class CalibrationSettings:
    """How well Cs is calibrated. A calibration's error is the same in every frame, so that no number
    of features averages it out: the filter considers it and does not estimate it, but for the
    readout (METHOD 4). All zero: the calibration is exact.
    """
    @property
    def focal_sd(self) -> float:
        """Standard deviation of the focal length, relative."""
    @property
    def aspect_sd(self) -> float:
        """Standard deviation of the ratio of both focal lengths."""
    @property
    def centre_sd(self) -> float:
        """Standard deviation of each coordinate of the principal point."""
    @property
    def radial_sd(self) -> float:
        """Standard deviation of the radial distortion: of its coefficients of the third and the fifth
        power.
        """
    @property
    def readout(self) -> float:
        """Time from the first row of an image of Cs to the last one: 0 for a global shutter, negative
        for an image upside down. The filter estimates it from here. The default is that of a
        shutter of which nothing is told: it may take its rows all at once, or one after the other
        until the next image of 30 a second, or evenly anything between.
        """
    @property
    def readout_sd(self) -> float:
        """Standard deviation of that time; 0 where it is exact."""

@final
class PixelSettings:
    """Noise of pixel measurements (METHOD 4)."""
    @property
    def sigma_cs(self) -> float:
        """Standard deviation of a feature's measured pixel in Cs, per axis."""
    @property
    def sigma_cf(self) -> float:
        """Standard deviation of a matched pixel in Cf, per axis."""

@final
class BirthSettings:
    """How features are born (METHOD 5)."""
    @property
    def first_pose(self) -> str:
        """How the pose of a candidate's first view is treated at a delayed birth."""
    @property
    def min_baseline(self) -> float:
        """Least distance between first and present view for a delayed birth."""
    @property
    def min_parallax(self) -> float:
        """Least parallax for a delayed birth."""
    @property
    def max_rho_ratio(self) -> float:
        """Largest sd(rho)/rho of a birth from two views; while it is larger the candidate waits."""
    @property
    def undelayed_rho(self) -> float:
        """Inverse depth of an undelayed birth."""
    @property
    def undelayed_rho_sd(self) -> float:
        """Standard deviation of the inverse depth of an undelayed birth."""
    @property
    def vague_below(self) -> float:
        """Where fewer features than this share of `map.in_view` are tracked, as in a turn, waiting
        candidates are born with a vague inverse depth from their first view. 0 for never. In mono
        never in metres, as the scale would come from that prior, and in an arbitrary unit only
        below twice `lost.min_matches`.
        """

@final
class WornSettings:
    """The worn camera Cf and the error of its pose (METHOD 6)."""
    @property
    def errors(self) -> str:
        """How the error of T_CF enters the matches of a frame."""
    @property
    def bias_share(self) -> float:
        """Share of T_CF's stated variance that lasts (Gauss-Markov, along the axes of Cs) and is
        another error in each overlap, where the worn view itself does not say which part of its
        covariance lasts; the rest is white noise.
        """
    @property
    def length_sd(self) -> float:
        """Standard deviation of the logarithm of T_CF's lengths, an error for good, where the worn
        view itself says which part of its covariance lasts, or a bias_share of 0 that none does,
        and that part is less: no device knows its scale better (METHOD 6).
        """
    @property
    def bias_time(self) -> float:
        """Time constant of what lasts, within an overlap."""
    @property
    def common_share(self) -> float:
        """Share of T_CF's error, of its variance along the axes of Cs, that all worn cameras have in
        common in a frame, as where one tracker locates them all.
        """
    @property
    def late(self) -> float:
        """How late a view of Cf may come and still be used: for so long the poses of Cs are kept once
        views come that are not of a frame's own instant (METHOD 21).
        """
    @property
    def tolerance(self) -> float:
        """A view taken this close to a frame counts as one of its instant; the motion of Cs meanwhile
        is added to the noise of T_CF.
        """
    @property
    def clock_sd(self) -> float:
        """Standard deviation of the offset, the same in all views, of a worn camera's time stamps
        against the clock of Cs. Views that come between frames and see Cs change its motion tell
        it; until then it counts as an error of T_CF that lasts.
        """
    @property
    def readout(self) -> float:
        """Time from the first row of an image of Cf to the last one, root mean square of what it may
        be. Meanwhile its wearer moves and turns, by 1 m/s and 1 rad/s on each axis (standard
        deviations), and each row sees another T_CF (METHOD 6). 0 for a shutter that does not roll.
        """
    @property
    def readout_sd(self) -> float:
        """Standard deviation of that time, a part of its root mean square. It counts where a gyroscope
        of Cf tells how that turned.
        """
    @property
    def rate_sd(self) -> float:
        """Standard deviation of the rate, on each axis, that a gyroscope of Cf tells of an image: of
        its bias, scale and mounting, of its clock, and of how the rate changes while the image is
        read.
        """
    @property
    def start_births(self) -> int:
        """Least number of births that starts the filter from a first overlap."""

@final
class ValidateSettings:
    """Validation of a frame's matches (METHOD 8)."""
    @property
    def test(self) -> str:
        """Which test of the whole batch."""
    @property
    def level(self) -> float:
        """Confidence level of the chi-square tests."""
    @property
    def conditional_level(self) -> float:
        """Level of the gate for each match given all the others, after the batch test; 1 for none."""
    @property
    def max_nodes(self) -> int:
        """Largest number of hypotheses of a batch test. Past it the best set so far stands, and the
        frame's report says so. One takes about 0.15 ms for 100 matches and a tenth of that for 40,
        and a frame is tested up to three times.
        """

@final
class MapSettings:
    """Upkeep of the map (METHOD 7, step 8)."""
    @property
    def in_view(self) -> int:
        """Number of features that the map keeps in view."""
    @property
    def reserve(self) -> float:
        """Candidates tracked beside them, as a share of that number: births take time, and not every
        candidate is born.
        """
    @property
    def max_features(self) -> int:
        """Largest number of features in the map."""
    @property
    def local_from(self) -> int:
        """Size of the map from which features out of view are updated only when they come back into
        view or somebody asks for the whole state: the same result, faster for large maps.
        """
    @property
    def candidate_age(self) -> float:
        """A candidate that has not been born after so many seconds is dropped."""

@final
class LostSettings:
    """When the camera counts as lost."""
    @property
    def min_matches(self) -> int:
        """Accepted matches that a frame needs to be OK, and a lost camera to be found. Each gives two
        equations for the six numbers of the pose, so 8 leave ten to check it.
        """
    @property
    def seconds(self) -> float:
        """The camera is lost after this long without an OK frame, or after three failed frames in a
        row.
        """

@final
class OverlapSettings:
    """Prediction of the overlap of both views (METHOD 9)."""
    @property
    def near(self) -> float:
        """Least depth at which either camera is taken to see anything."""
    @property
    def far(self) -> float:
        """Largest depth at which Cf is used."""

def skew(v: ArrayLike) -> NDArray[np.float64]:
    """Matrix of the cross product: ``skew(v) @ p == cross(v, p)``.

    Parameters
    ----------
    v : (3,) float64

    Returns
    -------
    (3, 3) float64

    Raises
    ------
    InputError
        For a wrong shape, or a number that is not finite.
    """

def rotation_exp(w: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrix of a rotation vector.

    Parameters
    ----------
    w : (3,) float64
        Axis times angle, radians.

    Returns
    -------
    (3, 3) float64

    Raises
    ------
    InputError
        For a wrong shape, or a number that is not finite.
    """

def rotation_log(rotation: ArrayLike) -> NDArray[np.float64]:
    """Rotation vector of a rotation matrix.

    Parameters
    ----------
    rotation : (3, 3) float64

    Returns
    -------
    (3,) float64
        Axis times angle, radians; no longer than pi.

    Raises
    ------
    InputError
        For a wrong shape, or a number that is not finite.
    """

def left_jacobian(w: ArrayLike) -> NDArray[np.float64]:
    """Left Jacobian of SO(3): the mean of ``Exp(s w)`` over s from 0 to 1.

    Under a constant twist ``(v, w)`` over a unit of time a pose is moved by ``left_jacobian(w) v``.

    Parameters
    ----------
    w : (3,) float64
        Axis times angle, radians.

    Returns
    -------
    (3, 3) float64

    Raises
    ------
    InputError
        For a wrong shape, or a number that is not finite.
    """

def rotation_from_quaternion(q_wxyz: ArrayLike) -> NDArray[np.float64]:
    """Rotation matrix of a Hamilton quaternion.

    Parameters
    ----------
    q_wxyz : (4,) float64
        Scalar first; it is normalised.

    Returns
    -------
    (3, 3) float64

    Raises
    ------
    InputError
        For a wrong shape, a number that is not finite, or a quaternion of length zero.
    """

def quaternion_wxyz(rotation: ArrayLike) -> NDArray[np.float64]:
    """Hamilton quaternion of a rotation matrix.

    Parameters
    ----------
    rotation : (3, 3) float64

    Returns
    -------
    (4,) float64
        ``(w, x, y, z)``, of length one, w not below zero.

    Raises
    ------
    InputError
        For a wrong shape, or a number that is not finite.
    """

def is_rotation(matrix: ArrayLike, tolerance: float = 1e-3) -> bool:
    """Whether a matrix is a rotation.

    Parameters
    ----------
    matrix : array
        Of any shape.
    tolerance : float
        Largest error of an entry of ``matrix @ matrix.T``.

    Returns
    -------
    bool
        It is (3, 3), finite, orthonormal and no reflection.
    """

def pose_inverse(t_ab: ArrayLike) -> NDArray[np.float64]:
    """Inverse of a rigid pose: ``t_ba`` of ``t_ab``.

    Parameters
    ----------
    t_ab : (4, 4) float64
        Maps points of frame B into frame A, metres.

    Returns
    -------
    (4, 4) float64

    Raises
    ------
    InputError
        For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
    """

def se3_exp(xi: ArrayLike) -> NDArray[np.float64]:
    """Exp of METHOD 1: ``Exp((v, w)) = [R(w), v; 0, 1]``.

    Translation and rotation act separately: ``T_hat Exp(xi) = (R_hat R(w), t_hat + R_hat v)``.

    Parameters
    ----------
    xi : (6,) float64
        Translation in metres, then rotation vector in radians.

    Returns
    -------
    (4, 4) float64

    Raises
    ------
    InputError
        For a wrong shape, or a number that is not finite.
    """

def se3_log(t: ArrayLike) -> NDArray[np.float64]:
    """Inverse of :func:`se3_exp`.

    Parameters
    ----------
    t : (4, 4) float64

    Returns
    -------
    (6,) float64
        Translation in metres, then rotation vector in radians.

    Raises
    ------
    InputError
        For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
    """

def adjoint(t_ab: ArrayLike) -> NDArray[np.float64]:
    """Matrix that carries a small tangent vector through a pose, in (translation, rotation) order.

    To first order ``T Exp(xi) T^-1 = Exp(adjoint(T) xi)``; it makes a left perturbation of a right one.

    Parameters
    ----------
    t_ab : (4, 4) float64

    Returns
    -------
    (6, 6) float64

    Raises
    ------
    InputError
        For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
    """

def ray_angles(rays: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Azimuth and elevation of rays (METHOD 2), with their derivatives.

    Parameters
    ----------
    rays : (N, 3) float64
        Of any length but zero, along the axes in which the angles are.

    Returns
    -------
    angles : (N, 2) float64
        Radians.
    derivatives : (N, 2, 3) float64
        Of the angles by the ray.

    Raises
    ------
    InputError
        For a wrong shape, or a number that is not finite.
    """

def tangent_to_fixed(t_ab: ArrayLike, covariance: ArrayLike) -> NDArray[np.float64]:
    """A pose's covariance along the fixed axes of A: diag(R, R) P diag(R, R)^T.

    Parameters
    ----------
    t_ab : (4, 4) float64
    covariance : (6, 6) float64
        Over (translation m, rotation rad), tangent on the right.

    Returns
    -------
    (6, 6) float64
        Over (x, y, z, rotation about X, Y, Z) of A, as in ROS's PoseWithCovariance.

    Raises
    ------
    InputError
        For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
    """

def fixed_to_tangent(t_ab: ArrayLike, covariance: ArrayLike) -> NDArray[np.float64]:
    """The inverse of :func:`tangent_to_fixed`.

    Parameters
    ----------
    t_ab : (4, 4) float64
    covariance : (6, 6) float64
        Over (x, y, z, rotation about X, Y, Z) of A, m^2 and rad^2.

    Returns
    -------
    (6, 6) float64
        Over (translation m, rotation rad), tangent on the right.

    Raises
    ------
    InputError
        For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
    """

def interpolate_pose(t0: ArrayLike, t1: ArrayLike, share: float) -> NDArray[np.float64]:
    """Pose between two poses: straight in translation, constant rate in rotation.

    Parameters
    ----------
    t0, t1 : (4, 4) float64
    share : float
        0 gives ``t0``, 1 gives ``t1``.

    Returns
    -------
    (4, 4) float64

    Raises
    ------
    InputError
        For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
    """

def chi2_quantile(probability: float, dof: float) -> float:
    """Chi-square quantile: the x with P(X <= x) = probability.

    Parameters
    ----------
    probability : float
        Between 0 and 1, exclusively.
    dof : float
        Degrees of freedom, above zero.

    Returns
    -------
    float

    Raises
    ------
    InputError
        For a probability or degrees of freedom out of range.
    """

def settings_schema() -> list[
    tuple[str, str, bool | int | float | str, float | None, float | None, str, tuple[str, ...], str, str]
]:
    """What there is to know of every setting of the filter, and of every switch of the lab.

    Returns
    -------
    list of tuple
        The arguments of `collabslam.settings.setting.Setting`, in its order.
    """

def epipolar_residuals(
    rays_s: ArrayLike, rays_f: ArrayLike, t_cf: ArrayLike, focal: tuple[float, float]
) -> EpipolarResiduals:
    """Sampson residual of each pair of rays, and its derivative by an error of the pose.

    Parameters
    ----------
    rays_s, rays_f : (M, 3) float64
        Unit rays in C and F.
    t_cf : (4, 4) float64
        Maps points of F into C, metres.
    focal : (float, float)
        Focal lengths of Cs and Cf, pixels per radian.

    Returns
    -------
    EpipolarResiduals

    Raises
    ------
    InputError
        If an argument has another shape.
    """

def find_consensus(
    rays_s: ArrayLike,
    rays_f: ArrayLike,
    t_cf: ArrayLike,
    covariance: ArrayLike,
    noise: MatchNoise,
    start: Consensus | None = None,
) -> Consensus:
    """Correction of a measured pose that most pairs agree on, under the prior of its covariance.

    Sampled first (three pairs and the prior give a correction, linear in the residuals), then refined
    by Gauss-Newton steps with Tukey weights.

    Parameters
    ----------
    rays_s, rays_f : (M, 3) float64
        Matched unit rays in C and F; fewer than three leave the pose as it is.
    t_cf : (4, 4) float64
        Measured pose: maps points of F into C, metres.
    covariance : (6, 6) float64
        Over (translation m, rotation rad), tangent on the right.
    noise : MatchNoise
    start : Consensus, optional
        An earlier one of nearly the same matches; it takes the place of the sampling.

    Returns
    -------
    Consensus

    Raises
    ------
    InputError
        If an argument has another shape, or the covariance is not positive definite.
    """

def corner_peaks(
    response: NDArray[np.float32], reach: int, border: int, quality: float, least: float
) -> NDArray[np.float64]:
    """Local maxima of a corner response, the strongest first.

    Parameters
    ----------
    response : (H, W) float32
        Not below zero.
    reach : int
        A peak is the largest response within so many pixels (square neighbourhood).
    border : int
        Pixels along the edge without peaks.
    quality, least : float
        Least response as a share of the best, and as a number.

    Returns
    -------
    (M, 2) float64
        Sub-pixel places (u, v), by a parabola through each peak.

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """

def spread_corners(
    peaks: ArrayLike, existing: ArrayLike, count: int, shape: tuple[int, int], cells: int, distance: float
) -> NDArray[np.int64]:
    """At most ``count`` peaks, those first whose part of the image needs them most.

    Parameters
    ----------
    peaks : (M, 2) float64
        Pixels, the most wanted first.
    existing : (N, 2) float64
        Points that there are already; those that are not finite do not count.
    count : int
    shape : (int, int)
        Rows and columns of the image.
    cells : int
        Of the grid, along the image's longer side.
    distance : float
        Least distance between a peak and an existing point, pixels.

    Returns
    -------
    (K,) int64
        Rows of ``peaks``.

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """

def describe_windows(
    image: NDArray[np.uint8], centres: ArrayLike, axes: ArrayLike, step: float
) -> NDArray[np.float32]:
    """SIFT's histogram of gradients over windows warped by affine maps.

    Parameters
    ----------
    image : (H, W) uint8
    centres : (N, 2) float64
        Pixels (u, v).
    axes : (N, 2, 2) float64
        Maps offsets in the described view to pixel offsets in the image.
    step : float
        Distance of the window's 8 x 8 samples in the described view.

    Returns
    -------
    (N, 128) float32
        Square roots of the L1-normalised histogram (RootSIFT): unit vectors.

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """

def match_pairs(
    points: PairPoints,
    rays_f: ArrayLike,
    descriptors_f: NDArray[np.float32],
    t_cf: ArrayLike,
    covariance: ArrayLike,
    options: PairOptions,
) -> PairMatches:
    """Matches points of Cs with points of Cf by their descriptors, among the pairs that the measured pose
    allows.

    Parameters
    ----------
    points : PairPoints
        Of Cs.
    rays_f : (M, 3) float64
        Unit rays of the points of Cf, in F.
    descriptors_f : (M, K) float32
    t_cf : (4, 4) float64
        Measured pose of Cf relative to Cs: maps points of F into C, metres.
    covariance : (6, 6) float64
        Of it, over (translation m, rotation rad), tangent on the right.
    options : PairOptions

    Returns
    -------
    PairMatches

    Raises
    ------
    InputError
        If an argument has another type or shape, or the covariance is not positive definite.
    """

def capture_windows(image: NDArray[np.uint8], uv: ArrayLike, half: int) -> Windows:
    """Cuts windows around points rounded to whole pixels out of an image.

    Parameters
    ----------
    image : (H, W) uint8
        Beyond its edge the edge repeats.
    uv : (N, 2) float64
        Pixels.
    half : int
        Pixels of a window on each side of its middle.

    Returns
    -------
    Windows

    Raises
    ------
    InputError
        If an argument has another type or shape, or a point is not finite.
    """

def sample_templates(
    image: NDArray[np.uint8], centres: ArrayLike, affine: ArrayLike, size: int
) -> SampledTemplates:
    """Templates sampled around points of an image under affine maps.

    Parameters
    ----------
    image : (H, W) uint8
        Beyond its edge the edge repeats.
    centres : (N, 2) float64
        Centre of each template in the image (u, v).
    affine : (N, 2, 2) float64
        Map from image offsets to template offsets.
    size : int
        Side of a template, pixels (odd).

    Returns
    -------
    SampledTemplates

    Raises
    ------
    InputError
        If an argument has another type or shape, or a map has no inverse.
    """

def warp_patches(
    camera: Camera,
    patches: Sequence[Patch],
    t_wc: ArrayLike,
    points: ArrayLike,
    size: int,
    limits: WarpLimits,
) -> WarpedPatches:
    """Templates as patches are expected to look from another pose.

    Parameters
    ----------
    camera : Camera
        The camera that captured the patches and that looks now.
    patches : sequence of N Patch
        See `collabslam.frontend.patch.Patch`.
    t_wc : (4, 4) float64
        Pose of the camera now: maps its points into W, metres.
    points : (N, 3) float64
        Landmarks in W, metres; a row of NaN: only the rotation between the poses counts.
    size : int
        Side of a template, pixels (odd).
    limits : WarpLimits

    Returns
    -------
    WarpedPatches

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """

def search_templates(
    image: NDArray[np.uint8],
    templates: NDArray[np.uint8],
    expected: ExpectedPixels,
    window: SearchWindow,
    peaks: PeakTest,
    *,
    whole: bool = True,
) -> SearchResult:
    """Looks for each template inside the ellipse of its predicted pixel, by zero-normalised
    cross-correlation.

    Parameters
    ----------
    image : (H, W) uint8
    templates : (N, h, h) uint8
        Side h odd.
    expected : ExpectedPixels
        One row for each template.
    window : SearchWindow
    peaks : PeakTest
    whole : bool
        Whether ellipses above ``large_radius`` are searched where no guess lies in them.

    Returns
    -------
    SearchResult

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """

def affine_maps(
    camera_ref: Camera, uv_ref: ArrayLike, camera_now: Camera, t_now_ref: ArrayLike, inverse_range: ArrayLike
) -> AffineMaps:
    """Predicted pixel of patches in another view, and the affine map of pixel offsets into it.

    Parameters
    ----------
    camera_ref, camera_now : Camera
    uv_ref : (N, 2) float64
        Points in the reference image.
    t_now_ref : (N, 4, 4) float64
        Each maps points of its reference camera into the camera now, metres.
    inverse_range : (N,) float64
        Inverse distance of each landmark from its reference camera, 1/m; NaN or 0: infinitely far.

    Returns
    -------
    AffineMaps

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """

def affine_at(
    camera_ref: Camera,
    uv_ref: ArrayLike,
    camera_now: Camera,
    t_now_ref: ArrayLike,
    inverse_range: ArrayLike,
    limits: WarpLimits,
) -> NDArray[np.float64]:
    """Affine maps of pixel offsets from one camera's image into another's, at given depths.

    Parameters
    ----------
    camera_ref, camera_now : Camera
    uv_ref : (N, 2) float64
        Points in the reference image.
    t_now_ref : (4, 4) float64
        Maps points of the reference camera into the camera now, metres.
    inverse_range : (N,) float64
        Inverse distance of each point from its reference camera, 1/m; NaN or 0: infinitely far.
    limits : WarpLimits

    Returns
    -------
    (N, 2, 2) float64
        ``offset_now = affine @ offset_ref``; where that is not allowed at the depth, the map of the
        rotation alone; where this is not either, the identity.

    Raises
    ------
    InputError
        If an argument has another type or shape.
    """
