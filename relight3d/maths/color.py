"""Linear radiance and display values: the sRGB curve, its inverse, luminance."""

import numpy as np
from jaxtyping import Float

LUMINANCE_WEIGHTS = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)  # ITU-R BT.709


def srgb_from_linear(linear: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
    """Encode linear values in [0, 1] with the sRGB curve; values outside are clipped, NaN becomes 0."""
    clipped = np.clip(np.nan_to_num(linear, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    # Both branches are evaluated, so the power's base is kept off zero.
    power = 1.055 * np.maximum(clipped, 1e-9) ** (1.0 / 2.4) - 0.055
    return np.where(clipped <= 0.0031308, 12.92 * clipped, power).astype(linear.dtype)


def linear_from_srgb(encoded: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
    """Decode sRGB values in [0, 1]."""
    power = ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, power).astype(encoded.dtype)


def luminance(rgb: Float[np.ndarray, "*axes 3"]) -> Float[np.ndarray, "*axes"]:
    """Relative luminance of linear BT.709 colours."""
    return rgb @ LUMINANCE_WEIGHTS.astype(rgb.dtype)


def exposure_of(radiance: Float[np.ndarray, "*axes"], percentile: float = 99.5) -> float:
    """The contract's exposure: the factor that shows the given percentile of all values as white."""
    finite = radiance[np.isfinite(radiance)]
    white = float(np.percentile(finite, percentile)) if finite.size else 0.0
    return 1.0 / white if white > 0.0 else 1.0


def display_u8(radiance: Float[np.ndarray, "*axes"], exposure: float = 1.0) -> np.ndarray:
    """8-bit sRGB values of linear radiance under one exposure."""
    return np.rint(srgb_from_linear(np.asarray(radiance, np.float32) * np.float32(exposure)) * 255).astype(np.uint8)
