"""Settings of the simulations: the reference parameters of METHOD 14, each with its unit and range.

They are changed on the command line by ``--set name=value``; the only owner of their defaults is
`SIMULATION`.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from collabslam.errors import SettingsError
from collabslam.settings.setting import Setting, Value


def _float(key: str, default: float, unit: str, low: float, high: float, doc: str) -> Setting:
    return Setting(key, "float", default, low, high, unit, (), doc)


def _int(key: str, default: int, low: int, high: int, doc: str) -> Setting:
    return Setting(key, "int", default, low, high, "", (), doc)


SIMULATION = {
    setting.key: setting
    for setting in (
        _float("rate", 10.0, "Hz", 1.0, 100.0, "frames of Cs"),
        _float("duration", 30.0, "s", 1.0, 300.0, "length of a run"),
        _float("path", 14.0, "m", 0.1, 1000.0, "mean way along the wall"),
        _float("wall_distance", 4.0, "m", 0.5, 100.0, "from the path to the wall"),
        _float("wall_relief", 0.2, "m", 0.0, 10.0, "landmarks are up to so much before or behind the wall"),
        _float("spacing", 0.6, "m", 0.1, 10.0, "between landmarks"),
        _float("acceleration_density", 0.03, "m/s^1.5", 0.0, 10.0, "of the truth and of the filter"),
        _float(
            "angular_acceleration_density", 2.0, "deg/s^1.5", 0.0, 100.0, "of the truth and of the filter"
        ),
        _float("velocity_time", 10.0, "s", 0.1, 1e4, "in which the truth returns to its mean velocity"),
        _float("path_stiffness", 0.05, "1/s^2", 0.0, 10.0, "that pulls the truth back to its line"),
        _float("heading_stiffness", 0.3, "1/s^2", 0.0, 100.0, "that turns the truth back to the wall"),
        _float("heading_damping", 1.0, "1/s", 0.0, 100.0, "of the truth's turns"),
        _float("fov", 70.0, "deg", 5.0, 170.0, "field of view of Cs"),
        _float("bearing_sigma", 1.0, "deg", 1e-3, 30.0, "noise of a bearing of Cs, sigma_Cs"),
        _float("stereo_bearing_sigma", 6.0, "deg", 1e-3, 90.0, "noise of a pseudo-stereo bearing, sigma_Csf"),
        _float("range_sigma", 0.5, "m", 1e-3, 100.0, "noise of a pseudo-stereo range, sigma_r"),
        _float("first_window_start", 8.0, "s", 0.0, 300.0, "pseudo-stereo measurements are there from..."),
        _float("first_window_end", 9.0, "s", 0.0, 300.0, "...to"),
        _float("second_window_start", 17.0, "s", 0.0, 300.0, "and again from..."),
        _float("second_window_end", 19.0, "s", 0.0, 300.0, "...to"),
        _float("min_parallax", 10.0, "deg", 0.5, 90.0, "of a delayed birth, alpha_min"),
        _int("known_features", 4, 1, 20, "landmarks known at the start, the nearest to the optical axis"),
        _float("known_sigma", 0.01, "m", 1e-4, 10.0, "of a known landmark, per axis"),
        _float("start_velocity_sigma", 0.1, "m/s", 0.0, 10.0, "of the velocity the filter starts with"),
        _float("start_turn_sigma", 1.0, "deg/s", 0.0, 90.0, "of the turn rate the filter starts with"),
        _int("map_size", 18, 4, 100, "landmarks the filter remembers, the latest ones"),
        _float("inflation", 1.3, "", 0.1, 10.0, "of sigma_Cs where an estimator uses it"),
        _float("converged", 0.1, "", 0.01, 10.0, "largest sd(rho) / rho of a depth that counts as known"),
        _float("scale_depth", 1.0, "", 0.01, 10.0, "largest sd(rho) / rho of a depth that tells the scale"),
        _int("cloud_runs", 100, 2, 100000, "runs of the 6-DoF check of consistency"),
        _float("cloud_density", 1.2, "1/m^2", 0.1, 20.0, "landmarks on the wall of that check"),
        _float("cloud_relief", 0.5, "m", 0.0, 3.0, "of the wall of that check"),
        _int("cloud_in_view", 12, 5, 100, "features in view that its filter asks for"),
        _int("worn_runs", 100, 2, 100000, "walks of the check of the worn camera's pose"),
        _float("worn_duration", 14.0, "s", 2.0, 300.0, "of such a walk"),
        _int("worn_told", 1, 0, 1, "1 if that estimator is told where the person starts, 0 if not"),
    )
}


class SimulationSettings:
    """Checked values of `SIMULATION`, read as attributes; angles stay in degrees as documented.

    Parameters
    ----------
    changes : mapping of str to value
        Over the defaults.

    Raises
    ------
    SettingsError
        For an unknown name, a wrong type, a value out of range, or windows that are out of order.
    """

    def __init__(self, changes: Mapping[str, Any] | None = None) -> None:
        values: dict[str, Value] = {key: setting.default for key, setting in SIMULATION.items()}
        for key, value in (changes or {}).items():
            if key not in SIMULATION:
                near = difflib.get_close_matches(key, SIMULATION, n=1)
                hint = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(SIMULATION)}."
                raise SettingsError(f"There is no setting '{key}' of the simulation; {hint}")
            values[key] = SIMULATION[key].checked(value)
        self.values = values
        edges = [e for window in self.windows for e in window]
        if edges != sorted(edges):
            raise SettingsError(
                f"The windows {edges} are out of order; give start, end, start, end in seconds."
            )

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["values"][name]
        except KeyError:
            raise AttributeError(name) from None

    @property
    def windows(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Start and end of both windows of pseudo-stereo, seconds."""
        v = self.values
        return (
            (float(v["first_window_start"]), float(v["first_window_end"])),
            (float(v["second_window_start"]), float(v["second_window_end"])),
        )

    @property
    def frames(self) -> int:
        """Number of frames, the one at time 0 included."""
        return round(float(self.values["duration"]) * float(self.values["rate"])) + 1

    def window_at(self, frame: int) -> int:
        """Index of the window that the frame lies in; -1 for none."""
        t = frame / float(self.values["rate"])
        return next((k for k, (a, b) in enumerate(self.windows) if a - 1e-9 <= t < b - 1e-9), -1)
