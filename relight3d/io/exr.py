"""OpenEXR files, by the official binding: float and half, RGB, RGBA and Y.

The binding reports damage on the terminal and then hands back a file without parts, so whether a file is whole is
asked first, from its header and its table of chunks.
"""

import mmap
import struct
from pathlib import Path

import numpy as np
import OpenEXR

from relight3d.errors import InputError
from relight3d.io.files import atomic_path

MAGIC = b"\x76\x2f\x31\x01"
_IS_TILED, _IS_DEEP, _IS_MULTIPART = 0x200, 0x800, 0x1000
# Rows in a chunk by the header's number of the compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A, DWAA, DWAB.
_ROWS_IN_CHUNK = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256)
_HALF_MAX = 65504.0


def exr_size(path: Path) -> tuple[int, int]:
    """Width and height of the pixels in the file, from its header. Raises InputError for a damaged file."""
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as raw:
        return _size(_header(raw, path)[0])


def read_exr(path: Path) -> np.ndarray:
    """The pixels as stored, with 1, 3 or 4 (alpha last) channels as the last axis.

    Raises InputError for a file that is cut short or damaged, or that has neither R, G, B nor Y.
    """
    _require_whole(path)
    try:
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
    except (RuntimeError, ValueError) as error:
        raise InputError(str(path), f"a damaged EXR file ({error})", "an EXR file that can be decoded") from error
    for names in ("RGBA", "RGB", "Y"):
        if all(name in channels for name in names) and "RY" not in channels:  # RY, BY: colour kept as differences
            planes = [np.asarray(channels[name].pixels, dtype=np.float32) for name in names]
            if any(plane.shape != planes[0].shape for plane in planes):
                raise InputError(str(path), "channels of unequal size", "R, G and B sampled alike")
            return np.stack(planes, axis=-1)
    raise InputError(str(path), f"the channels {', '.join(sorted(channels))}", "R, G and B (and A), or Y")


def write_exr(path: str | Path, array: np.ndarray, half: bool = False) -> None:
    """Write (height, width) as Y or (height, width, 3) as RGB, ZIP-compressed, whole or not at all.

    `half` keeps 11 bits of precision; what exceeds its largest number, 65504, is stored as that.
    """
    pixels = np.asarray(array, dtype=np.float32)
    assert pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3), pixels.shape
    if half:
        pixels = np.clip(pixels, -_HALF_MAX, _HALF_MAX).astype(np.float16)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {"Y" if pixels.ndim == 2 else "RGB": np.ascontiguousarray(pixels)}
    with atomic_path(path) as temporary:
        try:
            OpenEXR.File(header, channels).write(str(temporary))
        except RuntimeError as error:
            raise InputError(str(path), error, "a place that can be written") from error


def _require_whole(path: Path) -> None:
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as raw:
        header, end, flags = _header(raw, path)
        compression = header["compression"][0]
        if flags & (_IS_TILED | _IS_MULTIPART) or compression >= len(_ROWS_IN_CHUNK):
            return  # their tables differ; the binding's own word will do
        count = -(-_size(header)[1] // _ROWS_IN_CHUNK[compression])
        try:
            for place in struct.unpack_from(f"<{count}Q", raw, end):
                (length,) = struct.unpack_from("<i", raw, place + 4)
                if not 0 <= length <= len(raw) - place - 8:
                    raise ValueError
        except (struct.error, ValueError, OverflowError) as error:
            raise InputError(str(path), "an EXR file that is cut short", "a whole one; copy it again") from error


def _header(raw: "mmap.mmap", path: Path) -> tuple[dict[str, bytes], int, int]:
    """The attributes of the (first) header by name, where it ends, and the version's flags."""
    attributes: dict[str, bytes] = {}
    try:
        (flags,) = struct.unpack_from("<I", raw, 4)
        at = 8
        while raw[at] != 0:  # name, 0, type, 0, length, value
            name_end = raw.find(b"\0", at)
            type_end = raw.find(b"\0", name_end + 1)
            (length,) = struct.unpack_from("<i", raw, type_end + 1)
            if min(name_end, type_end, length) < 0:
                raise ValueError
            attributes[raw[at:name_end].decode("latin-1")] = raw[type_end + 5 : type_end + 5 + length]
            at = type_end + 5 + length
        if len(attributes["dataWindow"]) != 16 or len(attributes["compression"]) != 1:
            raise ValueError
    except (struct.error, IndexError, KeyError, ValueError) as error:
        raise InputError(str(path), "a damaged EXR header", "an EXR file that can be decoded") from error
    if flags & _IS_DEEP:
        raise InputError(str(path), "a deep EXR file", "one colour a pixel; flatten it")
    return attributes, at + 1, flags


def _size(header: dict[str, bytes]) -> tuple[int, int]:
    left, top, right, bottom = struct.unpack("<4i", header["dataWindow"])
    return max(0, right - left + 1), max(0, bottom - top + 1)
