"""Which settings are worth choosing: costs on one clock, and the points that no other dominates."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from relight3d.evaluate.study_measure import NUM_REPEATS, Point
from relight3d.evaluate.study_settings import RECOVERY, RENDER

SAME_DB = 0.01  # figures that differ by less are the same
COSTS = {RECOVERY: "recovery_s", RENDER: "frame_ms"}


def key_of(point: Point) -> tuple[str, str, str]:
    return point.family, point.factor, point.name


def cost_of(point: Point) -> float:
    """Seconds of a recovery, milliseconds of a frame."""
    return float(getattr(point, COSTS[point.family]) or 0.0)


def cost_error(point: Point) -> float:
    """The standard error of a frame's median time, from the quartiles of its repeats; 0 for a cost without repeats."""
    if point.family != RENDER or point.frame_low_ms is None or point.frame_high_ms is None:
        return 0.0
    # Of a normal scatter: sigma = quartile range / 1.35, and a median's error is 1.25 sigma / sqrt(n).
    return 0.93 * (point.frame_high_ms - point.frame_low_ms) / NUM_REPEATS**0.5


def dominated(points: Sequence[Point]) -> tuple[tuple[Point, ...], tuple[str, ...]]:
    """The points, and for each the name of one that is as cheap and as accurate and clearly better in one; "" on the
    front.

    Clearly: by more than the errors of the two median times, or by more than SAME_DB. Of several, the most accurate names
    it.
    """
    names = []
    for point in points:
        better = [o for o in points if _beats(o, point)]
        best = max(better, key=lambda o: o.psnr_db, default=None)
        names.append("" if best is None else f"{best.factor}: {best.name}")
    return tuple(points), tuple(names)


def _beats(one: Point, other: Point) -> bool:
    saves, gains = cost_of(other) - cost_of(one), one.psnr_db - other.psnr_db
    error = float(np.hypot(cost_error(one), cost_error(other)))
    return saves >= 0 and gains >= -SAME_DB and (saves > error or gains > SAME_DB)


def on_one_clock(points: Sequence[Point]) -> list[Point]:
    """Times as if nothing else had run: frames' by the default's beside them, recoveries' by their processor seconds."""
    return _recoveries_on_one_clock(_frames_on_one_clock(points))


def _recoveries_on_one_clock(points: Sequence[Point]) -> list[Point]:
    """Processor seconds times the clock's seconds that one took in the recovery that was disturbed least."""
    rates = [p.recovery_s / p.recovery_cpu_s for p in points if p.recovery_s and p.recovery_cpu_s]
    return [replace(p, recovery_s=p.recovery_cpu_s * min(rates)) if p.recovery_cpu_s else p for p in points]


def _frames_on_one_clock(points: Sequence[Point]) -> list[Point]:
    """Each time by the default's beside it, times one default time."""
    beside = sorted(p.default_ms for p in points if p.default_ms)
    if not beside:
        return list(points)
    middle, out = beside[len(beside) // 2], []
    for point in points:
        scale = middle / point.default_ms if point.default_ms else 1.0
        times = {n: getattr(point, n) for n in ("frame_ms", "frame_low_ms", "frame_high_ms")}
        scaled = {n: t * scale for n, t in times.items() if t is not None and point.default_ms}
        out.append(replace(point, **scaled))
    return out
