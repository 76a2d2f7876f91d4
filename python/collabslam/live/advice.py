"""What becomes of a phone's images, by what the robot reports of them, and what its wearer can do."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

REPORTS = 6
"""Reports that are looked at together: some three seconds."""
USED, DROPPED = "used", "dropped "
"""Of a report: views that frames used, and how the names of those that were not begin."""
_SHOW_THE_TAG = (
    "The robot gets your images and does not know where you are: show the tag to both cameras, yours and "
    "the robot's."
)
_SLOW = "Your images come too late: go where the radio is better."
_MEANS = {
    "no pose": _SHOW_THE_TAG,
    "no target": _SHOW_THE_TAG,
    "no clock": "The robot learns your phone's clock; this takes a moment.",
    "other session": "Another worn camera is at work; end it, or wait until it is silent.",
    "no person": "The robot waits for other persons; it must be started with this device's name.",
    "broken": "The robot cannot read your images; close what else uses the camera, and load this page again.",
    "other calibration": "Your calibration is not the one that the robot began with; start the robot again.",
    "refused": "What is known of your place is impossible; look at the tag once more.",
    "malformed": "The robot does not understand this page; both need the same version of collabslam.",
    "too many": "More images come than the robot takes; load this page again.",
    "stale": _SLOW,
    "crowded": _SLOW,
    "superseded": _SLOW,
}


class OwnImages:
    """The robot's last reports of one device's images."""

    def __init__(self) -> None:
        self._reports: deque[dict[str, int]] = deque(maxlen=REPORTS)

    def report(self, told: Mapping[str, str]) -> tuple[str, bool]:
        """What to say after one more report, and whether all is well.

        Parameters
        ----------
        told : mapping
            ``images`` that arrived, those `USED`, and those `DROPPED` by reason, counted since the beginning.
        """
        counts = {name: int(float(value)) for name, value in told.items() if _is_count(name)}
        if self._reports and any(counts.get(name, 0) < value for name, value in self._reports[-1].items()):
            self._reports.clear()  # the robot was started anew
        self._reports.append(counts)
        then = self._reports[0]
        new = {name: value - then.get(name, 0) for name, value in counts.items()}
        if len(self._reports) == 1:
            return "Sending; the robot has not said yet what becomes of your images.", False
        if new.get("images", 0) == 0:
            return "No image has reached the robot for a while: go where the radio is better.", False
        if new.get(USED, 0) > 0:
            return "The robot uses your images.", True
        reasons = {name.removeprefix(DROPPED): n for name, n in new.items() if name.startswith(DROPPED) and n}
        if reasons:
            reason = max(reasons, key=lambda name: reasons[name])
            return _MEANS.get(reason, f"The robot does not use your images ({reason})."), False
        return "Your images arrive; nothing in them is known yet. Look at what the robot sees.", False


def _is_count(name: str) -> bool:
    return name in ("images", USED) or name.startswith(DROPPED)
