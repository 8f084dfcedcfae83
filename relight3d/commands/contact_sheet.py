"""A contact sheet: for several held-out photographs, what the model makes of their lights, and the difference."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8
from PIL import Image, ImageDraw, ImageFont

from relight3d.evaluate.metrics import display_values, psnr_db
from relight3d.evaluate.run import Evaluation, relighters
from relight3d.io.capture import read_photograph
from relight3d.records import Capture, Photograph, RelightModel
from relight3d.relight.relighter import Relighter

DIFFERENCE_GAIN = 4  # the difference of display values is shown so many times as large
GAP, HEADER, LABEL = 10, 58, 26  # pixels
PAPER, INK, FAINT = (250, 250, 248), (28, 28, 30), (120, 120, 124)


@dataclass(frozen=True, eq=False)
class Strip:
    """One row of the sheet: display values of the relit frame and the photograph, black where the mesh is not."""

    title: str
    relit: Float32[np.ndarray, "height width 3"]
    photograph: Float32[np.ndarray, "height width 3"]
    psnr_db: float


def strips(model: RelightModel, capture: Capture, evaluation: Evaluation, num: int = 6) -> list[Strip]:
    """Strips for the worst frame and for others, of every group, evenly through the split."""
    photographs = capture.split(evaluation.split)
    by_group: dict[str, list[Photograph]] = {}
    for photograph in photographs:
        by_group.setdefault(photograph.group, []).append(photograph)
    share = max(1, num // len(by_group))
    chosen = {evaluation.model.worst.name}
    for members in by_group.values():
        places = np.linspace(0, len(members) - 1, min(share, len(members)))
        chosen |= {members[int(place)].name for place in places.round()}
    shown, relighter_at = [p for p in photographs if p.name in chosen], relighters(model)
    return [_strip(relighter_at(p.camera), capture, p, evaluation.exposure) for p in shown]


def contact_sheet(title: str, rows: Sequence[Strip]) -> UInt8[np.ndarray, "rows columns 3"]:
    """The sheet: a row for each strip, with relit frame, photograph and the difference times DIFFERENCE_GAIN."""
    scale = max(1, round(360 / max(row.relit.shape[1] for row in rows)))  # tiny pictures are shown larger
    widths = max(row.relit.shape[1] for row in rows) * scale
    heights = [row.relit.shape[0] * scale for row in rows]
    size = (3 * widths + 4 * GAP, HEADER + sum(heights) + len(rows) * LABEL + GAP)
    sheet = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((GAP, 8), title, INK, _font(18))
    columns = ("relit", "photograph", f"difference x {DIFFERENCE_GAIN}")
    for column, name in enumerate(columns):
        draw.text((GAP + column * (widths + GAP), 35), name, FAINT, _font(14))
    y = HEADER
    for row, height in zip(rows, heights):
        difference = np.clip(DIFFERENCE_GAIN * np.abs(row.relit - row.photograph), 0.0, 1.0)
        for column, picture in enumerate((row.relit, row.photograph, difference)):
            sheet.paste(_image(picture, scale), (GAP + column * (widths + GAP), y))
        draw.text((GAP, y + height + 3), row.title, INK, _font(13))
        draw.text((GAP + 2 * (widths + GAP), y + height + 3), f"{row.psnr_db:.1f} dB", INK, _font(13))
        y += height + LABEL
    return np.asarray(sheet)


def _strip(relighter: Relighter, capture: Capture, photograph: Photograph, exposure: float) -> Strip:
    frame = relighter.render(list(photograph.lights))
    radiance, is_valid = read_photograph(capture, photograph)
    mask = is_valid & frame.is_hit
    relit, wanted = (
        display_values(np.where(mask[..., None], picture, np.float32(0)), exposure)
        for picture in (frame.radiance, radiance)
    )
    words = [photograph.name, photograph.group.replace("_", " ")]
    return Strip("  ".join(word for word in words if word), relit, wanted, psnr_db(relit[mask], wanted[mask]))


def _image(values: np.ndarray, scale: int) -> Image.Image:
    image = Image.fromarray(np.rint(values * 255).astype(np.uint8))
    return image.resize((image.width * scale, image.height * scale), Image.Resampling.NEAREST)


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)  # Pillow brings it, so the sheet looks the same everywhere
