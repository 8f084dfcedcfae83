"""Figure 4 of the paper again: a highlight on a surface with relief, without detail, with it, and the photograph."""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from accuracy.frames import Shot, Truth
from accuracy.measure import BORDER_PX
from accuracy.rows import Found
from relight3d.evaluate.metrics import display_values
from relight3d.records import RelightModel
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter

STRONG = 0.5  # of the lobes' largest radiance in the frame: the highlight region
SCALE, GAP, LABEL, GAIN = 2, 8, 24, 4
CROP_PX = (140, 200)  # at most, rows and columns
PAPER, INK = (250, 250, 248), (28, 28, 30)


class Relief:
    """The highlight region of every shot with one light, and the frames of both models there."""

    def __init__(
        self, plain: RelightModel, detailed: RelightModel, shots: list[Shot], truth: Truth, exposure: float
    ) -> None:
        self.shots = [shot for shot in shots if len(shot.lights) == 1]
        self.exposure = exposure
        has_relief = [key for key, each in truth.surfaces.items() if each["has_relief"]]
        on_surface = np.isin(truth.label, has_relief)
        self.regions = [_region(plain, shot, on_surface) for shot in self.shots]
        off = RelightOptions(residual=False)
        self.frames = {
            "without": self._frames(plain, RelightOptions()),
            "with": self._frames(detailed, RelightOptions()),
            "without, no residual": self._frames(plain, off),
            "with, no residual": self._frames(detailed, off),
            "switched off": self._frames(detailed, RelightOptions(detail=False)),
        }

    def _frames(self, model: RelightModel, options: RelightOptions) -> list[np.ndarray]:
        relighter = Relighter(model, options=options)
        return [display_values(relighter.render(list(shot.lights)).radiance, self.exposure) for shot in self.shots]

    def wanted(self, index: int) -> np.ndarray:
        return display_values(self.shots[index].wanted, self.exposure)

    def errors(self) -> Found:
        """Errors over the regions, and over what of them is clear of shadow borders and outlines."""
        clear = [ndimage.binary_erosion(region, iterations=BORDER_PX) for region in self.regions]
        names = [shot.name for shot in self.shots]
        return {"names": names, "region": self._errors(self.regions), "clear": self._errors(clear)}

    def _errors(self, regions: list[np.ndarray]) -> Found:
        """Root mean square of display values over all shots together and shot by shot, and the sizes."""
        found: Found = {"pixels": [int(region.sum()) for region in regions], "frames": {}, "all": {}}
        for name, frames in self.frames.items():
            squares = [(frames[k] - self.wanted(k))[region] ** 2 for k, region in enumerate(regions)]
            found["frames"][name] = [float(np.sqrt(each.mean())) if each.size else None for each in squares]
            together = np.concatenate(squares)
            found["all"][name] = float(np.sqrt(together.mean())) if together.size else None
        return found

    def picture(self, path: Path) -> str:
        """A crop of the largest region, as a PNG with a palette; the name of its shot."""
        index = int(np.argmax([region.sum() for region in self.regions]))
        crop = _crop(self.regions[index])
        plain, detailed = (self.frames[name][index][crop] for name in ("without", "with"))
        photograph = self.wanted(index)[crop]
        rows = [
            [("without detail", plain), ("with detail", detailed), ("photograph", photograph)],
            [
                (f"without: difference x {GAIN}", _difference(plain, photograph)),
                (f"with: difference x {GAIN}", _difference(detailed, photograph)),
                ("where the lobe is strong", np.repeat(self.regions[index][crop][..., None], 3, axis=2) * 0.8),
            ],
        ]
        path.parent.mkdir(parents=True, exist_ok=True)
        _sheet(rows).quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
        return self.shots[index].name


def _region(plain: RelightModel, shot: Shot, on_surface: np.ndarray) -> np.ndarray:
    """Pixels of the surface where the smooth model's lobes are strong in this frame."""
    specular = Relighter(plain).render(list(shot.lights)).terms.specular
    if specular is None:
        return np.zeros(on_surface.shape, bool)
    shine = specular.mean(axis=-1) * (on_surface & shot.mask)
    return (shine > STRONG * shine.max()) & (shine > 0)


def _crop(region: np.ndarray) -> tuple[slice, slice]:
    """About the region's middle, within the picture."""
    starts = [
        int(np.clip(round(float(places.mean())) - most // 2, 0, max(0, size - most)))
        for places, most, size in zip(np.nonzero(region), CROP_PX, region.shape)
    ]
    return slice(starts[0], starts[0] + CROP_PX[0]), slice(starts[1], starts[1] + CROP_PX[1])


def _difference(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.clip(GAIN * np.abs(one - other), 0, 1)


def _sheet(rows: list[list[tuple[str, np.ndarray]]]) -> Image.Image:
    height, width = (SCALE * size for size in rows[0][0][1].shape[:2])
    size = (GAP + len(rows[0]) * (width + GAP), GAP + len(rows) * (height + LABEL))
    sheet = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(sheet)
    for row, tiles in enumerate(rows):
        for column, (title, values) in enumerate(tiles):
            tile = Image.fromarray(np.rint(np.asarray(values, float) * 255).astype(np.uint8))
            x, y = GAP + column * (width + GAP), GAP + row * (height + LABEL)
            sheet.paste(tile.resize((width, height), Image.Resampling.NEAREST), (x, y))
            draw.text((x, y + height + 3), title, INK, ImageFont.load_default(14))
    return sheet
