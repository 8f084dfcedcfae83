"""The model as far as the options let it: what is switched off is neither traced nor stored."""

from dataclasses import replace

import numpy as np

from relight3d.records import Lobe, RelightModel, Residual
from relight3d.relight.options import RelightOptions


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
