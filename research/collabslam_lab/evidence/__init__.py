"""All that is claimed, made by one command: ``collabslam-lab evidence``."""

from collabslam_lab.evidence.gather import Asked, gather

__all__ = ["Asked", "gather"]
