"""The other systems: what is installed for each, and what it can do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

SCRIPTS = Path(__file__).parent / "scripts"
OURS = "collabslam"


@dataclass(frozen=True)
class Peer:
    """Another system.

    Attributes
    ----------
    name : str
    requirement : str
        What pip installs into its environment.
    licence : str
    script : str
        Of `SCRIPTS`; the environment's interpreter runs it on a prepared folder.
    stereo : bool
        Whether it is given both images of a rectified pair, and so has a scale.
    offline : bool
        Whether it looks at all frames before it says where the first was.
    covariance : bool
        Whether the wheel says how uncertain a pose is.
    words : bool
        Whether it needs a vocabulary (`collabslam_lab.peers.vocabulary`).
    """

    name: str
    requirement: str
    licence: str
    script: str
    stereo: bool = False
    offline: bool = False
    covariance: bool = False
    words: bool = False

    @property
    def version(self) -> str:
        """As pinned."""
        return self.requirement.partition("==")[2]


_ORB = ("pyorbslam3==0.1.1", "GPL-3.0", "orbslam3.py")
PEERS = (
    Peer("orbslam3-mono", *_ORB, words=True),
    Peer("orbslam3-stereo", *_ORB, stereo=True, words=True),
    Peer("svo", "svo-cpp==1.5.0", "GPL-3.0", "svo.py"),
    Peer("colmap", "pycolmap==4.2.1", "BSD-3-Clause", "colmap.py", offline=True, covariance=True),
)
