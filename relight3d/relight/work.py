"""The work that a frame takes, in counts that are the same on every machine, and what a count costs on this one."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

from relight3d.records import Stats

if TYPE_CHECKING:
    from relight3d.relight.relighter import Relighter

# What each of a frame's clocks is spent on. Without numba there is one clock, and it is spent on everything.
KINDS_OF_CLOCK = {
    "shadow": ("points", "shadow rays", "border rays"),
    "thrown": ("thrown rays",),
    "indirect": ("site functions",),
    "shade": ("points", "lobes", "modes", "readings"),
}
KINDS = tuple(dict.fromkeys(kind for kinds in KINDS_OF_CLOCK.values() for kind in kinds))
PRIOR = 1e-2  # how strongly the kinds of one clock are held alike where the timed frames do not tell them apart
MODES_PER_WORD = {"float32": 1, "int16": 2, "int8": 4}

Work = Mapping[str, int]
Clocks = Mapping[str, float]  # milliseconds of a frame by the names of KINDS_OF_CLOCK


def work_of(relighter: "Relighter", stats: Sequence[Stats]) -> dict[str, int]:
    """What a frame of a relighter takes: rays by kind, points shaded, lobes and modes read, functions of the sites
    and how often their light is read.

    `stats` are of frames under one moved light each; their rays' mean counts.
    """
    model, view, options = relighter.model, relighter.view, relighter.options
    lobes = np.array([len(each) for each in model.lobes], np.int64)
    residual, indirect = model.residual, model.indirect
    modes = 0 if residual is None else residual.lit_modes.shape[1] + residual.dark_modes.shape[1]
    packed = modes * len(model.pixels.points) // MODES_PER_WORD[options.precision]
    engine = relighter._engine
    if indirect is None or engine is None or engine.sites is None:
        num_sites = 0 if indirect is None else len(indirect.coefficients)
    else:  # those that some point reads, or the anchors
        num_sites = len(engine.sites.coefficients)
    return {
        "points": len(view.points) if engine is None else engine.num_points,
        "shadow rays": _mean_rays(stats, "shadow"),
        "border rays": _mean_rays(stats, "border"),
        "thrown rays": _mean_rays(stats, "thrown"),
        "site functions": 0 if indirect is None else num_sites * indirect.coefficients.shape[1],
        "lobes": int(lobes[view.surface].sum()) if len(lobes) else 0,
        "modes": int(packed),
        "readings": 3 * len(view.points) if engine is None else engine.num_readings,
    }


def _mean_rays(stats: Sequence[Stats], kind: str) -> int:
    return round(sum(each.rays.get(kind, 0) for each in stats) / max(len(stats), 1))


def nominal_work(work: Work, exact: Work) -> float:
    """Work as parts of the exact setting's, all kinds counted alike: an order without a clock."""
    return float(np.mean([work[kind] / exact[kind] for kind in KINDS if exact.get(kind, 0) > 0] or [0.0]))


def clocks_of(stats: Stats) -> dict[str, float]:
    """A frame's milliseconds under the names of KINDS_OF_CLOCK; what has none of them counts as shading."""
    clocks = dict.fromkeys(KINDS_OF_CLOCK, 0.0)
    for name, milliseconds in stats.milliseconds.items():
        clocks[name if name in clocks else "shade"] += milliseconds
    return clocks


def predicted_ms(works: Sequence[Work], timed: Sequence[Work], clocks: Sequence[Clocks], exact: Work) -> np.ndarray:
    """Milliseconds of a frame of each work, from frames timed here: non-negative costs of each kind, clock by clock.

    Kinds are counted in parts of `exact`, so that the prior, which holds the costs of one clock alike, has no unit.
    """
    has_one_clock = all(each["shadow"] == 0 for each in clocks)
    kinds_of_clock = {"shade": KINDS} if has_one_clock else KINDS_OF_CLOCK
    total = np.zeros(len(works))
    for clock, kinds in kinds_of_clock.items():
        there = [kind for kind in kinds if exact.get(kind, 0) > 0]
        if not there:
            continue
        parts = np.array([[work[kind] / exact[kind] for kind in there] for work in timed])
        took = np.array([each[clock] for each in clocks])
        even = PRIOR * (np.eye(len(there)) - 1 / len(there))
        costs = nnls(np.vstack([parts, even]), np.append(took, np.zeros(len(there))))[0]
        total += np.array([[work[kind] / exact[kind] for kind in there] for work in works]) @ costs
    return total
