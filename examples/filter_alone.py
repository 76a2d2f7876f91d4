"""The filter without images: a simulated camera that moves sideways before a cloud of points.

Shows what the whole covariance P holds: the pose, the landmarks, and how they go together.
"""

from __future__ import annotations

import numpy as np

from collabslam import Camera, DepthMeasurement, Filter, FilterSettings

FRAMES, SPEED, PIXEL = 40, 0.02, 0.7


def main() -> None:
    generator = np.random.default_rng(0)
    camera = Camera("pinhole", 640, 480, (500.0, 500.0, 319.5, 239.5))
    points = generator.uniform((-1.0, -0.8, 2.5), (1.5, 0.8, 5.0), (40, 3))  # in W, metres

    slam = Filter(camera, settings=FilterSettings({"pixel.sigma_cs": PIXEL}))
    slam.predict(0.0)
    uv = camera.project(points).uv
    depth = points[:, 2] * (1.0 + 0.03 * generator.standard_normal(len(points)))
    nobody = np.empty(0, np.int64)
    new = np.full(len(points), -1)
    depths = DepthMeasurement(new, uv, depth, 0.03 * depth)
    born = slam.update(nobody, nobody, np.empty((0, 2)), depths=depths).depths.born
    point_of = dict(zip(born.tolist(), range(len(points)), strict=True))

    for k in range(1, FRAMES):
        slam.predict(0.1 * k)
        expected = slam.predict_pixels()
        seen = points[[point_of[i] for i in expected.ids.tolist()]] - [SPEED * k, 0.0, 0.0]
        there = camera.project(seen)
        ids, uv = expected.ids[there.visible], there.uv[there.visible]
        slam.update(expected.ids, ids, uv + PIXEL * generator.standard_normal((len(ids), 2)))
        slam.manage_map()

    p, blocks = slam.covariance, slam.blocks
    x, sigma = slam.pose[0, 3], np.sqrt(slam.pose_covariance[0, 0])
    print(f"x = {x:.3f} m after {SPEED * (FRAMES - 1):.3f} m, standard deviation {sigma:.3f} m")
    size = f"{len(p)}x{len(p)}"
    print(f"P is {size}: camera 13, then {len(blocks)} blocks; soundness {slam.soundness():.1e}")
    one, other = [block for block in blocks if block.kind == "Feature"][:2]
    first, second = (block.offset + block.size - 1 for block in (one, other))  # their inverse depths
    names, scale = f"{one.id} and {other.id}", np.sqrt(p[first, first] * p[second, second])
    print(f"landmarks {names}: the errors of their depths are correlated by {p[first, second] / scale:.2f}")


if __name__ == "__main__":
    main()
