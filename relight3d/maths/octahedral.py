"""Directions on an octahedron laid flat: nearly even over the sphere, and the three about any one are found at once.

Engelhardt and Dachsbacher, "Octahedron Environment Maps" (2008). The square [-1, 1]^2 has the pole in its middle, the
equator on its inner diamond, the other pole at its four corners.
"""

import numpy as np
from jaxtyping import Float64


def octahedral_directions(side: int) -> Float64[np.ndarray, "direction 3"]:
    """The unit directions at the crossings of a lattice of side x side cells, (side + 1)^2 of them, row by row."""
    v, u = np.mgrid[0 : side + 1, 0 : side + 1].reshape(2, -1) / side * 2 - 1
    z = 1 - np.abs(u) - np.abs(v)
    x = np.where(z < 0, (1 - np.abs(v)) * np.where(u >= 0, 1, -1), u)
    y = np.where(z < 0, (1 - np.abs(u)) * np.where(v >= 0, 1, -1), v)
    out = np.stack([x, y, z], axis=1)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def directions_about(
    way: Float64[np.ndarray, "3"], side: int
) -> tuple[tuple[int, int, int], tuple[float, float, float]]:
    """The three of octahedral_directions(side), `side` even, about a direction, and their shares of it, which add up to 1.

    Cells are cut along the octahedron's own edges, so that a triangle lies in one of its faces.
    """
    x, y, z = (float(c) for c in way)
    size = abs(x) + abs(y) + abs(z)
    u, v = x / size, y / size
    if z < 0:
        u, v = (1 - abs(v)) * (1 if u >= 0 else -1), (1 - abs(u)) * (1 if v >= 0 else -1)
    across, down = (u + 1) / 2 * side, (v + 1) / 2 * side
    column, row = min(int(across), side - 1), min(int(down), side - 1)
    a, b = across - column, down - row
    first = row * (side + 1) + column
    right, below = first + 1, first + side + 1
    if (2 * column + 1 - side) * (2 * row + 1 - side) > 0:  # where u v > 0 edges fall from right to left
        if a + b < 1:
            return (first, right, below), (1 - a - b, a, b)
        return (below + 1, below, right), (a + b - 1, 1 - a, 1 - b)
    if a > b:
        return (first, right, below + 1), (1 - a, a - b, b)
    return (first, below, below + 1), (1 - b, b - a, a)
