"""Half resolution: light at every second pixel each way, and how every pixel of a view reads it.

Slots are where light is evaluated: a grid of every second pixel, and after it one for each piece of a pixel that no grid
point can stand for, since no reading leaves a point's own surface, nor crosses a crease or a step in depth. Items are what
is shown: a pixel's points, those of one surface taken together. Almost all items are whole pixels between grid points of
their own surface; these read one, two or four of them, halves and quarters, without an index. The others are loose: each
has its own slots and shares.

Items stand by rows of the grid (two rows of pixels), in each by phase: pixels on the grid, to the right of it, below it,
and both; then come the row's loose items, and zeros up to a whole block of the residual's (modes.LANES).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32

from relight3d.relight.anchors import _along_curve, _corners, _leads, _Points
from relight3d.relight.buffers import Buffers
from relight3d.relight.modes import LANES
from relight3d.views import View

SPACING, PHASES = 2, 4


@dataclass(frozen=True, eq=False)
class HalfLattice:
    """Slots and items of one view; points by their places in the buffers.

    The grid has one column and one row more than the picture needs, which stand for the last ones: so every pixel has a
    slot to its right and below.
    """

    columns: int  # of the grid
    rows: int
    point: Int32[np.ndarray, " slot"]  # whose light a slot has; -1 for a slot that nobody reads
    lane: Int32[np.ndarray, " lane"]  # the slots that always cast rays, neighbours together
    later: Int32[np.ndarray, " later"]  # those that cast where the corners of a cell about them disagree
    later_cell: Int32[np.ndarray, "later 2"]  # the cells that each of those lies in
    cell: Int32[np.ndarray, "cell 4"]  # corners, two slots apart: cells whose nine slots are all on one smooth piece
    is_joined: Bool[
        np.ndarray, "2 grid"
    ]  # whether the slot to the right, and the one below, is on the same smooth piece
    row_start: Int32[
        np.ndarray, " row_and_end"
    ]  # the first item of each row of the grid, but the last: a multiple of LANES
    loose_start: Int32[np.ndarray, " row_and_end"]  # the first loose item of each row, counted among loose ones
    corner: Int32[np.ndarray, "loose 4"]  # the slots that a loose item reads
    share: Float32[np.ndarray, "loose 4"]  # adds up to 1
    pixel: Int32[np.ndarray, " loose"]  # ascending in a row
    item: Int32[np.ndarray, " member"]  # the item of each point
    num_items: int

    @property
    def num_grid(self) -> int:
        """Slots of the grid; the others follow them."""
        return self.columns * self.rows

    def place_of_loose(self) -> Int32[np.ndarray, " loose"]:
        """Where loose items stand among all."""
        num, row = np.diff(self.loose_start), np.arange(self.rows - 1)
        first = self.row_start[:-1] + PHASES * self.columns - self.loose_start[:-1]
        return (np.repeat(first[row], num) + np.arange(len(self.pixel))).astype(np.int32)

    @property
    def num_bytes(self) -> int:
        """Memory that it takes."""
        return sum(part.nbytes for part in vars(self).values() if isinstance(part, np.ndarray))


def find_half_lattice(view: View, buffers: Buffers) -> HalfLattice:
    """The slots and items of a view."""
    points = _Points(view, buffers)
    columns, rows = (points.width + 1) // SPACING + 1, (points.height + 1) // SPACING + 1
    grid = points.of_pixels(points.is_whole & (points.x % SPACING == 0) & (points.y % SPACING == 0))
    corner, share = _corners(points, SPACING, grid)
    x, y = points.x % SPACING > 0, points.y % SPACING > 0
    unread = np.stack([np.zeros_like(x), ~x, ~y, ~(x & y)], axis=1)
    is_implicit = points.is_whole & ((corner >= 0) | unread).all(axis=1)

    point = np.full((rows, columns), -1, np.int32)
    picture = grid.reshape(points.height, points.width)[::SPACING, ::SPACING]
    point[:-1, :-1] = picture
    slot_of_point = np.full(len(points) + 1, -1, np.int32)  # the last one for no point
    on_grid = np.flatnonzero(point.ravel() >= 0)
    slot_of_point[point.ravel()[on_grid]] = on_grid
    joined = _joined(points, point)
    point[:-1, -1], point[-1] = point[:-1, -2], point[-2]  # to read what does not come from rays
    point[-1, -1] = point[-2, -2]

    lead = _leads(points)
    loose = np.unique(lead[~is_implicit])
    alone = needs_own(corner[loose], points.is_whole[loose])
    slots, shares = _read_slots(corner[loose], share[loose], alone, slot_of_point, point.size)
    everything = np.append(point.ravel(), loose[alone]).astype(np.int32)
    casting = np.append(on_grid, point.size + np.arange(alone.sum()))
    at = everything[casting]
    casting = casting[np.lexsort((_along_curve(points.x[at], points.y[at]), points.label[at]))]
    cell, cells_of = _cells(joined.reshape(2, rows, columns), everything.size)
    is_later = (cells_of[casting] >= 0).all(axis=1)
    lane, later = casting[~is_later].astype(np.int32), casting[is_later].astype(np.int32)

    order = np.lexsort((points.x[loose], points.y[loose], points.y[loose] // SPACING))
    loose, slots, shares = loose[order], slots[order], shares[order]
    loose_row = points.y[loose] // SPACING
    loose_start = np.searchsorted(loose_row, np.arange(rows)).astype(np.int32)
    lengths = -(-(PHASES * columns + np.diff(loose_start)) // LANES) * LANES
    row_start = np.append(0, np.cumsum(lengths)).astype(np.int32)
    phase = 2 * y + x
    item = row_start[points.y // SPACING] + phase * columns + points.x // SPACING
    item_of_lead = np.full(len(points), -1, np.int64)
    of_row = np.arange(len(loose)) - loose_start[loose_row]
    item_of_lead[loose] = row_start[loose_row] + PHASES * columns + of_row
    item = np.where(is_implicit, item, item_of_lead[lead]).astype(np.int32)
    return HalfLattice(
        columns, rows, everything, lane, later, cells_of[later], cell, joined, row_start, loose_start, slots, shares,
        points.pixel[loose].astype(np.int32), item, int(row_start[-1]),
    )  # fmt: skip


def needs_own(corner: Int32[np.ndarray, "loose 4"], is_whole: Bool[np.ndarray, " loose"]) -> Bool[np.ndarray, " loose"]:
    """Which loose items get a slot of their own: shadows begin at outlines, where a corner or two say little."""
    return (corner >= 0).sum(axis=1) <= 2


def _read_slots(corner, share, alone, slot_of_point, first_own: int) -> tuple[np.ndarray, np.ndarray]:
    """The slots and shares of loose items, those that have their own included."""
    slots, shares = slot_of_point[corner], np.where(corner >= 0, share, 0.0).astype(np.float32)
    slots[alone], shares[alone] = -1, 0.0
    slots[alone, 0], shares[alone, 0] = first_own + np.arange(alone.sum()), 1.0
    shares /= shares.sum(axis=1, keepdims=True)
    best = slots[np.arange(len(slots)), shares.argmax(axis=1)]
    return np.where(slots >= 0, slots, best[:, None]).astype(np.int32), shares


def _joined(points: _Points, point: Int32[np.ndarray, "row column"]) -> Bool[np.ndarray, "2 slot"]:
    """Which slots of the grid have a neighbour on the same smooth piece, to the right and below."""
    grid = np.full(points.width * points.height, -1, np.int32)
    at = point[point >= 0]
    grid[points.pixel[at]] = at
    joined = np.zeros((2, point.size), bool)
    here = np.flatnonzero(point.ravel() >= 0)
    for axis, (dx, dy) in enumerate(((SPACING, 0), (0, SPACING))):
        joined[axis, here] = points.looked_up(grid, points.x[at] + dx, points.y[at] + dy, at) >= 0
    return joined


def _cells(joined: Bool[np.ndarray, "2 row column"], num_slots: int) -> tuple[np.ndarray, np.ndarray]:
    """The corners of cells, and for each slot that is no corner of any the two that it lies in; else -1."""
    _, rows, columns = joined.shape
    right, below = joined
    y, x = (part.ravel() for part in np.mgrid[0 : rows - 3 : 2, 0 : columns - 3 : 2])
    is_whole = np.ones(len(y), bool)
    for k in range(3):
        for step in range(2):
            is_whole &= right[y + k, x + step] & below[y + step, x + k]
    y, x = y[is_whole], x[is_whole]
    first = y * columns + x
    cell = np.stack([first, first + 2, first + 2 * columns, first + 2 * columns + 2], axis=1).astype(np.int32)
    cells_of = np.full((num_slots, 2), -1, np.int32)
    each = np.arange(len(first), dtype=np.int32)
    cells_of[first + columns + 1] = each[:, None]
    for before, after in ((columns, columns + 2), (1, 2 * columns + 1)):
        cells_of[first + after, 0] = each  # left of it, or above
        cells_of[first + before, 1] = each
    return cell, cells_of
