"""Calls of the public Python API that no program should make; each is refused, or does what it says."""

from __future__ import annotations

import copy
import pickle
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from collabslam import BusyError, Camera, InputError, Slam
from collabslam.types import Array, Frame, Image
from collabslam_lab.reliability.attacks.attack import HELD, READ_OR_REFUSED, REFUSED, Attack, AttackOutcome


@dataclass(frozen=True)
class Moment:
    """An engine in the middle of a walk, and the frame that comes next."""

    slam: Slam
    frame: Frame

    @property
    def t_cf(self) -> Array:
        """The measured pose of Cf in that frame."""
        return self.frame.views[0].t_cf if self.frame.views else np.eye(4)

    def step(self, t: Any = None, image: Any = None, **worn: Any) -> None:
        """The next step, something about it replaced."""
        views = tuple(replace(view, **worn) for view in self.frame.views)
        self.slam.step(self.frame.t if t is None else t, self.frame.image if image is None else image, views)

    def step_after(self, *depths: Any) -> None:
        """The next step, with depths."""
        self.slam.add_depth(*depths)
        self.step()


def _turned(t_cf: Array, by: float) -> Array:
    wrong: Array = t_cf.copy()
    wrong[:3, :3] *= by
    return wrong


def _lying(image: Image) -> Image:
    """An image whose shape is not the one that it says."""

    def said(self: object) -> tuple[int, int]:
        return 10**6, 10**6

    return image.view(type("Lying", (np.ndarray,), {"shape": property(said)}))


def _interrupted(moment: Moment) -> None:
    """Ctrl-C in the middle of a step, as late as its own clock says."""
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, 0.008)
    try:
        moment.step()
    except KeyboardInterrupt as error:
        raise InputError("interrupted") from error
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _two_threads(moment: Moment) -> None:
    said: list[BaseException] = []

    def work() -> None:
        try:
            for _ in range(20):
                moment.slam.step(moment.frame.t + 0.1 * len(said), moment.frame.image)
        except BusyError as error:
            said.append(error)
        except InputError:
            return

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


Do = Callable[[Moment], object]
CAMERA = Camera("pinhole", 96, 64, (80.0, 80.0, 47.5, 31.5))

CALLS: tuple[tuple[str, str, Do, tuple[AttackOutcome, ...]], ...] = (
    ("colour", "an image of three colours", lambda m: m.step(image=np.dstack([m.frame.image] * 3)), REFUSED),
    ("column", "an image H x W x 1", lambda m: m.step(image=m.frame.image[..., None]), REFUSED),
    ("deep", "an image of uint16", lambda m: m.step(image=m.frame.image.astype(np.uint16) << 8), REFUSED),
    ("float", "an image from 0 to 1", lambda m: m.step(image=m.frame.image / 255.0), REFUSED),
    ("bool", "an image of truth values", lambda m: m.step(image=m.frame.image > 99), REFUSED),
    ("objects", "an image of Python objects", lambda m: m.step(image=m.frame.image.astype(object)), REFUSED),
    ("list", "an image that is a list", lambda m: m.step(image=m.frame.image.tolist()), READ_OR_REFUSED),
    ("text", "an image that is a name", lambda m: m.step(image="0.png"), REFUSED),
    ("none", "no image", lambda m: m.slam.step(m.frame.t, None), REFUSED),  # type: ignore[arg-type]
    ("empty", "an image without pixels", lambda m: m.step(image=np.zeros((0, 0), np.uint8)), REFUSED),
    ("half", "an image of half the size", lambda m: m.step(image=m.frame.image[::2, ::2]), REFUSED),
    ("turned", "an image on its side", lambda m: m.step(image=m.frame.image.T), REFUSED),
    ("lying", "an image that lies about its shape", lambda m: m.step(image=_lying(m.frame.image)),
     READ_OR_REFUSED),
    ("masked", "a masked image", lambda m: m.step(image=np.ma.masked_greater(m.frame.image, 99)),
     READ_OR_REFUSED),
    ("fortran", "an image by column", lambda m: m.step(image=np.asfortranarray(m.frame.image)), HELD),
    ("strided", "every second pixel of a larger array",
     lambda m: m.step(image=np.repeat(m.frame.image, 2, axis=1)[:, ::2]), HELD),
    ("frozen", "a read-only image", lambda m: m.step(image=np.frombuffer(
        m.frame.image.tobytes(), np.uint8).reshape(m.frame.image.shape)), HELD),
    ("nan-time", "a stamp that is not a number", lambda m: m.step(t=float("nan")), REFUSED),
    ("endless-time", "an infinite stamp", lambda m: m.step(t=float("inf")), REFUSED),
    ("past", "a stamp before the last", lambda m: m.step(t=m.frame.t - 5.0), REFUSED),
    ("same", "the last stamp again", lambda m: m.step(t=m.slam.filter.time), REFUSED),
    ("nanoseconds", "a stamp in nanoseconds", lambda m: m.step(t=1.7e18), REFUSED),
    ("word-time", "a stamp that is a word", lambda m: m.step(t="now"), REFUSED),
    ("scaled", "a T_CF that is not a rotation", lambda m: m.step(t_cf=_turned(m.t_cf, 2.0)), REFUSED),
    ("mirrored", "a T_CF that mirrors", lambda m: m.step(t_cf=_turned(m.t_cf, -1.0)), REFUSED),
    ("nowhere", "a T_CF that is not a number", lambda m: m.step(t_cf=np.full((4, 4), np.nan)), REFUSED),
    ("far", "a T_CF of 1e300 m", lambda m: m.step(t_cf=m.t_cf + 1e300), REFUSED),
    ("small", "a T_CF of 3 x 3", lambda m: m.step(t_cf=np.eye(3)), REFUSED),
    ("singular", "a covariance without full rank",
     lambda m: m.step(covariance=np.diag([1e-4, 0, 0, 0, 0, 0])), REFUSED),
    ("negative", "a negative covariance", lambda m: m.step(covariance=-np.eye(6)), REFUSED),
    ("crooked", "a covariance that is not symmetric",
     lambda m: m.step(covariance=np.triu(np.ones((6, 6)))), REFUSED),
    ("bias", "a bias larger than the covariance", lambda m: m.step(bias=np.eye(6)), REFUSED),
    ("no-depths", "no depths at all", lambda m: m.step_after(np.zeros((0, 2)), [], []), HELD),
    ("depth-nan", "a depth that is not a number",
     lambda m: m.slam.add_depth([[50.0, 50.0]], float("nan"), 0.1), REFUSED),
    ("depth-behind", "a negative depth", lambda m: m.slam.add_depth([[50.0, 50.0]], -3.0, 0.1), REFUSED),
    ("depth-exact", "a depth that is exact", lambda m: m.slam.add_depth([[50.0, 50.0]], 3.0, 0.0), REFUSED),
    ("depth-sharp", "a depth known to 1 nm",
     lambda m: m.step_after([[50.0, 50.0]], 3.0, 1e-9), READ_OR_REFUSED),
    ("depth-outside", "a depth outside the image",
     lambda m: m.step_after([[-1e6, 1e6]], 3.0, 0.1), READ_OR_REFUSED),
    ("interrupted", "Ctrl-C in the middle of a step", _interrupted, REFUSED),
    ("threads", "four threads at once", _two_threads, READ_OR_REFUSED),
    ("pickled", "an engine pickled", lambda m: pickle.dumps(m.slam), REFUSED),
    ("copied", "an engine copied", lambda m: copy.copy(m.slam), REFUSED),
    ("copied-deep", "an engine copied with all in it", lambda m: copy.deepcopy(m.slam), REFUSED),
    ("mode", "an engine of a mode that there is not", lambda m: Slam(CAMERA, mode="best"), REFUSED),
    ("no-camera", "an engine without a camera", lambda m: Slam(None), REFUSED),  # type: ignore[arg-type]
    ("camera", "a camera of no size", lambda m: Camera("pinhole", 0, 0, (1.0, 1.0, 0.0, 0.0)), REFUSED),
    ("camera-nan", "a camera without a focal length",
     lambda m: Camera("pinhole", 9, 9, (float("nan"), 1.0, 0.0, 0.0)), REFUSED),
    ("load", "an engine loaded from a device", lambda m: Slam.load("/dev/zero"), REFUSED),
)  # fmt: skip

ATTACKS = tuple(
    Attack("call", name, what, lambda scene, name=name: scene.child("call", name), good)  # type: ignore[misc]
    for name, what, _, good in CALLS
)
