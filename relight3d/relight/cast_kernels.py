"""Shadow rays in one compiled call: made, traced by Embree's packets, and written down without the interpreter.

Two threads that change places at the interpreter's lock between short loops lose more time there than in the loops.
"""

import numba
import numpy as np

from relight3d.maths.pixel_parts import HALVINGS, PLACES
from relight3d.packets import occluded
from relight3d.relight.kernels import AT_INFINITY, KIND
from relight3d.relight.ray_kernels import ask_borders, narrow_borders, rays_to_light, settle


@numba.njit(nogil=True, cache=True)
def trace(packets, light, origins, ways, limits, blocked):
    """Whether anything stands along rays to the light; `packets`: the query's address, the scene's, its arguments."""
    if light[0, KIND] == AT_INFINITY:
        occluded(packets[0], packets[1], packets[2], origins, light[:, 1:4].copy(), limits[:0], blocked)
    else:
        occluded(packets[0], packets[1], packets[2], origins, ways, limits, blocked)


@numba.njit(nogil=True, cache=True)
def cast_listed(packets, light, position, geometric, offset, index, state, seen):
    """A ray to the light from each point of `index`, and what it found."""
    origins, ways = np.empty((len(index), 3), np.float32), np.empty((len(index), 3), np.float32)
    limits, blocked = np.empty(len(index), np.float32), np.empty(len(index), np.bool_)
    rays_to_light(light, position, geometric, offset, index, origins, ways, limits)
    trace(packets, light, origins, ways, limits, blocked)
    settle(index, blocked, state, seen)


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
