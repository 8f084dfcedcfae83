"""How the camera answered: each photograph's exposure beside the others', and linear values or sRGB's.

Both are read off matte points in plain light, where radiance goes with the light that geometry says a point gets.
"""

import numpy as np
from jaxtyping import Bool, Float, Float64

from relight3d.maths.color import linear_from_srgb, srgb_from_linear
from relight3d.recover.readings import MIN_PHOTOS, Sample, correlation
from relight3d.recover.visibility import highlight_zone

HIGHLIGHT_DEG = 40.0  # half angle about the mirror direction that is left out


def matte_light(sample: Sample, form: Float[np.ndarray, "photo point"]) -> Bool[np.ndarray, "photo point"]:
    """Where a point is lit, not grazed, not near its highlight, and not at the sensor's limit."""
    use = sample.is_valid & (form > 0.05 * form.max(axis=0)) & (sample.radiance > 0)
    for photo, each in enumerate(sample.lights):
        for light in each:
            to_light = light.incident(sample.points.position)[0].astype(np.float32)
            use[photo] &= ~highlight_zone(sample.points, to_light, HIGHLIGHT_DEG)
    return use


def exposure_gains(
    sample: Sample, form: Float[np.ndarray, "photo point"], matte: Bool[np.ndarray, "photo point"]
) -> Float64[np.ndarray, " photo"]:
    """How much brighter each photograph is than the others have it, by medians over points and photographs in turn.

    Only well lit points: elsewhere light from other surfaces, which the form does not know, has a larger share. NaN for
    a photograph that has too few of them.
    """
    use = matte & (form > 0.4 * form.max(axis=0))
    use &= use.sum(axis=0) >= 3
    use &= (use.sum(axis=1) >= 20)[:, None]
    ratio = np.log(np.where(use, sample.radiance, 1.0) / np.where(use, form, 1.0))
    known, gains = use.any(axis=1), np.zeros(len(form))
    if not known.any():
        return np.full(len(form), np.nan)
    for _ in range(8):
        albedo = _median(ratio - gains[:, None], use, axis=0)
        gains = _median(ratio - albedo, use, axis=1)
        gains -= np.median(gains[known])
    return np.where(known, np.exp(gains), np.nan)


def _median(values: np.ndarray, use: np.ndarray, axis: int) -> np.ndarray:
    """The median of what is in use along an axis; 0 where nothing is."""
    order = np.sort(np.where(use, values, np.inf), axis=axis)
    middle = np.expand_dims(np.maximum(use.sum(axis=axis) - 1, 0) // 2, axis)
    found = np.take_along_axis(order, middle, axis).squeeze(axis)
    return np.where(np.isfinite(found), found, 0.0)


def other_curve(
    sample: Sample, form: Float[np.ndarray, "photo point"], matte: Bool[np.ndarray, "photo point"], color_space: str
) -> float | None:
    """The share of points whose radiance follows their light better under the other colour space's curve.

    On matte points in light radiance is linear in the form; the curve of sRGB bends that. None where too few points
    tell.
    """
    power = np.array([sum(x.power[sample.channel] for x in each) for each in sample.lights])[:, None]
    values = sample.radiance * power
    white = np.percentile(values[sample.is_valid], 99.5)
    values = np.clip(values / max(white, 1e-30), 0.0, 1.0)
    other = linear_from_srgb(values) if color_space == "linear" else srgb_from_linear(values)
    use = matte & (values < 0.99)
    light = form * power
    most, least = np.where(use, light, 0.0).max(axis=0), np.where(use, light, np.inf).min(axis=0)
    told = (use.sum(axis=0) >= MIN_PHOTOS) & (most > 2.0 * least)
    if told.sum() < 0.2 * len(told) or told.sum() < 50:
        return None
    better = correlation(other, light, use) > correlation(values, light, use)
    return float(better[told].mean())
