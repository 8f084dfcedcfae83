"""How much of a pixel lies on its centre's side of an edge that was placed between it and its neighbours.

Between a lit and a dark neighbour a ray half-way says in which half the edge runs, the next one in which quarter: it ends
up in one of `PLACES` places, counted from the one that asks. Four numbers say all of a pixel's edges (to the right, left,
below and above): 0 for none, else 1 + the edge's place as seen from the pixel.
"""

import numpy as np
from jaxtyping import Int32, UInt8

HALVINGS = 3  # rays between two neighbours
PLACES = 2**HALVINGS
FULL = 252  # levels of a pixel; also the compiled loops' `seen` of a lit point


def _beside_lines() -> Int32[np.ndarray, "place place"]:
    """The part of a pixel on its centre's side of the line that crosses the two axes at given places, in levels."""
    nearness = np.append(0.0, PLACES / (np.arange(PLACES) + 0.5))
    steep, flat = np.maximum(nearness[:, None], nearness), np.minimum(nearness[:, None], nearness)
    corner = np.maximum((steep + flat) / 2 - 1, 0.0)  # 0: the line passes outside
    cut_off = corner**2 / 2 / np.maximum(steep * flat, 1e-9)
    across = 0.5 - 1 / np.maximum(steep, 1e-9)  # the line runs from side to side, not about a corner
    part = 1 - np.where(corner == 0, 0.0, np.where(steep - flat <= 2, cut_off, across))
    return np.round(part * FULL).astype(np.int32)


BESIDE_LINE = _beside_lines()


def own_part(edges: UInt8[np.ndarray, "pixel 4"]) -> Int32[np.ndarray, " pixel"]:
    """How much of each pixel is in its centre's state, in levels; edges are taken as straight.

    One edge along each axis: a line through both, the nearer of two on one axis. Two edges on one axis and none on the
    other bound a thin shadow, or a thin light: both sides are cut off.
    """
    away = np.where(edges > 0, edges, PLACES + 1).astype(np.int32)
    nearest = np.stack([away[:, :2].min(axis=1), away[:, 2:].min(axis=1)], axis=1) % (PLACES + 1)
    out = BESIDE_LINE[nearest[:, 0], nearest[:, 1]]
    for axis in (0, 1):
        one, other = edges[:, 2 * axis], edges[:, 2 * axis + 1]
        strip = (one > 0) & (other > 0) & (nearest[:, 1 - axis] == 0)
        out = np.where(strip, BESIDE_LINE[one, 0] + BESIDE_LINE[other, 0] - FULL, out)
    return out
