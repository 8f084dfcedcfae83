"""Parts of photographs that something outside the mesh keeps the lamp from: the photographer, a stand, a missing part.

Differs from the paper, whose photographs are all as the geometry says. A shadow that the mesh does not throw is nobody's
reflectance: left in, it divides surfaces, and left-out photographs, which it makes unpredictable, speak against every
effect. It is told before any fit, by what is matte and lit: there radiance over the lamp's irradiance is nearly the same
in all photographs, and falls in the shadow alone.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32

from relight3d.camera import Camera
from relight3d.records import Observations, ShadingPoints

CELLS = 12  # along a row of the picture
MIN_CELL_PX = 4
MIN_POINTS = 8  # of a cell, in a photograph
MIN_PHOTOGRAPHS = 4  # that light a point, to say what is usual there
MIN_FORM = 0.3  # of the strongest light of a point: where it is grazed, other light counts for more
DARKER = 0.4  # by this part and more a shadow is darker than the same place in other photographs
UNUSUAL = 4.0  # times the usual deviation of the place
MIN_SHARE, MOST_SHARE = 0.05, 0.8  # of a photograph: less is a detail, and more is the lamp itself
WHOLE_SHARE = 0.25  # of what its lights reach: beyond, the light that the rest of the picture sends on is missing, too
MOST_OF_ALL = 0.25  # of all photographs: more is not the exception, but the rule


def without_blockers(observed: Observations, points: ShadingPoints, camera: Camera) -> Observations:
    """The photographs without their parts in shadows that the mesh does not throw: those have weight 0, and of photographs
    with large ones everything, since the blocked part sends no light on to the rest.

    `blocked_share` of the result says how much of what its lights reach is blocked in each photograph.
    """
    relative = darker_than_usual(observed)
    cell, num_cells = _cells(points, camera)
    usual = _cell_medians(relative, cell, num_cells)
    is_told = np.isfinite(usual)
    deviation = _median(np.abs(usual))
    is_dark = is_told & (usual < -np.maximum(DARKER, UNUSUAL * deviation))
    size = np.stack([np.bincount(cell[np.isfinite(each)], minlength=num_cells) for each in relative]) * is_told
    share = (size * is_dark).sum(axis=1) / np.maximum(size.sum(axis=1), 1)
    is_dark &= ((share >= MIN_SHARE) & (share <= MOST_SHARE))[:, None]
    if not is_dark.any() or (size * is_dark).sum() > MOST_OF_ALL * size.sum():
        return observed
    # A point is of the shadow when it is nearer to it than to what is usual; what cannot tell goes with its cell.
    half = _around(np.where(is_dark, usual, 0.0)).min(axis=0)[:, cell] / 2
    is_in = _with_untold(is_dark, is_told)[:, cell]
    blocked = observed.is_lit & np.where(np.isfinite(relative), (half < 0) & (relative < half), is_in)
    lost = blocked.sum(axis=1) / np.maximum(observed.is_lit.sum(axis=1), 1)
    weight = np.where(blocked, np.float32(0), observed.weight)
    is_lost = lost > WHOLE_SHARE
    if is_lost.sum() <= MOST_OF_ALL * len(lost):
        weight[is_lost] = 0.0
    return replace(observed, weight=weight, blocked_share=tuple(float(x) for x in lost))


def darker_than_usual(observed: Observations) -> Float32[np.ndarray, "photo point"]:
    """Radiance over irradiance beside its median over photographs, less 1; NaN where a photograph cannot tell.

    Ambient light is taken off where a photograph with the lights off shows it.
    """
    gray, form = observed.radiance.mean(axis=2), observed.form.mean(axis=2)
    if (ambient := observed.ambient) is not None:
        gray = gray - ambient.mean(axis=2)
    tells = observed.is_lit & observed.is_safe & ~observed.is_highlight & (observed.weight > 0)
    tells &= form > MIN_FORM * np.where(tells, form, 0.0).max(axis=0)
    tells &= tells.sum(axis=0) >= MIN_PHOTOGRAPHS
    ratio = np.where(tells, gray / np.where(tells, form, 1.0), np.nan).astype(np.float32)
    usual = _median(ratio)
    return np.where(usual > 0, ratio / np.where(usual > 0, usual, 1.0) - 1.0, np.nan).astype(np.float32)


def _median(values: np.ndarray) -> np.ndarray:
    """The median over photographs of what is known; NaN where nothing is."""
    out = np.full(values.shape[1], np.nan, values.dtype)
    is_known = np.isfinite(values).any(axis=0)
    out[is_known] = np.nanmedian(values[:, is_known], axis=0)
    return out


def _cells(points: ShadingPoints, camera: Camera) -> tuple[np.ndarray, int]:
    """The cell of the picture that each point is in, and their number."""
    side = max(MIN_CELL_PX, -(-camera.width // CELLS))
    row, column = np.divmod(points.pixel, camera.width)
    return row // side * CELLS + column // side, -(-camera.height // side) * CELLS


def _cell_medians(relative: np.ndarray, cell: np.ndarray, num_cells: int) -> Float32[np.ndarray, "photo cell"]:
    """The median of each cell in each photograph; NaN where too few points tell."""
    out = np.full((len(relative), num_cells), np.nan, np.float32)
    for photo, each in enumerate(relative):
        known = np.flatnonzero(np.isfinite(each))
        order = known[np.lexsort((each[known], cell[known]))]  # by cell, and from dark to bright within
        found, first, count = np.unique(cell[order], return_index=True, return_counts=True)
        enough = count >= MIN_POINTS
        out[photo, found[enough]] = each[order[(first + count // 2)[enough]]]
    return out


def _with_untold(is_dark: np.ndarray, is_told: np.ndarray) -> Bool[np.ndarray, "photo cell"]:
    """With the cells that say nothing (a highlight, an outline) where more of their neighbours are dark than are not."""
    for _ in range(2):
        says = np.where(is_told, np.where(is_dark, 1, -1), 0)
        added = ~is_told & (_around(says).sum(axis=0) > 0)
        is_dark, is_told = is_dark | added, is_told | added
    return is_dark


def _around(values: np.ndarray) -> np.ndarray:
    """The nine cells about each one (9 x photo x cell); 0 beyond the picture."""
    padded = np.pad(values.reshape(len(values), -1, CELLS), ((0, 0), (1, 1), (1, 1)))
    rows, columns = padded.shape[1] - 2, CELLS
    shifted = [padded[:, i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return np.stack(shifted).reshape(9, len(values), -1)
