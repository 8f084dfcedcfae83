"""Procedural images: the table's relief as a map of normals, and the painted box's albedo."""

import numpy as np

from desk.settings import Relief
from desk.shapes import ATLAS_COLUMNS, ATLAS_ROWS

CELL_PX = 256


def relief_normals(relief: Relief, size_m: tuple[float, float]) -> np.ndarray:
    """Unit normals (row, column, 3) over the table top, x along columns and y along rows; flat at its rim.

    Noise of one band of wavelengths; slopes from the spectrum, so that the normals are those of a height field.
    """
    columns, rows = (round(extent / relief.texel_m) for extent in size_m)
    noise = np.random.default_rng(relief.seed).normal(size=(rows, columns))
    wave_y, wave_x = np.meshgrid(
        np.fft.fftfreq(rows, relief.texel_m), np.fft.fftfreq(columns, relief.texel_m), indexing="ij"
    )
    frequency = np.hypot(wave_x, wave_y)
    band = (frequency > 1 / relief.longest_m) & (frequency < 1 / relief.shortest_m)
    height = np.fft.ifft2(np.fft.fft2(noise) * band / np.maximum(frequency, 1e-9)).real
    edge_m = np.minimum.outer(rim_distance(rows), rim_distance(columns)) * relief.texel_m
    height *= smooth_step(edge_m / 0.02)
    slope_y, slope_x = np.gradient(height, relief.texel_m)
    scale = np.tan(np.deg2rad(relief.slope_deg)) / np.sqrt((slope_x**2 + slope_y**2).mean() / 2)
    normals = np.dstack([-slope_x * scale, -slope_y * scale, np.ones_like(height)])
    normals[[0, -1], :] = normals[:, [0, -1]] = [0, 0, 1]  # the table's other sides look up the corner
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def rim_distance(count: int) -> np.ndarray:
    index = np.arange(count)
    return np.minimum(index, index[::-1])


def smooth_step(value: np.ndarray) -> np.ndarray:
    value = np.clip(value, 0, 1)
    return value * value * (3 - 2 * value)


def painted_atlas(mean: tuple[float, float, float]) -> np.ndarray:
    """Albedo (row, column, 3) of a box, one cell a side: soft shades under sharp marks; within 0.04 to 0.85."""
    v, u = np.meshgrid((np.arange(CELL_PX) + 0.5) / CELL_PX, (np.arange(CELL_PX) + 0.5) / CELL_PX, indexing="ij")
    atlas = np.zeros((CELL_PX * ATLAS_ROWS, CELL_PX * ATLAS_COLUMNS, 3))
    for side in range(6):
        row, column = divmod(side, ATLAS_COLUMNS)
        cell = np.array(mean) * soft_shades(u, v, side)
        cell = np.where(sharp_marks(u, v, side)[..., None], cell * MARK_TINTS[side], cell)
        atlas[row * CELL_PX : (row + 1) * CELL_PX, column * CELL_PX : (column + 1) * CELL_PX] = cell
    return np.clip(atlas, 0.04, 0.85)


MARK_TINTS = np.array(
    [(0.25, 0.45, 1.3), (1.5, 0.5, 0.3), (0.3, 0.9, 0.5), (1.7, 1.2, 0.25), (0.22, 0.28, 0.62), (0.5, 0.5, 0.5)]
)


def soft_shades(u: np.ndarray, v: np.ndarray, side: int) -> np.ndarray:
    phase = np.array([0.0, 1.1, 2.3]) + side
    wave = np.sin(2 * np.pi * (0.9 * u + 0.5 * v)[..., None] + phase) + 0.6 * np.sin(
        2 * np.pi * (1.7 * v - 0.8 * u)[..., None] + 2 * phase
    )
    return 1.0 + 0.22 * wave


def sharp_marks(u: np.ndarray, v: np.ndarray, side: int) -> np.ndarray:
    checker = (np.floor(u * 6) + np.floor(v * 5)) % 2 == 0
    stripes = np.abs(((u + 0.4 * v) * 5) % 1 - 0.5) < 0.16
    discs = np.hypot((u * 4) % 1 - 0.5, ((v * 3) % 1 - 0.5) * 4 / 3) < 0.33
    ring = np.abs(np.hypot(u - 0.5, v - 0.5) - 0.33) < 0.06
    cross = (np.abs(u - v) < 0.05) | (np.abs(u + v - 1) < 0.05)
    return (stripes, discs, stripes, discs | cross, checker & (np.hypot(u - 0.5, v - 0.5) < 0.47) | ring, checker)[side]
