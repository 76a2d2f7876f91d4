"""What the engine is made of: each part, and what it is given."""

from __future__ import annotations

from collections.abc import Mapping

from collabslam._core import Camera, Filter
from collabslam.errors import InputError
from collabslam.frontend.mask import StaticMask
from collabslam.settings.table import Settings
from collabslam.slam.consistency_monitor import ConsistencyMonitor
from collabslam.slam.gyro_monitor import GyroMonitor
from collabslam.slam.inertial_samples import InertialSamples
from collabslam.slam.level_estimator import LevelEstimator
from collabslam.slam.map.management import MapManager, scarce_below
from collabslam.slam.map.size import MapSize
from collabslam.slam.recovery.known_submaps import KnownSubmaps
from collabslam.slam.recovery.recovery import Recovery
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.recovery.restart import Restart
from collabslam.slam.search import FrameSearch
from collabslam.slam.starts import start_of
from collabslam.slam.status import StatusMonitor
from collabslam.slam.submaps.submaps import Submaps
from collabslam.slam.targets.in_map import PrintedTargets
from collabslam.slam.tracking.blank_image import BlankImageDetector
from collabslam.slam.tracking.depth_input import DepthInput
from collabslam.slam.tracking.fixed_content import FixedContent
from collabslam.slam.tracking.tracks import Tracks
from collabslam.slam.usual_speed import UsualSpeed
from collabslam.slam.verdict import Verdict
from collabslam.slam.worn.late_views import LateViews
from collabslam.slam.worn.matcher import WornMatcher
from collabslam.slam.worn.rates import WornRates
from collabslam.slam.worn.seen_through import SeenThrough
from collabslam.slam.worn.view_planning import ViewPlanner
from collabslam.slam.worn.wearers import Wearers
from collabslam.types import Masks, Target, person_name


class Parts:
    """The filter and the parts around it, made from the settings.

    What a frame leaves behind is in the filter and in those of them that are a `PersistentState`, and
    nowhere else.

    Parameters
    ----------
    core : Filter
        New or restored.
    camera : Camera
        Cs.
    worn_cameras : mapping
        Each Cf by its name.
    settings : Settings
    start : str
        One of `modes.SLAM_STARTS`.
    metric : bool
        Whether lengths are metres.
    target : Target, optional
        To start from.
    masks : Masks
        Each of its camera's size.

    Raises
    ------
    InputError
        If a worn camera's name is none.
    """

    def __init__(
        self,
        core: Filter,
        camera: Camera,
        worn_cameras: Mapping[str, Camera],
        settings: Settings,
        start: str,
        *,
        metric: bool,
        target: Target | None = None,
        masks: Masks = Masks(),  # noqa: B008 (it is frozen)
    ) -> None:
        for name in worn_cameras:
            if name != "":
                person_name(name, InputError)
        self.filter, self.camera, self.worn_cameras, self.settings = core, camera, worn_cameras, settings
        self.masks = masks
        self.mask = None if masks.robot is None else StaticMask(masks.robot).hides
        options = self.options = settings.frontend
        self.monitor = StatusMonitor(settings.filter.lost, lost=start == "map")
        self.printed = PrintedTargets(core, camera)
        self.start = start_of(
            start,
            metric=metric,
            core=core,
            camera=camera,
            printed=self.printed,
            target=target,
            mode=settings.filter.estimator.mode,
            options=options,
        )
        self.blank = BlankImageDetector(options.blank_image)
        self.tracks = Tracks(camera, options, scarce_below(settings))
        self.gyro = GyroMonitor(core, camera, options.flow)
        self.usual_speed = UsualSpeed(core)
        self.forces, self.rates = InertialSamples(), InertialSamples()
        self.level = LevelEstimator(settings.filter.imu, self.forces, self.rates, metric=self.start.metric)
        self.search = FrameSearch(core, self.tracks, self.printed, self.monitor, self.gyro, options.search)
        self.fixed = FixedContent(camera)
        self.depth = DepthInput()
        self.wearers = Wearers(core, camera, worn_cameras, options.worn)
        self.worn = WornMatcher(core, camera, worn_cameras, settings, masks, self.wearers)
        self.worn_rates = WornRates(core, settings)
        self.late = LateViews(core, camera, self.worn, self.tracks, settings, self.wearers, self.mask)
        self.seen_through = SeenThrough(core, camera, self.tracks, self.worn, self.wearers, settings)
        self.view_planner = ViewPlanner(core, self.monitor, options.worn.min_matches)
        self.map = MapManager(core, settings, self.printed, self.start, self.usual_speed)
        self.size = MapSize(core, self.usual_speed, settings.filter.worn.bias_time)
        self.submaps = Submaps(core, camera, settings.filter.pixel.sigma_cs, options, self.mask)
        self.relocaliser = Relocaliser(core, camera, self.tracks, options)
        self.known = KnownSubmaps(camera, self.relocaliser, self.submaps, options)
        restart = Restart(
            core,
            printed=self.printed,
            relocaliser=self.relocaliser,
            worn=self.worn,
            map_manager=self.map,
            monitor=self.monitor,
            size=self.size,
            metric=self.start.metric,
        )
        self.recovery = Recovery(
            core,
            camera,
            printed=self.printed,
            relocaliser=self.relocaliser,
            known=self.known,
            restart=restart,
            size=self.size,
        )
        self.consistency_monitor = ConsistencyMonitor(settings.filter, self.size, self.gyro)
        self.verdict = Verdict(
            core,
            monitor=self.monitor,
            consistency_monitor=self.consistency_monitor,
            relocaliser=self.relocaliser,
            submaps=self.submaps,
            gyro=self.gyro,
        )
