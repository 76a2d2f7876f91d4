"""The subcommands, a module each; only the one that is called is imported.

The module of the command ``check-calib`` is ``collabslam.cli.check_calib``.  It offers
``configure(parser)``, which adds its options, and ``main(arguments)``, which does the work and returns the
exit status.
"""

from __future__ import annotations

OK, NOT_TRUSTED, BAD_INPUT, FAULT, INTERRUPTED, TERMINATED = 0, 1, 2, 3, 130, 143
"""Exit statuses: fine; finished, but not to be trusted (the camera was lost, the filter gave up, a check
found something); bad input; a fault of this program; ended by Ctrl-C; ended by SIGTERM."""

COMMANDS = {
    "run": "run a recording through the filter",
    "batch": "run many recordings, here or on a cluster, into one table",
    "init": "write a settings file and a calibration for a recording",
    "demo": "render a corridor walk and run it with and without Cf",
    "info": "say what a recording holds",
    "check-calib": "say whether calibration, poses and time stamps agree with the images",
    "calibrate-person": "measure how the person who wears Cf is built, with a checkerboard",
    "compare": "set two runs beside each other, with a picture",
    "doctor": "explain in sentences why a run went well or badly",
    "export": "write a run's trajectory or map in another format",
    "settings": "list, write or check settings",
    "record": "write a recording in the two-camera layout",
    "live": "robot and worn camera on a network, the pose while the robot drives",
}
"""Every command with its help, in the order of ``collabslam --help``."""
