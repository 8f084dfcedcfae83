"""Which highlights can be seen under some lights, and how far from their middle."""

import numpy as np
from jaxtyping import Float32

from relight3d.relight.kernels import AT_INFINITY, COLOR, KIND, PLACE

FAINT = 1e-3  # of white: a lobe that would add less at a point is left out there
EXPONENT, DARK = 6, 11  # columns of a lobe's row, buffers.pack_view


def bright_lobes(
    lobes: Float32[np.ndarray, "lobe 15"],
    rows: Float32[np.ndarray, "light row"],
    most: float,
    radius: float,
    faint: float = FAINT,
) -> Float32[np.ndarray, "lobe 15"]:
    """The lobes with the base below which each is too faint to be seen under the lights.

    `most` is the largest gain of a point, in parts of white for radiance 1; `radius` the mesh's, about its centre; what adds
    less than `faint` of white cannot be seen.
    """
    lobes = lobes.copy()
    if len(lobes) == 0 or len(rows) == 0:
        return lobes
    peak = lobes[:, :3].max(axis=1) * most * _most_irradiance(rows, radius)
    base = (faint / np.maximum(peak, faint)) ** (1 / np.maximum(lobes[:, EXPONENT], 1e-3))
    lobes[:, DARK] = np.clip(base, lobes[:, DARK], 0.999999)
    return lobes


def _most_irradiance(rows: Float32[np.ndarray, "light row"], radius: float) -> float:
    """What the strongest light sends to any point of the mesh."""
    nearest = np.maximum(np.linalg.norm(rows[:, PLACE : PLACE + 3], axis=1) - radius, 0.05 * radius)
    falloff = np.where(rows[:, KIND] == AT_INFINITY, 1.0, 1.0 / nearest**2)
    return float((rows[:, COLOR : COLOR + 3].max(axis=1) * falloff).max())
