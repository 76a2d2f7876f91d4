"""Known metric targets: printed tags and boards in an image, and the pose they tell."""
