"""Settings for a wanted time or error: from the model's own price list, turned into milliseconds by frames timed here."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from relight3d.errors import InputError
from relight3d.records import Price
from relight3d.relight.calibrate import clocks_beside, frame_clocks
from relight3d.relight.options import PRESETS, RelightOptions, preset_options
from relight3d.relight.work import nominal_work, predicted_ms

if TYPE_CHECKING:
    from relight3d.records import RelightModel
    from relight3d.relight.relighter import Relighter

logger = logging.getLogger(__name__)

# A preset is the cheapest point of the front that loses no more than this to the exact setting.
PRESET_LOSS_DB = {"exact": 0.0, "balanced": 0.2, "fast": 2.0}
NUM_TRIALS = 6  # settings that are timed at most, beside the exact and the cheapest one
TOLERANCE = 1.05  # a median so much above the budget still fits it: medians of a few frames are no surer

# Clocks of settings timed in this process, in parts of the exact frame's time: what else the machine does changes that
# time and not the parts, so that two budgets are chosen by the same figures.
_ratios: "WeakKeyDictionary[RelightModel, dict[tuple, dict[int, dict[str, float]]]]" = WeakKeyDictionary()

Choice = tuple[RelightOptions, tuple[str, ...]]


def check_wish(
    options: object | None, preset: str | None, budget_ms: float | None, max_error_db: float | None = None
) -> None:
    """Raises InputError where the options are settled in more than one way, and for a time or an error that is none."""
    wishes = {"options": options, "preset": preset, "budget_ms": budget_ms, "max_error_db": max_error_db}
    given = [name for name, value in wishes.items() if value is not None]
    if len(given) > 1 and given != ["budget_ms", "max_error_db"]:
        raise InputError(" and ".join(given), "both", "one of options, preset, and budget_ms with max_error_db")
    if budget_ms is not None and not (np.isfinite(budget_ms) and budget_ms > 0):
        raise InputError("budget_ms", budget_ms, "a positive number of milliseconds")
    if max_error_db is not None and not (np.isfinite(max_error_db) and max_error_db >= 0):
        raise InputError("max_error_db", max_error_db, "a number of dB, 0 or more")


def front_of(prices: Sequence[Price], costs: Sequence[float] | np.ndarray) -> list[int]:
    """The prices that no other beats in both cost and error, cheapest first, by their places in the list."""
    front: list[int] = []
    for k in sorted(range(len(prices)), key=lambda k: (costs[k], prices[k].error_db)):
        if not front or prices[k].error_db < prices[front[-1]].error_db:
            front.append(k)
    return front


def choose_options(
    prices: Sequence[Price],
    costs_ms: Sequence[float],
    budget_ms: float | None = None,
    max_error_db: float | None = None,
) -> Choice:
    """The most accurate setting that fits the budget, or the cheapest that loses no more than `max_error_db`.

    `costs_ms` are the settings' milliseconds on the machine that is meant. With both wishes, the cheapest that loses no
    more, if it fits; else the most accurate that fits. The note says what was chosen and what is given up. Raises
    InputError for an empty list, and for neither a time nor an error.
    """
    if not prices:
        raise InputError("prices", "none", "a model with a price list", "recover it again, or name a preset")
    if budget_ms is None and max_error_db is None:
        raise InputError("budget", "none", "budget_ms or max_error_db")
    limits = np.full(len(prices), np.inf if budget_ms is None else budget_ms)
    chosen = _chosen(prices, costs_ms, limits, max_error_db)
    return options_of(prices[chosen]), (_note(prices[chosen], costs_ms[chosen], budget_ms, max_error_db),)


def preset_for(model: "RelightModel", name: str) -> RelightOptions:
    """A preset as a point of the model's own front, the work counted, not timed; without a price list the general one.

    So is "baked" always: what is cast ahead is no work of a frame.

    Raises InputError for another name.
    """
    general = preset_options(name)
    if name not in PRESET_LOSS_DB or name == "exact" or not model.prices:
        return general
    costs = [nominal_work(price.work, model.prices[0].work) for price in model.prices]
    nowhere = np.full(len(costs), np.inf)
    return options_of(model.prices[_chosen(model.prices, costs, nowhere, PRESET_LOSS_DB[name])])


def within(relighter: "Relighter", budget_ms: float | None, max_error_db: float | None) -> Choice:
    """The settings for a wanted time, error or both on this machine, and what is given up, in words.

    The exact and the cheapest setting are timed, which turns the list's counts of work into milliseconds; then the
    chosen setting is timed in turn with the exact one, and what it took corrects the others' and perhaps the choice.
    Without a list the presets are timed; an error cannot be asked for then.
    """
    prices = relighter.given_model.prices
    if not prices:
        if budget_ms is None:
            raise InputError("prices", "none", "a model with a price list", "recover it again, or name a preset")
        return _from_presets(relighter, budget_ms)
    exact, budget = prices[0].work, np.inf if budget_ms is None else budget_ms
    cheapest = int(np.argmin([nominal_work(price.work, exact) for price in prices]))
    standard = _with(relighter, RelightOptions())
    clocks = {0: frame_clocks(standard)}
    exact_ms = sum(clocks[0].values())
    camera = relighter.camera
    ratios = _ratios.setdefault(relighter.given_model, {}).setdefault(
        (camera.width, camera.height, camera.world_from_camera.tobytes()), {}
    )
    clocks |= {k: {name: ratio * exact_ms for name, ratio in each.items()} for k, each in ratios.items()}

    def time_it(k: int) -> None:
        clocks[k] = clocks_beside(_with(standard, options_of(prices[k])), standard, exact_ms)
        ratios[k] = {name: ms / exact_ms for name, ms in clocks[k].items()}

    if cheapest not in clocks:
        time_it(cheapest)
    for trial in range(NUM_TRIALS + 1):
        timed = [prices[k].work for k in clocks]
        costs = predicted_ms([p.work for p in prices], timed, list(clocks.values()), exact)
        costs[list(clocks)] = [sum(each.values()) for each in clocks.values()]
        limits = np.full(len(prices), float(budget))
        limits[list(clocks)] *= TOLERANCE
        if trial == NUM_TRIALS:  # no promise that was not kept once
            limits[[k for k in range(len(prices)) if k not in clocks]] = -1.0
        chosen = _chosen(prices, costs, limits, max_error_db)
        if chosen in clocks:
            break
        time_it(chosen)
    note = _note(prices[chosen], costs[chosen], budget_ms, max_error_db)
    is_missed = costs[chosen] > TOLERANCE * budget or _loses_more(prices[chosen], max_error_db)
    logger.log(logging.WARNING if is_missed else logging.INFO, note)
    return options_of(prices[chosen]), (note,)


def options_of(price: Price) -> RelightOptions:
    """The setting itself."""
    return replace(RelightOptions(), **price.options)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------ choices


def _chosen(
    prices: Sequence[Price], costs: Sequence[float] | np.ndarray, limits: np.ndarray, max_error_db: float | None
) -> int:
    """The place of the price that is chosen; the cheapest where none is within its limit."""
    front = front_of(prices, costs)
    within_limit = [k for k in range(len(prices)) if costs[k] <= limits[k]]
    if not within_limit:
        return front[0]
    fitting = [within_limit[k] for k in front_of([prices[k] for k in within_limit], [costs[k] for k in within_limit])]
    good = [k for k in fitting if max_error_db is not None and not _loses_more(prices[k], max_error_db)]
    return good[0] if good else fitting[-1]


def _loses_more(price: Price, max_error_db: float | None) -> bool:
    return max_error_db is not None and price.error_db > max_error_db + 1e-9


def _note(price: Price, took_ms: float, budget_ms: float | None, max_error_db: float | None) -> str:
    gives_up = f"gives up {price.error_db:.2f} dB" if price.error_db > 0.005 else "gives up nothing"
    note = f"{price.name}: {took_ms:.1f} ms here, {gives_up}"
    if budget_ms is not None and took_ms > TOLERANCE * budget_ms:
        note += f"; no setting fits the budget of {budget_ms:g} ms, this is the cheapest"
    if _loses_more(price, max_error_db):
        note += f"; no setting that fits loses less than the wanted {max_error_db:g} dB"
    return note


def _from_presets(relighter: "Relighter", budget_ms: float) -> Choice:
    """A model without a price list: the general presets, timed here, most accurate first."""
    name, took = "exact", np.inf
    for name in ("exact", "balanced", "fast"):
        took = sum(frame_clocks(_with(relighter, PRESETS[name])).values())
        if took <= TOLERANCE * budget_ms:
            break
    note = f"preset {name} (the model has no price list): {took:.1f} ms here, what it gives up is not measured"
    if took > TOLERANCE * budget_ms:
        note += f"; no setting fits the budget of {budget_ms:g} ms, this is the cheapest"
        logger.warning(note)
    return PRESETS[name], (note,)


def _with(relighter: "Relighter", options: RelightOptions) -> "Relighter":
    return relighter if options == relighter.options else relighter.with_options(options)
