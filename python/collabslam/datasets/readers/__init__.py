"""Layouts that are read from disk, one file per layout."""
