"""From the legs' centre to the worn camera, with everything that is uncertain on the way.

In N (z up), with the legs' centre p (horizontal, from Cs) and s_z the height of the scanner's plane over Cs:
F = [p + d + l, h] with the neck upright over the legs but for the lean d and the steps, n = R_NF n_F from the
neck to the camera, l its horizontal part, and h the height of F over Cs. Both attitudes err, R_NC = Exp(e)
R_NC_hat and R_NF = Exp(f) R_NF_hat. Legs and way were seen from C: a wrong heading of C turns only the head:

    dt_N = [e_y (s_z - h) + e_z l_y, -e_x (s_z - h) - e_z l_x, -e_x p_y + e_y p_x] + f x n + (legs, lever_arm)
    xi = (R_FN dt_N, R_FN (f - e))

except for the white part of the heading: it differs between scan and image and turns the whole of p.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import numpy as np

from collabslam.types import Array
from collabslam.worn_pose.config import WornPoseConfig

_WALK, _FASTEST = 1.3, 1.5
"""Speed at which sway and bob are stated, m/s, and the largest multiple of it that still adds to them."""
_STEP = 0.2
"""Speed, in m/s, from which the trunk faces the way rather than what the head looks at."""
_WALKS, _STANDS = 0.1, 0.7
"""How far it then faces elsewhere, of somebody who walks fast and of somebody who stands, radians."""


@dataclass(frozen=True)
class Gait:
    """How the person moves.

    Attributes
    ----------
    speed : float
        m/s.
    way : (3, 3) array
        `trunk`.
    swing : (2,) array
        As in `WornPoseEstimate.swing`.
    """

    speed: float
    way: Array
    swing: Array


def worn_pose(
    config: WornPoseConfig,
    r_nc: Array,
    r_nf: Array,
    legs: Array,
    legs_covariance: Array,
    plane: float,
    gait: Gait,
) -> tuple[Array, Array, Array]:
    """``T_CF``, its covariance, and the part of it that is bias.

    Parameters
    ----------
    config : WornPoseConfig
    r_nc, r_nf : (3, 3) array
        Attitudes of both cameras in N.
    legs : (2,) array
        Centre of the legs from Cs, along N's x and y, metres.
    legs_covariance : (2, 2) array
    plane : float
        Height of the scanner's plane over Cs, metres (negative below).
    gait : Gait

    Returns
    -------
    (4, 4), (6, 6), (6, 6) arrays
        Covariances over (translation, rotation), tangent on the right.
    """
    person, ahrs = config.person, config.ahrs
    speed, way, swing = gait.speed, gait.way, gait.swing
    arm = r_nf @ np.asarray(person.neck_to_camera)
    neck = person.camera_height + person.neck_to_camera[1] - config.camera_height
    height = neck + arm[2] + float(np.dot(person.bob, swing))
    ahead, left = person.lean
    lean = way[:2, :2] @ np.array([ahead + float(np.dot(person.surge, swing)), left])
    t_n = np.array([legs[0] + lean[0] + arm[0], legs[1] + lean[1] + arm[1], height])
    t_cf = np.eye(4)
    t_cf[:3, :3] = r_nc.T @ r_nf
    t_cf[:3, 3] = r_nc.T @ t_n
    # Columns: legs (2), arm (2), height, robot's tilt (2), heading, white heading, worn tilt (2), heading.
    j = np.zeros((6, 12))
    j[0, 0] = j[1, 1] = j[0, 2] = j[1, 3] = j[2, 4] = 1.0
    up = plane - height
    j[:3, 5:9] = [
        [0.0, up, arm[1], t_n[1]],
        [-up, 0.0, -arm[0], -t_n[0]],
        [-t_n[1], t_n[0], 0.0, 0.0],
    ]
    j[:3, 9:] = [[0.0, arm[2], -arm[1]], [-arm[2], 0.0, arm[0]], [arm[1], -arm[0], 0.0]]
    j[[3, 4, 5, 5], [5, 6, 7, 8]] = -1.0
    j[[3, 4, 5], [9, 10, 11]] = 1.0
    turn = r_nf.T
    j = np.concatenate([turn @ j[:3], turn @ j[3:]])
    slow = np.zeros((12, 12))
    tilt = ahrs.tilt_sd**2 - ahrs.tilt_white_sd**2
    yaw = ahrs.yaw_sd**2 - ahrs.yaw_white_sd**2
    steady, shaken = config.robot_tilt
    slow[range(2, 12), range(2, 12)] = (
        *(person.lever_sd**2,) * 2, person.height_sd**2, steady, steady, yaw, 0.0, tilt, tilt, yaw,
    )  # fmt: skip
    pace = pace_of(speed)
    elsewhere = _WALKS + (_STANDS - _WALKS) * _STEP / (speed + _STEP)
    aside = (pace * person.sway_sd) ** 2 + (elsewhere * hypot(*person.lean)) ** 2
    white = np.zeros((12, 12))
    white[:2, :2] = legs_covariance
    white[range(2, 12), range(2, 12)] = (
        aside, aside, (pace * person.bob_sd) ** 2, shaken, shaken, 0.0,
        ahrs.yaw_white_sd**2, *(ahrs.tilt_white_sd**2,) * 2, ahrs.yaw_white_sd**2,
    )  # fmt: skip
    bias = j @ slow @ j.T
    covariance = bias + j @ white @ j.T
    return t_cf, 0.5 * (covariance + covariance.T), 0.5 * (bias + bias.T)


def pace_of(speed: float) -> float:
    """Share of what `Person` says of the steps at 1.3 m/s that is there at a speed in m/s."""
    return min(speed / _WALK, _FASTEST)


def trunk(velocity: Array, r_nf: Array) -> Array:
    """(3, 3): turns the axes of somebody's trunk (ahead, left, up) into N's: they face the way that they
    walk, at ``velocity`` (2,) in m/s, or stand and face what they look at."""
    x, y = (velocity + _STEP * r_nf[:2, 2]).tolist()
    size = max(hypot(x, y), 1e-9)
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, size]]) / size
