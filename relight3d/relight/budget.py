"""Settings for a wanted time or error: from the model's own price list, rescaled to the machine at hand."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from relight3d.errors import InputError
from relight3d.relight.calibrate import frame_ms, frame_pair_ms
from relight3d.relight.options import PRESETS, RelightOptions, preset_options

if TYPE_CHECKING:
    from relight3d.records import RelightModel
    from relight3d.relight.relighter import Relighter

logger = logging.getLogger(__name__)

# A preset is the cheapest point of the front that loses no more than this to the exact setting.
PRESET_LOSS_DB = {"exact": 0.0, "balanced": 0.5, "fast": 3.0}
NUM_TRIALS = 3  # settings that are timed at most before a budget is given up
TOLERANCE = 1.05  # a median so much above the budget still fits it: medians of a few frames are no surer

Price = Mapping[str, Any]
Choice = tuple[RelightOptions, tuple[str, ...]]


def one_of_three(options: object | None, budget_ms: float | None, preset: str | None) -> None:
    """Raises InputError where more than one way to settle the options is given, or a budget is no time."""
    given = [n for n, v in (("options", options), ("budget_ms", budget_ms), ("preset", preset)) if v is not None]
    if len(given) > 1:
        raise InputError(" and ".join(given), "both", "one of options, budget_ms and preset")
    if budget_ms is not None and not (np.isfinite(budget_ms) and budget_ms > 0):
        raise InputError("budget_ms", budget_ms, "a positive number of milliseconds")


def front_of(prices: Sequence[Price]) -> tuple[Price, ...]:
    """The prices that no other beats in both time and error, cheapest first."""
    front: list[Price] = []
    for price in sorted(prices, key=lambda p: (p["milliseconds"], p["error_db"])):
        if not front or price["error_db"] < front[-1]["error_db"]:
            front.append(price)
    return tuple(front)


def choose_options(
    prices: Sequence[Price],
    budget_ms: float | None = None,
    max_error_db: float | None = None,
    machine_scale: float = 1.0,
) -> Choice:
    """The most accurate setting that fits the budget, or the cheapest that loses no more than `max_error_db`.

    With both, the cheapest that loses no more, if it fits; else the most accurate that fits. `machine_scale` is a
    frame's time here over its time in the list. The note says what was chosen and what was given up. Raises
    InputError for an empty list, and for neither a time nor an error.
    """
    if not prices:
        raise InputError("prices", "none", "a model with a price list", "recover it again, or name a preset")
    if budget_ms is None and max_error_db is None:
        raise InputError("budget", "none", "budget_ms or max_error_db")
    chosen = _chosen(front_of(prices), budget_ms, max_error_db, machine_scale)
    note = _note(chosen, budget_ms, max_error_db, chosen["milliseconds"] * machine_scale)
    return _options(chosen), (note,)


def preset_for(model: "RelightModel", name: str) -> RelightOptions:
    """A preset as a point of the model's own front; without a price list the general one. Raises InputError."""
    general = preset_options(name)
    if name == "exact" or not model.prices:
        return general
    return _options(_chosen(front_of(model.prices), None, PRESET_LOSS_DB[name], 1.0))


def within_budget(relighter: "Relighter", budget_ms: float) -> Choice:
    """The settings of least error whose frame fits the budget on this machine, and what was given up, in words.

    One calibration, the exact frame's time here over its price, rescales the model's list; what it promises is then
    timed, and a setting that does not keep it yields to the next cheaper one. Without a list the presets are timed.
    """
    listed: tuple[Mapping[str, Any], ...] = relighter.given_model.prices
    if not listed:
        return _from_presets(relighter, budget_ms)
    prices = front_of(listed)
    scale = frame_ms(relighter) / prices[0]["exact_ms"]
    for _ in range(NUM_TRIALS):
        chosen = _chosen(prices, budget_ms, None, scale)
        took = _time_of(relighter, _options(chosen))
        cheaper = [p for p in prices if p["milliseconds"] < chosen["milliseconds"]]
        if took <= TOLERANCE * budget_ms or not cheaper:
            break
        prices, scale = tuple(cheaper), took / chosen["milliseconds"]
    note = _note(chosen, budget_ms, None, took)
    logger.log(logging.INFO if took <= TOLERANCE * budget_ms else logging.WARNING, note)
    return _options(chosen), (note,)


# ------------------------------------------------------------------------------------------------ choices


def _chosen(front: Sequence[Price], budget_ms: float | None, max_error_db: float | None, scale: float) -> Price:
    """A price of the front, which is sorted by time; its error falls along it."""
    fitting = [p for p in front if budget_ms is None or p["milliseconds"] * scale <= budget_ms]
    good = [p for p in fitting if max_error_db is not None and p["error_db"] <= max_error_db + 1e-9]
    if good:
        return good[0]
    return fitting[-1] if fitting else front[0]


def _options(price: Price) -> RelightOptions:
    return replace(RelightOptions(), **price["options"])


def _note(price: Price, budget_ms: float | None, max_error_db: float | None, took_ms: float) -> str:
    gives_up = f"gives up {price['error_db']:.2f} dB" if price["error_db"] > 0.005 else "gives up nothing"
    note = f"{price['name']}: {took_ms:.1f} ms here, {gives_up}"
    if budget_ms is not None and took_ms > TOLERANCE * budget_ms:
        note += f"; no setting fits the budget of {budget_ms:g} ms, this is the cheapest"
    if max_error_db is not None and price["error_db"] > max_error_db + 1e-9:
        note += f"; no setting that fits loses less than the wanted {max_error_db:g} dB"
    return note


def _from_presets(relighter: "Relighter", budget_ms: float) -> Choice:
    """A model without a price list: the general presets, timed here, most accurate first."""
    for name in ("exact", "balanced", "fast"):
        took = _time_of(relighter, PRESETS[name])
        if took <= TOLERANCE * budget_ms:
            break
    price = {"name": f"preset {name} (the model has no price list)", "error_db": 0.0}
    note = _note(price, budget_ms, None, took).replace("gives up nothing", "what it gives up is not measured")
    return PRESETS[name], (note,)


def _time_of(relighter: "Relighter", options: RelightOptions) -> float:
    if options == relighter.options:
        return frame_ms(relighter)
    other = type(relighter)(relighter.given_model, relighter.camera, options=options)
    return frame_pair_ms(relighter, other, num_pairs=5)[1]
