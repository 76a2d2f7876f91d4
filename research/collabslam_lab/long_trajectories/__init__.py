"""Long trajectories: rounds through rendered corridors, what loops gain, and whether false ones are found."""

from collabslam_lab.long_trajectories.study import EXPERIMENTS, study_loops

__all__ = ["EXPERIMENTS", "study_loops"]
