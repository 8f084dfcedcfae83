"""The plots of a study: error against time, marginal prices, growth. Each is an SVG in a string."""

import io
import re
from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from relight3d.evaluate.study import Study
from relight3d.evaluate.study_front import cost_of, dominated
from relight3d.evaluate.study_growth import Growth
from relight3d.evaluate.study_measure import Point
from relight3d.evaluate.study_settings import RECOVERY, RENDER

INK, FAINT, FRONT, OTHER, DEFAULT = "#1d1d20", "#8a8a90", "#c2410c", "#4b78a8", "#111111"
FONTS = ["DejaVu Sans", "sans-serif"]
AXIS = {RECOVERY: "recovery, seconds", RENDER: "frame, milliseconds"}


def error_plot(study: Study, family: str) -> str:
    """PSNR of held-out photographs against cost; the front is a line, dominated settings are hollow."""
    figure = Figure(figsize=(7.6, 4.6), layout="constrained")
    axes = figure.subplots()
    points, names = dominated(study.family(family))
    ours = [(p, by) for p, by in zip(points, names) if p.factor != "baseline"]
    others = [p for p in points if p.factor == "baseline"]
    front = [p for p, by in zip(points, names) if not by and p.factor != "baseline"]
    axes.plot([cost_of(p) for p in front], [p.psnr_db for p in front], color=FRONT, lw=1.2, zorder=1)
    for point, by in ours:
        color = DEFAULT if point.factor == "default" else OTHER if by else FRONT
        axes.plot(cost_of(point), point.psnr_db, "o", ms=6, color=color, mfc="white" if by else color)
        if family == RENDER and point.frame_low_ms and point.frame_high_ms:
            axes.plot([point.frame_low_ms, point.frame_high_ms], [point.psnr_db] * 2, color=color, lw=0.8, alpha=0.6)
    # Interpolation is fitted in no time: it stands at the rim, so that our own costs have the room.
    rim = 0.6 * min((cost_of(p) for p, _ in ours), default=1.0)
    shown = [p for p, _ in ours if p in front or p.factor == "default"]
    places = [(cost_of(p), p.psnr_db, _label_of(p)) for p in shown]
    for p in others:
        place = max(cost_of(p), rim)
        axes.plot(place, p.psnr_db, "^" if place > rim else "<", ms=7, color=FAINT)
        places.append((place, p.psnr_db, p.name if place > rim else f"{p.name} ({cost_of(p):.2g} s)"))
    axes.set_xscale("log")
    _label(axes, places)
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(AXIS[family])
    axes.set_ylabel("PSNR of held-out photographs, dB")
    axes.margins(x=0.2, y=0.1)
    return _svg(figure, axes)


def price_plot(study: Study, family: str) -> str:
    """What each single change gives up, and what it saves, against the default."""
    points = study.family(family)
    default = next((p for p in points if p.factor == "default"), None)
    single = [p for p in points if p.factor not in ("default", "combined", "baseline", "pixels")]
    if default is None or not single:
        return ""
    single.sort(key=lambda p: p.psnr_db)
    figure = Figure(figsize=(7.6, 0.24 * len(single) + 1.1), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    rows = np.arange(len(single))
    loss = [default.psnr_db - p.psnr_db for p in single]
    saved = [100 * (1 - cost_of(p) / cost_of(default)) for p in single]
    for axes, values, title in ((left, loss, "gives up, dB"), (right, saved, f"saves, % of the {family} time")):
        colors = [FRONT if v > 0 else OTHER for v in values]
        axes.barh(rows, values, color=colors, height=0.7)
        axes.axvline(0, color=INK, lw=0.8)
        axes.set_xlabel(title)
    left.set_yticks(rows, [f"{p.factor}: {p.name}" for p in single])
    left.invert_yaxis()
    return _svg(figure, left, right)


def growth_plot(growth: Sequence[Growth]) -> str:
    """Time against size on log-log axes, with the fitted exponents."""
    if not growth:
        return ""
    columns = min(3, len(growth))
    rows = -(-len(growth) // columns)
    figure = Figure(figsize=(7.6, 2.3 * rows), layout="constrained")
    grid = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axes, one in zip(grid, growth):
        x, y = np.array(one.sizes), np.array(one.times)
        axes.plot(x, y, "o", color=OTHER, ms=4.5)
        line = np.array([x.min(), x.max()])
        level = np.exp(np.mean(np.log(y)) - one.exponent * np.mean(np.log(x)))
        axes.plot(line, level * line**one.exponent, color=FRONT, lw=1)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(x, [_short(value) for value in x], fontsize=8)
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_minor_formatter(NullFormatter())
        axes.set_title(f"{one.what}, {one.against}: {one.exponent:.2f} ± {one.scatter:.2f}", fontsize=9)
    for axes in grid[len(growth) :]:
        axes.remove()
    return _svg(figure, *grid[: len(growth)])


def _short(value: float) -> str:
    """Of a size: 30,000 as 30k."""
    return f"{value / 1000:.3g}k" if value >= 1000 else f"{value:g}"


def _label_of(point: Point) -> str:
    is_clear = point.factor in ("baseline", "default", "combined", "photographs", "faces")
    return point.name if is_clear else f"{point.factor}: {point.name}"


def _label(axes: Axes, places: Sequence[tuple[float, float, str]]) -> None:
    """Names beside (cost, PSNR), one under the other where points crowd, then with a line to the point."""
    if not places:
        return
    taken: list[tuple[float, float]] = []
    height = max(y for _, y, _ in places) - min(y for _, y, _ in places) + 1e-9
    costs = np.log([max(x, 1e-6) for x, _, _ in places])
    width = float(np.ptp(costs)) + 1e-9
    for cost, psnr_db, name in sorted(places, key=lambda place: (-place[1], -place[0])):
        x, y = np.log(max(cost, 1e-6)) / width, psnr_db / height
        while any(abs(x - u) < 0.35 and abs(y - v) < 0.05 for u, v in taken):
            y -= 0.005
        taken.append((x, y))
        is_moved = psnr_db - y * height > 0.02 * height
        line = {"arrowstyle": "-", "color": FAINT, "lw": 0.6, "shrinkA": 0, "shrinkB": 4} if is_moved else None
        axes.annotate(
            name,
            (cost, psnr_db),
            xytext=(cost * np.exp(0.03 * width), y * height),
            va="center",
            fontsize=8,
            color=INK,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6},
            arrowprops=line,
        )


def _svg(figure: Figure, *all_axes: Axes) -> str:
    for axes in all_axes:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25, lw=0.5)
        axes.set_axisbelow(True)
    stream = io.StringIO()
    with rc_context({"svg.fonttype": "none", "font.family": FONTS}):  # letters, not their outlines: a tenth of the size
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = re.sub(r"<metadata>.*?</metadata>", "", stream.getvalue(), flags=re.DOTALL)
    return text[text.index("<svg") :]
