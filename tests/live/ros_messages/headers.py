"""Names this Python's headers in the CMake files of ROS's wheels, which name those they were built with.

``python headers.py SHARE``: the folder below the environment where the wheels put their CMake files.
"""

from __future__ import annotations

import re
import sys
import sysconfig
from pathlib import Path

import numpy as np

HEADERS = {
    r'/opt/python/[^;"]*/include/python[0-9.]+': sysconfig.get_paths()["include"],
    r'/opt/python/[^;"]*/numpy/_core/include': np.get_include(),
}

for path in Path(sys.argv[1]).rglob("*.cmake"):
    text = path.read_text()
    for built_with, here in HEADERS.items():
        text = re.sub(built_with, lambda _, here=here: here, text)
    if text != path.read_text():
        path.write_text(text)
