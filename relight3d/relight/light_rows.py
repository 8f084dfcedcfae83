"""Lights as rows of numbers for the kernels, and extended lights as samples."""

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
from jaxtyping import Float32

from relight3d.lights import DirectionalLight, Light, RectangleLight, RectangleSample, SphereLight, SpotLight
from relight3d.relight.kernels import AXIS, COLOR, CONE_COSINE, CONE_POWER, CONE_SCALE, HAS_RESIDUAL, KIND, PLACE, ROW


def light_row(light: Light) -> Float32[np.ndarray, " row"]:
    """One light (centred coordinates) as the kernels read it."""
    return _kept_row(light).copy()


@lru_cache(maxsize=64)
def _kept_row(light: Light) -> Float32[np.ndarray, " row"]:
    """Several parts of a frame ask for it."""
    row = np.zeros(ROW, np.float32)
    row[KIND] = 0.0 if isinstance(light, DirectionalLight) else 1.0
    row[PLACE : PLACE + 3] = light.to_light if isinstance(light, DirectionalLight) else light.position
    row[COLOR : COLOR + 3] = light.power
    row[HAS_RESIDUAL] = 1.0
    if isinstance(light, SpotLight):
        inner, outer = np.cos(light.inner_cone_angle), np.cos(light.outer_cone_angle)
        row[AXIS : AXIS + 3] = light.direction
        row[[CONE_COSINE, CONE_SCALE, CONE_POWER]] = outer, 1.0 / max(inner - outer, 1e-3), 2.0
    elif isinstance(light, RectangleSample):
        row[AXIS : AXIS + 3] = light.normal
        row[[CONE_COSINE, CONE_SCALE, CONE_POWER]] = 0.0, 1.0, 1.0
    return row


def geometry_key(light: Light) -> tuple:
    """What shadows depend on: everything but the colour."""
    row = light_row(light)
    row[COLOR : COLOR + 3] = 0.0
    return (row.tobytes(),)


def expanded(lights: Iterable[Light], num_samples: int) -> tuple[list[Light], list[str]]:
    """Lights without extent as they are, spheres and rectangles as samples; those without power are left out.

    Beside each, what its shadow rays are counted as: "shadow", or "soft" for a sample.
    """
    out: list[Light] = []
    effects: list[str] = []
    for light in lights:
        if not np.any(light.power > 0):
            continue
        samples = light.samples(num_samples) if isinstance(light, SphereLight | RectangleLight) else None
        out += [light] if samples is None else samples
        effects += ["shadow"] if samples is None else ["soft"] * len(samples)
    return out, effects
