"""Several small pictures as one: contact sheets with a word above each."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

_PAPER, _INK = (250, 250, 248), (40, 42, 46)
_GAP, _STRIP = 6, 18  # pixels between pictures, and above each for its word
_LEAST_WIDTH = 150  # smaller pictures are shown in whole multiples of their size


def contact_grid(
    cells: Sequence[tuple[str, UInt8[np.ndarray, "height width 3"]]], columns: int | None = None
) -> UInt8[np.ndarray, "rows columns 3"]:
    """Pictures of one size in rows, each under its word; `columns` by default makes the sheet about 4 : 3."""
    height, width = cells[0][1].shape[:2]
    enlarged = max(1, -(-_LEAST_WIDTH // width))
    reduced = max(1, width // 320)
    size = (width * enlarged // reduced, height * enlarged // reduced)
    columns = columns or max(1, round((len(cells) * 4 / 3 * size[1] / size[0]) ** 0.5))
    columns = min(columns, len(cells))
    rows = -(-len(cells) // columns)
    step = (size[0] + _GAP, size[1] + _STRIP + _GAP)
    sheet = Image.new("RGB", (columns * step[0] + _GAP, rows * step[1] + _GAP), _PAPER)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(13)
    for index, (word, pixels) in enumerate(cells):
        left, top = _GAP + index % columns * step[0], _GAP + index // columns * step[1]
        draw.text((left, top), word, _INK, font)
        way = Image.Resampling.NEAREST if enlarged > 1 else Image.Resampling.BOX
        sheet.paste(Image.fromarray(pixels).resize(size, way), (left, top + _STRIP))
    return np.asarray(sheet)
