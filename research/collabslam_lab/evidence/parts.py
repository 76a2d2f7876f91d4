"""What evidence is made of: the lab's own commands, and which of their files the documentation shows.

In a command `OUT` stands for the part's folder, `DATA` for that of the recordings, `BENCHES` for the source
tree's; `JOBS` and `ENGINE` for the options of that name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

OUT, DATA, BENCHES, JOBS, ENGINE = "OUT", "DATA", "BENCHES", "--jobs", "--engine"
Command = Sequence[str]


@dataclass(frozen=True)
class Part:
    """One question, and the commands that answer it.

    Attributes
    ----------
    name : str
        Also of its folder.
    question : str
    full, quick : sequence of commands
        Words after ``collabslam-lab``; `BENCHES` as the first one names a program of the source tree.
    tables : mapping
        Name of a table of the documentation to the file in the part's folder that it is made from.
    """

    name: str
    question: str
    full: Sequence[Command]
    quick: Sequence[Command]
    tables: Mapping[str, str] = field(default_factory=dict)

    def needs(self, word: str, *, quick: bool) -> bool:
        """Whether one of its commands has that word."""
        return any(word in command for command in (self.quick if quick else self.full))


def _evaluate(name: str, question: str, *options: str, quick: Command) -> Part:
    words = ("evaluate", DATA, "--out", OUT, JOBS, ENGINE)
    named = [*words, *options]
    return Part(name, question, [named], [[*named, *quick]], {name: f"{name}.md"})


def _reproduce(name: str, question: str, *names: str, options: Command = (), files: Command = ()) -> Part:
    words = ["reproduce", *names, "--out", OUT, JOBS, ENGINE, *options]
    return Part(name, question, [words], [[*words, "--quick"]], {n: f"{n}.md" for n in files or names})


_EXPERIMENTS = ("table1", "fig11", "fig13", "table2", "fig15", "cost", "study")
_SIMULATION = ("observability", "fig7", "fig8", "fig9", "fig10", "consistency", "worn-pose")
_SIMULATED = ("reproduce", "all", "--out", OUT, JOBS, ENGINE)
_DEMO = ("evaluate", OUT, "--out", OUT, JOBS, ENGINE, "--only", "demo")
_ATTACKED = ("reliability", "attacks", "--out", f"{OUT}/reliability.json", JOBS)

PARTS: tuple[Part, ...] = (
    Part(
        "accuracy",
        "How far off is the pose, and does its covariance say so?",
        [["evaluate", DATA, "--out", OUT, JOBS, ENGINE]],
        [[*_DEMO, "--seeds", "0", "--modes", "mono"]],
        {"accuracy": "evaluate.md"},
    ),
    Part(
        "demo",
        "The same of the rendered demo alone, which needs no recordings?",
        [_DEMO],
        [[*_DEMO, "--seeds", "0"]],
    ),
    _evaluate(
        "ablation",
        "What is each rule of the filter worth?",
        "--ablation",
        quick=["--only", "kitti_seq1", "--seeds", "0"],
    ),
    _evaluate(
        "blackout",
        "How soon is a camera that saw nothing found again?",
        "--seeds",
        "0",
        "--modes",
        "collab",
        "--blackout",
        quick=["--only", "kitti_seq1"],
    ),
    _evaluate(
        "descriptors",
        "Which descriptor matches two cameras that look from different sides?",
        "--descriptors",
        quick=["--only", "kitti_seq1"],
    ),
    _reproduce(
        "viewpoints",
        "Would a learned descriptor match more?",
        "viewpoints",
        options=["--data", DATA],
    ),
    Part(
        "simulation",
        "Do the paper's simulation and its statements on observability hold?",
        [_SIMULATED],
        [["reproduce", "observability", "--out", OUT, JOBS, ENGINE, "--runs", "2"]],
        {name: f"{name}.md" for name in _SIMULATION},
    ),
    _reproduce("experiments", "Do the paper's experiments come out as it says?", "paper", files=_EXPERIMENTS),
    Part(
        "gyro",
        "What is a gyroscope worth?",
        [["gyro", "--out", OUT, JOBS, ENGINE]],
        [["gyro", "--out", OUT, JOBS, ENGINE, "--quick"]],
        {"gyro": "gyro.md"},
    ),
    _reproduce("loops", "What is left of the error after a long way?", "loops"),
    _reproduce("persons", "What do several persons add, and looking where one is told?", "persons", "cue"),
    _reproduce(
        "calibration",
        "Can a wrong T_CF be found and corrected?",
        "calibration",
        options=["--data", DATA],
    ),
    Part(
        "peers",
        "How does it stand beside other systems on the same images?",
        [["peers", DATA, "--out", OUT]],
        [["peers", DATA, "--out", OUT, "--only", "kitti_seq1", "--systems", "collabslam"]],
        {"peers": "peers.md"},
    ),
    Part(
        "reliability",
        "Does anything that it reads or is told break it?",
        [["reliability", "all", "--full", "--out", f"{OUT}/reliability.json", JOBS]],
        [_ATTACKED],
        {"reliability": "reliability.md"},
    ),
    Part(
        "bench",
        "What does a frame cost?",
        [[BENCHES, "frames.py", "--out", f"{OUT}/frames.json"]],
        [[BENCHES, "frames.py", "--runs", "1", "--out", f"{OUT}/frames.json"]],
    ),
)
"""In the order in which they are made."""
