"""SVO on a prepared folder; run by the interpreter of its own environment: ``svo.py FOLDER``.

Nothing imports it, and it speaks through the folder's files alone.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
import svo_cpp

folder = Path(sys.argv[1])
job = json.loads((folder / "job.json").read_text())
left = np.load(folder / "left.npy", mmap_mode="r")
height, width = left.shape[1:]
vo = svo_cpp.SVO(svo_cpp.PinholeCamera(width, height, *job["intrinsics"]))
vo.start()
live, wall = {}, []
began, cpu = time.perf_counter(), time.process_time()
for k, t in enumerate(job["times"]):
    time.sleep(max(0.0, began + t - time.perf_counter()))
    start = time.perf_counter()
    vo.addImage(np.array(left[k]), t)
    wall.append(time.perf_counter() - start)
    if vo.stage() == svo_cpp.Stage.DEFAULT_FRAME:
        live[k] = vo.lastFrame().T_f_w.inverse().translation().ravel().tolist()
cpu = time.process_time() - cpu
(folder / "found.json").write_text(json.dumps({"live": live, "cpu": cpu, "wall": wall}))
