"""Do the calibration, the poses and the time stamps of a recording agree with its images?

Cs is held against its true poses, Cf against its measured ones, their lengths against each other; each check
undoes the usual mistakes and names the one that explains the images best.  Without true poses the images of
each camera are asked alone, which tells less, and the notes say what.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from collabslam.checks.alone import FocalRange, focal_range
from collabslam.checks.depth import check_depth
from collabslam.checks.lengths import check_lengths
from collabslam.checks.mistakes import MirroredCamera
from collabslam.checks.report import Report
from collabslam.checks.robot import RobotReport, check_robot
from collabslam.checks.worn import MOST_PX, WornReport, check_worn
from collabslam.datasets.at_frames import AtFrames
from collabslam.datasets.persons import check_alone
from collabslam.datasets.wrapped import OnlyPersons
from collabslam.runs.busy import Tell, say_nothing
from collabslam.types import Recording, worn_cameras

OF_CS = "images of Cs under the true poses"


@dataclass(frozen=True)
class CalibrationReport(Report):
    """What was found; residuals are medians, pixels.

    Attributes
    ----------
    by_gap : dict of frame gap to residual of Cs under the true poses
    focal : float or None
        Factor on the focal lengths of Cs that fits the true poses best.
    offset : float or None
        Seconds to add to the image stamps of Cs so that the true poses fit best.
    worn : WornReport
        What the views of Cf say of ``T_CF``.
    lengths : float or None
        Lengths of the true poses over those of ``T_CF``, 1 if both are in metres.
    alone : FocalRange or None
        Factors on the focal length of Cs that its images allow without any poses.
    """

    by_gap: dict[int, float] = field(default_factory=dict)
    focal: float | None = None
    offset: float | None = None
    worn: WornReport = field(default_factory=WornReport)
    lengths: float | None = None
    alone: FocalRange | None = None

    @property
    def checked(self) -> bool:
        """Whether there was anything to hold the images against."""
        return bool(self.by_gap) or self.worn.residual is not None

    @property
    def agrees(self) -> bool:
        """Whether all that was checked agrees with the images; see `worn.MOST_PX`."""
        return (
            self.checked
            and not self.findings
            and (self.worn.residual is None or self.worn.agrees)
            and all(r <= MOST_PX for r in self.by_gap.values())
        )


def check_persons(recording: Recording, tell: Tell = say_nothing) -> dict[str, CalibrationReport]:
    """Check a recording as each of its persons sees it, by name; "" where there is at most one camera.

    What is said of Cs is the same in all of them.  ``tell`` is told what is checked next.
    """
    names = list(worn_cameras(recording))
    if len(names) < 2:
        return {name: check_calibration(recording, tell=tell) for name in names or [""]}
    tell(OF_CS)
    robot = check_robot(recording)
    return {name: check_calibration(OnlyPersons(recording, [name]), robot, tell=tell) for name in names}


def check_calibration(
    recording: Recording, robot: RobotReport | None = None, *, tell: Tell = say_nothing
) -> CalibrationReport:
    """Check a recording of Cs and at most one Cf; nothing of it is changed.

    Parameters
    ----------
    recording : Recording
        With true poses, recorded worn views, or both; without either its images alone are asked.  Views
        of another time than their frame's are asked beside the frame nearest to it; see `AtFrames`.
    robot : RobotReport, optional
        What is known of Cs already.
    tell : callable
        Is told what is checked next.

    Raises
    ------
    SettingsError
        If several persons wear a camera: see `check_persons`.
    """
    check_alone(recording)
    if robot is None:
        tell(OF_CS)
        robot = check_robot(recording)
    with_views = AtFrames(recording, robot.poses)
    tell("images of Cf under T_CF")
    worn = check_worn(with_views, robot)
    tell("lengths of the true poses beside those of T_CF, and depths")
    lengths = check_lengths(with_views, robot, worn.undo)
    findings = robot.findings + worn.findings + lengths.findings
    findings += check_depth(with_views, robot, worn.undo)
    notes = robot.notes + worn.notes + lengths.notes
    if with_views.free and robot.poses is None:
        notes.append(
            "Cf has a clock of its own: without true poses nothing tells what Cs moved between a view and "
            "the frame nearest to it, and that counts as noise of T_CF."
        )
    alone = None
    if not robot.by_gap:
        tell("focal length by the images of Cs alone")
        alone = focal_range(recording.image, range(len(recording)), MirroredCamera(recording.camera))
        if alone is not None and alone.contradicts:
            findings.append(
                f"The images of Cs do not fit its focal length: with {alone.best:.2f} times the calibrated "
                f"one the residual of its matches falls from {alone.before:.2f} to {alone.after:.2f} px; "
                "calibrate this camera at this resolution."
            )
        notes.append(_untold(alone))
    return CalibrationReport(
        robot.by_gap, robot.focal, robot.offset, worn, lengths.ratio, alone, findings=findings, notes=notes
    )


def _untold(alone: FocalRange | None) -> str:
    """What the images of Cs alone leave open."""
    if alone is None:
        told = "do not tell its focal length: they move too little"
    else:
        told = f"allow {alone.least:.2f} to {alone.most:.2f} times its focal length"
    return f"The images of Cs alone {told}; its stamps and mirroring cannot be told from them."
