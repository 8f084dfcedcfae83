"""What a frame runs: the model as far as the options let it, and the reasons in lines."""

from dataclasses import replace

import numpy as np

from relight3d.records import Decision, Lobe, RelightModel, Residual
from relight3d.relight.options import RelightOptions
from relight3d.views import View

WHOLE_SCENE = -1


def restrict(model: RelightModel, options: RelightOptions) -> RelightModel:
    """The model without the effects that the options switch off, so that nothing is traced or stored for them."""
    pixels, residual = model.pixels, model.residual
    if not options.detail:
        pixels = replace(pixels, normal=pixels.points.normal, lobe_gain=np.ones_like(pixels.lobe_gain))
    if not options.residual or options.max_modes == 0:
        residual = None
    mirrors = model.mirrors
    if not options.thrown:
        mirrors = tuple(replace(mirror, throws_light=False) for mirror in mirrors)
    return replace(
        model,
        pixels=pixels,
        residual=None if residual is None else _first_modes(residual, options.max_modes),
        indirect=model.indirect if options.indirect else None,
        background=model.background if options.indirect else None,
        lobes=tuple(_strongest(lobes, options.max_lobes) for lobes in model.lobes),
        mirrors=mirrors,
    )


def plan_of_view(given: RelightModel, model: RelightModel, view: View, options: RelightOptions) -> tuple[Decision, ...]:
    """The model's decisions as evidence has them, then what the options and this view change."""
    names = model.surfaces.names
    visible = np.bincount(view.surface, minlength=len(names))
    lines = list(given.decisions)

    def add(effect: str, surface: int, is_on: bool, reason: str) -> None:
        lines.append(Decision(effect, surface, is_on, 0.0, 0.0, reason))

    add("shadow", WHOLE_SCENE, options.shadows != "off", f"option shadows={options.shadows}")
    if options.shadows in ("exact", "adaptive"):
        add("border", WHOLE_SCENE, options.borders, f"option borders={options.borders}")
    for effect, had, has in (
        ("indirect", given.indirect, model.indirect),
        ("residual", given.residual, model.residual),
    ):
        reason = "recovered" if has is not None else "option" if had is not None else "not in the model"
        add(effect, WHOLE_SCENE, has is not None, reason)
    for surface, lobes in enumerate(given.lobes):
        if lobes:
            kept = len(model.lobes[surface])
            seen = f"{visible[surface]} points in view"
            add("lobe", surface, kept > 0 and visible[surface] > 0, f"{kept} of {len(lobes)} lobes, {seen}")
    mirrored = int(view.is_mirrored.sum()) + len(view.miss_pixel)
    for mirror in given.mirrors:
        reason = f"{mirrored} points are seen in mirrors" if mirrored else "no mirror in view, or max_bounces=0"
        add("mirror", mirror.surface, mirrored > 0, reason)
        if mirror.throws_light:
            add("thrown", mirror.surface, options.thrown, f"option thrown={options.thrown}")
    return tuple(lines)


def _first_modes(residual: Residual, num: int) -> Residual:
    return replace(
        residual,
        lit_modes=residual.lit_modes[:, :num],
        lit_weights=residual.lit_weights[:num],
        dark_modes=residual.dark_modes[:, :num],
        dark_weights=residual.dark_weights[:num],
    )


def _strongest(lobes: tuple[Lobe, ...], num: int) -> tuple[Lobe, ...]:
    """The lobes that carry most energy (colour over exponent), in their own order."""
    if len(lobes) <= num:
        return lobes
    energy = [float(np.mean(lobe.color)) / (lobe.exponent + 1.0) for lobe in lobes]
    kept = sorted(np.argsort(energy)[::-1][:num])
    return tuple(lobes[k] for k in kept)
