"""Images of any camera as the grey images that the filter takes, and masks of what is never scene in them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from collabslam._core import Camera
from collabslam.errors import InputError
from collabslam.types import Image, Mask, Masks

ORDERS = ("rgb", "bgr")
LEAST = 0.05
"""Least share of the image that a mask leaves: less is one whose colours are exchanged."""


def to_grey(image: Any, bits: int | None = None, *, order: str = "rgb") -> Image:
    """A grey image of 8 bits from a colour, a 16-bit, a float or a (H, W, 1) image.

    Brightness is scaled by one constant factor, never stretched to an image's own range: frames must stay
    comparable.

    Parameters
    ----------
    image : (H, W), (H, W, 1), (H, W, 3) or (H, W, 4) array of uint8, uint16 or float
        A fourth channel is ignored.  Floats are from 0 to 1.
    bits : int, optional
        Bits that a uint16 image uses: 10, 12, 14 or 16, as the camera's manual says.  Needed for uint16,
        where it cannot be guessed, and for nothing else.
    order : {"rgb", "bgr"}
        Of the colours; OpenCV's are "bgr".

    Returns
    -------
    (H, W) uint8
        In C order; the image itself if it is that already.

    Raises
    ------
    InputError
        For another shape or type, values out of their range, or a uint16 image without its bits.
    """
    array = np.asarray(image)
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[:, :, 0]
    colour = array.ndim == 3 and array.shape[2] in (3, 4)
    if not (array.ndim == 2 or colour) or 0 in array.shape:
        raise InputError(
            f"An image has the shape (H, W), (H, W, 1), (H, W, 3) or (H, W, 4), not {array.shape}."
        )
    if order not in ORDERS:
        raise InputError(f"There is no order of colours '{order}'; use one of {', '.join(ORDERS)}.")
    grey = np.ascontiguousarray(_in_8_bits(array[..., :3] if colour else array, bits))
    if not colour:
        return grey
    import cv2

    code = cv2.COLOR_RGB2GRAY if order == "rgb" else cv2.COLOR_BGR2GRAY
    return np.asarray(cv2.cvtColor(grey, code), dtype=np.uint8)


def _is_deep(image: Any) -> bool:
    """Whether an array is of uint16, in either order of bytes."""
    return bool(image.dtype.kind == "u" and image.dtype.itemsize == 2)


def _in_8_bits(image: Any, bits: int | None) -> Image:
    """Each value of an array in 0..255."""
    if _is_deep(image):
        if bits is None:
            raise InputError(
                "A uint16 image may use 10, 12, 14 or 16 bits; say how many, as in to_grey(image, bits=12)."
            )
        if not (isinstance(bits, int | np.integer) and 8 <= bits <= 16):
            raise InputError(f"A uint16 image uses 8 to 16 bits, not {bits!r}; see the camera's manual.")
        if int(image.max()) >= 1 << bits:
            raise InputError(
                f"The image has values up to {image.max()}, more than {bits} bits; give more bits."
            )
        return np.asarray((image * (255.0 / ((1 << bits) - 1)) + 0.5).astype(np.uint8))
    if bits is not None:
        raise InputError(f"bits={bits} is for uint16 images, and this one is {image.dtype}; leave bits out.")
    if image.dtype == np.uint8:
        return np.asarray(image, dtype=np.uint8)
    if image.dtype.kind != "f":
        raise InputError(
            f"An image of {image.dtype} may mean anything; convert it to uint8, to uint16 with its bits, or "
            "to float from 0 to 1."
        )
    low, high = float(image.min()), float(image.max())
    if not (low >= 0.0 and high <= 1.0):  # NaN is neither
        raise InputError(
            f"A float image goes from 0 to 1, this one from {low:g} to {high:g}; divide it by the camera's "
            "largest value."
        )
    return np.asarray((image * 255.0 + 0.5).astype(np.uint8))


def check_grey(image: Any, camera: Camera, name: str) -> Image:
    """An image that is grey, of 8 bits and of its camera's size, in C order.

    Parameters
    ----------
    image
        Whatever was given.
    camera : Camera
        Whose image it is.
    name : str
        Of the image in messages.

    Raises
    ------
    InputError
        If it is none, with the line of code that makes it one.
    """
    if not isinstance(image, np.ndarray):
        raise InputError(f"The {name} is a {type(image).__name__}; give a (H, W) uint8 array, a grey image.")
    if image.ndim != 2 or image.dtype != np.uint8:
        deep = _is_deep(image)
        raise InputError(
            f"The {name} is {image.shape} {image.dtype}, not a (H, W) uint8 grey image; convert it"
            f"{' (with the bits that the camera uses)' if deep else ''}: "
            f"collabslam.to_grey(image{', bits=12' if deep else ''})."
        )
    if image.shape != (camera.height, camera.width):
        raise InputError(
            f"The {name} is {image.shape[1]} x {image.shape[0]} pixels, its calibration is for "
            f"{camera.width} x {camera.height}; scale the calibration or the images."
        )
    return np.ascontiguousarray(image)


def check_mask(mask: Any, camera: Camera, whose: str = "mask") -> Mask:
    """A mask as True where there may be scene.

    Parameters
    ----------
    mask : (H, W) bool or uint8
        False or 0, black, is never scene. The other value, one alone, may be.
    camera : Camera
        Whose images it is for.
    whose : str
        What to call it in messages.

    Returns
    -------
    (H, W) bool

    Raises
    ------
    InputError
        If it is no such array, of another size, has more than two values, or leaves hardly anything.
    """
    if not isinstance(mask, np.ndarray) or mask.ndim != 2 or mask.dtype not in (np.bool_, np.uint8):
        kind = f"{mask.shape} {mask.dtype}" if isinstance(mask, np.ndarray) else type(mask).__name__
        raise InputError(
            f"The {whose} is {kind}; give a (H, W) array of bool or uint8, 0 where never is scene."
        )
    if mask.shape != (camera.height, camera.width):
        raise InputError(
            f"The {whose} is {mask.shape[1]} x {mask.shape[0]} pixels, its camera's images are "
            f"{camera.width} x {camera.height}; make it of one of them."
        )
    scene = mask != 0
    if len(values := np.unique(mask[scene])) > 1:
        raise InputError(
            f"The {whose} has {len(values)} values beside 0; give 0 where never is scene and 255 elsewhere, "
            "as a PNG file keeps them (JPEG does not)."
        )
    if scene.mean() < LEAST:
        raise InputError(
            f"The {whose} leaves {100.0 * float(scene.mean()):.0f} % of the image; 0, black, is what is "
            "never scene: exchange its colours."
        )
    return np.ascontiguousarray(scene)


def check_masks(
    camera: Camera,
    worn_cameras: Mapping[str, Camera],
    mask: Mask | Image | None,
    worn_mask: Mask | Image | Mapping[str, Mask | Image] | None,
) -> Masks:
    """The masks that are given of Cs and Cf, each as `check_mask` has it; raises InputError."""
    given = dict(worn_mask) if isinstance(worn_mask, Mapping) else {"": worn_mask}
    of_worn = {}
    for name, one in given.items():
        if one is None:
            continue
        if name not in worn_cameras:
            known = ", ".join(map(repr, worn_cameras)) or "no worn camera"
            raise InputError(f"There is a mask of the worn camera {name!r}; there is {known}.")
        of_worn[name] = check_mask(one, worn_cameras[name], f"mask of Cf{f' ({name})' if name else ''}")
    return Masks(None if mask is None else check_mask(mask, camera, "mask"), of_worn)
