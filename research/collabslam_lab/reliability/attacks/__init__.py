"""Attacks on the whole product, each in a process of its own: what must never happen, tried on purpose.

An attack prepares files, calls or frames; then the command line or the public API has to deal with them,
within a time and a memory, without touching anything but its results.
"""
