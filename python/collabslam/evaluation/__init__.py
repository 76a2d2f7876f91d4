"""Errors of a run against the truth, and what a filter's covariance is worth."""
