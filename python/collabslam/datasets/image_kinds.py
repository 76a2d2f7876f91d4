"""What a file is that is no image of ours, by its first bytes: what an error calls it, and what to do."""

from __future__ import annotations

from typing import NamedTuple

TO_PNG = "convert it to PNG (ffmpeg -i IN OUT.png, or magick mogrify -format png *{suffix})"
_DEVELOP = "develop it to PNG or JPEG with the camera's own program"
FILM = "give the film in place of a folder of images"
_ARRAY = "write the array as a PNG file (cv2.imwrite)"
_NO_DOWNLOAD = "download it again: what came is not the image"


class Kind(NamedTuple):
    """Files of one kind.

    Attributes
    ----------
    name : str
        As a person calls one, with its article.
    remedy : str
        What to do, a part of a sentence.
    short : str
        What many of them are called.
    suffixes : tuple of str
        How the names of images of this kind end.
    starts : tuple of bytes
        How their content begins, where that alone tells them.
    """

    name: str
    remedy: str
    short: str = ""
    suffixes: tuple[str, ...] = ()
    starts: tuple[bytes, ...] = ()


def _picture(short: str, *suffixes: str, starts: tuple[bytes, ...] = ()) -> Kind:
    """An image that other programs read."""
    article = "an" if short[0] in "AEIO" else "a"
    return Kind(f"{article} {short} image", TO_PNG.format(suffix=suffixes[0]), short, suffixes, starts)


_WEBP, _AVIF = _picture("WebP", ".webp"), _picture("AVIF", ".avif")
_HEIC = Kind(
    "a HEIC image, as iPhones make them",
    "convert it to JPEG (heif-convert, or magick mogrify -format jpg *.heic), or set the phone's camera to "
    "'Most Compatible'",
    "HEIC",
    (".heic", ".heif", ".hif"),
)
_RAW = Kind(
    "a raw image of a camera",
    _DEVELOP,
    "raw",
    (".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf", ".raw"),
    (b"IIU\0", b"IIRO", b"FUJIFILM"),
)
_KINDS = (
    _WEBP,
    _AVIF,
    _HEIC,
    _RAW,
    _picture("GIF", ".gif", starts=(b"GIF8",)),
    _picture("JPEG 2000", ".jp2", ".j2k", starts=(b"\0\0\0\x0cjP  ", b"\xff\x4f\xff\x51")),
    _picture("JPEG XL", ".jxl", starts=(b"\0\0\0\x0cJXL ", b"\xff\x0a")),
    _picture("OpenEXR", ".exr", starts=(b"v/1\x01",)),
    _picture("Radiance HDR", ".hdr", starts=(b"#?RADIANCE", b"#?RGBE")),
    _picture("PAM", ".pam", starts=(b"P7",)),
    _picture("PFM", ".pfm", starts=(b"PF", b"Pf")),
    _picture("QOI", ".qoi", starts=(b"qoif",)),
    Kind("an array of NumPy", _ARRAY, "NumPy", (".npy",), (b"\x93NUMPY",)),
    Kind("a BigTIFF", TO_PNG.format(suffix=".tif"), starts=(b"II+\0", b"MM\0+")),
    Kind("a Photoshop file", TO_PNG.format(suffix=".psd"), starts=(b"8BPS",)),
    Kind("an icon", TO_PNG.format(suffix=".ico"), starts=(b"\0\0\x01\0",)),
    Kind("a film (Matroska or WebM)", FILM, starts=(b"\x1aE\xdf\xa3",)),
    Kind("a PDF", "give images", starts=(b"%PDF",)),
    Kind("a ZIP archive", "unpack it", starts=(b"PK\x03\x04",)),
    Kind("a gzip archive", "unpack it", starts=(b"\x1f\x8b",)),
    Kind("a 7z archive", "unpack it", starts=(b"7z\xbc\xaf",)),
    Kind("an HDF5 file", _ARRAY, starts=(b"\x89HDF",)),
    Kind("a pointer of Git LFS", "get the images with 'git lfs pull'", starts=(b"version https://git-lfs",)),
    Kind(
        "a text with a path, as where a link was copied",
        "copy the files that the links lead to",
        starts=(b"../",),
    ),
)
FOREIGN = {suffix: kind.short for kind in _KINDS for suffix in kind.suffixes}
"""Images by the ends of their names that are not read, and what they are called."""
_TEXTS = (
    (b"<!doctype html", Kind("a web page", _NO_DOWNLOAD)),
    (b"<html", Kind("a web page", _NO_DOWNLOAD)),
    (b"<svg", Kind("an SVG", TO_PNG.format(suffix=".svg"))),
    (b"<?xml", Kind("an XML file", _NO_DOWNLOAD)),
    (b"{", Kind("a JSON file", _NO_DOWNLOAD)),
)
_BRANDS = {b"avif": _AVIF, b"avis": _AVIF, b"crx ": _RAW}
_OF_HEIC = frozenset({b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"})
_OURS = (
    (b"\x89PNG", "a PNG"),
    (b"\xff\xd8\xff", "a JPEG"),
    (b"BM", "a BMP"),
    (b"II*\0", "a TIFF"),
    (b"MM\0*", "a TIFF"),
)


def kind_of(data: bytes) -> Kind | None:
    """What a file's content is, if that is known and no image of ours."""
    if data[:4] == b"RIFF":
        if data[8:12] == b"WEBP":
            return _WEBP
        return Kind("a film (AVI)", FILM) if data[8:11] == b"AVI" else None
    if data[4:8] == b"ftyp":
        brands = {data[k : k + 4] for k in (8, *range(16, min(int.from_bytes(data[:4], "big"), 64), 4))}
        named = next((kind for brand, kind in _BRANDS.items() if brand in brands), None)
        return named or (_HEIC if brands & _OF_HEIC else Kind("a film (MP4 or MOV)", FILM))
    text = data[:64].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    return next((kind for kind in _KINDS if data.startswith(kind.starts)), None) or next(
        (kind for start, kind in _TEXTS if text.startswith(start)), None
    )


def ours(data: bytes) -> str | None:
    """Which image of ours a file begins as, with its article, whole or not."""
    if data[:1] == b"P" and data[1:2] and data[1:2] in b"123456":
        return "a PGM or PPM"
    return next((name for start, name in _OURS if data.startswith(start)), None)
