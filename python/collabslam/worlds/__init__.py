"""Rendered worlds in which the paper's experiments are done again: two cameras, exact truth, one recipe each."""

from collabslam.worlds.catalogue import SETS, Recipe, recipe
from collabslam.worlds.recording import WorldRecording, world_recording

__all__ = ["SETS", "Recipe", "WorldRecording", "recipe", "world_recording"]
