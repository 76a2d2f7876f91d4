"""Settings: what a user may change, with default, unit, range and reason."""
