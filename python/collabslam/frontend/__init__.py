"""Image front end: corners, patches, active search, optical flow, descriptors, matches with the worn camera.

Every function is a pure function of its arguments; none keeps state between frames.
"""
