"""Highlights about the half-way direction: round ones, and brushed ones that are far longer than wide.

    f(u, v) = rho * (1 / (C_x h_x^2 + C_y h_y^2 + C_z h_z^2)) ** n,   h = (u + v) / |u + v|,   C_x, C_y >= C_z = 1

in the frame (tangent, bitangent, normal) of a point. n = 2 is the distribution of Trowbridge and Reitz with roughness
C_x ** -0.5 along the tangent and C_y ** -0.5 across; a large n with C near 1 is Gaussian. The base is in (0, 1].

Differs from the paper: a Lafortune lobe is round about C v whatever its axes, so that no sum of a few makes the long
streak of brushed metal; nor has it the peak and the wide foot together that rough metal and varnish show. The tangent may
turn with the surface as well: its field is the velocity of a rigid motion, which is one direction everywhere, circles
about an axis (a turned part), or a helix.
"""

import numpy as np
from jaxtyping import Float

from relight3d.maths.lafortune import tangent_frame


def halfway_base(
    normal: Float[np.ndarray, "*axes 3"],
    to_light: Float[np.ndarray, "*axes 3"],
    to_viewer: Float[np.ndarray, "*axes 3"],
    axes: Float[np.ndarray, "3"],
    along: Float[np.ndarray, "*#axes 3"],
) -> Float[np.ndarray, "*axes"]:
    """The base of the power; unit vectors, `along` of any length."""
    middle = to_light + to_viewer
    tangent, bitangent = tangent_frame(normal, along)
    t, b, n = (np.einsum("...i,...i->...", way, middle) for way in (tangent, bitangent, normal))
    tiny = np.asarray(1e-12, normal.dtype)  # opposite directions have no half
    whole = np.einsum("...i,...i->...", middle, middle) + tiny
    return whole / (axes[0] * t**2 + axes[1] * b**2 + axes[2] * n**2 + tiny)


def round_halfway_base(
    normal: Float[np.ndarray, "*axes 3"],
    to_light: Float[np.ndarray, "*axes 3"],
    to_viewer: Float[np.ndarray, "*axes 3"],
    axes: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "*axes"]:
    """The same where C_x = C_y, which needs no tangent."""
    middle = to_light + to_viewer
    ahead = np.einsum("...i,...i->...", normal, middle)
    level = ((middle - ahead[..., None] * normal) ** 2).sum(axis=-1)  # nothing cancels in it
    tiny = np.asarray(1e-12, normal.dtype)
    return (level + ahead**2 + tiny) / (axes[0] * level + axes[2] * ahead**2 + tiny)


def rigid_field(
    positions: Float[np.ndarray, "point 3"],
    tangents: Float[np.ndarray, "point 3"],
    normals: Float[np.ndarray, "point 3"],
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """(start, turn) of the rigid motion whose velocity, start + turn x position, runs most nearly along the tangents.

    A share of squares along the tangents, as a generalised eigenvector: a motion along the normals is none of either.
    The velocity is of mean square 1 over the positions.
    """
    from scipy.linalg import eigh

    middle = positions.mean(axis=0)
    size = max(float(np.sqrt(((positions - middle) ** 2).sum(axis=1).mean())), 1e-30)
    place, across = (positions - middle) / size, np.cross(normals, tangents)
    rows = [np.concatenate([way, np.cross(place, way)], axis=1) for way in (tangents, across)]
    along, aside = (row.T @ row for row in rows)
    whole = along + aside
    _, vectors = eigh(along, whole + 1e-6 * np.trace(whole) / 6 * np.eye(6))
    turn = vectors[3:, -1] / size
    start = vectors[:3, -1] - np.cross(turn, middle)
    speed = np.sqrt(((start + np.cross(turn, positions)) ** 2).sum(axis=1).mean())
    return start / max(speed, 1e-30), turn / max(speed, 1e-30)


def halfway_energy(axes: Float[np.ndarray, "3"], exponent: float, num: int = 96) -> float:
    """The largest directional albedo of a lobe of colour 1: max over viewers of the integral of f cos; to a few percent."""
    turns = (0.0, np.pi / 4, np.pi / 2)
    return max(
        _directional_albedo(
            axes, exponent, np.array([np.sqrt(1 - z * z) * np.cos(a), np.sqrt(1 - z * z) * np.sin(a), z]), num
        )
        for z in (1.0, 0.8, 0.5, 0.25, 0.1)
        for a in turns
    )


def _directional_albedo(axes: np.ndarray, exponent: float, view: np.ndarray, num: int) -> float:
    """The integral of the lobe times the cosine over the directions to the light, for one viewer.

    The half-way direction is sampled by the lobe's own slopes, of which (1 + q^2) ** -n is integrated over q^2 in closed
    form; the light is its mirror image of the viewer, at four times the solid angle per cosine.
    """
    i = (np.arange(num) + 0.5) / num
    azimuth, share = np.meshgrid(2 * np.pi * i, i)
    order = max(exponent, 1.2)  # of the density (order - 1) (1 + q^2) ** -order: one at 1 has no integral
    squared = share ** (-1.0 / (order - 1.0)) - 1.0
    slope = np.sqrt(squared)
    half = np.stack(
        [slope * np.cos(azimuth) / axes[0] ** 0.5, slope * np.sin(azimuth) / axes[1] ** 0.5, np.ones_like(slope)],
        axis=-1,
    )
    length = np.linalg.norm(half, axis=-1)
    half /= length[..., None]
    cosine = half @ view
    light_z = 2 * cosine * half[..., 2] - view[2]
    # base = |slopes|^2 / (1 + q^2); solid angle per slopes' area = 1 / |slopes|^3.
    value = (length**2 / (1 + squared)) ** exponent * (1 + squared) ** order / (order - 1)
    value = value * np.pi / np.sqrt(axes[0] * axes[1]) / length**3 * 4 * np.maximum(cosine, 0) * np.maximum(light_z, 0)
    return float(value.mean())
