"""The commands of ``collabslam-lab``, a module each; only the one that is called is imported."""

from __future__ import annotations

COMMANDS = {
    "clocks": "measure what a worn camera with a clock of its own costs",
    "cluster": "measure what replays on a Dask cluster cost, lose and change",
    "costs": "measure what a wrong focal length costs",
    "evaluate": "measure a set of recordings: accuracy, consistency, cost, levers",
    "evidence": "make all tables of the documentation, and one archive of what they were made of",
    "gyro": "measure what a gyroscope is worth: trajectories as hard as life, close turns, corridors",
    "odometry": "measure what wheel odometry is worth: in the dark, in turns, with slip",
    "peers": "measure ORB-SLAM3, SVO and COLMAP beside this system, on the same images",
    "people": "measure the worn pose's parts on real people's legs and real inertial units",
    "reliability": "measure faults in the stream, fuzzing and endurance",
    "reproduce": "redo the paper's simulation and experiments",
    "worlds": "list the rendered worlds, or write one as a recording",
}
"""Every command with its help, in the order of ``collabslam-lab --help``."""
