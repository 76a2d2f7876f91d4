"""COLMAP on a prepared folder; run by the interpreter of its own environment: ``colmap.py FOLDER``.

Nothing imports it, and it speaks through the folder's files alone.  Incremental reconstruction from a
share of the frames; the calibration is kept.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
import pycolmap

folder = Path(sys.argv[1])
job = json.loads((folder / "job.json").read_text())
left = np.load(folder / "left.npy", mmap_mode="r")
images, database = folder / "images", folder / "database.db"
images.mkdir()
for k in job["few"]:
    pycolmap.Bitmap.from_array(np.array(left[k])).write(images / f"{k:06d}.png")
reader = pycolmap.ImageReaderOptions(
    camera_model="PINHOLE", camera_params=",".join(map(str, job["intrinsics"]))
)
extraction = pycolmap.FeatureExtractionOptions(use_gpu=False)
extraction.sift.max_num_features = job["features"]
options = pycolmap.IncrementalPipelineOptions(
    multiple_models=False, ba_refine_focal_length=False, ba_refine_extra_params=False, random_seed=0
)
options.mapper.init_max_forward_motion = 1.0  # roads lead along the optical axis
options.mapper.init_min_tri_angle = 4.0  # and short ways see little parallax
options.mapper.abs_pose_refine_focal_length = False
options.mapper.abs_pose_refine_extra_params = False
cpu = time.process_time()
pycolmap.extract_features(
    database,
    images,
    camera_mode=pycolmap.CameraMode.SINGLE,
    reader_options=reader,
    extraction_options=extraction,
    device=pycolmap.Device.cpu,
)
pycolmap.match_sequential(database, device=pycolmap.Device.cpu)
models = pycolmap.incremental_mapping(database, images, folder / "models", options)
cpu = time.process_time() - cpu
largest = max(models.values(), key=lambda model: model.num_reg_images(), default=None)
placed = [] if largest is None else [largest.images[i] for i in largest.reg_image_ids()]
final = {int(Path(image.name).stem): image.projection_center().tolist() for image in placed}
turns = {int(Path(i.name).stem): i.cam_from_world().rotation.matrix().T.tolist() for i in placed}
(folder / "found.json").write_text(json.dumps({"final": final, "turns": turns, "cpu": cpu}))
