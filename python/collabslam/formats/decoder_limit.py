"""The most pixels of an image, as a decoder keeps it: it may read another size in a header than we do."""

from __future__ import annotations

import os

MOST_PIXELS = 1 << 27
"""That no image has more of."""
_VARIABLE = "OPENCV_IO_MAX_IMAGE_PIXELS"


def limit_decoder() -> None:
    """Has OpenCV refuse larger images itself, in this process and its children, if it is not loaded yet.

    For programs of our own: somebody else's may have larger images.  A limit that is set already stays.
    """
    os.environ.setdefault(_VARIABLE, str(MOST_PIXELS))
