"""ORB-SLAM3 on a prepared folder; run by the interpreter of its own environment: ``orbslam3.py FOLDER``.

Nothing imports it, and it speaks through the folder's files alone.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
import pyorbslam3

folder = Path(sys.argv[1])
job = json.loads((folder / "job.json").read_text())
left = np.load(folder / "left.npy", mmap_mode="r")
right = np.load(folder / "right.npy", mmap_mode="r") if job["baseline"] else None
sensor = pyorbslam3.Sensor.STEREO if job["baseline"] else pyorbslam3.Sensor.MONOCULAR
slam = pyorbslam3.Slam(job["vocabulary"], folder / "settings.yaml", sensor)
live, wall = {}, []
began, cpu = time.perf_counter(), time.process_time()
for k, t in enumerate(job["times"]):
    time.sleep(max(0.0, began + t - time.perf_counter()))
    start = time.perf_counter()
    if right is None:
        result = slam.track_monocular(np.array(left[k]), t)
    else:
        result = slam.track_stereo(np.array(left[k]), np.array(right[k]), t)
    wall.append(time.perf_counter() - start)
    if result.ok:
        live[k] = np.asarray(result.pose_wc)[:3, 3].tolist()
slam.shutdown()
cpu = time.process_time() - cpu
final = {}
if live:  # of the largest map, put right by all that came later
    slam.save_trajectory_euroc(str(folder / "final.txt"))
    for line in (folder / "final.txt").read_text().splitlines():
        nanoseconds, *position = map(float, line.split()[:4])
        final[int(np.argmin(np.abs(np.array(job["times"]) - 1e-9 * nanoseconds)))] = position
(folder / "found.json").write_text(json.dumps({"live": live, "final": final, "cpu": cpu, "wall": wall}))
