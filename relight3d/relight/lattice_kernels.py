"""The compiled loops of shadows on a lattice: which points take their anchors' state, and which neighbours differ.

Each walks a slice and holds no lock. States are those of ray_kernels; a state that was read off anchors, not traced, has
the bit READ as well.
"""

import numpy as np

from relight3d.relight.kernels import FULL, compiled, dot, incident, inlined
from relight3d.relight.ray_kernels import ASKS, AWAY, DARK, LIT, ground_blocks

STATE, READ, FOLLOWS = 3, 4, 8  # the bits of a state; of one that was read; of one whose leader is traced for it


@inlined
def _facing(lights, ground, geometry, p):
    """The state of a point as far as it is known without a ray; `geometry`: positions, geometric normals, normals."""
    position, geometric, normal = geometry
    x, y, z = position[0, p], position[1, p], position[2, p]
    lx, ly, lz, falloff, distance = incident(lights, 0, x, y, z)
    if not (dot(normal, p, lx, ly, lz) > 0 and dot(geometric, p, lx, ly, lz) > 0):
        return AWAY
    if not falloff > 0 or ground_blocks(ground, x, y, z, lx, ly, lz, distance):
        return DARK
    return ASKS


@compiled
def face_traced(lights, ground, geometry, first, last, state, index):
    """The states of the traced points first..last, and those among them that ask for a ray. Returns how many.

    All arrays are of traced points alone, side by side: a cache line serves sixteen.
    """
    count = 0
    for i in range(first, last):
        state[i] = _facing(lights, ground, geometry, i)
        index[count] = i
        count += state[i] == ASKS
    return count


@compiled
def scatter(traced, of_traced, first, last, state, seen):
    """States of the traced points first..last to their places among all."""
    for i in range(first, last):
        state[traced[i]], seen[traced[i]] = of_traced[i], np.uint8(FULL if of_traced[i] == LIT else 0)


@inlined
def _agreed(witness, i, state):
    """The state that four points have, ASKS where they differ: of lit and not lit, not of why a point is dark."""
    a, b, c, d = state[witness[i, 0]], state[witness[i, 1]], state[witness[i, 2]], state[witness[i, 3]]
    num_lit = (a == LIT) + (b == LIT) + (c == LIT) + (d == LIT)
    if num_lit == 4:
        return LIT
    if num_lit > 0:
        return ASKS
    return AWAY if a == AWAY and b == AWAY and c == AWAY and d == AWAY else DARK


@compiled
def spread_cells(lights, ground, geometry, cell, witness, first, last, states, seen, index):
    """Cells whose corners agree take their state; of the others' points, those that face the light ask for a ray.

    `states`: those of traced points, and where all are written. Returns how many ask.
    """
    of_traced, state = states
    count = 0
    for i in range(first, last):
        agreed, start = _agreed(witness, i, of_traced), cell[i]
        if agreed != ASKS:
            mine, part, level = state[start : start + 16], seen[start : start + 16], np.uint8(agreed | READ)
            full = np.uint8(FULL if agreed == LIT else 0)
            for k in range(16):
                mine[k], part[k] = level, full
            continue
        for p in range(start, start + 16):
            state[p] = _facing(lights, ground, geometry, p)
            seen[p] = 0
            index[count] = p
            count += state[p] == ASKS
    return count


@compiled
def spread_loose(lights, ground, geometry, loose, witness, lead, is_sure, first, last, states, seen, index):
    """The same for loose points; one that has a leader in its pixel waits for what that one finds."""
    of_traced, state = states
    count = 0
    for i in range(first, last):
        p = loose[i]
        agreed = _agreed(witness, i, of_traced) if is_sure[i] else ASKS
        if agreed != ASKS:
            state[p], seen[p] = np.uint8(agreed | READ), np.uint8(FULL if agreed == LIT else 0)
        elif lead[i] != p:
            state[p] = FOLLOWS
        else:
            state[p] = _facing(lights, ground, geometry, p)
            seen[p] = 0
            index[count] = p
            count += state[p] == ASKS
    return count


@compiled
def follow(loose, lead, state, seen):
    """Points that wait take what their leader found."""
    for i in range(len(loose)):
        if state[loose[i]] == FOLLOWS:
            state[loose[i]], seen[loose[i]] = state[lead[i]], seen[lead[i]]


@compiled
def find_borders_among(neighbour, state, index, pairs):
    """ray_kernels.find_borders of the points of `index`."""
    count = 0
    for p in index:
        mine = state[p] & STATE
        if mine == AWAY:
            continue
        for k in range(4):
            q = neighbour[p, k]
            if q < 0:
                continue
            other = state[q]
            # The one to the left or above finds the pair, unless it was not traced.
            if other & STATE == AWAY or other & STATE == mine or (k % 2 == 1 and other & READ == 0):
                continue
            lit, dark, way = (p, q, k) if mine == LIT else (q, p, k ^ 1)
            pairs[count, 0], pairs[count, 1], pairs[count, 2] = lit, dark, way
            count += 1
    return count
