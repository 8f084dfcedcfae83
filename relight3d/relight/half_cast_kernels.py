"""The compiled loops of half resolution that cast shadow rays from slots and place the shadows' edges between them.

Between slots an edge is kept as a distance: how many pixels a slot is away from it, positive where the slot is lit. That
is read like anything else, bilinearly, and says at every pixel how much of it is lit: no pixel asks its neighbours.
"""

import math

import numba
import numpy as np

from relight3d.maths.pixel_parts import PLACES
from relight3d.packets import DIRECTION, FAR, NEVER, NUM_RAY_ROWS, WIDTH, call_query, empty_packet
from relight3d.relight.cast_kernels import cast_listed
from relight3d.relight.kernels import AT_INFINITY, KIND, ONE, PLACE, compiled, dot, incident, inlined, take
from relight3d.relight.lanes import face_packet, leave_surface
from relight3d.relight.ray_kernels import ASKS, AWAY, DARK, LIT, ground_blocks

SPACING = np.float32(2)  # pixels between slots
HALF_WAY, NO_EDGE = np.float32(1), np.float32(1e9)  # to an edge, in pixels: of a pair without rays; of no pair
PER_PLACE = np.float32(SPACING / PLACES)


@compiled
def face_lanes(light, ground, position, geometric, first, last, state):
    """The states of lanes first..last as far as they are known without a ray: what a surface's bumps do comes later."""
    lx, ly, lz = light[0, PLACE], light[0, PLACE + 1], light[0, PLACE + 2]
    from_above = len(ground) == 0 or lx * ground[1, 0] + ly * ground[1, 1] + lz * ground[1, 2] > 0
    if light[0, KIND] == AT_INFINITY and from_above:
        nx, ny, nz = geometric[0, first:last], geometric[1, first:last], geometric[2, first:last]
        out = state[first:last]
        for i in range(len(out)):
            out[i] = ASKS if nx[i] * lx + ny[i] * ly + nz[i] * lz > 0 else AWAY
        return
    for p in range(first, last):
        x, y, z = position[0, p], position[1, p], position[2, p]
        lx, ly, lz, falloff, distance = incident(light, 0, x, y, z)
        if not dot(geometric, p, lx, ly, lz) > 0:
            state[p] = AWAY
        elif not falloff > 0 or ground_blocks(ground, x, y, z, lx, ly, lz, distance):
            state[p] = DARK
        else:
            state[p] = ASKS


@inlined
def _aim(light, position, offset, first, rays):
    """The ways to a lamp from sixteen lanes."""
    for lane in range(WIDTH):
        p = first + lane
        x, y, z, _, distance = incident(light, 0, position[0, p], position[1, p], position[2, p])
        rays[DIRECTION, lane], rays[DIRECTION + 1, lane], rays[DIRECTION + 2, lane] = x, y, z
        rays[FAR, lane] = distance - 2 * offset


@numba.njit(nogil=True, cache=True, error_model="numpy")
def cast_lanes(counter, size, num, packets, light, ground, position, geometric, offset, slot, of_lane, state):
    """Tiles of `size` of the first `num` lanes, as long as there are any: a ray from each that asks.

    What came of it stands in `state`, by slot.
    `position` and `geometric` are of lanes, which come in whole packets. Returns the number of rays.
    """
    words, rays, active = empty_packet(NUM_RAY_ROWS)
    for axis in range(3):
        rays[DIRECTION + axis] = light[0, PLACE + axis]
    wx, wy, wz = light[0, PLACE], light[0, PLACE + 1], light[0, PLACE + 2]
    from_above = len(ground) == 0 or wx * ground[1, 0] + wy * ground[1, 1] + wz * ground[1, 2] > 0
    is_simple = light[0, KIND] == AT_INFINITY and from_above
    far, count = rays[FAR], 0
    while True:
        begin = take(counter) * size  # pyright: ignore[reportCallIssue]
        if begin >= num:
            return count
        end = min(begin + size, num)
        if not is_simple:
            face_lanes(light, ground, position, geometric, begin, end, of_lane)
        for first in range(begin, end, WIDTH):
            mine, asking = of_lane[first : first + WIDTH], 0
            if is_simple:
                asking = face_packet(geometric, first, wx, wy, wz, active)  # pyright: ignore[reportCallIssue]
                for lane in range(WIDTH):
                    mine[lane] = ASKS if active[lane] < 0 else AWAY
            else:
                for lane in range(WIDTH):
                    active[lane] = -1 if mine[lane] == ASKS else 0
                for lane in range(WIDTH):
                    asking -= active[lane]
            if asking > 0:
                leave_surface(rays, position, geometric, first, offset)  # pyright: ignore[reportCallIssue]
                far[:] = NEVER
                if light[0, KIND] != AT_INFINITY:
                    _aim(light, position, offset, first, rays)
                call_query(packets[0], active.ctypes.data, packets[1], words.ctypes.data, packets[2])  # pyright: ignore[reportCallIssue]
                count += asking
            for lane in range(WIDTH):
                found = DARK if far[lane] < 0 else LIT
                state[slot[first + lane]] = found if mine[lane] == ASKS else mine[lane]


@compiled
def agree(cell, state, of_cell):
    """The state that a cell's corners share; ASKS where they differ."""
    for i in range(len(cell)):
        a, b, c, d = state[cell[i, 0]], state[cell[i, 1]], state[cell[i, 2]], state[cell[i, 3]]
        of_cell[i] = a if (a == b) & (b == c) & (c == d) else ASKS


@compiled
def read_cells(light, ground, position, geometric, first, last, slot, cells_of, of_cell, of_lane, state, index):
    """Lanes first..last take the state of the cells that they lie in, or ask for a ray. Returns how many ask.

    `cells_of` counts from the first of these lanes on (`len(slot) - len(cells_of)`).
    """
    count, before = 0, len(slot) - len(cells_of)
    for i in range(first, last):
        one, other = of_cell[cells_of[i - before, 0]], of_cell[cells_of[i - before, 1]]
        if one == other and one != ASKS:
            state[slot[i]] = one
            continue
        face_lanes(light, ground, position, geometric, i, i + 1, of_lane)
        state[slot[i]] = of_lane[i]
        index[count] = i
        count += of_lane[i] == ASKS
    return count


@numba.njit(nogil=True, cache=True)
def cast_later(
    counter, size, packets, light, ground, position, geometric, offset, slot, cells_of, of_cell, of_lane, state
):
    """cast_lanes for those that a cell may spare: the last lanes, tile by tile."""
    before, num, count = len(slot) - len(cells_of), len(slot), 0
    index, unused = np.empty(size, np.int32), np.empty(num, np.uint8)
    while True:
        first = before + take(counter) * size  # pyright: ignore[reportCallIssue]
        if first >= num:
            return count
        last = min(first + size, num)
        asking = index[
            : read_cells(
                light, ground, position, geometric, first, last, slot, cells_of, of_cell, of_lane, state, index
            )
        ]
        cast_listed(packets, light, position, geometric, offset, asking, of_lane, unused)
        for i in asking:
            state[slot[i]] = of_lane[i]
        count += len(asking)


@compiled
def find_edges(counter, num_rows, columns, is_joined, state, has_rays, edges, pairs):
    """Which neighbours of the grid differ in whether they are lit, of a few rows at a time, as long as there are any.

    Writes HALF_WAY or NO_EDGE for each slot to `edges` (to the right, below), and to `pairs` those between which a ray
    can tell: both turned to the light (none without `has_rays`). Pairs are as in ray_kernels.find_borders; returns how many.
    """
    last_row, count = len(state) // columns, 0
    while True:
        first = take(counter) * num_rows * columns  # pyright: ignore[reportCallIssue]
        if first >= last_row * columns:
            return count
        last = min(first + num_rows * columns, last_row * columns)
        for axis in range(2):
            step = columns if axis else 1
            end = min(last, last_row * columns - step)
            mine, other, joined, edge = (
                state[first:end],
                state[first + step :],
                is_joined[axis, first:],
                edges[axis, first:],
            )
            num = 0
            for i in range(len(mine)):
                differs = joined[i] & ((mine[i] == LIT) != (other[i] == LIT))
                edge[i] = HALF_WAY if differs else NO_EDGE
                num += differs & (mine[i] != AWAY) & (other[i] != AWAY)
            if num == 0 or not has_rays:
                continue
            for i in range(len(mine)):
                if edge[i] == HALF_WAY and mine[i] != AWAY and other[i] != AWAY:
                    p, q = first + i, first + i + step
                    is_lit = mine[i] == LIT
                    pairs[count, 0], pairs[count, 1] = (p, q) if is_lit else (q, p)
                    pairs[count, 2] = 2 * axis + (0 if is_lit else 1)
                    count += 1


@compiled
def write_edges(pairs, place, edges):
    """How far the edges of pairs are from their left or upper slot, in pixels."""
    for i in range(len(pairs)):
        from_lit = (np.float32(place[i]) + np.float32(0.5)) * PER_PLACE
        axis = pairs[i, 2] // 2
        if pairs[i, 2] % 2 == 0:
            edges[axis, pairs[i, 0]] = from_lit
        else:
            edges[axis, pairs[i, 1]] = SPACING - from_lit


@compiled
def edge_distances(counter, columns, rows, state, edges, distance):
    """How far each slot is from a shadow's edge, in pixels, at most SPACING: positive where it is lit. Row by row.

    The last column and row stand for those before them.
    """
    while True:
        row = take(counter)  # pyright: ignore[reportCallIssue]
        if row >= rows:
            break
        first = min(row, rows - 2) * columns
        right, below, out = (
            edges[0, first : first + columns],
            edges[1, first : first + columns],
            distance[row * columns :],
        )
        above = edges[1, max(first - columns, 0) : max(first - columns, 0) + columns]
        has_above, mine = first > 0, state[first : first + columns]
        for i in range(columns):
            left = right[i - 1] if i > 0 else NO_EDGE
            up = above[i] if has_above else NO_EDGE
            x, y = (
                min(right[i], SPACING - left if left < SPACING else NO_EDGE),
                min(below[i], SPACING - up if up < SPACING else NO_EDGE),
            )
            near = min(ONE / np.float32(math.sqrt(ONE / (x * x) + ONE / (y * y))), SPACING)
            out[i] = near if mine[i] == LIT else -near
        out[columns - 1] = out[columns - 2]
    if row == rows:  # one of the threads also does the slots after the grid
        for i in range(rows * columns, len(distance)):
            distance[i] = SPACING if state[i] == LIT else -SPACING
