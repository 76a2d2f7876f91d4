"""COLMAP on a prepared folder; run by the interpreter of its own environment: ``colmap.py FOLDER``.

Nothing imports it, and it speaks through the folder's files alone.  Incremental reconstruction from a
share of the frames; the calibration is kept.  The covariance is that of a last bundle adjustment, one
camera's pose and a length held fixed, for corners that err by one pixel.
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


def told(model: pycolmap.Reconstruction) -> tuple[dict[int, list[list[float]]], float | None]:
    """Covariance of each pose, T_WC = T_hat Exp(xi), and the RMS of the pixels' residuals."""
    config = pycolmap.BundleAdjustmentConfig()
    for i in model.reg_image_ids():
        config.add_image(i)
    for camera in model.cameras:
        config.set_constant_cam_intrinsics(camera)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(
        pycolmap.BundleAdjustmentOptions(print_summary=False), config, model
    )
    adjuster.solve()
    wanted = pycolmap.BACovarianceOptions(params=pycolmap.BACovarianceOptionsParams.POSES)
    found = pycolmap.estimate_ba_covariance(wanted, model, adjuster)
    if found is None:
        return {}, None
    covariances = {}
    for i in model.reg_image_ids():
        frame, p = int(Path(model.images[i].name).stem), found.get_cam_cov_from_world(i)
        if p is None:
            covariances[frame] = np.zeros((6, 6)).tolist()
        elif p.shape == (6, 6):  # not the camera whose distance is held
            x, y, z = model.images[i].cam_from_world().translation
            across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            # its angles are half angles, turned on the left of R_CW; its positions are t_CW
            j = np.block([[-2 * across, -np.eye(3)], [-2 * np.eye(3), np.zeros((3, 3))]])
            covariances[frame] = (j @ p @ j.T).tolist()
    off = [
        model.images[part.image_id].project_point(point.xyz)
        - model.images[part.image_id].points2D[part.point2D_idx].xy
        for point in model.points3D.values()
        for part in point.track.elements
    ]
    return covariances, float(np.sqrt(np.mean(np.square(off))))


covariances, residual = told(largest) if largest is not None else ({}, None)
placed = [] if largest is None else [largest.images[i] for i in largest.reg_image_ids()]
final = {int(Path(image.name).stem): image.projection_center().tolist() for image in placed}
turns = {int(Path(i.name).stem): i.cam_from_world().rotation.matrix().T.tolist() for i in placed}
found = {"final": final, "turns": turns, "covariances": covariances, "residual_px": residual, "cpu": cpu}
(folder / "found.json").write_text(json.dumps(found))
