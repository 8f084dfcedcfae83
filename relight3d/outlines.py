"""Pixels on outlines, cut into points that share them, as a photograph's pixel mixes what it covers."""

import numpy as np
from jaxtyping import Float32, Float64, Int32

from relight3d.camera import Camera
from relight3d.records import RelightModel, ShadingPoints
from relight3d.shading import NUDGE_PX, points_along
from relight3d.tracing import RayScene

CREASE_COSINE, FAR_BEHIND = 0.85, 0.06  # between normals; of the farther one's depth


def is_break(depth: np.ndarray, other_depth: np.ndarray, normal: np.ndarray, other_normal: np.ndarray) -> np.ndarray:
    """Whether two spots are on different sides of a crease, or one far behind the other."""
    crease = np.einsum("...i,...i->...", normal, other_normal) < CREASE_COSINE
    return crease | (np.abs(depth - other_depth) > FAR_BEHIND * np.maximum(depth, other_depth))


def cut_pixels(
    scene: RayScene,
    model: RelightModel,
    camera: Camera,
    pixel: Int32[np.ndarray, " pixel"],
    samples: int,
    is_fine: bool,
) -> tuple[ShadingPoints, Float32[np.ndarray, " point"], int]:
    """The points that stand for pixels on outlines, their shares of the pixel, and the rays cast.

    About `samples` points a pixel: each the end of a ray, or with `is_fine` chosen from four times as many rays, so that
    a side of the outline has the share that it covers.
    """
    place = _fine_places(samples) if is_fine else _grid_places(samples)
    pixels, places = _within(camera, pixel, place)
    parts = points_along(scene, model.mesh, camera, pixels, places)
    if model.outlines_end == "black":
        share = np.full(len(parts), 1.0 / len(place))
    else:
        share = 1.0 / np.bincount(parts.pixel, minlength=camera.num_pixels)[parts.pixel]
    if is_fine and len(parts):
        parts, share = _thinned(model, parts, share)
    return parts, share.astype(np.float32), len(pixels)


def _grid_places(samples: int) -> Float64[np.ndarray, "sample 2"]:
    side = round(samples**0.5)
    y, x = (np.mgrid[0:side, 0:side].reshape(2, -1) + 0.5) / side
    return np.stack([x, y], axis=1)


def _fine_places(samples: int) -> Float64[np.ndarray, "ray 2"]:
    """Four times as many places, four after four of them in a cell of the grid, no two in a row or a column."""
    side = 2 * round(samples**0.5)
    y, x = np.mgrid[0:side, 0:side].reshape(2, -1)
    order = np.lexsort((x, y, x // 2, y // 2))
    return np.stack([x * side + y + 0.5, y * side + x + 0.5], axis=1)[order] / side**2


def _within(camera: Camera, pixel: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corner = np.stack([pixel % camera.width, pixel // camera.width], axis=1)
    return np.repeat(pixel, len(place)), (corner[:, None] + place + NUDGE_PX).reshape(-1, 2)


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
