"""Rendered worlds for the paper's experiments: two cameras, exact truth, a recipe for each."""

from collabslam_lab.worlds.catalogue import SETS, Recipe, recipe
from collabslam_lab.worlds.recording import WorldRecording, world_recording

__all__ = ["SETS", "Recipe", "WorldRecording", "recipe", "world_recording"]
