"""What the engine is made of, and how all of it is written to a file and read back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn, SupportsIndex, TypeVar

from collabslam._core import Camera, Filter
from collabslam.errors import CollabslamError, DataError, InputError
from collabslam.formats.container import read_container, write_container
from collabslam.formats.schema import (
    array,
    covariance,
    data,
    fields,
    flag,
    instance,
    items,
    optional,
    pose,
    table,
    text,
)
from collabslam.frontend.patch import Patch
from collabslam.results import Loop
from collabslam.settings.modes import SLAM_STARTS
from collabslam.settings.table import STATE as SETTINGS_STATE
from collabslam.settings.table import Settings
from collabslam.slam.doubts import Doubts
from collabslam.slam.guard import Guard, alone
from collabslam.slam.map.free_start import FreeStart
from collabslam.slam.map.management import MapManager, scarce_below
from collabslam.slam.map.saved_map import SavedMap
from collabslam.slam.map.size import MapSize
from collabslam.slam.recovery.known_submaps import KnownSubmaps
from collabslam.slam.recovery.map_aside import MapAside
from collabslam.slam.recovery.recovery import Recovery
from collabslam.slam.recovery.relocalise import Relocaliser
from collabslam.slam.state import check_camera, persistent_parts
from collabslam.slam.status import StatusMonitor
from collabslam.slam.submaps.chain import Submap
from collabslam.slam.submaps.loop_search import Wanted
from collabslam.slam.submaps.submaps import Submaps
from collabslam.slam.targets.in_map import PrintedTargets
from collabslam.slam.targets.start import TargetStart
from collabslam.slam.tracking.blank_image import BlankImageDetector
from collabslam.slam.tracking.depth_input import DepthInput
from collabslam.slam.tracking.fixed_content import FixedContent
from collabslam.slam.tracking.tracks import Tracks
from collabslam.slam.worn.late_views import KeptFrame, LateViews
from collabslam.slam.worn.looking import Look, Looking, WornPose
from collabslam.slam.worn.matcher import WornMatcher
from collabslam.types import Target, WornView

KIND, VERSION = "engine state", 14
"""Of the file that `EngineParts.save` writes; the version counts the changes of what is in it."""
CLASSES = (KeptFrame, Loop, MapAside, Patch, Submap, Target, Wanted, WornPose, WornView)
"""Dataclasses that are in it."""

Engine = TypeVar("Engine", bound="EngineParts")


def _check_target(value: Any, where: str) -> None:
    """A `Target` with a patch of each point."""
    instance(Target, points=array("<f8", None, 3), t_tc=pose, covariance=covariance(6))(value, where)
    items(array("|u1", None, None), len(value.points))(value.patches, f"{where}.patches")


STATE = fields(
    camera=check_camera,
    worn_cameras=table(str, check_camera),
    settings=SETTINGS_STATE,
    start=text(SLAM_STARTS),
    metric=flag,
    target=optional(_check_target),
    filter=data,
    parts=table(str, lambda value, where: None),  # each asks by itself
)
"""What `EngineParts.state` may hold."""


class EngineParts:
    """The filter and the parts around it; what a frame leaves behind is in these, and nowhere else.

    Attributes
    ----------
    filter : Filter
    """

    def _assemble(
        self,
        core: Filter,
        camera: Camera,
        worn_cameras: Mapping[str, Camera],
        settings: Settings,
        start: str,
        target: Target | None,
        metric: bool,
    ) -> None:
        """Puts the parts around a filter, new or restored."""
        self.filter = core
        self._camera, self._worn_cameras, self._settings = camera, worn_cameras, settings
        self._start, self._target, self._metric = start, target, metric
        self._options = settings.frontend()
        self._blank = BlankImageDetector(self._options.blank_image)
        self._tracks = Tracks(camera, self._options, scarce_below(settings))
        self._worn = WornMatcher(core, camera, worn_cameras, settings, self._options)
        self._late = LateViews(core, camera, self._worn, self._tracks, settings, self._options)
        self._looking = Looking(core, self._options.worn.min_matches)
        self._fixed = FixedContent(camera)
        self._depth = DepthInput()
        self._relocaliser = Relocaliser(core, camera, self._tracks, self._options)
        self._printed = PrintedTargets(core, camera)
        sigma = float(settings["filter.pixel.sigma_cs"])
        self._submaps = Submaps(core, camera, sigma, self._options)
        self._known = KnownSubmaps(camera, self._relocaliser, self._submaps, self._options)
        self._target_start: TargetStart | None = None
        if start == "target":
            self._target_start = TargetStart(core, camera, target, self._printed, self._options)
        self._free_start = FreeStart(core, camera) if start == "scale-free" else None
        self._map = MapManager(
            core,
            settings,
            self._printed,
            target=self._target_start,
            free=self._free_start,
            wheels=start == "odometry",
            metric=metric,
        )
        self._size = MapSize()
        self._doubts = Doubts(settings.section("filter"), self._size)
        self._monitor = StatusMonitor(settings.section("filter"), lost=start == "map")
        self._recovery = Recovery(
            core,
            camera,
            self._printed,
            (self._relocaliser, self._known),
            self._worn,
            self._map,
            (self._monitor, self._size),
            metric=metric,
        )
        self._guard = Guard(core, list(persistent_parts(self).values()))

    @alone
    def where_to_look(self, who: str | None = None) -> Look | None:
        """Where the person who wears Cf should look next, as far as pose and scale are concerned (METHOD 24).

        Cf is taken to be where its last view was taken from, relative to Cs.  It takes a millisecond or two
        and changes nothing.  With the setting ``frontend.worn.where_to_look`` the diagnostics of each frame
        have it.

        Parameters
        ----------
        who : str, optional
            Whose Cf, by its name; the first one's if left out.

        Returns
        -------
        Look or None
            None before the start, while LOST, before the first view of Cf, and where no view would help.

        Raises
        ------
        InputError
            If there is no such worn camera.
        """
        if who is not None and who not in self._worn_cameras:
            raise InputError(f"There is no worn camera {who!r}; take one of worn_cameras.")
        return self._next_look(0 if who is None else self._worn.number(who))

    def _next_look(self, number: int = 0) -> Look | None:
        return None if self._monitor.lost else self._looking.ask(number)

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise InputError(
            f"A {type(self).__name__} cannot be copied or pickled; write it with save(path) and read it with "
            f"{type(self).__name__}.load(path)."
        )

    def save(self, path: str | Path) -> None:
        """Writes all that the engine knows into one file, for `load`: map, covariance, patches, settings.

        Raises
        ------
        DataError
            If the file cannot be written.
        """
        write_container(Path(path), KIND, VERSION, self.state(), CLASSES)

    @classmethod
    def load(cls: type[Engine], path: str | Path) -> Engine:
        """The engine that `save` wrote, which goes on bit for bit as that one would have.

        Raises
        ------
        DataError
            If the file cannot be read, is cut short, altered, or of another version.
        """
        return cls.from_state(read_container(Path(path), KIND, VERSION, CLASSES))

    @alone
    def state(self) -> dict[str, Any]:
        """What `save` writes, to be written before the next frame."""
        return {
            "camera": self._camera.__getnewargs__(),
            "worn_cameras": {name: worn.__getnewargs__() for name, worn in self._worn_cameras.items()},
            "settings": self._settings.state(),
            "start": self._start,
            "metric": self._metric,
            "target": self._target,
            "filter": self.filter.snapshot(),
            "parts": {name: part.state() for name, part in persistent_parts(self).items()},
        }

    @classmethod
    def from_state(cls: type[Engine], state: Mapping[str, Any]) -> Engine:
        """The engine of a `state`; raises DataError if it is none."""
        try:
            STATE(state, "engine")
            engine = cls.__new__(cls)
            engine._assemble(
                Filter.restore(state["filter"]),
                Camera(*state["camera"]),
                {name: Camera(*worn) for name, worn in state["worn_cameras"].items()},
                Settings.from_state(state["settings"]),
                state["start"],
                state["target"],
                bool(state["metric"]),
            )
            parts = persistent_parts(engine)
            if set(state["parts"]) != set(parts):
                raise DataError("The file holds other parts of an engine; take an earlier one.")
            for name, part in parts.items():
                part.restore(state["parts"][name])
            if not engine._tracks.knows(engine.filter.features, engine.filter.candidates):
                raise DataError("The file lacks a feature's patch; take an earlier one.")
        except CollabslamError as error:
            raise DataError(f"The state cannot be used. {error}") from error
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError("The file holds no state of an engine; take an earlier one.") from error
        return engine

    @alone
    def saved_map(self) -> SavedMap:
        """The map with all its uncertainty, to be kept in a file and started in later.

        Raises
        ------
        InputError
            If there is no map yet.
        """
        known = self.filter.known_map()
        if not len(known.ids):
            raise InputError("There is no map to save yet; run on until the filter has started.")
        return SavedMap(
            self._camera,
            self._metric,
            known.landmarks,
            known.covariance,
            known.place,
            self._relocaliser.views(known.ids),
            self._submaps.chain().handed_over(known.ids),
            self._printed.in_list(known.ids),
        )
