"""Polygons cut into triangles: fans where a fan fits, clipped ears where none does."""

import numpy as np
from jaxtyping import Bool, Float64, Int64

MAX_FAN_STARTS = 8  # corners tried as a fan's hub; covers every quadrilateral and most of what modellers draw
MAX_EAR_CORNERS = 1000  # clipping ears takes the square of this; a longer outline is broken or flat enough for a fan


def triangulate(
    points: Float64[np.ndarray, "corner 3"], num_corners: Int64[np.ndarray, " polygon"]
) -> tuple[Int64[np.ndarray, "triangle 3"], Int64[np.ndarray, " triangle"]]:
    """Cut polygons, given one after another, into triangles of their own corners, in the polygons' order.

    Returns the corners (numbers of `points`) and the polygon of each triangle. Triangles wind as their polygon does
    and a triangle stays as it is; polygons of one or two corners have none. A concave outline is clipped in the plane
    of its mean normal; one that crosses itself becomes a fan.
    """
    start = np.cumsum(num_corners) - num_corners
    triangles, polygons = [np.empty((0, 3), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for size in np.unique(num_corners[num_corners >= 3]):
        which = np.flatnonzero(num_corners == size)
        corners = start[which, None] + np.arange(size)
        with np.errstate(invalid="ignore", over="ignore"):  # corners at NaN or infinity compare false: a plain fan
            cut = corners[:, None] if size == 3 else _cut(points, corners)
        triangles.append(cut.reshape(-1, 3))
        polygons.append(np.repeat(which, size - 2))
    polygon = np.concatenate(polygons)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(triangles)[order], polygon[order]


def _cut(points: np.ndarray, corners: np.ndarray) -> Int64[np.ndarray, "polygon triangle 3"]:
    """Polygons of one size: a fan about the first corner from which every triangle faces the polygon's way."""
    place = points[corners]
    normal = np.cross(place, np.roll(place, -1, axis=1)).sum(axis=1)  # Newell: fits a polygon that is not quite flat
    size = corners.shape[1]
    cut, todo = _fan(corners, 0), np.arange(len(corners))
    for hub in range(min(size, MAX_FAN_STARTS)):
        fan = _fan(corners[todo], hub)
        a, b, c = np.moveaxis(points[fan], 2, 0)
        fits = (np.einsum("ptk,pk->pt", np.cross(b - a, c - a), normal[todo]) > 0).all(axis=1)
        cut[todo[fits]] = fan[fits]
        todo = todo[~fits]
    for polygon in todo if size <= MAX_EAR_CORNERS else ():
        ears = _clip_ears(place[polygon], normal[polygon])
        if ears is not None:
            cut[polygon] = corners[polygon][ears]
    return cut


def _fan(corners: np.ndarray, hub: int) -> Int64[np.ndarray, "polygon triangle 3"]:
    turned = np.roll(corners, -hub, axis=1)
    first = np.broadcast_to(turned[:, :1], (len(corners), corners.shape[1] - 2))
    return np.stack([first, turned[:, 1:-1], turned[:, 2:]], axis=2)


def _clip_ears(place: np.ndarray, normal: np.ndarray) -> Int64[np.ndarray, "triangle 3"] | None:
    """Clip one outline ear by ear, along its normal; None where no ear is left (it crosses itself, or has no area)."""
    drop = int(np.argmax(np.abs(normal)))
    side = np.sign(normal[drop]) * (-1 if drop == 1 else 1)  # x and z alone are a left-handed pair
    flat = np.delete(place - place[0], drop, axis=1) * np.array([1.0, side])
    left, ears = list(range(len(flat))), []
    while len(left) > 3:
        for at in range(len(left)):
            ear = [left[at - 1], left[at], left[(at + 1) % len(left)]]
            others = np.array([corner for corner in left if corner not in ear])
            if _turn(*flat[ear]) > 0 and not _is_inside(flat[others], *flat[ear]).any():
                ears.append(ear)
                del left[at]
                break
        else:
            return None
    return np.array([*ears, left], dtype=np.int64)


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray | np.floating:
    """Twice the signed area of a, b, c in the plane: positive where they turn left."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])


def _is_inside(points: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> Bool[np.ndarray, " point"]:
    turns = np.stack([_turn(a, b, points), _turn(b, c, points), _turn(c, a, points)])
    return np.asarray((turns >= 0).all(axis=0))
