"""Inertial sensors beside a recording: their samples, how they sit, and the files that tell of both."""
