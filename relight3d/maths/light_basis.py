"""Low-order functions of a light's direction, in which the indirect light is written, eq. (7).

omega is the unit direction to the light; z is up (the scene's own axis need not be: the functions of one order span
the same space in every frame, but for the hemispherical ones and the paper's angles). Each basis starts with the
constant 1. The order of a basis is the highest degree of its polynomials.
"""

import numpy as np
from jaxtyping import Float

GOLDEN_ANGLE = np.pi * (3.0 - 5.0**0.5)
BASES: dict[str, int] = {  # name -> number of functions
    "constant": 1,
    "linear": 4,
    "angles2": 6,
    "cosines2": 9,
    "sh2": 9,
    "sh3": 16,
    "hsh2": 9,
    "hsh3": 16,
}


def evaluate_basis(name: str, omega: Float[np.ndarray, "*axes 3"]) -> Float[np.ndarray, "*axes basis"]:
    """The functions of a basis at unit directions.

    "angles2" is the paper's polynomial in (theta, phi): it breaks at the pole and jumps at phi = +-pi, and is here to
    be priced. "linear" is 1 and the direction cosines, "cosines2" all their products to degree 2 (the dependent one
    left out), "sh" and "hsh" the real spherical and hemispherical harmonics.
    """
    x, y, z = np.moveaxis(np.asarray(omega), -1, 0)
    one = np.ones_like(x)
    if name == "constant":
        return one[..., None]
    if name == "linear":
        return np.stack([one, x, y, z], axis=-1)
    if name == "angles2":
        theta, phi = np.arccos(np.clip(z, -1.0, 1.0)), np.arctan2(y, x)
        return np.stack([one, theta, phi, theta * theta, theta * phi, phi * phi], axis=-1)
    if name == "cosines2":
        return np.stack([one, x, y, z, x * y, y * z, x * z, x * x - y * y, z * z], axis=-1)
    if name in ("sh2", "sh3"):
        return _harmonics(x, y, z, order=int(name[-1]))
    if name in ("hsh2", "hsh3"):
        # The upper hemisphere is stretched over the sphere: cos(theta) -> 2 cos(theta) - 1 (Gautron et al. 2004).
        stretched = 2.0 * np.clip(z, 0.0, 1.0) - 1.0
        ring = np.sqrt(np.maximum(x * x + y * y, 1e-24))
        around = np.sqrt(np.maximum(1.0 - stretched * stretched, 0.0)) / ring
        return _harmonics(x * around, y * around, stretched, order=int(name[-1]))
    raise KeyError(name)


def _harmonics(x: np.ndarray, y: np.ndarray, z: np.ndarray, order: int) -> np.ndarray:
    """Real spherical harmonics to degree 2 or 3, scaled so that the first is 1 (Sloan 2008, appendix A2)."""
    functions = [np.ones_like(x)]
    functions += [3**0.5 * f for f in (y, z, x)]
    functions += [15**0.5 * f for f in (x * y, y * z, x * z)]
    functions += [5**0.5 / 2 * (3 * z * z - 1), 15**0.5 / 2 * (x * x - y * y)]
    if order == 3:
        functions += [(35 / 8) ** 0.5 * y * (3 * x * x - y * y), 105**0.5 * x * y * z]
        functions += [(21 / 8) ** 0.5 * f * (5 * z * z - 1) for f in (y, x)]
        functions += [7**0.5 / 2 * z * (5 * z * z - 3), 105**0.5 / 2 * z * (x * x - y * y)]
        functions += [(35 / 8) ** 0.5 * x * (x * x - 3 * y * y)]
    return np.stack(functions, axis=-1)


def degree_of(name: str) -> Float[np.ndarray, " basis"]:
    """The polynomial degree of each function of a basis: what damping grows with."""
    degrees = {
        "constant": [0],
        "linear": [0, 1, 1, 1],
        "angles2": [0, 1, 1, 2, 2, 2],
        "cosines2": [0, 1, 1, 1, 2, 2, 2, 2, 2],
    }
    harmonics = [0] + [1] * 3 + [2] * 5 + [3] * 7
    return np.array(degrees.get(name, harmonics[: BASES[name]]), dtype=np.float64)


def spread_directions(num: int) -> Float[np.ndarray, "num 3"]:
    """Unit directions spread evenly over the sphere, by a golden spiral from pole to pole."""
    index = np.arange(num) + 0.5
    z = 1.0 - 2.0 * index / max(num, 1)
    ring, turn = np.sqrt(1.0 - z * z), GOLDEN_ANGLE * index
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)


def embedding(name: str, into: str) -> Float[np.ndarray, "basis wider"]:
    """The functions of one basis as combinations of a wider one's: rows of coefficients.

    Raises ValueError where the wider one does not hold them all.
    """
    if name == into:
        return np.eye(BASES[name])
    omega = spread_directions(200)
    wide, narrow = evaluate_basis(into, omega), evaluate_basis(name, omega)
    rows = np.linalg.lstsq(wide, narrow, rcond=None)[0].T
    if np.abs(wide @ rows.T - narrow).max() > 1e-9:
        raise ValueError(f"basis {into} does not hold the functions of {name}")
    return np.where(np.abs(rows) < 1e-12, 0.0, rows)


def within_reach(
    omega: Float[np.ndarray, "light 3"], anchors: Float[np.ndarray, "anchor 3"], reach_rad: float
) -> tuple[Float[np.ndarray, "light 3"], Float[np.ndarray, " light"]]:
    """Directions moved on their great circle to within `reach_rad` of the nearest anchor, and how far, in radians.

    A low-order function is only known near the lights that it was fitted to; beyond, this keeps it from running away,
    without a jump at the border of reach. Directions within reach are returned as they are. Out of reach of all
    anchors, the place that is read jumps where the nearest one changes.
    """
    if len(anchors) == 0:
        return omega, np.zeros(len(omega))
    cosine = np.clip(omega @ anchors.T, -1.0, 1.0)
    nearest, cosine = anchors[np.argmax(cosine, axis=1)], cosine.max(axis=1)
    excess = np.maximum(np.arccos(cosine) - reach_rad, 0.0)
    # A light opposite to its anchor has no great circle of its own: it is read at the anchor.
    aside = omega - cosine[:, None] * nearest
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-9)
    moved = np.cos(reach_rad) * nearest + np.sin(reach_rad) * aside
    moved /= np.maximum(np.linalg.norm(moved, axis=1, keepdims=True), 1e-12)
    return np.where(excess[:, None] > 0, moved, omega), excess
