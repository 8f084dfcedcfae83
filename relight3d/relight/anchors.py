"""Fewer points than are shown: anchors, which are evaluated, and how every other point is read off those about it.

Anchors are the pixels of a lattice, and the points that no lattice point can stand for: a reading never leaves a
point's own surface, nor crosses a crease or a step in depth. Most of a picture are whole blocks of 4 x 4 pixels between
four anchors (cells); their shares are those of a bilinear patch and are not stored. All other points, such as the parts
of a pixel on an outline, are loose: each has its own anchors and shares.

Shadows are read off witnesses: the four corners where a point has all of them, else, near outlines, where an object's
shadow begins, the pixels about it, every second of which is traced as the white squares of a chessboard are.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32

from relight3d.relight import anchor_kernels
from relight3d.relight.buffers import Buffers
from relight3d.relight.lazy_view import LazyView
from relight3d.views import View

CELL = 4  # pixels along a side of a cell
CELL_POINTS = CELL * CELL
STEP_IN_DEPTH, CREASE_COSINE = 0.06, 0.9  # as views.py finds outlines
MIN_WITNESSES = 3  # of the pixels about a point near an outline
# To the next pixels: from a black square of the chessboard to white ones, and from a white one.
STRAIGHT, ACROSS = ((1, 0), (-1, 0), (0, 1), (0, -1)), ((1, 1), (-1, 1), (1, -1), (-1, -1))


@dataclass(frozen=True, eq=False)
class Anchors:
    """Points by their places in the buffers; `corner`, `cell_corner` by rows of `point`."""

    point: Int32[np.ndarray, " anchor"]  # ascending
    cell: Int32[np.ndarray, " cell"]  # the first of each cell's 16 points, ascending
    cell_corner: Int32[np.ndarray, "cell 4"]  # left and right above, left and right below
    loose: Int32[np.ndarray, " loose"]  # all points in no cell, ascending
    corner: Int32[np.ndarray, "loose 4"]
    share: Float32[np.ndarray, "loose 4"]  # adds up to 1
    traced: Int32[np.ndarray, " traced"]  # points whose shadow is always traced, so that neighbours share packets
    witness: Int32[np.ndarray, "loose 4"]  # the points among them that settle a loose point's shadow if they agree
    is_sure: Bool[np.ndarray, " loose"]  # whether there are enough of them
    lead: Int32[np.ndarray, " loose"]  # the point whose ray serves this one too: itself, or one of the same pixel

    @property
    def num_bytes(self) -> int:
        """Memory that they take."""
        return sum(part.nbytes for part in vars(self).values())


class _Points:
    """What tells a view's points apart, in the order of the buffers."""

    def __init__(self, view: View, buffers: Buffers) -> None:
        self.width, self.height = view.camera.width, view.camera.height
        self.start, self.normal = buffers.point_start, buffers.geometric_normal
        counts = np.diff(self.start)
        self.pixel, self.is_whole = np.repeat(buffers.pixel_of_rank, counts), np.repeat(counts == 1, counts)
        self.y, self.x = np.divmod(self.pixel, np.int32(self.width))
        if isinstance(view, LazyView):  # which knows without being asked for all it could tell
            ray, rays = view.looked.listed.ray, view.looked.rays
            self.label, self.depth = rays.label[ray], rays.depth[ray]
        else:
            self.label = (view.surface * 2 + view.is_mirrored)[buffers.order].astype(np.int32)
            self.depth = view.points.depth[buffers.order]

    def __len__(self) -> int:
        return len(self.pixel)

    def of_pixels(self, which: np.ndarray) -> Int32[np.ndarray, " pixel"]:
        """The point of each pixel, among those chosen; -1 for none."""
        grid = np.full(self.width * self.height, -1, np.int32)
        grid[self.pixel[which]] = np.flatnonzero(which)
        return grid

    def looked_up(self, grid: np.ndarray, x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
        """The points of pixels x, y in a grid, where they lie on the same smooth piece as the points `at`; else -1."""
        found, kind = np.empty(len(at), np.int32), (self.label, self.depth, self.normal)
        anchor_kernels.look_up(grid, self.width, self.height, x, y, at, *kind, STEP_IN_DEPTH, CREASE_COSINE, found)
        return found


def find_anchors(view: View, buffers: Buffers, spacing: int, chunk: int, shared_rays: bool = False) -> Anchors:
    """Anchors `spacing` pixels apart. A cell lies within one of the chunks (of so many ranks) that kernels walk.

    `shared_rays` lets one ray serve all parts of a pixel that show the same piece of a surface.
    """
    points = _Points(view, buffers)
    on_lattice = points.is_whole & (points.x % spacing == 0) & (points.y % spacing == 0)
    corner, share = _corners(points, spacing, points.of_pixels(on_lattice))
    num_corners, lead = (corner >= 0).sum(axis=1), _leads(points)
    alone = np.flatnonzero(num_corners == 0)
    corner[alone, 0], share[alone, 0] = lead[alone], 1.0
    share /= share.sum(axis=1, keepdims=True)
    corner = np.where(corner >= 0, corner, corner[np.arange(len(corner)), share.argmax(axis=1)][:, None])

    cell = _cells(points, num_corners == 4, buffers, chunk) if spacing == CELL else np.zeros(0, np.int32)
    is_loose = np.ones(len(points), bool)
    is_loose[(cell[:, None] + np.arange(CELL_POINTS)).ravel()] = False
    loose = np.flatnonzero(is_loose).astype(np.int32)
    # A cell's corners are those of its first point, a lattice point with all four.
    cell_corner = corner[cell]
    anchor = np.unique(np.concatenate([cell_corner.ravel(), corner[loose].ravel()])).astype(np.int32)
    corner[anchor], share[anchor] = anchor[:, None], (1.0, 0.0, 0.0, 0.0)  # an anchor reads itself
    row = np.full(len(points), -1, np.int32)
    row[anchor] = np.arange(len(anchor), dtype=np.int32)
    traced, witness, is_sure = _witnesses(points, corner, num_corners == 4, row >= 0)
    leader = lead if shared_rays else np.arange(len(points), dtype=np.int32)
    values = (row[corner[loose]], share[loose])
    return Anchors(
        anchor, cell, row[cell_corner], loose, *values, traced, witness[loose], is_sure[loose], leader[loose]
    )


def spread_values(
    anchors: Anchors, values: Float32[np.ndarray, "anchor channel"]
) -> Float32[np.ndarray, "point channel"]:
    """Values of anchors read at every point: what the compiled passes do, readably."""
    out = np.empty((len(anchors.loose) + CELL_POINTS * len(anchors.cell), values.shape[1]), np.float32)
    out[anchors.loose] = np.einsum("pk,pkc->pc", anchors.share, values[anchors.corner])
    inside = anchors.cell[:, None] + np.arange(CELL_POINTS)
    out[inside] = np.einsum("ik,nkc->nic", cell_shares(), values[anchors.cell_corner])
    return out


def cell_shares() -> Float32[np.ndarray, "16 4"]:
    """What each corner of a cell gives each of its points."""
    y, x = (part.ravel() / np.float32(CELL) for part in np.mgrid[0:CELL, 0:CELL].astype(np.float32))
    return np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1).astype(np.float32)


def _corners(points: _Points, spacing: int, lattice: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lattice points about each point on its own smooth piece of surface (-1: none), and bilinear shares."""
    corner, share = np.full((len(points), 4), -1, np.int32), np.zeros((len(points), 4), np.float32)
    left, top, at = points.x // spacing * spacing, points.y // spacing * spacing, np.arange(len(points))
    right, below = (points.x - left) / np.float32(spacing), (points.y - top) / np.float32(spacing)
    for k in range(4):
        corner[:, k] = points.looked_up(lattice, left + spacing * (k % 2), top + spacing * (k // 2), at)
        weight = (right if k % 2 else 1 - right) * (below if k // 2 else 1 - below)
        # A corner alone on a point's surface stands for it however far it is.
        share[:, k] = np.where(corner[:, k] >= 0, np.maximum(weight, 1e-3), 0.0)
    whole_cell = (corner >= 0).all(axis=1)
    share[whole_cell] = np.stack(
        [(1 - right) * (1 - below), right * (1 - below), (1 - right) * below, right * below], axis=1
    )[whole_cell]
    return corner, share


def _leads(points: _Points) -> Int32[np.ndarray, " point"]:
    """The first point of the same pixel and surface, or the point itself where that one faces elsewhere."""
    lead = np.empty(len(points), np.int32)
    anchor_kernels.find_leads(points.start, points.label, points.normal, CREASE_COSINE, lead)
    return lead


def _cells(points: _Points, has_corners: np.ndarray, buffers: Buffers, chunk: int) -> Int32[np.ndarray, " cell"]:
    """The first points of whole blocks of 4 x 4 pixels, all of whose points have four corners."""
    x, y = points.x, points.y
    first = np.flatnonzero((x % CELL == 0) & (y % CELL == 0) & points.is_whole)
    first = first[first + CELL_POINTS <= len(points)]
    # A block is whole where its last pixel stands 15 places on: points are sorted, and a pixel cut has several.
    last = first + CELL_POINTS - 1
    first = first[(x[last] == x[first] + CELL - 1) & (y[last] == y[first] + CELL - 1)]
    ends = np.append(0, np.cumsum(points.is_whole & has_corners))
    first = first[ends[first + CELL_POINTS] - ends[first] == CELL_POINTS]
    rank = np.repeat(np.arange(len(buffers.pixel_of_rank)), np.diff(buffers.point_start))
    return first[rank[first] // chunk == rank[first + CELL_POINTS - 1] // chunk].astype(np.int32)


def _witnesses(points: _Points, corner, has_corners, is_anchor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points that are traced, and for every point those of them that settle its shadow, and whether they do."""
    is_traced = is_anchor | (points.is_whole & ~has_corners & ((points.x + points.y) % 2 == 0))
    doubtful = np.flatnonzero(~has_corners & ~is_traced)
    grid = points.of_pixels(is_traced & points.is_whole)
    x, y = points.x[doubtful], points.y[doubtful]
    is_black = (x + y) % 2 == 1
    found = np.empty((len(doubtful), 4), np.int32)
    for k, (straight, across) in enumerate(zip(STRAIGHT, ACROSS)):
        dx, dy = (np.where(is_black, straight[axis], across[axis]) for axis in (0, 1))
        found[:, k] = points.looked_up(grid, x + dx, y + dy, doubtful)
    witness, is_sure = corner.copy(), has_corners | is_traced
    witness[doubtful] = np.where(found >= 0, found, found.max(axis=1, keepdims=True, initial=-1))
    is_sure[doubtful] = (found >= 0).sum(axis=1) >= MIN_WITNESSES
    itself = np.flatnonzero(is_traced)
    witness[itself] = itself[:, None]
    traced = itself[np.argsort(_along_curve(points.x[itself], points.y[itself]), kind="stable")]
    return traced.astype(np.int32), witness, is_sure


def _along_curve(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Places along Morton's curve, which keeps neighbours together: packets of rays are then squares."""
    key = np.zeros(len(x), np.int64)
    for bit in range(16):
        key |= ((x.astype(np.int64) >> bit & 1) << 2 * bit) | ((y.astype(np.int64) >> bit & 1) << 2 * bit + 1)
    return key
