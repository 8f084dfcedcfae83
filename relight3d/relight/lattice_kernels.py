"""The compiled loops of shadows on a lattice: which points take their anchors' state, and where a shadow's edge runs.

Each walks a slice and holds no lock. States are those of ray_kernels; a state that was read off anchors, not traced, has
the bit READ as well.
"""

import numpy as np

from relight3d.relight.kernels import AT_INFINITY, FULL, KIND, ONE, compiled, dot, incident, inlined
from relight3d.relight.ray_kernels import ASKS, AWAY, DARK, LIT, ground_blocks

STATE, READ, FOLLOWS = 3, 4, 8  # the bits of a state; of one that was read; of one whose leader is traced for it
ZERO, HALF = np.float32(0), np.float32(0.5)


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
def find_crossings(neighbour, state, index, pairs):
    """Pairs of neighbours between which a shadow's edge runs, at least one of them among the points of `index`.

    `pairs`: the lit point, the dark one, and which neighbour of the lit one it is. Returns how many.
    """
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


@compiled
def ask_crossings(lights, position, geometric, step, offset, num_each, pairs, origins, ways, limits):
    """Rays from `num_each` places evenly between the two points of each pair, from the lit one to the dark one.

    `step` is the lit points' (View.step).
    """
    ray = 0
    for i in range(len(pairs)):
        p, axis, sign = pairs[i, 0], pairs[i, 2] // 2, ONE - 2 * (pairs[i, 2] % 2)
        for k in range(num_each):
            part = np.float32(sign * (k + 1) / (num_each + 1))
            x = position[0, p] + part * step[i, axis, 0]
            y = position[1, p] + part * step[i, axis, 1]
            z = position[2, p] + part * step[i, axis, 2]
            origins[ray, 0] = x + geometric[0, p] * offset
            origins[ray, 1] = y + geometric[1, p] * offset
            origins[ray, 2] = z + geometric[2, p] * offset
            if lights[0, KIND] != AT_INFINITY:
                lx, ly, lz, _, distance = incident(lights, 0, x, y, z)
                ways[ray, 0], ways[ray, 1], ways[ray, 2] = lx, ly, lz
                limits[ray] = distance - 2 * offset
            ray += 1


@inlined
def _own_side(u, v):
    """The area of a pixel on its centre's side of the line u x + v y = 1 (from the centre, in pixels; u, v >= 0)."""
    steep, flat = max(u, v), min(u, v)
    corner = HALF * (steep + flat) - ONE
    if corner <= 0:
        return ONE
    if HALF * (steep - flat) <= ONE:  # the line cuts one corner off
        return ONE - corner * corner * HALF / (steep * flat)
    return HALF + ONE / steep


@compiled
def settle_crossings(pairs, blocked, num_each, nearness, seen):
    """How much of each pixel beside an edge is lit, the edge taken as straight.

    Of `num_each` rays those before the edge are free: it runs so far from the lit centre, in pixels, and 1 minus that from
    the dark one. `nearness` (point x axis, all 0, and left so) takes 1 / distance along the two axes.
    """
    for i in range(len(pairs)):
        free = 0
        for k in range(num_each):
            free += not blocked[i * num_each + k]
        edge, axis = np.float32((free + 0.5) / (num_each + 1)), pairs[i, 2] // 2
        lit, dark = pairs[i, 0], pairs[i, 1]
        nearness[lit, axis] = max(nearness[lit, axis], ONE / edge)
        nearness[dark, axis] = max(nearness[dark, axis], ONE / (ONE - edge))
    for i in range(len(pairs)):
        for side in range(2):
            p = pairs[i, side]
            if nearness[p, 0] + nearness[p, 1] > 0:  # else it was another pair's too, and is done
                own = _own_side(nearness[p, 0], nearness[p, 1])
                share = own if side == 0 else ONE - own
                seen[p] = np.uint8(share * FULL + np.float32(0.5))
                nearness[p, 0] = nearness[p, 1] = ZERO
