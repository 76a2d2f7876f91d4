"""Rendered worlds for the paper's experiments: two cameras, exact truth, a recipe for each."""

from collabslam.worlds.catalogue import SETS, Recipe, recipe
from collabslam.worlds.recording import WorldRecording, world_recording

__all__ = ["SETS", "Recipe", "WorldRecording", "recipe", "world_recording"]
