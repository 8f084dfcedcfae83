"""Settings for a wanted time: from the model's own price list where it has one, calibrated on this machine."""

import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from relight3d.errors import InputError
from relight3d.lights import DirectionalLight, Light
from relight3d.relight.options import PRESETS, RelightOptions

if TYPE_CHECKING:
    from relight3d.relight.relighter import Relighter

NUM_FRAMES = 5  # of a calibration: their median counts

logger = logging.getLogger(__name__)


def one_of_three(options: object | None, budget_ms: float | None, preset: str | None) -> None:
    """Raises InputError where more than one way to settle the options is given, or a budget is no time."""
    given = [n for n, v in (("options", options), ("budget_ms", budget_ms), ("preset", preset)) if v is not None]
    if len(given) > 1:
        raise InputError(" and ".join(given), "both", "one of options, budget_ms and preset")
    if budget_ms is not None and not (np.isfinite(budget_ms) and budget_ms > 0):
        raise InputError("budget_ms", budget_ms, "a positive number of milliseconds")


def within_budget(relighter: "Relighter", budget_ms: float) -> tuple[RelightOptions, tuple[str, ...]]:
    """The settings of least error whose frame fits the budget on this machine, and what was given up, in words.

    The model's prices (`name`, `options`: changes to RelightOptions, `milliseconds`, `error_db`) are scaled by one
    calibration: the exact frame's time here over its price. Without prices the presets are timed themselves, most
    accurate first.
    """
    prices = [price for price in relighter.given_model.prices if isinstance(price.get("options"), Mapping)]
    exact_ms = frame_ms(relighter)
    if prices:
        return _from_prices(prices, exact_ms, budget_ms)
    relighter_type = type(relighter)
    took = exact_ms
    for name in ("exact", "balanced", "fast"):
        if name != "exact":
            took = frame_ms(relighter_type(relighter.given_model, relighter.camera, PRESETS[name]))
        if took <= budget_ms or name == "fast":
            return PRESETS[name], _note(name, took, budget_ms)
    raise AssertionError("the last preset always answers")


def frame_ms(relighter: "Relighter") -> float:
    """The median time of frames whose light moves, in milliseconds; the first, which may compile, is not counted."""
    took = []
    for light in _calibration_lights(relighter):
        start = time.perf_counter()
        relighter.render([light])
        took.append(1e3 * (time.perf_counter() - start))
    return float(np.median(took[1:]))


def _calibration_lights(relighter: "Relighter") -> list[Light]:
    """The photographs' own first lights, each turned a little so that no kept shadow answers."""
    lights = [each[0] for each in relighter.given_model.lights if each] or [DirectionalLight((0.3, 0.2, 1.0), 1.0)]
    lights = [lights[k % len(lights)] for k in range(NUM_FRAMES + 1)]
    nudge = 1e-4 * np.arange(1, NUM_FRAMES + 2)
    return [
        replace(light, to_light=tuple(np.asarray(light.to_light) + shift))
        if isinstance(light, DirectionalLight)
        else light.translated(shift * relighter.given_model.mesh.radius * np.ones(3))
        for light, shift in zip(lights, nudge)
    ]


def _from_prices(prices: list[Mapping], exact_ms: float, budget_ms: float) -> tuple[RelightOptions, tuple[str, ...]]:
    exact = [float(p["milliseconds"]) for p in prices if not p["options"]]
    scale = exact_ms / exact[0] if exact and exact[0] > 0 else 1.0
    fitting = [p for p in prices if float(p["milliseconds"]) * scale <= budget_ms]
    best = (
        min(fitting, key=lambda p: float(p["error_db"]))
        if fitting
        else min(prices, key=lambda p: float(p["milliseconds"]))
    )
    name = str(best.get("name", "a setting of the price list"))
    return RelightOptions(**best["options"]), _note(name, float(best["milliseconds"]) * scale, budget_ms)


def _note(name: str, took_ms: float, budget_ms: float) -> tuple[str, ...]:
    verdict = "fits" if took_ms <= budget_ms else "is the cheapest there is, and does not fit"
    note = f"{name}: {took_ms:.1f} ms here {verdict} the budget of {budget_ms:g} ms"
    logger.log(logging.INFO if took_ms <= budget_ms else logging.WARNING, note)
    return (note,)
