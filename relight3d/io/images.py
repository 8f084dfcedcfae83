"""Photographs, masks and pictures: EXR, PNG, TIFF and JPEG, told apart by their first bytes.

A photograph is read as linear float32 radiance: integers are divided by their largest value, then "srgb" files are
decoded. Negative values (noise about black) stay; NaN and infinity make a pixel invalid, as alpha 0 does.
"""

import logging
import warnings
from pathlib import Path

import imagecodecs
import numpy as np
import PIL.Image
import tifffile
from jaxtyping import Bool, Float32, UInt8, UInt16

from relight3d.errors import InputError
from relight3d.io import exr
from relight3d.io.exr import write_exr as write_exr
from relight3d.io.files import read_bytes, write_bytes
from relight3d.maths.color import linear_from_srgb

# tifffile reports damage in the log too; the InputError says it once. A program that sets up logging still hears it.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

COLOR_SPACES = ("linear", "srgb")
IMAGE_SUFFIXES = (".exr", ".png", ".tif", ".tiff", ".jpg", ".jpeg")
_FORMAT_OF_START = {
    b"\x89PNG": "png",
    b"\xff\xd8\xff": "jpeg",
    b"II*\0": "tiff",
    b"MM\0*": "tiff",
    b"II+\0": "tiff",
    b"MM\0+": "tiff",
    exr.MAGIC: "exr",
}


def image_format(path: str | Path) -> str:
    """One of "exr", "png", "tiff" and "jpeg". Raises InputError for a missing file or another format."""
    start = read_bytes(path, limit=4)
    for magic, name in _FORMAT_OF_START.items():
        if start.startswith(magic):
            return name
    got = "an empty file" if not start else "a file of another format"
    raise InputError(str(path), got, "EXR, PNG, TIFF or JPEG", "develop raw photographs to 16-bit TIFF or EXR")


def image_size(path: str | Path) -> tuple[int, int]:
    """Width and height, from the header alone. Raises InputError for a file that is no image."""
    path = Path(path)
    return _guarded(path, _SIZES[image_format(path)])


def image_bits(path: str | Path) -> int:
    """Bits a channel, from the header alone. Raises InputError for a file that is no image."""
    path = Path(path)
    return _guarded(path, _BITS[image_format(path)])


def read_image(
    path: str | Path, color_space: str = "linear"
) -> tuple[Float32[np.ndarray, "height width 3"], Bool[np.ndarray, "height width"] | None]:
    """Linear radiance, 0 where invalid, and which pixels are valid; None where all are. Grey becomes rgb.

    Raises InputError for a missing, damaged or foreign file, or an unknown colour space.
    """
    if color_space not in COLOR_SPACES:
        raise InputError("color_space", color_space, " or ".join(COLOR_SPACES))
    color, alpha = _channels(Path(path))
    if color_space == "srgb":
        color = linear_from_srgb(color)
    is_valid = np.all(np.isfinite(color), axis=-1)
    if alpha is not None:
        is_valid &= alpha > 0
    radiance = np.where(is_valid[..., None], color, np.float32(0))
    return np.ascontiguousarray(np.broadcast_to(radiance, (*is_valid.shape, 3))), None if is_valid.all() else is_valid


def read_mask(path: str | Path) -> Bool[np.ndarray, "height width"]:
    """True where any channel is above zero and alpha, if any, is too. Raises InputError as read_image does."""
    color, alpha = _channels(Path(path))
    # JPEG rings about a mask's edges: half way is the border there, zero everywhere else.
    threshold = 0.5 if image_format(path) == "jpeg" else 0.0
    is_valid = np.any(color > threshold, axis=-1)
    return is_valid if alpha is None else is_valid & (alpha > 0)


def write_png(
    path: str | Path,
    pixels: UInt8[np.ndarray, "height width *channel"] | UInt16[np.ndarray, "height width *channel"],
) -> None:
    """Write 8 or 16 bits a channel, grey, rgb or with alpha, whole or not at all; values as they are."""
    write_bytes(path, bytes(imagecodecs.png_encode(np.ascontiguousarray(pixels), level=4)))


def _channels(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Colour (1 or 3 channels) and alpha, float32 in the file's own encoding, integers divided by their largest."""
    pixels = _guarded(path, _READERS[image_format(path)])
    if pixels.dtype.kind == "u":
        pixels = pixels.astype(np.float32) / np.float32(np.iinfo(pixels.dtype).max)
    elif pixels.dtype.kind in "bf":
        pixels = pixels.astype(np.float32)
    else:
        raise InputError(str(path), f"pixels of type {pixels.dtype}", "unsigned integers or floats")
    if pixels.ndim == 2:
        pixels = pixels[..., None]
    if pixels.ndim != 3 or not 1 <= pixels.shape[2] <= 4 or pixels.size == 0:
        raise InputError(str(path), f"an array of shape {pixels.shape}", "one picture, grey or rgb, alpha or none")
    has_alpha = pixels.shape[2] in (2, 4)
    return (pixels[..., :-1], pixels[..., -1]) if has_alpha else (pixels, None)


def _guarded(path: Path, read):
    """What `read` makes of the file; whatever a decoder raises for a damaged one becomes an InputError."""
    try:
        return read(path)
    except InputError:
        raise
    except Exception as error:  # the decoders raise nearly every type there is
        reason = str(error) or type(error).__name__
        raise InputError(str(path), f"a damaged image ({reason})", "one that can be decoded") from error


def _read_png(path: Path) -> np.ndarray:
    return imagecodecs.png_decode(read_bytes(path))


def _read_jpeg(path: Path) -> np.ndarray:
    with _open_jpeg(path) as image:
        return np.asarray(image if image.mode in ("L", "RGB") else image.convert("RGB"))


def _open_jpeg(path: Path) -> PIL.Image.Image:
    with warnings.catch_warnings():  # Pillow warns of more than 89 megapixels; photographs may be that large
        warnings.simplefilter("ignore", PIL.Image.DecompressionBombWarning)
        return PIL.Image.open(path, formats=["JPEG"])


def _read_tiff(path: Path) -> np.ndarray:
    """The first page, channels last; extra channels that are not alpha are left out."""
    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        if page.photometric.name not in ("MINISBLACK", "RGB", "YCBCR"):
            raise InputError(str(path), f"a TIFF of the kind {page.photometric.name}", "grey or rgb")
        if page.bitspersample not in (1, 8, 16, 32):
            raise InputError(str(path), f"{page.bitspersample} bits a channel", "8, 16 or 32")
        pixels = page.asarray()
        if page.axes == "SYX":
            pixels = np.moveaxis(pixels, 0, -1)
        num_colors = 1 if page.photometric.name == "MINISBLACK" else 3
        has_alpha = len(page.extrasamples) > 0 and page.extrasamples[0] in (1, 2)
    return pixels if pixels.ndim == 2 else pixels[..., : num_colors + has_alpha]


def _png_size(path: Path) -> tuple[int, int]:
    start = read_bytes(path, limit=25)
    if len(start) < 25 or start[12:16] != b"IHDR":
        raise InputError(str(path), "a PNG file that is cut short", "a whole one; copy it again")
    return int.from_bytes(start[16:20], "big"), int.from_bytes(start[20:24], "big")


def _png_bits(path: Path) -> int:
    _png_size(path)  # refuses a file that is cut short
    return read_bytes(path, limit=25)[24]


def _tiff_bits(path: Path) -> int:
    with tifffile.TiffFile(path) as file:
        return int(file.pages.first.bitspersample)


def _jpeg_size(path: Path) -> tuple[int, int]:
    with _open_jpeg(path) as image:
        return image.size


def _tiff_size(path: Path) -> tuple[int, int]:
    with tifffile.TiffFile(path) as file:
        return file.pages.first.imagewidth, file.pages.first.imagelength


_READERS = {"exr": exr.read_exr, "png": _read_png, "jpeg": _read_jpeg, "tiff": _read_tiff}
_SIZES = {"exr": exr.exr_size, "png": _png_size, "jpeg": _jpeg_size, "tiff": _tiff_size}
_BITS = {"exr": lambda path: 16, "png": _png_bits, "jpeg": lambda path: 8, "tiff": _tiff_bits}
