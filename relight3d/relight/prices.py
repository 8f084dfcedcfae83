"""A model's own price list: what each cheaper setting saves and what it loses, measured on the model itself.

The error of a setting is its difference from the exact frame under lights between the photographed ones, where no
photograph was fitted, on top of the error that the exact frame itself has there. That one is taken from the photographs
without the residual (which was fitted to them) and from the residual's own gain on left-out photographs:

    error_db = 10 log10(1 + difference / e0),   e0 = misfit without residual / 10^(residual's gain / 10)

Both are mean squares of display values. The two errors are taken as unrelated; docs/plan.md compares with held-out
frames.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from relight3d.lights import Light
from relight3d.maths.color import srgb_from_linear
from relight3d.records import Capture, RelightModel
from relight3d.relight.calibrate import fastest_pair_ms, nudged
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter

NUM_LIGHTS = 6  # between the photographed ones, at which settings are compared
NUM_PHOTOGRAPHS = 6  # of the training ones, from which the model's own error is taken
NUM_PAIRS = 5  # of frames that are timed, the exact one and the cheaper one in turn

Changes = Mapping[str, Any]  # of RelightOptions
Price = Mapping[str, Any]  # name, options, milliseconds, error_db, psnr_db, rays


@dataclass(frozen=True, eq=False)
class Shop:
    """What every setting is compared with."""

    model: RelightModel
    exact: Relighter
    lights: list[list[Light]]
    wanted: list[np.ndarray]  # the exact frames' display values under them
    own_error: float  # e0


def measure_prices(model: RelightModel, capture: Capture, max_seconds: float | None = None) -> tuple[Price, ...]:
    """The price list of a model, cheapest first: steps away from the exact setting, together and each alone.

    First a chain of settings that takes one step after the other in a fixed order, so that a short time still reaches
    from exact to cheap; then each step alone; then the steps together in the order of what they were found to lose.
    After `max_seconds` no more setting is begun. Milliseconds are of this machine: a list is rescaled where it is used.
    """
    start = time.perf_counter()
    shop = _shop(model, capture)
    prices = [_price(shop, "exact", {})]
    steps = single_steps(model)
    waiting = [(_name(changes), changes) for changes in _chain(list(steps.values()))] + list(steps.items())
    is_ranked = False
    while waiting and (max_seconds is None or time.perf_counter() - start < max_seconds):
        name, changes = waiting.pop(0)
        if changes not in [p["options"] for p in prices]:
            prices.append(_price(shop, name, changes))
        if not waiting and not is_ranked:
            alone = sorted((p for p in prices if p["name"] in steps), key=lambda p: p["error_db"])
            waiting, is_ranked = [(_name(c), c) for c in _chain([p["options"] for p in alone])], True
    return tuple(sorted(_on_one_clock(prices), key=lambda price: price["milliseconds"]))


def _chain(steps: Sequence[Changes]) -> list[dict[str, Any]]:
    """One step after the other, each kept."""
    chain: list[dict[str, Any]] = [{}]
    for step in steps:
        chain.append(joined(chain[-1], step))
    return chain[1:]


def single_steps(model: RelightModel) -> dict[str, Changes]:
    """Every step away from the exact setting that this model can take: what it does not have needs no leaving out."""
    steps: dict[str, Changes] = {"shadows on a lattice of 4 pixels": {"shadows": "adaptive", "lattice_px": 4}}
    num_lobes = max((len(lobes) for lobes in model.lobes), default=0)
    num_modes = 0
    if model.residual is not None:
        num_modes = max(model.residual.lit_modes.shape[1], model.residual.dark_modes.shape[1])
        steps["residual in int16"] = {"precision": "int16"}
    steps |= {f"{k} modes of the residual": {"max_modes": k} for k in (8, 3) if k < num_modes}
    if len(model.mirrors) > 1 or any(not mirror.is_plane for mirror in model.mirrors):
        steps["one bounce between mirrors"] = {"max_bounces": 1}
    steps |= {"hard outlines": {"edge_samples": 1}, "hard shadow borders": {"borders": False}}
    if num_modes:
        steps["no residual"] = {"residual": False}
    if num_lobes > 1:
        steps["one lobe a surface"] = {"max_lobes": 1}
    if any(mirror.throws_light for mirror in model.mirrors):
        steps["no light thrown by mirrors"] = {"thrown": False}
    return steps | {"no shadows": {"shadows": "off"}}


# ------------------------------------------------------------------------------------------------ measures


def _shop(model: RelightModel, capture: Capture) -> Shop:
    exact = Relighter(model, options=RelightOptions())
    lights = lights_between(model)
    wanted = [_shown(exact, each) for each in lights]
    return Shop(model, exact, lights, wanted, _own_error(model, capture))


def _price(shop: Shop, name: str, changes: Changes) -> Price:
    relighter = Relighter(shop.model, options=replace(RelightOptions(), **changes)) if changes else shop.exact
    exact_ms, ours_ms = fastest_pair_ms(shop.exact, relighter, NUM_PAIRS)
    difference = [np.mean((_shown(relighter, each) - w) ** 2) for each, w in zip(shop.lights, shop.wanted)]
    square = float(np.mean(difference)) if changes else 0.0
    counted = relighter.render(nudged(shop.lights[0], shop.model.mesh.radius)).stats if shop.lights else None
    return {
        "name": name,
        "options": dict(changes),
        "milliseconds": ours_ms,
        "exact_ms": exact_ms,
        "error_db": float(10 * np.log10(1 + square / shop.own_error)),
        "psnr_db": float(-10 * np.log10(shop.own_error + square)),
        "rays": 0 if counted is None else counted.num_rays,
    }


def _on_one_clock(prices: list[Price]) -> list[Price]:
    """Each setting's time by the exact one beside it, times one exact time: the machine's other work drops out."""
    exact_ms = float(np.median([p["exact_ms"] for p in prices]))
    return [{**p, "exact_ms": exact_ms, "milliseconds": p["milliseconds"] / p["exact_ms"] * exact_ms} for p in prices]


def _own_error(model: RelightModel, capture: Capture) -> float:
    """The mean square of display values that the exact frame is thought to miss left-out photographs by."""
    from relight3d.io.capture import read_photograph

    plain = Relighter(model, options=RelightOptions(residual=False))
    photographs = capture.split("train")
    chosen = np.unique(np.linspace(0, len(photographs) - 1, NUM_PHOTOGRAPHS).round().astype(int))
    squares = []
    for photograph in (photographs[k] for k in chosen):
        picture, is_valid = read_photograph(capture, photograph)
        frame = plain.render(list(photograph.lights))
        mask = is_valid & frame.is_hit
        if mask.any():
            shown = srgb_from_linear(frame.radiance[mask] * np.float32(model.exposure))
            squares.append(np.mean((shown - srgb_from_linear(picture[mask] * np.float32(model.exposure))) ** 2))
    gain = max([d.gain_db for d in model.decisions if d.effect == "residual" and d.is_on], default=0.0)
    return max(float(np.mean(squares)) * 10 ** (-float(gain) / 10), 1e-10) if squares else 1e-4


def _shown(relighter: Relighter, lights: list[Light]) -> np.ndarray:
    frame = relighter.render(lights)
    return srgb_from_linear(frame.radiance[frame.is_hit] * np.float32(frame.exposure))


def lights_between(model: RelightModel, num: int = NUM_LIGHTS) -> list[list[Light]]:
    """Lights half-way between photographed ones and their nearest neighbours: as far from all fits as use will be."""
    single = [each[0] for each in model.lights if len(each) == 1]
    places = np.array([light.translated(-model.mesh.center).incident(np.zeros((1, 3)))[0][0] for light in single])
    if len(single) < 2:
        return [[light] for light in single]
    nearness = places @ places.T - 4 * np.eye(len(places))
    nearest = nearness.argmax(axis=1)
    chosen = np.unique(np.linspace(0, len(single) - 1, num).round().astype(int))
    return [[_half_way(single[k], single[nearest[k]])] for k in chosen]


def _half_way(a: Light, b: Light) -> Light:
    """Half-way between two lights of one kind; the first where they differ in kind."""
    if a.kind != b.kind:
        return a
    name = "to_light" if a.kind == "directional" else "position"
    return replace(a, **{name: tuple((np.asarray(getattr(a, name)) + np.asarray(getattr(b, name))) / 2)})


# ------------------------------------------------------------------------------------------------ together


def joined(changes: Changes, more: Changes) -> dict[str, Any]:
    """Both changes; of two answers to one question the rougher, which comes later, and no answer to a question gone."""
    out = {**changes, **more}
    if out.get("residual") is False:
        out = {k: v for k, v in out.items() if k not in ("max_modes", "precision")}
    if "max_modes" in changes and "max_modes" in more:
        out["max_modes"] = min(changes["max_modes"], more["max_modes"])
    if "off" in (changes.get("shadows"), more.get("shadows")):
        out = {k: v for k, v in out.items() if k not in ("lattice_px", "borders")} | {"shadows": "off"}
    return out


def _name(changes: Changes) -> str:
    return ", ".join(f"{key}={value}" for key, value in changes.items())
