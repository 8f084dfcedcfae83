"""What a layer is, and how numbers become its colours. The same few colours mean the same thing in every picture."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Shaped, UInt8

from relight3d.records import RelightModel

EMPTY = (27, 29, 33)  # where the mesh is not
DULL = (58, 61, 67)  # where the mesh is, and what the layer shows is not
UNKNOWN = (112, 116, 124)  # where nothing is known
GOOD, FAIR, WEAK, BAD = (46, 160, 134), (236, 200, 84), (236, 138, 62), (205, 62, 78)  # how far to trust an answer
LIT, SHADOWED = (255, 207, 92), (86, 140, 235)

# Okabe and Ito's colours, which the colour-blind tell apart too, and a few more of their kind.
_CATEGORIES = (
    (86, 180, 233),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (240, 228, 66),
    (0, 114, 178),
    (213, 94, 0),
    (170, 170, 170),
    (140, 200, 120),
    (150, 110, 200),
    (110, 75, 50),
    (250, 170, 170),
)


@dataclass(frozen=True)
class Swatch:
    """One line of a legend: what a colour means."""

    color: tuple[int, int, int]
    label: str


@dataclass(frozen=True)
class Scale:
    """The legend of numbers: a colour map (matplotlib's name) from `low` to `high`."""

    colormap: str
    low: float
    high: float
    label: str  # what is measured, with its unit


@dataclass(frozen=True, eq=False, kw_only=True)
class Painting:
    """A picture and its legend.

    `values` are the numbers behind the colours, NaN (or -1) where there are none; None where the picture is all there
    is. `note` is what this one picture has to say beyond its layer's caption.
    """

    image: UInt8[np.ndarray, "rows columns 3"]
    legend: tuple[Swatch, ...] = ()
    scale: Scale | None = None
    values: Shaped[np.ndarray, "*axes"] | None = None
    note: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Layer(Painting):
    """An inspection layer: a picture, and all that is needed to read it."""

    name: str
    title: str
    caption: str

    def figure(self):
        """The picture with its title and legend, as a matplotlib Figure."""
        from relight3d.display.layer_figure import figure_of

        return figure_of(self)

    def __repr__(self) -> str:
        rows, columns, _ = self.image.shape
        return f"Layer({self.name!r}, {columns}x{rows} px, {self.title!r})"


def category_color(index: int) -> tuple[int, int, int]:
    """The colour of the index-th of any number of categories; they repeat darker after the first dozen."""
    color = np.array(_CATEGORIES[index % len(_CATEGORIES)])
    shade = 0.72 ** (index // len(_CATEGORIES) % 4)
    red, green, blue = (int(c) for c in np.rint(color * shade))
    return red, green, blue


def image_of_points(
    model: RelightModel, values: Shaped[np.ndarray, "point *channel"], empty: float | int | bool = np.nan
) -> Shaped[np.ndarray, "height width *channel"]:
    """Values of the captured view's points as a picture, `empty` (of the values' own type) where no point is."""
    image = np.full((model.camera.num_pixels, *values.shape[1:]), empty, values.dtype)
    image[model.pixels.points.pixel] = values
    return image.reshape(model.camera.height, model.camera.width, *values.shape[1:])


def paint_numbers(values: Float[np.ndarray, "rows columns"], scale: Scale) -> UInt8[np.ndarray, "rows columns 3"]:
    """Numbers by their scale's colour map; NaN is painted as nothing known."""
    from matplotlib import colormaps

    span = scale.high - scale.low
    place = np.clip((values - scale.low) / (span if span > 0 else 1.0), 0.0, 1.0)
    colors = colormaps[scale.colormap](np.nan_to_num(place))[..., :3]
    painted = np.rint(colors * 255).astype(np.uint8)
    painted[np.isnan(values)] = EMPTY
    return painted


def painted_numbers(
    values: Float[np.ndarray, "rows columns"], colormap: str, low: float, high: float, label: str, note: str = ""
) -> Painting:
    """Numbers as a picture with their scale."""
    scale = Scale(colormap, low, high, label)
    return Painting(image=paint_numbers(values, scale), scale=scale, values=values, note=note)


def painted_categories(
    index: Shaped[np.ndarray, "rows columns"], legend: tuple[Swatch, ...], note: str = ""
) -> Painting:
    """Each pixel in the colour of its line of the legend; a negative index is painted as no mesh.

    Lines that no pixel has are left out of the legend.
    """
    colors = np.array([EMPTY, *(swatch.color for swatch in legend)], np.uint8)
    present = set(np.unique(index).tolist())
    shown = tuple(swatch for number, swatch in enumerate(legend) if number in present)
    return Painting(image=colors[np.maximum(index, -1) + 1], legend=shown, values=index, note=note)


def paint_on_empty(
    image: UInt8[np.ndarray, "rows columns 3"], is_there: Shaped[np.ndarray, "rows columns"]
) -> UInt8[np.ndarray, "rows columns 3"]:
    """The picture where the mesh is, and the colour of no mesh elsewhere."""
    return np.where(is_there[..., None], image, np.array(EMPTY, np.uint8)).astype(np.uint8)


def upper_limit(values: Float[np.ndarray, "*axes"], quantile: float = 0.99, least: float = 1e-6) -> float:
    """A round number (1, 2 or 5 times a power of ten) that holds most of the values: the end of a scale."""
    finite = values[np.isfinite(values)]
    top = max(float(np.quantile(finite, quantile)) if finite.size else least, least)
    decade = 10.0 ** np.floor(np.log10(top))
    return float(decade * next(step for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= top * (1 - 1e-9)))


def hit_mask(model: RelightModel) -> np.ndarray:
    """Where the captured view hits the mesh."""
    is_hit = np.zeros(model.camera.num_pixels, bool)
    is_hit[model.pixels.points.pixel] = True
    return is_hit.reshape(model.camera.height, model.camera.width)
