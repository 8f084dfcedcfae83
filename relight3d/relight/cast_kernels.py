"""Shadow rays in one compiled call: made, traced by Embree's packets, and written down without the interpreter.

Two threads that change places at the interpreter's lock between short loops lose more time there than in the loops.
"""

import numba
import numpy as np

from relight3d.maths.pixel_parts import HALVINGS, PLACES
from relight3d.packets import DIRECTION, FAR, NEVER, NUM_RAY_ROWS, ORIGIN, WIDTH, call_query, empty_packet, occluded
from relight3d.relight.kernels import AT_INFINITY, FULL, KIND, PLACE, compiled, incident, inlined, take
from relight3d.relight.lanes import leave_surface, mark_blocked
from relight3d.relight.ray_kernels import DARK, LIT, ask_borders, face_light, find_borders, gather, narrow_borders


@numba.njit(nogil=True, cache=True)
def trace(packets, light, origins, ways, limits, blocked):
    """Whether anything stands along rays to the light; `packets`: the query's address, the scene's, its arguments."""
    if light[0, KIND] == AT_INFINITY:
        occluded(packets[0], packets[1], packets[2], origins, light[:, 1:4].copy(), limits[:0], blocked)
    else:
        occluded(packets[0], packets[1], packets[2], origins, ways, limits, blocked)


@inlined
def _fill(position, geometric, offset, index, start, count, rays):
    """Rays to the light from `count` points of `index`; the last one again in the lanes that are left."""
    for lane in range(WIDTH):
        p = np.uintp(index[start + min(lane, count - 1)])  # unsigned: no look from the end
        for axis in range(3):
            rays[ORIGIN + axis, lane] = position[axis, p] + geometric[axis, p] * offset


@inlined
def _aim(light, position, offset, index, start, count, rays):
    """The ways to a lamp."""
    for lane in range(WIDTH):
        p = np.uintp(index[start + min(lane, count - 1)])
        x, y, z, _, distance = incident(light, 0, position[0, p], position[1, p], position[2, p])
        rays[DIRECTION, lane], rays[DIRECTION + 1, lane], rays[DIRECTION + 2, lane] = x, y, z
        rays[FAR, lane] = distance - 2 * offset


@numba.njit(nogil=True, cache=True, error_model="numpy")
def cast_listed(packets, light, position, geometric, offset, index, state, seen):
    """A ray to the light from each point of `index` (ascending), and what it found.

    Mostly sixteen points follow one another: then vector registers fill the packet and write down what came of it.
    """
    words, rays, active = empty_packet(NUM_RAY_ROWS)
    for axis in range(3):
        rays[DIRECTION + axis] = light[0, PLACE + axis]
    active[:] = -1
    far = rays[FAR]
    for start in range(0, len(index), WIDTH):
        count = min(WIDTH, len(index) - start)
        active[count:] = 0
        first = index[start]
        is_run = count == WIDTH and index[start + WIDTH - 1] - first == WIDTH - 1
        if is_run:
            leave_surface(rays, position, geometric, first, offset)  # pyright: ignore[reportCallIssue]
        else:
            _fill(position, geometric, offset, index, start, count, rays)
        far[:] = NEVER
        if light[0, KIND] != AT_INFINITY:
            _aim(light, position, offset, index, start, count, rays)
        call_query(packets[0], active.ctypes.data, packets[1], words.ctypes.data, packets[2])  # pyright: ignore[reportCallIssue]
        if is_run:
            mark_blocked(far, state, first, DARK, LIT)  # pyright: ignore[reportCallIssue]
            mark_blocked(far, seen, first, 0, FULL)  # pyright: ignore[reportCallIssue]
        else:
            for lane in range(count):
                p, is_blocked = np.uintp(index[start + lane]), far[lane] < 0
                state[p], seen[p] = (DARK, 0) if is_blocked else (LIT, FULL)


@numba.njit(nogil=True, cache=True)
def cast_tiles(counter, size, packets, light, ground, position, geometric, normal, offset, state, seen):
    """Tiles of `size` points, as long as there are any: their states, and a ray from each that asks. Returns how many."""
    num, count, index = len(state), 0, np.empty(size, np.int32)
    while True:
        first = take(counter) * size  # pyright: ignore[reportCallIssue]
        if first >= num:
            return count
        last = min(first + size, num)
        face_light(light, ground, position, geometric, normal, first, last, state)
        asked = index[: gather(first, last, state, index)]
        cast_listed(packets, light, position, geometric, offset, asked, state, seen)
        count += len(asked)


@compiled
def find_in_tiles(counter, size, neighbour, state, pairs):
    """ray_kernels.find_borders of tiles of `size` points, as long as there are any."""
    num, count = len(state), 0
    while True:
        first = take(counter) * size  # pyright: ignore[reportCallIssue]
        if first >= num:
            return count
        count += find_borders(neighbour, state, first, min(first + size, num), pairs[count:])


@numba.njit(nogil=True, cache=True)
def place_borders(packets, light, position, geometric, step, offset, pairs, place):
    """Where the edge runs between the two points of each pair, by halving, written to `place`."""
    origins, ways = np.empty((len(pairs), 3), np.float32), np.empty((len(pairs), 3), np.float32)
    limits, blocked = np.empty(len(pairs), np.float32), np.empty(len(pairs), np.bool_)
    place[:] = 0
    for k in range(HALVINGS):
        half = PLACES >> (k + 1)
        ask_borders(light, position, geometric, step, offset, pairs, place, half, origins, ways, limits)
        trace(packets, light, origins, ways, limits, blocked)
        narrow_borders(blocked, half, place)
