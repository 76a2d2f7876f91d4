"""What a file is that is no image of ours, by its first bytes: what an error calls it, and what to do."""

from __future__ import annotations

from typing import NamedTuple

TO_PNG = "convert it to PNG (ffmpeg -i IN OUT.png, or magick mogrify -format png *{suffix})"
_DEVELOP = "develop it to PNG or JPEG with the camera's own program"
FILM = "give the film in place of a folder of images"
_ARRAY = "write the array as a PNG file (cv2.imwrite)"
_NO_DOWNLOAD = "download it again: what came is not the image"


class Kind(NamedTuple):
    """``name`` as a person calls it, with its article, and ``remedy``, a part of a sentence."""

    name: str
    remedy: str


_STARTS: tuple[tuple[bytes, Kind], ...] = (
    (b"GIF8", Kind("a GIF", TO_PNG.format(suffix=".gif"))),
    (b"\0\0\0\x0cjP  ", Kind("a JPEG 2000 image", TO_PNG.format(suffix=".jp2"))),
    (b"\xff\x4f\xff\x51", Kind("a JPEG 2000 image", TO_PNG.format(suffix=".j2k"))),
    (b"\0\0\0\x0cJXL ", Kind("a JPEG XL image", TO_PNG.format(suffix=".jxl"))),
    (b"\xff\x0a", Kind("a JPEG XL image", TO_PNG.format(suffix=".jxl"))),
    (b"II+\0", Kind("a BigTIFF", TO_PNG.format(suffix=".tif"))),
    (b"MM\0+", Kind("a BigTIFF", TO_PNG.format(suffix=".tif"))),
    (b"IIU\0", Kind("a raw image of a camera", _DEVELOP)),
    (b"IIRO", Kind("a raw image of a camera", _DEVELOP)),
    (b"FUJIFILM", Kind("a raw image of a camera", _DEVELOP)),
    (b"v/1\x01", Kind("an OpenEXR image", TO_PNG.format(suffix=".exr"))),
    (b"#?RADIANCE", Kind("a Radiance HDR image", TO_PNG.format(suffix=".hdr"))),
    (b"#?RGBE", Kind("a Radiance HDR image", TO_PNG.format(suffix=".hdr"))),
    (b"P7", Kind("a PAM image", TO_PNG.format(suffix=".pam"))),
    (b"PF", Kind("a PFM image", TO_PNG.format(suffix=".pfm"))),
    (b"Pf", Kind("a PFM image", TO_PNG.format(suffix=".pfm"))),
    (b"qoif", Kind("a QOI image", TO_PNG.format(suffix=".qoi"))),
    (b"8BPS", Kind("a Photoshop file", TO_PNG.format(suffix=".psd"))),
    (b"\0\0\x01\0", Kind("an icon", TO_PNG.format(suffix=".ico"))),
    (b"\x93NUMPY", Kind("an array of NumPy", _ARRAY)),
    (b"\x1aE\xdf\xa3", Kind("a film (Matroska or WebM)", FILM)),
    (b"%PDF", Kind("a PDF", "give images")),
    (b"PK\x03\x04", Kind("a ZIP archive", "unpack it")),
    (b"\x1f\x8b", Kind("a gzip archive", "unpack it")),
    (b"7z\xbc\xaf", Kind("a 7z archive", "unpack it")),
    (b"\x89HDF", Kind("an HDF5 file", _ARRAY)),
    (b"version https://git-lfs", Kind("a pointer of Git LFS", "get the images with 'git lfs pull'")),
    (b"../", Kind("a text with a path, as where a link was copied", "copy the files that the links lead to")),
)
_TEXTS = (
    (b"<!doctype html", Kind("a web page", _NO_DOWNLOAD)),
    (b"<html", Kind("a web page", _NO_DOWNLOAD)),
    (b"<svg", Kind("an SVG", TO_PNG.format(suffix=".svg"))),
    (b"<?xml", Kind("an XML file", _NO_DOWNLOAD)),
    (b"{", Kind("a JSON file", _NO_DOWNLOAD)),
)
_HEIC = Kind(
    "a HEIC image, as iPhones make them",
    "convert it to JPEG (heif-convert, or magick mogrify -format jpg *.heic), or set the phone's camera to "
    "'Most Compatible'",
)
_AVIF = Kind("an AVIF image", TO_PNG.format(suffix=".avif"))
_BRANDS = {b"avif": _AVIF, b"avis": _AVIF, b"crx ": Kind("a raw image of a camera", _DEVELOP)}
_OF_HEIC = frozenset({b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"})
_OURS = (
    (b"\x89PNG", "a PNG"),
    (b"\xff\xd8\xff", "a JPEG"),
    (b"BM", "a BMP"),
    (b"II*\0", "a TIFF"),
    (b"MM\0*", "a TIFF"),
)
FOREIGN = {
    ".webp": "WebP",
    ".heic": "HEIC",
    ".heif": "HEIC",
    ".hif": "HEIC",
    ".avif": "AVIF",
    ".gif": "GIF",
    ".jp2": "JPEG 2000",
    ".j2k": "JPEG 2000",
    ".jxl": "JPEG XL",
    ".exr": "OpenEXR",
    ".hdr": "Radiance HDR",
    ".pfm": "PFM",
    ".pam": "PAM",
    ".qoi": "QOI",
    ".dng": "raw",
    ".cr2": "raw",
    ".cr3": "raw",
    ".nef": "raw",
    ".arw": "raw",
    ".orf": "raw",
    ".rw2": "raw",
    ".raf": "raw",
    ".raw": "raw",
    ".npy": "NumPy",
}
"""Images by the ends of their names that are not read, and what they are called."""


def kind_of(data: bytes) -> Kind | None:
    """What a file's content is, if that is known and no image of ours."""
    if data[:4] == b"RIFF":
        if data[8:12] == b"WEBP":
            return Kind("a WebP image", TO_PNG.format(suffix=".webp"))
        return Kind("a film (AVI)", FILM) if data[8:11] == b"AVI" else None
    if data[4:8] == b"ftyp":
        brands = {data[k : k + 4] for k in (8, *range(16, min(int.from_bytes(data[:4], "big"), 64), 4))}
        named = next((kind for brand, kind in _BRANDS.items() if brand in brands), None)
        return named or (_HEIC if brands & _OF_HEIC else Kind("a film (MP4 or MOV)", FILM))
    text = data[:64].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    return next((kind for start, kind in _STARTS if data.startswith(start)), None) or next(
        (kind for start, kind in _TEXTS if text.startswith(start)), None
    )


def ours(data: bytes) -> str | None:
    """Which image of ours a file begins as, with its article, whole or not."""
    if data[:1] == b"P" and data[1:2] and data[1:2] in b"123456":
        return "a PGM or PPM"
    return next((name for start, name in _OURS if data.startswith(start)), None)
