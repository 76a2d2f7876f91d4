"""A run as a Rerun recording: pictures with features, both cameras, the map, the path, and curves over time.

Needs the extra ``viz``.  A ``.rrd`` file is for looking at with the same version of Rerun, not for keeping:
the result folder is the archive.
"""

from __future__ import annotations

import os
import sys
from colorsys import hsv_to_rgb
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np

from collabslam._core import Camera
from collabslam.errors import DataError
from collabslam.extras import needs
from collabslam.formats.files import try_place
from collabslam.results import CELL, FrameFeatures
from collabslam.types import Array, Frame, Recording, WornView, worn_cameras
from collabslam.viz.rerun_layout import LOGGED, blueprint, curve, picture_of

SIGMAS = 3.0
COLOURS = {
    "accepted": (60, 200, 90),
    "rejected": (230, 60, 60),
    "unlike": (240, 150, 40),
    "ambiguous": (200, 90, 220),
    "outside": (130, 130, 130),
    "not searched": (130, 130, 130),
}
CS, CF, TRUTH = (29, 111, 165), (242, 177, 50), (200, 200, 200)
NEXT_VIEW, LOOP = (60, 200, 90), (42, 157, 111)
STATUS = {"OK": 3.0, "DEGRADED": 2.0, "COASTING": 1.0, "LOST": 0.0, "NOT_STARTED": -1.0}
UNIX_STAMPS = 1e8
PLANE = 0.4
JPEG_QUALITY = 80
FLUSH_SECONDS = 10.0
SURE, UNSURE = 0.02, 0.5
"""Metres of a landmark's standard deviation at which its colour is green, and red."""
_EVERY = 5
_CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 25)), np.sin(np.linspace(0, 2 * np.pi, 25))])


def viewer() -> str:
    """The viewer that was installed with the rerun-sdk that is imported, whatever the search path finds.

    Raises
    ------
    DataError
        If it is not there.
    """
    package = find_spec("rerun_cli")
    for folder in () if package is None else package.submodule_search_locations or ():
        for name in ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun"):
            if (path := Path(folder) / name).is_file():
                return str(path)
    raise DataError("rerun-sdk is here without its viewer; write a file with --save FILE.rrd instead.")


class Viewed(Protocol):
    """What is looked at besides the steps: the engine's filter and its map."""

    filter: Any

    def landmarks(self) -> Any: ...
    def next_best_view(self) -> Any: ...
    def submaps(self) -> Any: ...


class RerunLog:
    """Logs frames to a viewer, a file, or both; use it as a context manager.

    Parameters
    ----------
    recording : Recording
    view : bool
        Open the viewer.
    save : Path, optional
        Write an ``.rrd`` file.

    Raises
    ------
    DataError
        If the extra ``viz`` is not installed, or there is no display for the viewer.
    """

    def __init__(self, recording: Recording, *, view: bool = False, save: Path | None = None) -> None:
        with needs("viz"):
            import rerun as rr
        if view and sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
            raise DataError("There is no display for the viewer; write a file with --save FILE.rrd instead.")
        self._rr: Any = rr
        self._camera, self._worn_cameras = recording.camera, worn_cameras(recording)
        self._truth = recording.truth
        self._track: list[Array] = []
        self._true: list[Array] = []
        self._start: Array | None = None
        self._log: Any = rr.RecordingStream("collabslam", recording_id=recording.name)
        self._lost = "The Rerun viewer was not reached ({}); --save writes a file instead."
        if save is not None:
            try_place(save)
            self._lost = (
                "The file of --save is not whole ({}); free disk space, and take it as far as it goes."
            )
        sinks: list[Any] = [rr.FileSink(str(save))] if save is not None else []
        if view:
            rr.spawn(connect=False, recording=self._log, executable_path=viewer())
            sinks.append(rr.GrpcSink())
        self._log.set_sinks(*sinks)
        self._log.send_blueprint(blueprint(self._worn_cameras))
        self._put("world", rr.ViewCoordinates.RIGHT_HAND_Y_DOWN, static=True)

    def __enter__(self) -> RerunLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._log.flush(timeout_sec=FLUSH_SECONDS)
        except RuntimeError as unreached:
            print(self._lost.format(unreached), file=sys.stderr)
        self._log.disconnect()

    def frame(self, frame: Frame, step: Any, engine: Viewed) -> None:
        """Log one frame and the engine's answer to it."""
        rr = self._rr
        self._log.set_time("frame", sequence=frame.index)
        kind = "timestamp" if frame.t > UNIX_STAMPS else "duration"
        self._log.set_time("time", **{kind: frame.t})
        self._curves(step)
        self._picture(frame.image)
        features: FrameFeatures = step.features
        self._features(features)
        self._left_out(features, frame.image.shape)
        if not step.started:
            return
        pose = step.pose
        self._put("world/cs", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
        self._path(frame.index, step)
        views = {view.who: view for view in frame.views}
        for number, name in enumerate(self._worn_cameras):
            self._worn(number, name, views.get(name), step, engine)
        if "next_view_gain" in step.diagnostics:
            self._next_view(step.pose, engine.next_best_view())
        if frame.index % _EVERY == 0:
            self._map(engine.landmarks())
        if step.diagnostics.get("loops"):
            self._submap_poses(engine.submaps())

    def _put(self, path: str, *what: Any, static: bool = False) -> None:
        self._log.log(path, *what, static=static)

    def _clear(self, *paths: str) -> None:
        for path in paths:
            self._put(path, self._rr.Clear(recursive=False))

    def _curves(self, step: Any) -> None:
        rr = self._rr
        self._put(curve("status"), rr.Scalars(STATUS[str(getattr(step.status, "value", step.status))]))
        for key in LOGGED:
            value = step.diagnostics.get(key)
            if value is not None and np.isfinite(value):
                self._put(curve(key), rr.Scalars(float(value)))
        sigma = np.sqrt(np.maximum(step.covariance[:3, :3].trace(), 0.0))
        self._put(curve("position_sigma_m"), rr.Scalars(float(sigma)))

    def _picture(self, image: Any) -> None:
        rr, camera = self._rr, self._camera
        fx, fy, cx, cy = camera.intrinsics
        lens = rr.Pinhole(
            image_from_camera=[[fx, 0, cx], [0, fy, cy], [0, 0, 1]],
            resolution=[camera.width, camera.height],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=PLANE,
        )
        self._put("world/cs/image", lens, rr.Image(image).compress(jpeg_quality=JPEG_QUALITY))

    def _features(self, features: FrameFeatures) -> None:
        rr = self._rr
        colours = [COLOURS[state] for state in features.states]
        rings = [
            (uv[:, None] + SIGMAS * _root(s) @ _CIRCLE).T
            for uv, s in zip(features.predicted, features.s, strict=True)
        ]
        self._put("world/cs/image/ellipses", rr.LineStrips2D(rings, colors=colours))
        seen = np.asarray(np.isfinite(features.found).all(axis=1))
        points = rr.Points2D(
            features.found[seen],
            colors=[c for c, ok in zip(colours, seen, strict=True) if ok],
            radii=3.0,
            labels=[s for s, ok in zip(features.states, seen, strict=True) if ok],
            show_labels=False,
        )
        self._put("world/cs/image/features", points)

    def _left_out(self, features: FrameFeatures, shape: tuple[int, ...]) -> None:
        where = "world/cs/image/left_out"
        if features.left_out is None:
            self._clear(where)
            return
        squares = np.kron(features.left_out, np.ones((CELL, CELL), np.uint8))[: shape[0], : shape[1]]
        self._put(where, self._rr.SegmentationImage(squares, opacity=0.4))

    def _path(self, index: int, step: Any) -> None:
        rr = self._rr
        if step.valid:
            self._track.append(step.pose[:3, 3])
            turned = step.pose[:3, :3] @ step.covariance[:3, :3] @ step.pose[:3, :3].T
            self._put("world/path", rr.LineStrips3D([np.array(self._track)], colors=[CS]))
            self._ellipsoids("world/path_covariance", step.pose[None, :3, 3], turned[None], [CS])
        if self._truth is None or not np.isfinite(self._truth[index]).all():
            return
        if self._start is None:  # the truth's world becomes W where the estimate starts
            self._start = step.pose @ np.linalg.inv(self._truth[index])
        self._true.append((self._start @ self._truth[index])[:3, 3])
        self._put("world/truth", rr.LineStrips3D([np.array(self._true)], colors=[TRUTH]))

    def _worn(self, number: int, name: str, view: WornView | None, step: Any, engine: Viewed) -> None:
        """A worn camera: its picture, where it is, and what it should share with Cs."""
        rr, lens, below = self._rr, self._worn_cameras[name], f"/{name}" if name else ""
        image = picture_of(name)
        overlaps = f"world/overlap/cs{below}", f"world/overlap/cf{below}"
        boxes = f"world/cs/image/overlap{below}", f"{image}/overlap"
        self._matches(step.features.pairs_of(name), f"world/cs/image/matches{below}", f"{image}/matches")
        if view is None:
            # A compressed image can't be cleared, so black stands for none.
            self._put(image, rr.Image(np.zeros((lens.height, lens.width), np.uint8)).compress())
            self._clear(f"world/cf{below}", *overlaps, *boxes)
            return
        pose = step.pose @ view.t_cf
        self._put(image, rr.Image(view.image).compress(jpeg_quality=JPEG_QUALITY))
        self._put(f"world/cf{below}", rr.LineStrips3D(_pyramid(lens, pose, PLANE), colors=[CF]))
        overlap = engine.filter.predict_overlap(view.t_cf, view.covariance, who=number)
        if overlap is None:
            self._clear(*overlaps, *boxes)
            return
        sides = (self._camera, step.pose, CS, overlap.roi_s), (lens, pose, CF, overlap.roi_f)
        for entity, box, (camera, t, colour, roi) in zip(overlaps, boxes, sides, strict=True):
            edges = _pyramid(camera, t, overlap.d_max)
            self._put(entity, rr.LineStrips3D(edges, colors=[colour]))
            u0, v0, u1, v1 = roi
            self._put(box, rr.Boxes2D(mins=[[u0, v0]], sizes=[[u1 - u0, v1 - v0]], colors=[colour]))

    def _matches(self, pairs: Array, in_cs: str, in_cf: str) -> None:
        """What both cameras see: a match has one colour and one number in both pictures."""
        hues = np.linspace(0.0, 1.0, len(pairs), endpoint=False)
        colours = [tuple(round(255 * v) for v in hsv_to_rgb(hue, 0.8, 1.0)) for hue in hues.tolist()]
        labels = [str(k) for k in range(len(pairs))]
        for entity, uv in ((in_cs, pairs[:, :2]), (in_cf, pairs[:, 2:])):
            shown = self._rr.Points2D(uv, colors=colours, radii=5.0, labels=labels, show_labels=False)
            self._put(entity, shown)

    def _next_view(self, pose: Array, plan: Any) -> None:
        """An arrow of a metre from Cf to where it should look, and the place where more would be gained."""
        rr = self._rr
        if plan is None:
            self._clear("world/next_view", "world/stand")
            return
        view, place = pose @ plan.t_cf, pose[:3, :3] @ plan.stand_at + pose[:3, 3]
        label = f"look here: {plan.gain:.2f} nats"
        arrow = rr.Arrows3D(origins=[view[:3, 3]], vectors=[view[:3, 2]], colors=[NEXT_VIEW], labels=[label])
        self._put("world/next_view", arrow)
        label = f"stand here: {plan.stand_gain:.2f} nats"
        self._put("world/stand", rr.Points3D([place], radii=0.05, colors=[NEXT_VIEW], labels=[label]))

    def _map(self, landmarks: Any) -> None:
        self._ellipsoids("world/map", landmarks.points, landmarks.covariance, by_sd(landmarks.covariance))

    def _submap_poses(self, poses: Any) -> None:
        """The submaps as loops correct them, a line for each loop, and the map of the whole way."""
        rr, at = self._rr, poses.poses[:, :3, 3]
        self._put("world/submaps", rr.LineStrips3D([at], colors=[LOOP]))
        ends = [at[[loop.first, loop.second]] for loop in poses.loops]
        self._put("world/loops", rr.LineStrips3D(ends, colors=[LOOP]))
        self._ellipsoids("world/whole_map", poses.landmarks.points, poses.landmarks.covariance, [LOOP])

    def _ellipsoids(self, path: str, centres: Array, covariances: Array, colours: Any) -> None:
        rr = self._rr
        if not len(centres):
            return
        variances, directions = np.linalg.eigh(covariances)
        directions[np.linalg.det(directions) < 0.0, :, 0] *= -1.0
        from collabslam.geometry import quaternion_wxyz

        turns = [np.roll(quaternion_wxyz(d), -1) for d in directions]  # x y z w
        sizes = np.clip(SIGMAS * np.sqrt(np.maximum(variances, 0.0)), 0.005, 2.0)
        shapes = rr.Ellipsoids3D(
            centers=centres, half_sizes=sizes, quaternions=turns, colors=colours, fill_mode="densewireframe"
        )
        self._put(path, shapes)


def by_sd(covariances: Array) -> list[tuple[int, int, int]]:
    """Colours of landmarks by the logarithm of their largest sd: green up to `SURE`, red from `UNSURE`."""
    sd = np.sqrt(np.maximum(np.linalg.eigvalsh(covariances)[:, -1], SURE**2)) if len(covariances) else []
    share = np.clip(np.log(np.asarray(sd) / SURE) / np.log(UNSURE / SURE), 0.0, 1.0)
    return [tuple(round(255 * v) for v in hsv_to_rgb((1.0 - x) / 3.0, 0.75, 0.9)) for x in share.tolist()]  # type: ignore[misc]


def _root(s: Array) -> Array:
    """Matrix whose columns are the half axes of a 2x2 covariance's ellipse."""
    variances, directions = np.linalg.eigh(s)
    return np.asarray(directions * np.sqrt(np.maximum(variances, 0.0)))


def _pyramid(camera: Camera, pose: Array, depth: float) -> list[Array]:
    """Edges of a camera's field of view up to a depth, in W."""
    w, h = camera.width - 1.0, camera.height - 1.0
    rays = camera.unproject(np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]))
    corners = rays / rays[:, 2:] * depth @ pose[:3, :3].T + pose[:3, 3]
    return [np.array([*corners, corners[0]]), *(np.array([pose[:3, 3], c]) for c in corners)]
