"""Pixels on outlines, cut into points that share them, as a photograph's pixel mixes what it covers."""

from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

from relight3d.camera import Camera
from relight3d.records import RelightModel, ShadingPoints
from relight3d.shading import NUDGE_PX, points_along
from relight3d.tracing import RayScene


def is_break(depth: np.ndarray, other_depth: np.ndarray, normal: np.ndarray, other_normal: np.ndarray) -> np.ndarray:
    """Whether two spots are on different sides of a crease, or one far behind the other."""
    crease = np.einsum("...i,...i->...", normal, other_normal) < 0.85
    return crease | (np.abs(depth - other_depth) > 0.06 * np.maximum(depth, other_depth))


# On which side of a pixel its neighbour shows something else: bits of a number.
RIGHT, LEFT, BELOW, ABOVE = 1, 2, 4, 8
ALL_SIDES = RIGHT | LEFT | BELOW | ABOVE


class Cut(NamedTuple):
    """The points that stand for pixels on outlines. Pixels are those of the whole picture."""

    points: ShadingPoints
    share: Float32[np.ndarray, " point"]  # of the pixel
    middle: Float32[np.ndarray, " pixel"]  # what stays with the ray through a pixel's middle
    is_full: Bool[np.ndarray, " pixel"]  # whether all rays of a pixel met the mesh
    num_rays: int


@cache
def grid_places(samples: int) -> Float64[np.ndarray, "sample 2"]:
    """The middles of a pixel's cells, x and y from 0 to 1."""
    side = round(samples**0.5)
    y, x = (np.mgrid[0:side, 0:side].reshape(2, -1) + 0.5) / side
    return np.stack([x, y], axis=1)


@cache
def places_beyond(samples: int) -> Bool[np.ndarray, "sides sample"]:
    """Which of a pixel's places (grid_places) are towards some sides, for all sixteen sets of sides.

    A straight outline between a pixel's middle and some of its neighbours' passes no place that is towards none of them.
    """
    x, y = grid_places(samples).T
    is_beyond = {RIGHT: x > 0.5, LEFT: x < 0.5, BELOW: y > 0.5, ABOVE: y < 0.5}
    sides = np.arange(ALL_SIDES + 1)[:, None]
    return np.any([(sides & side > 0) & beyond for side, beyond in is_beyond.items()], axis=0)


def cut_pixels(
    scene: RayScene,
    model: RelightModel,
    camera: Camera,
    pixel: Int32[np.ndarray, " some"],
    sides: UInt8[np.ndarray, " some"],
    samples: int,
    is_fine: bool,
) -> Cut:
    """Looks through several places of each of the pixels, towards the sides where neighbours show something else.

    About `samples` points a pixel, what its middle shows among them: each the end of a ray, or with `is_fine` chosen from
    four times as many rays through all of the pixel, so that a side of the outline has the share that it covers.
    """
    place = _fine_places(samples) if is_fine else grid_places(samples)
    is_asked = np.ones((len(pixel), len(place)), bool) if is_fine else places_beyond(samples)[sides]
    which, sample = np.nonzero(is_asked)
    corner = np.stack([pixel % camera.width, pixel // camera.width], axis=1)
    places = corner[which] + place[sample] + NUDGE_PX
    parts = points_along(scene, model.mesh, camera, pixel[which], places)
    found = np.bincount(parts.pixel, minlength=camera.num_pixels)
    asked, rest = np.zeros((2, camera.num_pixels), int)
    asked[pixel] = is_asked.sum(axis=1)
    rest[pixel] = len(place) - asked[pixel]
    whole = np.full(camera.num_pixels, len(place)) if model.outlines_end == "black" else np.maximum(found + rest, 1)
    share = 1.0 / whole[parts.pixel]
    if is_fine and len(parts):
        parts, share = _thinned(model, parts, share)
    return Cut(parts, share.astype(np.float32), (rest / whole).astype(np.float32), found == asked, len(which))


def _fine_places(samples: int) -> Float64[np.ndarray, "ray 2"]:
    """Four times as many places, four after four of them in a cell of the grid, no two in a row or a column."""
    side = 2 * round(samples**0.5)
    y, x = np.mgrid[0:side, 0:side].reshape(2, -1)
    order = np.lexsort((x, y, x // 2, y // 2))
    return np.stack([x * side + y + 0.5, y * side + x + 0.5], axis=1)[order] / side**2


def _thinned(model: RelightModel, parts: ShadingPoints, share: np.ndarray) -> tuple[ShadingPoints, np.ndarray]:
    """A fourth of the points, but at least one for each side of an outline; a point's share is that of all it stands for."""
    surface = model.surfaces.surface_of_face[parts.face]
    order = np.lexsort((surface, parts.pixel))  # the rays of a pixel and surface in their own order
    first, _ = _runs(parts.pixel[order], surface[order])
    first = order[first]
    is_other = np.empty(len(parts), bool)
    normal, depth = parts.normal, parts.depth
    is_other[order] = is_break(depth[first], depth[order], normal[first], normal[order])
    order = np.lexsort((is_other, surface, parts.pixel))
    first, count = _runs(parts.pixel[order], surface[order], is_other[order])
    points = (count + 2) // 4 + (count == 1)
    block = (np.arange(len(parts)) - first) * points // count
    start, size = _runs(first, block)
    begin = np.flatnonzero(start == np.arange(len(start)))
    return parts.take(order[begin + size[begin] // 2]), np.add.reduceat(share[order], begin)


def _runs(*keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the run of equal keys that each element is in begins, and how long it is."""
    is_new = np.ones(len(keys[0]), bool)
    is_new[1:] = np.any([key[1:] != key[:-1] for key in keys], axis=0)
    begin = np.flatnonzero(is_new)
    run = np.cumsum(is_new) - 1
    return begin[run], np.diff(np.append(begin, len(is_new)))[run]
