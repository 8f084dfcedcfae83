"""The Lafortune lobe, eq. (4): f(u, v) = rho * max(0, C_x u_x v_x + C_y u_y v_y + C_z u_z v_z) ** n.

u and v are unit directions to the light and to the viewer in the frame (tangent, bitangent, normal) of a point;
C = (-1, -1, 1) is the mirror direction, C_x != C_y anisotropic, all C > 0 retro-reflective, |C_z| above |C_x| moves
the highlight off the mirror direction at grazing angles. The base is <= 1 as |C| <= 1, so no exponent overflows.
"""

import numpy as np
from jaxtyping import Float

MAX_EXPONENT = 1e4  # of a lobe that is fitted


def tangent_frame(
    normal: Float[np.ndarray, "*axes 3"], along: Float[np.ndarray, "*#axes 3"] | None = None
) -> tuple[Float[np.ndarray, "*axes 3"], Float[np.ndarray, "*axes 3"]]:
    """Tangent and bitangent of unit normals, the tangent as near to `along` as the plane allows.

    Without `along`, or where it stands on the normal, the frame of Duff et al. (2017), which has no seam but at -z.
    """
    x, y, z = np.moveaxis(normal, -1, 0)
    sign = np.where(z >= 0, 1.0, -1.0).astype(normal.dtype)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    if along is not None:
        projected = along - normal * np.einsum("...i,...i->...", normal, along)[..., None]
        length, whole = (np.linalg.norm(a, axis=-1, keepdims=True) for a in (projected, along))
        tangent = np.where(length > 1e-4 * whole, projected / np.maximum(length, 1e-12), tangent)
    return tangent.astype(normal.dtype), np.cross(normal, tangent).astype(normal.dtype)


def lobe_base(
    normal: Float[np.ndarray, "*axes 3"],
    to_light: Float[np.ndarray, "*axes 3"],
    to_viewer: Float[np.ndarray, "*axes 3"],
    axes: Float[np.ndarray, "3"],
    along: Float[np.ndarray, "3"] | None = None,
) -> Float[np.ndarray, "*axes"]:
    """The base of the power, before clamping. An isotropic lobe (C_x = C_y) needs no tangent frame:

    C_x (u.v - u_n v_n) + C_z u_n v_n.
    """
    u_n = np.einsum("...i,...i->...", normal, to_light)
    v_n = np.einsum("...i,...i->...", normal, to_viewer)
    if axes[0] == axes[1]:
        return axes[0] * (np.einsum("...i,...i->...", to_light, to_viewer) - u_n * v_n) + axes[2] * u_n * v_n
    tangent, bitangent = tangent_frame(normal, along)
    u_t, v_t = (np.einsum("...i,...i->...", tangent, d) for d in (to_light, to_viewer))
    u_b, v_b = (np.einsum("...i,...i->...", bitangent, d) for d in (to_light, to_viewer))
    return axes[0] * u_t * v_t + axes[1] * u_b * v_b + axes[2] * u_n * v_n


def power(base: Float[np.ndarray, "*axes"], exponent: float) -> Float[np.ndarray, "*axes"]:
    """max(0, base) ** exponent, finite for every base <= 1 and exponent > 0, and 0 at base <= 0."""
    # exp(n log b), since a negative base to a real power is NaN; b = 1 gives exactly 1, and the clamp keeps the log
    # finite at b = 0.
    clamped = np.clip(base, 1e-30, 1.0)
    return np.where(base > 0, np.exp(exponent * np.log(clamped)), 0.0).astype(base.dtype)


def lobe_energy(axes: Float[np.ndarray, "3"], exponent: float, num: int = 64) -> float:
    """The largest directional albedo of a lobe of colour 1: max over viewers of the integral of f cos.

    Stratified quadrature over the hemisphere about the lobe; exact to about 1 % for exponents to 1e4.
    """
    turns = (0.0,) if axes[0] == axes[1] else (0.0, np.pi / 4, np.pi / 2)
    views = [
        np.array([np.sqrt(1 - v_z * v_z) * np.cos(turn), np.sqrt(1 - v_z * v_z) * np.sin(turn), v_z])
        for v_z in (1.0, 0.8, 0.5, 0.25, 0.1)
        for turn in turns
    ]
    return max(_directional_albedo(axes, exponent, view, num) for view in views)


def _directional_albedo(axes: np.ndarray, exponent: float, view: np.ndarray, num: int) -> float:
    """The integral of a lobe of colour 1 times the cosine over the directions to the light, for one viewer."""
    peak = axes * view
    length = np.linalg.norm(peak)
    if length == 0:
        return 0.0
    # A cosine-power about the peak direction samples the lobe itself: the weight left is length^n cos.
    i = (np.arange(num) + 0.5) / num
    azimuth, height = np.meshgrid(2 * np.pi * i, i ** (1.0 / (exponent + 1.0)))
    ring = np.sqrt(np.maximum(0.0, 1 - height**2))
    local = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), height], axis=-1)
    axis = peak / length
    t, b = tangent_frame(axis)
    u_z = np.maximum(0.0, local[..., 0] * t[2] + local[..., 1] * b[2] + local[..., 2] * axis[2])
    return float(length**exponent * 2 * np.pi / (exponent + 1) * u_z.mean())
