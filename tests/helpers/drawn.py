"""Each picture of a scene is drawn once a process: its noise is drawn anew for every recording."""

from __future__ import annotations

import hashlib
import weakref
from collections import OrderedDict
from collections.abc import Sequence

import numpy as np

from collabslam._core import Camera
from collabslam.simulation.renderer import Mover, Renderer, Shutter
from collabslam.types import Array, Image

MOST = 1500
"""Pictures that are kept: half a gigabyte of the demo's."""

draw = Renderer.render
"""As the product draws."""
_kept: OrderedDict[tuple[object, ...], Image] = OrderedDict()
_scenes: weakref.WeakKeyDictionary[Renderer, bytes] = weakref.WeakKeyDictionary()


def _scene(renderer: Renderer) -> bytes:
    """What tells one scene from another: all that it draws from."""
    if renderer not in _scenes:
        digest = hashlib.blake2b(repr(renderer._scale).encode())
        for array in (renderer._origin, renderer._u, renderer._v, renderer._gloss, renderer._texels):
            digest.update(array.tobytes())
        for texture in renderer._maps:
            digest.update(np.ascontiguousarray(texture.level(0, 0)).data)
        _scenes[renderer] = digest.digest()
    return _scenes[renderer]


def kept(
    renderer: Renderer,
    pose: Array,
    camera: Camera,
    movers: Sequence[Mover] = (),
    shutter: Shutter | None = None,
) -> Image:
    """What `draw` gives, of the same scenes, poses, camera and shutter only once; it cannot be written to."""
    lens = camera.model, camera.width, camera.height, tuple(camera.intrinsics), tuple(camera.distortion)
    swept = shutter and (shutter.motion.tobytes(), shutter.exposure, shutter.readout)
    bodies = [(_scene(body), np.asarray(at, float).tobytes()) for body, at in movers]
    key = _scene(renderer), np.asarray(pose, float).tobytes(), lens, swept, *bodies
    if key not in _kept:
        _kept[key] = draw(renderer, pose, camera, movers, shutter)
        _kept[key].flags.writeable = False
        if len(_kept) > MOST:
            _kept.popitem(last=False)
    _kept.move_to_end(key)
    return _kept[key]
