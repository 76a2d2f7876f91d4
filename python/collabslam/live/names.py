"""Keys of the link, and who writes them: ``collabslam/worn/NAME/PART`` the device NAME, the rest the robot.

Each key is the name of a ROS topic, and each payload a ROS message in CDR, so that a bridge between Zenoh and
ROS 2 needs to be told nothing.
"""

from __future__ import annotations

import re
import secrets

from collabslam.errors import DataError, InputError, SettingsError
from collabslam.types import PERSON

ROBOT = "collabslam/robot"
WORN = "collabslam/worn"
POSE, POSE_MAP, ODOMETRY, STATUS, MAP, CLOCK, VIEW = (
    f"{ROBOT}/{part}" for part in ("pose", "pose_map", "odometry", "status", "map", "clock", "view")
)
"""What the robot writes; ``clock`` answers questions."""
ALL_WORN = f"{WORN}/*/*"
"""What any device writes."""
WORN_POSE = f"{ROBOT}/worn_pose"
"""Where a worn camera is; of several persons the name follows, as `of_person` has it."""
IMAGE, CAMERA_INFO, T_CF, EXCHANGE, BEAT = "image", "camera_info", "pose", "clock", "beat"
ATTITUDE, ROBOT_ATTITUDE, SCAN, OWN, RATE = "imu", "robot_imu", "scan", "own_pose", "gyro"
PARTS = (IMAGE, CAMERA_INFO, T_CF, EXCHANGE, BEAT, ATTITUDE, ROBOT_ATTITUDE, SCAN, OWN, RATE)
"""What a device writes, below its own name; ``beat`` is empty and means nothing (see `worn`)."""

PORT = 7447
_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_START = "[A-Za-z0-9_-]{0,64}"
_SESSION = re.compile(rf"{PERSON}(/{_START})?")


def device_name(name: str) -> str:
    """``name`` if a device can be called so; raises SettingsError."""
    if not _NAME.fullmatch(name) or name == "robot":
        raise SettingsError(
            f"A device cannot be called '{name}'; take up to 32 of a-z, 0-9 and _, beginning with a letter, "
            "and not 'robot'."
        )
    return name


def key(device: str, part: str) -> str:
    """The key of a device's ``part``."""
    return f"{WORN}/{device}/{part}"


def of_person(key: str, name: str) -> str:
    """What the robot writes of one of several persons, who has a name, or of the only one, who has none."""
    return f"{key}/{name}" if name else key


def device_of(expression: str) -> tuple[str, str]:
    """Device and part of a key that `key` made; raises DataError for any other key, and for a wildcard."""
    above, _, rest = expression.partition(f"{WORN}/")
    name, _, part = rest.partition("/")
    if above or not _NAME.fullmatch(name) or part not in PARTS:
        raise DataError(f"The key {expression[:80]!r} is not a device's; write to {WORN}/NAME/PART.")
    return name, part


def own_session(device: str, told: str) -> str:
    """A session as its device tells it: whatever it calls itself, it is the device's own.

    Raises
    ------
    DataError
        If it is called otherwise than sessions are: up to 64 letters, digits, _ and - after the last ``/``.
    """
    start = told.rpartition("/")[2]
    if not re.fullmatch(_START, start):
        raise DataError(
            f"The session {start[:80]!r} is not called as sessions are; take letters, digits, _ and -."
        )
    return f"{device}/{start}"


def check_session(session: object) -> None:
    """Raises InputError if ``session`` is not ``NAME`` or ``NAME/START``, as `own_session` has it."""
    if not isinstance(session, str) or not _SESSION.fullmatch(session):
        raise InputError(
            f"A session cannot be called {str(session)[:80]!r}; take NAME/START, as 'anna/17', of letters, "
            "digits, _ and -."
        )


def new_session(device: str) -> str:
    """A name for a device's session that no other has."""
    return f"{device}/{secrets.token_hex(4)}"
