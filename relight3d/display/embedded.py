"""Pictures inside HTML, as data addresses: a page that carries them needs no other file and no network."""

import base64
import io

import numpy as np
from jaxtyping import UInt8
from PIL import Image

MAX_WIDTH = 1200  # pixels: a page is for looking, the files are for measuring


def photo_address(pixels: UInt8[np.ndarray, "rows columns 3"], max_width: int = MAX_WIDTH) -> str:
    """A photograph or relit frame, as JPEG of high quality."""
    return _address(_reduced(pixels, max_width), "JPEG", quality=92, subsampling=0)


def chart_address(pixels: UInt8[np.ndarray, "rows columns 3"], max_width: int = MAX_WIDTH) -> str:
    """A picture of flat colours or numbers, as PNG: every pixel as it is, of few colours with a palette."""
    image = _reduced(pixels, max_width)
    colors = image.getcolors(256)
    if colors is not None:
        image = image.convert("P", palette=Image.Palette.ADAPTIVE, colors=256)
    return _address(image, "PNG", optimize=True)


def file_address(data: bytes, kind: str) -> str:
    """A file's bytes under a MIME type."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _reduced(pixels: np.ndarray, max_width: int) -> Image.Image:
    image = Image.fromarray(np.ascontiguousarray(pixels))
    if image.width > max_width:
        height = max(1, round(image.height * max_width / image.width))
        image = image.resize((max_width, height), Image.Resampling.BOX)
    return image


def _address(image: Image.Image, encoding: str, **options) -> str:
    stream = io.BytesIO()
    image.save(stream, encoding, **options)
    return file_address(stream.getvalue(), f"image/{encoding.lower()}")
