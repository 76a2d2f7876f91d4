"""What the robot publishes: pose with covariance in every frame; status, map and picture now and then."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import cv2
import numpy as np

from collabslam._core import Camera
from collabslam.live import link, messages, names
from collabslam.live.core import MONO, LivePose
from collabslam.slam.engine import Slam
from collabslam.slam.worn import view_planning
from collabslam.types import Status

STATUS_EVERY, MAP_EVERY, VIEW_EVERY = 0.5, 2.0, 0.3
"""Seconds between two messages of a kind."""
SILENT = 2.0
"""Seconds without an image of a device after which its status is stale."""
VIEW_WIDTH, WIDEST = 480, 4 * 480
"""Pixels across of Cs in the picture for whoever watches, and of a Cf beside it at most."""
_USED, _UNUSED, _BOTH = (80, 200, 80), (60, 60, 220), (40, 170, 255)


class Downlink:
    """Publishes a robot's poses; only `frame` may use the engine.

    Parameters
    ----------
    session
        An open Zenoh session.
    """

    def __init__(self, session: Any) -> None:
        self._out = {
            key: link.publisher(session, key, urgent=key in (names.POSE, names.STATUS))
            for key in (names.POSE, names.POSE_MAP, names.ODOMETRY, names.STATUS, names.MAP, names.VIEW)
        }
        self._session = session
        self._worn: dict[str, Any] = {}
        self._due = {key: -float("inf") for key in self._out}

    def frame(self, pose: LivePose, slam: Slam, facts: Mapping[str, Any], devices: Mapping[str, Any]) -> None:
        """A frame is done.

        Parameters
        ----------
        pose : LivePose
        slam : Slam
        facts : mapping
            Further values for the robot's status.
        devices : mapping
            Values for the status of each device.
        """
        step = pose.step
        if step.valid and np.isfinite(step.covariance).all():
            self._out[names.POSE].put(messages.robot_pose(step.t, step.pose, step.covariance))
            twist = slam.filter.twist, slam.filter.pose_and_twist_covariance[6:, 6:]
            self._out[names.ODOMETRY].put(messages.odometry(step.t, step.pose, step.covariance, twist))
        if step.valid and np.isfinite(step.covariance_map).all():
            in_map = messages.pose_in_map(step.t, step.pose_map, step.covariance_map)
            self._out[names.POSE_MAP].put(in_map)
        self._place(pose)
        if self._is_due(names.STATUS, STATUS_EVERY):
            self._out[names.STATUS].put(status_of(pose, facts, devices, view_plans_of(pose, slam)))
        if self._is_due(names.MAP, MAP_EVERY) and step.started and self._wanted(names.MAP):
            found = slam.landmarks()
            sd = messages.point_sd(found.covariance)
            self._out[names.MAP].put(messages.cloud(step.t, found.points, sd))
        if self._is_due(names.VIEW, VIEW_EVERY) and self._wanted(names.VIEW):
            picture = view_picture(pose, slam.worn_cameras)
            self._out[names.VIEW].put(messages.compressed_image(step.t, "cs_optical", picture))

    def waits(self, now: Callable[[], float], what: str) -> None:
        """Tell who watches that no frame is worked on, as something is waited for."""
        if self._is_due(names.STATUS, STATUS_EVERY):
            state = Status.NOT_STARTED.value
            told = {"waits_for": what, "link": MONO}
            self._out[names.STATUS].put(messages.status(now(), {"robot": (state, state, told)}))

    @contextlib.contextmanager
    def waiting(self, now: Callable[[], float], what: str) -> Iterator[None]:
        """Tells who watches, until the block ends, what is waited for in it; no frame may be worked on."""
        over = threading.Event()

        def tell() -> None:
            while not over.is_set():
                self.waits(now, what)
                over.wait(STATUS_EVERY)

        teller = threading.Thread(target=tell, name="waiting", daemon=True)
        teller.start()
        try:
            yield
        finally:
            over.set()
            teller.join()

    def _place(self, pose: LivePose) -> None:
        """Where the worn cameras were whose views were measured."""
        for name, place in worn_poses(pose).items():
            if name not in self._worn:
                self._worn[name] = link.publisher(self._session, names.of_person(names.WORN_POSE, name))
            self._worn[name].put(place)

    def _wanted(self, key: str) -> bool:
        return bool(self._out[key].matching_status.matching)

    def _is_due(self, key: str, every: float) -> bool:
        now = time.monotonic()
        if now - self._due[key] < every:
            return False
        self._due[key] = now
        return True


def worn_poses(pose: LivePose) -> dict[str, bytes]:
    """Where the worn cameras were whose views were measured, as messages, by the name of each wearer."""
    if not pose.step.valid:
        return {}
    return {
        name: messages.robot_pose(place.t, place.pose, place.covariance)
        for name, place in pose.step.worn.items()
        if place.measured
    }


def status_of(
    pose: LivePose,
    facts: Mapping[str, Any],
    devices: Mapping[str, Any],
    plans: Mapping[str, Mapping[str, Any]] | None = None,
) -> bytes:
    """The robot's status and that of each device as one message.

    Where to look stands with the robot if there is one worn camera, with each person's device otherwise, as
    ``plans`` has it by name.
    """
    step = pose.step
    sd = np.sqrt(np.clip(np.diag(step.covariance), 0.0, None))
    values = {
        "link": pose.link,
        "started": step.started,
        "metric": step.metric,
        "scale_sd": f"{step.scale_sd:.4f}",
        "position_sd_m": f"{np.linalg.norm(sd[:3]):.4f}",
        "attitude_sd_deg": f"{np.degrees(np.linalg.norm(sd[3:])):.4f}",
        "map_size": step.diagnostics.get("map_size", 0),
        "accepted": step.diagnostics.get("accepted", 0),
        "cf_matches": step.diagnostics.get("cf_matches", 0),
        "ms": f"{step.diagnostics.get('ms_total', 0.0):.1f}",
        **({} if any(pose.links) else _view_plan(step.diagnostics)),
        **facts,
    }
    entries = {"robot": (step.status.value, step.status.value, values)}
    for name, report in devices.items():
        rounded = {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in report.items()}
        rounded |= _view_plan((plans or {}).get(name, {}))
        stale = report.get("last_image_s", 0.0) >= SILENT
        entries[name] = ("STALE" if stale else "OK", pose.links.get(name, pose.link), rounded)
    return messages.status(step.t, entries)


def view_plans_of(pose: LivePose, slam: Slam) -> dict[str, dict[str, Any]]:
    """Where each of several persons should look, in a run that says so."""
    if not any(pose.links) or view_planning.DIAGNOSTICS[0] not in pose.step.diagnostics:
        return {}
    return {name: view_planning.counts(slam.next_best_view(name)) for name in pose.links}


def _view_plan(diagnostics: Mapping[str, Any]) -> dict[str, str]:
    """Where the person should look, in a run that says so, as far as it is known now."""
    values = {name: float(diagnostics.get(name, np.nan)) for name in view_planning.DIAGNOSTICS}
    return {name: f"{value:.4g}" for name, value in values.items() if np.isfinite(value)}


def view_picture(pose: LivePose, cameras: Mapping[str, Camera] | None = None) -> bytes:
    """A JPEG: Cs with the frame's features, beside it each Cf that was used, lines between what both see.

    Parameters
    ----------
    pose : LivePose
    cameras : mapping, optional
        Each Cf by name: then one that was not used keeps its place, empty, and the picture its size.
    """
    left = cv2.cvtColor(pose.image, cv2.COLOR_GRAY2BGR)
    features = pose.step.features
    for predicted, found, state in zip(features.predicted, features.found, features.states, strict=True):
        used = state == "accepted"
        u, v = found if used else predicted
        cv2.circle(left, (round(float(u)), round(float(v))), 4, _USED if used else _UNUSED, 2)
    scale = min(1.0, VIEW_WIDTH / left.shape[1])
    picture = cv2.resize(left, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    height = picture.shape[0]
    views = {view.who: view.image for view in pose.views}
    for name in dict.fromkeys((*(cameras or {}), *views)):
        across = picture.shape[1]
        if name not in views and cameras is not None:
            picture = np.concatenate([picture, _empty(name, cameras[name], height)], axis=1)
            continue
        right = cv2.cvtColor(views[name], cv2.COLOR_GRAY2BGR)
        scale_f = height / right.shape[0]
        size = (_across(right.shape[1], right.shape[0], height), height)
        right = cv2.resize(right, size, interpolation=cv2.INTER_AREA)
        if name:
            _write(right, name, _BOTH)
        picture = np.concatenate([picture, right], axis=1)
        ends = features.pairs_of(name) * [scale, scale, scale_f, scale_f] + [0.0, 0.0, across, 0.0]
        for u, v, u_f, v_f in np.rint(ends).astype(int).tolist():
            cv2.line(picture, (u, v), (u_f, v_f), _BOTH, 1, cv2.LINE_AA)
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 60])[1])


def _empty(name: str, camera: Camera, height: int) -> Any:
    """The place of a worn camera whose view was not used in a frame."""
    place = np.full((height, _across(camera.width, camera.height, height), 3), 48, np.uint8)
    _write(place, f"{name}: no view in this frame" if name else "no view in this frame", (200, 200, 200))
    return place


def _across(width: int, height: int, shown: int) -> int:
    """Pixels across of a picture that is shown so high, whatever its shape."""
    return min(max(round(shown / height * width), 1), WIDEST)


def _write(picture: Any, text: str, colour: tuple[int, int, int]) -> None:
    cv2.putText(picture, text, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2, cv2.LINE_AA)
