"""An environment map as a handful of distant lights, by median cut (Debevec 2005)."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from relight3d.errors import InputError
from relight3d.lights import DirectionalLight

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


class _Region(NamedTuple):
    """Rows and columns of the map, and the energy in them."""

    top: int
    bottom: int
    left: int
    right: int
    energy: float


def lights_from_environment(
    environment: str | Path | Float[np.ndarray, "height width 3"], num: int = 32
) -> list[DirectionalLight]:
    """At most `num` distant lights that together send what the map does: regions of equal energy, one light each.

    An equirectangular map of linear radiance, z up: its first row looks up, its middle column along +x, and what lies
    left of the middle towards +y. Each light has its region's irradiance and stands at its centre of energy. Raises
    InputError for a map that is no such array, is negative or not finite, and for no light at all.
    """
    radiance = _read(environment)
    if num < 1:
        raise InputError("num", num, "at least one light")
    height, width = radiance.shape[:2]
    polar = np.pi * (np.arange(height) + 0.5) / height
    # The solid angle of a pixel, exactly: rows are zones of the sphere.
    zone = np.cos(np.pi * np.arange(height) / height) - np.cos(np.pi * np.arange(1, height + 1) / height)
    irradiance = radiance * (zone * 2 * np.pi / width)[:, None, None]
    energy = irradiance @ LUMINANCE
    azimuth = np.pi - 2 * np.pi * (np.arange(width) + 0.5) / width
    ring = np.sin(polar)[:, None]
    toward = np.stack(
        [ring * np.cos(azimuth), ring * np.sin(azimuth), np.broadcast_to(np.cos(polar)[:, None], energy.shape)], axis=-1
    )
    lights = []
    for region in _median_cut(energy, ring[:, 0], num):
        part = (slice(region.top, region.bottom), slice(region.left, region.right))
        direction = np.einsum("yx,yxi->i", energy[part], toward[part])
        color = irradiance[part].sum(axis=(0, 1))
        # A region that sends the same from all sides has no centre: the middle of its pixels stands in.
        if np.linalg.norm(direction) < 1e-9 * max(region.energy, 1e-300):
            direction = toward[(region.top + region.bottom) // 2, (region.left + region.right) // 2]
        if color.max() > 0:
            lights.append(DirectionalLight(tuple(direction), tuple(color)))
    return lights


def _median_cut(energy: np.ndarray, ring: np.ndarray, num: int) -> list[_Region]:
    """Regions of about equal energy: the strongest that can be cut is cut in half across its longer side."""
    height, width = energy.shape
    # Sums over any rectangle from one table.
    table = np.zeros((height + 1, width + 1))
    table[1:, 1:] = energy.cumsum(axis=0).cumsum(axis=1)

    def region(top: int, bottom: int, left: int, right: int) -> _Region:
        total = table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
        return _Region(top, bottom, left, right, float(total))

    regions = [region(0, height, 0, width)]
    while len(regions) < num:
        regions.sort(key=lambda r: r.energy if (r.bottom - r.top) * (r.right - r.left) > 1 else -1.0)
        top, bottom, left, right, total = regions[-1]
        if (bottom - top) * (right - left) < 2 or total <= 0:
            break
        regions.pop()
        tall = (bottom - top) / height * np.pi
        wide = (right - left) / width * 2 * np.pi * ring[(top + bottom) // 2]
        across_rows = bottom - top > 1 and (tall >= wide or right - left == 1)
        if across_rows:
            sums = table[top : bottom + 1, right] - table[top : bottom + 1, left]
            cut = top + _half(sums - sums[0])
            regions += [region(top, cut, left, right), region(cut, bottom, left, right)]
        else:
            sums = table[bottom, left : right + 1] - table[top, left : right + 1]
            cut = left + _half(sums - sums[0])
            regions += [region(top, bottom, left, cut), region(top, bottom, cut, right)]
    return regions


def _half(sums: np.ndarray) -> int:
    """Where running sums pass half of the last, kept inside."""
    return int(np.clip(np.argmin(np.abs(sums - sums[-1] / 2)), 1, len(sums) - 2))


def _read(environment: str | Path | np.ndarray) -> Float[np.ndarray, "height width 3"]:
    if isinstance(environment, str | Path):
        from relight3d.io.exr import read_exr

        radiance = np.asarray(read_exr(Path(environment)), np.float64)[..., :3]
    else:
        radiance = np.asarray(environment, np.float64)
    if radiance.ndim != 3 or radiance.shape[2] != 3 or 0 in radiance.shape:
        raise InputError("environment", radiance.shape, "height x width x 3")
    if not np.isfinite(radiance).all() or (radiance < 0).any():
        raise InputError("environment", "negative or not finite values", "linear radiance")
    return radiance
