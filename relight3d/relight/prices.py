"""A model's own price list: what each cheaper setting loses, measured on the model itself, and the work it takes.

The error of a setting is its difference from the exact frame (with shadows on a lattice, from the frame on the finest
one) under lights between the photographed ones, where no photograph was fitted, on top of the error that the exact
frame itself has there. That one is taken from the photographs without the residual (which was fitted to them) and from
the residual's own gain on left-out photographs:

    error_db = 10 log10(1 + difference / e0),   e0 = misfit without residual / 10^(residual's gain / 10)

Both are mean squares of display values. The two errors are taken as unrelated; docs/plan.md compares with held-out
frames. Nothing here reads a clock, so the list is as reproducible as the model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from relight3d.lights import Light
from relight3d.maths.color import srgb_from_linear
from relight3d.records import Capture, Frame, Price, RelightModel
from relight3d.relight.options import RelightOptions
from relight3d.relight.relighter import Relighter
from relight3d.relight.work import nominal_work, work_of

NUM_LIGHTS = 5  # between the photographed ones, at which settings are compared
NUM_PHOTOGRAPHS = 6  # of the training ones, from which the model's own error is taken

Changes = Mapping[str, Any]  # of RelightOptions


@dataclass(frozen=True, eq=False)
class Shop:
    """What every setting is compared with."""

    exact: Relighter
    lights: list[list[Light]]
    frames: list[Frame]  # the exact ones under them
    own_error: float  # e0


def measure_prices(model: RelightModel, capture: Capture) -> tuple[Price, ...]:
    """The price list of a model: the exact setting, each step away from it alone, and the steps together.

    They are put together in the order of what they lose for the work they save, so that the list reaches from exact to
    cheap along its front.
    """
    shop = _shop(model, capture)
    exact = _price(shop, "exact", {})
    alone = [_price(shop, name, changes) for name, changes in single_steps(model).items()]

    def rank(price: Price) -> float:
        saved = nominal_work(exact.work, exact.work) - nominal_work(price.work, exact.work)
        return (price.error_db + 1e-3) / max(saved, 1e-9)

    prices = [exact, *alone]
    for changes in _chain([p.options for p in sorted(alone, key=rank)]):
        if changes not in [p.options for p in prices]:
            prices.append(_price(shop, name_of(changes), changes))
    return tuple(prices)


def _chain(steps: Sequence[Changes]) -> list[dict[str, Any]]:
    """One step after the other, each kept."""
    chain: list[dict[str, Any]] = [{}]
    for step in steps:
        chain.append(joined(chain[-1], step))
    return chain[1:]


def single_steps(model: RelightModel) -> dict[str, Changes]:
    """Every step away from the exact setting that this model can take: what it does not have needs no leaving out."""
    lattice: Changes = {"shadows": "adaptive", "lattice_px": 4}
    steps: dict[str, Changes] = {
        "shadows on a lattice of 4 pixels": lattice,
        "one ray for the parts of a pixel": {**lattice, "shared_rays": True},
    }
    if model.indirect is not None or any(model.lobes):
        steps["shading on a lattice"] = {"shading": "adaptive"}
    steps["light at half resolution"] = {"shading": "half"}
    num_lobes = max((len(lobes) for lobes in model.lobes), default=0)
    num_modes = 0
    if model.residual is not None:
        num_modes = max(model.residual.lit_modes.shape[1], model.residual.dark_modes.shape[1])
    if num_modes:
        steps["a residual of 8 bits"] = {"precision": "int8"}
    steps |= {f"{k} modes of the residual": {"max_modes": k} for k in (8, 3) if k < num_modes}
    if len(model.mirrors) > 1 or any(not mirror.is_plane for mirror in model.mirrors):
        steps["one bounce between mirrors"] = {"max_bounces": 1}
    steps |= {"hard outlines": {"edge_samples": 1}, "hard shadow borders": {"borders": False}}
    if num_modes:
        steps["no residual"] = {"residual": False}
    if num_lobes > 1:
        steps["one lobe a surface"] = {"max_lobes": 1}
    if num_lobes:
        steps["no lobes"] = {"max_lobes": 0}
    if any(mirror.throws_light for mirror in model.mirrors):
        steps["no light thrown by mirrors"] = {"thrown": False}
    return steps | {"no shadows": {"shadows": "off"}}


# ------------------------------------------------------------------------------------------------ measures


def _shop(model: RelightModel, capture: Capture) -> Shop:
    exact = Relighter(model, options=RelightOptions())
    lights = lights_between(model)
    return Shop(exact, lights, [exact.render(light) for light in lights], _own_error(exact, model, capture))


def _difference(ours: Sequence[Frame], frames: Sequence[Frame]) -> float:
    """The mean square of display values between frames under the same lights."""
    squares = [np.mean((_shown(mine) - _shown(theirs)) ** 2) for mine, theirs in zip(ours, frames)]
    return float(np.mean(squares)) if squares else 0.0


def _price(shop: Shop, name: str, changes: Changes) -> Price:
    relighter, frames = shop.exact, shop.frames
    if changes:
        relighter = shop.exact.with_options(replace(RelightOptions(), **changes))
        frames = [relighter.render(each) for each in shop.lights]
    square = _difference(frames, shop.frames)
    return Price(
        name=name,
        options=dict(changes),
        error_db=float(10 * np.log10(1 + square / shop.own_error)),
        psnr_db=float(-10 * np.log10(shop.own_error + square)),
        work=work_of(relighter, [frame.stats for frame in frames]),
    )


def _own_error(exact: Relighter, model: RelightModel, capture: Capture) -> float:
    """The mean square of display values that the exact frame is thought to miss left-out photographs by."""
    from relight3d.io.capture import read_photograph

    plain = exact.with_options(RelightOptions(residual=False))
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


def _shown(frame: Frame) -> np.ndarray:
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
    """Both changes; of two answers to one question the rougher, and no answer to a question that is gone."""
    out = {**changes, **more}
    for name in ("max_modes", "max_lobes"):
        if name in changes and name in more:
            out[name] = min(changes[name], more[name])
    if "half" in (changes.get("shading"), more.get("shading")):  # which has a lattice of its own
        out = {k: v for k, v in out.items() if k not in ("lattice_px", "shared_rays")} | {"shading": "half"}
        if out.get("shadows") == "adaptive":
            del out["shadows"]
    if out.get("residual") is False:
        out = {k: v for k, v in out.items() if k not in ("max_modes", "precision")}
    if "off" in (changes.get("shadows"), more.get("shadows")):
        out = {k: v for k, v in out.items() if k not in ("lattice_px", "shared_rays", "borders")} | {"shadows": "off"}
    return out


def name_of(changes: Changes) -> str:
    return ", ".join(f"{key}={value}" for key, value in changes.items())
