"""Views of worn cameras as they come over a link, and why some never reach the engine."""

from __future__ import annotations

from dataclasses import dataclass

from collabslam.types import Array, Image

NO_CLOCK = "no clock"  # nothing is known of the sender's clock
OTHER = "other session"  # another worn camera is at work, or its sender has been started anew
NOBODY = "no person"  # of several persons none is called as its sender is
BROKEN = "broken"  # no image, or of another size
REFUSED = "refused"  # T_CF or its covariance is impossible
UNPOSED = "no target"  # it came without T_CF, and both cameras see no printed target
REASONS = (NO_CLOCK, OTHER, NOBODY, BROKEN, REFUSED, UNPOSED)
"""Why a view was dropped before the engine; it has reasons of its own (`collabslam.Slam.worn_dropped`)."""


@dataclass(frozen=True, eq=False)
class OwnPose:
    """Where a camera that tracks itself is in a world of its own, which begins anywhere and drifts.

    Attributes
    ----------
    t_xf : (4, 4) array
        Maps points of the camera into that world; metres.
    covariance : (6, 6) array
        Of what errs in each image anew, over (translation, rotation), tangent on the right; without drift.
    """

    t_xf: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class LiveView:
    """A view of the worn camera as its sender took it.

    Attributes
    ----------
    session : str
        Who sent it; another one each time that the sender starts.  What stands before the last ``/`` is the
        sender's name.
    stamp : float
        Seconds by the sender's clock.
    image : (H, W) uint8, or bytes
        Grey, or a JPEG or PNG of it; an encoded one may be smaller than its calibration.
    t_cf, covariance, bias
        As in `collabslam.WornView`; no ``t_cf`` if printed targets are to tell it.
    own : OwnPose or None
        Of a camera that tracks itself: then the targets need not be in this image.
    pixels : (H, W) uint8, or None
        What is in an encoded image, of its calibration's size, where it is decoded already.
    rate : (3,) array, or None
        As in `collabslam.WornView`.
    """

    session: str
    stamp: float
    image: Image | bytes
    t_cf: Array | None = None
    covariance: Array | None = None
    bias: Array | None = None
    own: OwnPose | None = None
    pixels: Image | None = None
    rate: Array | None = None


def sender_of(session: str) -> str:
    """What the sender of a session is called."""
    return session.rpartition("/")[0] or session
