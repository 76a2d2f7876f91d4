"""Finding a camera that is not where prediction puts it."""
