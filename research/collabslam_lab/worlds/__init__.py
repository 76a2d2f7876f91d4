"""Rendered worlds for the paper's experiments: two cameras, exact truth, a recipe for each."""

from collabslam_lab.worlds.catalogue import SETS, Recipe
from collabslam_lab.worlds.life import LIFE, lifelike, recipe
from collabslam_lab.worlds.recording import WorldRecording, world_recording

__all__ = ["LIFE", "SETS", "Recipe", "WorldRecording", "lifelike", "recipe", "world_recording"]
