"""A layer as a matplotlib Figure: the picture, its title and caption, and its legend."""

import textwrap

from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from relight3d.display.pictures import Layer

INK, FAINT = "#26282c", "#6b6f76"
_WIDTH = 7.2  # inches


def figure_of(layer: Layer) -> Figure:
    """The figure, made without pyplot, so nothing is kept and no screen is needed."""
    rows, columns, _ = layer.image.shape
    picture_height = (_WIDTH - 0.4) * rows / columns
    note = textwrap.wrap(layer.note, 105)
    legend_rows = -(-len(layer.legend) // 2)
    below = 0.12 + 0.2 * len(note) + (0.62 if layer.scale else 0.0) + 0.24 * legend_rows
    height = 0.75 + picture_height + below
    figure = Figure(figsize=(_WIDTH, height), dpi=120, facecolor="white")
    figure.text(0.2 / _WIDTH, 1 - 0.3 / height, layer.title, fontsize=14, color=INK, weight="bold", va="center")
    figure.text(0.2 / _WIDTH, 1 - 0.56 / height, layer.caption, fontsize=9.5, color=FAINT, va="center")
    axes = figure.add_axes((0.2 / _WIDTH, below / height, (_WIDTH - 0.4) / _WIDTH, picture_height / height))
    axes.imshow(layer.image, interpolation="nearest" if columns < 500 else "antialiased", aspect="auto")
    axes.set_axis_off()
    top = below - 0.1
    for line in note:
        figure.text(0.2 / _WIDTH, (top - 0.1) / height, line, fontsize=8.5, color=INK, va="center")
        top -= 0.2
    if layer.scale is not None:
        bar = figure.add_axes((0.35 / _WIDTH, (top - 0.2) / height, 3.0 / _WIDTH, 0.12 / height))
        norm = Normalize(layer.scale.low, layer.scale.high)
        colors = ScalarMappable(norm, layer.scale.colormap)
        figure.colorbar(colors, cax=bar, orientation="horizontal", ticks=MaxNLocator(4))
        bar.tick_params(labelsize=8, colors=FAINT, length=2)
        figure.text(3.65 / _WIDTH, (top - 0.14) / height, layer.scale.label, fontsize=8.5, color=INK, va="center")
        top -= 0.62
    if layer.legend:
        handles = [Patch(color=_unit_color(swatch.color), label=swatch.label) for swatch in layer.legend]
        place = (0.15 / _WIDTH, top / height)
        figure.legend(
            handles=handles, loc="upper left", bbox_to_anchor=place, ncols=2, frameon=False, fontsize=8.5,
            handlelength=1.1, handleheight=1.0, labelcolor=INK, borderpad=0.1,
        )  # fmt: skip
    return figure


def _unit_color(color: tuple[int, int, int]) -> tuple[float, float, float]:
    red, green, blue = color
    return red / 255, green / 255, blue / 255
