"""The compiled loops of precomputed shadows: distances grown outward from shadows' edges, and blended between directions."""

import numpy as np

from relight3d.relight.half_cast_kernels import HALF_WAY, SPACING
from relight3d.relight.kernels import compiled, inlined

REACH = np.float32(16)  # pixels: farther from an edge all is alike
PER_PIXEL = np.float32(127 / REACH)
DIAGONAL = np.float32(np.sqrt(2)) * SPACING
OWN = np.float32(1)  # pixels: what a slot beside the grid, which has no neighbours, is taken to be away from an edge


@inlined
def _no_farther(distance, far, one, other, step):
    """Slot `one`, on the same side of the edge as `other`, is no farther from it than that and the step between them."""
    if (distance[one] > 0) == (distance[other] > 0):
        far[one] = min(far[one], far[other] + step)


@compiled
def grow(distance, is_joined, columns, rows, far, out):
    """Distances to edges (positive where lit; at most SPACING) carried on to REACH, over slots that are joined.

    A chamfer transform (Borgefors, 1986): once down and once up. `far` is room for them; `out`: int8, PER_PIXEL a pixel.
    """
    right, below, num = is_joined[0], is_joined[1], columns * rows
    for i in range(num):
        size = abs(distance[i])
        far[i] = size if size < SPACING else REACH
    for row in range(rows):
        for column in range(columns):
            i = row * columns + column
            if column > 0 and right[i - 1]:
                _no_farther(distance, far, i, i - 1, SPACING)
            if row > 0 and below[i - columns]:
                up = i - columns
                _no_farther(distance, far, i, up, SPACING)
                if column > 0 and right[up - 1]:
                    _no_farther(distance, far, i, up - 1, DIAGONAL)
                if column + 1 < columns and right[up]:
                    _no_farther(distance, far, i, up + 1, DIAGONAL)
    for row in range(rows - 1, -1, -1):
        for column in range(columns - 1, -1, -1):
            i = row * columns + column
            if column + 1 < columns and right[i]:
                _no_farther(distance, far, i, i + 1, SPACING)
            if row + 1 < rows and below[i]:
                down = i + columns
                _no_farther(distance, far, i, down, SPACING)
                if column + 1 < columns and right[down]:
                    _no_farther(distance, far, i, down + 1, DIAGONAL)
                if column > 0 and right[down - 1]:
                    _no_farther(distance, far, i, down - 1, DIAGONAL)
    for i in range(num):
        size = np.int8(min(far[i], REACH) * PER_PIXEL + np.float32(0.5))
        out[i] = size if distance[i] > 0 else -size
    for row in range(rows):  # the last column and row stand for those before them
        out[row * columns + columns - 1] = out[row * columns + columns - 2]
    for column in range(columns):
        out[num - columns + column] = out[num - 2 * columns + column]
    own = np.int8(OWN * PER_PIXEL + np.float32(0.5))
    for i in range(num, len(distance)):
        out[i] = own if distance[i] > 0 else -own


@compiled
def blend(one, two, three, shares, geometric, way, out):
    """Distances between three directions' (of grow), at most SPACING. Slots that turn away from `way` are dark, the edge
    half-way to those that do not. Returns how many slots are lit, or near it.
    """
    a, b, c = shares[0] / PER_PIXEL, shares[1] / PER_PIXEL, shares[2] / PER_PIXEL
    nx, ny, nz = geometric[0], geometric[1], geometric[2]
    x, y, z = way[0], way[1], way[2]
    num_lit = 0
    for i in range(len(out)):
        value = a * np.float32(one[i]) + b * np.float32(two[i]) + c * np.float32(three[i])
        value = min(max(value, -SPACING), SPACING)
        value = value if nx[i] * x + ny[i] * y + nz[i] * z > 0 else min(value, -HALF_WAY)
        out[i] = value
        num_lit += value > -HALF_WAY
    return num_lit
