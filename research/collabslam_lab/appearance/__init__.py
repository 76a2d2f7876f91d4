"""How like recordings the rendered worlds are, by what the tracker makes of both: ``reproduce worlds``."""
