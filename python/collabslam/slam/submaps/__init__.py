"""Submaps of a long way, and the loops between them."""
