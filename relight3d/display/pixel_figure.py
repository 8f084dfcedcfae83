"""The figure of a pixel's report."""

import textwrap

import numpy as np
from jaxtyping import UInt8
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from relight3d.display.layer_figure import FAINT, INK
from relight3d.display.pixel_report import PixelReport
from relight3d.maths.color import luminance

_CHANNELS = (("red", "#d1495b"), ("green", "#3f9b6b"), ("blue", "#3a6ea5"))
_TERM_COLORS = {"indirect": "#b9c4d6", "direct": "#f2cf7d", "specular": "#e79b6a", "mirror": "#9cc5b0"}


def figure_of(report: PixelReport) -> Figure:
    """Colours on top, what they are the sum of below, parameters to the right."""
    lines = [(word, part) for word, text in report.parameters for part in textwrap.wrap(text, 44)]
    figure = Figure(figsize=(9.6, max(5.2, 1.0 + 0.2 * len(lines))), dpi=110, facecolor="white")
    title = f"Pixel ({report.x}, {report.y}) on {report.surface}"
    figure.text(0.05, 0.955, title, fontsize=13, weight="bold", color=INK, va="center")
    top = figure.add_axes((0.07, 0.53, 0.51, 0.36))
    bottom = figure.add_axes((0.07, 0.11, 0.51, 0.34), sharex=top)
    _draw_colors(top, report)
    _draw_terms(bottom, report)
    y, last = 0.9, ""
    for word, part in lines:
        figure.text(0.62, y, "" if word == last else word, fontsize=8.5, color=FAINT, va="top")
        figure.text(0.70, y, part, fontsize=8.5, color=INK, va="top")
        y, last = y - 0.2 / figure.get_figheight(), word
    return figure


def chart_of(report: PixelReport, width_px: int) -> UInt8[np.ndarray, "rows columns 3"]:
    """The colours alone, as a small picture for a panel."""
    dpi = 100
    figure = Figure(figsize=(width_px / dpi, chart_height(width_px) / dpi), dpi=dpi, facecolor="white")
    _draw_colors(figure.add_axes((0.17, 0.1, 0.81, 0.87)), report)
    return pixels_of(figure)


def chart_height(width_px: int) -> int:
    """How high `chart_of` is."""
    return round(0.62 * width_px)


def pixels_of(figure: Figure) -> UInt8[np.ndarray, "rows columns 3"]:
    """A figure drawn into an array, without any window system."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _draw_colors(axes: Axes, report: PixelReport) -> None:
    order, place = report.order, np.arange(len(report.order))
    for channel, (name, color) in enumerate(_CHANNELS):
        axes.plot(place, report.predicted[order, channel], color=color, linewidth=1.6, label=f"model, {name}")
        axes.plot(place, report.measured[order, channel], "o", color=color, markersize=4, alpha=0.85)
    axes.plot([], [], "o", color=FAINT, markersize=4, label="photograph")
    _finish(axes, report, "radiance")
    axes.tick_params(labelbottom=False)


def _draw_terms(axes: Axes, report: PixelReport) -> None:
    order, place = report.order, np.arange(len(report.order))
    if report.terms:
        parts = [luminance(values)[order] for values in report.terms.values()]
        colors = [_TERM_COLORS[name] for name in report.terms]
        axes.stackplot(place, parts, colors=colors, labels=list(report.terms), linewidth=0)
    axes.plot(place, luminance(report.predicted)[order], color=INK, linewidth=1.2, label="model")
    axes.plot(place, luminance(report.measured)[order], "o", color=INK, markersize=4, label="photograph")
    _finish(axes, report, "luminance")
    axes.set_xlabel(
        "photographs, brightest first by the model (grey: its light is not seen here)", fontsize=8.5, color=INK
    )


def _finish(axes: Axes, report: PixelReport, label: str) -> None:
    for place, photo in enumerate(report.order):
        if not report.is_lit[photo]:
            axes.axvspan(place - 0.5, place + 0.5, color="#eceef1", zorder=0, linewidth=0)
    axes.set_xlim(-0.5, len(report.order) - 0.5)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(label, fontsize=8.5, color=INK)
    axes.tick_params(labelsize=8, colors=FAINT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7.5, frameon=False, ncols=2)
