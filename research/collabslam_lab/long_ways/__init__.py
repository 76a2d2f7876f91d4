"""Long ways: rounds through rendered corridors, what loops gain there and whether false ones are found."""

from collabslam_lab.long_ways.study import EXPERIMENTS, study_loops

__all__ = ["EXPERIMENTS", "study_loops"]
