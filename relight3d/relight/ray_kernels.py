"""The compiled loops that decide which shadow rays a frame casts, and write down what they found.

Each walks a slice of the points and holds no lock, so that tiles run on any thread. The rays themselves are traced by
tracing.RayScene between two of these.
"""

import numpy as np

from relight3d.maths.pixel_parts import PLACES
from relight3d.relight.kernels import AT_INFINITY, FULL, KIND, ONE, PLACE, compiled, dot, incident, inlined

# States of a point: not yet known; lit; turned to the light but shadowed; turned away.
ASKS, LIT, DARK, AWAY = 3, 2, 1, 0


@inlined
def ground_blocks(ground, x, y, z, lx, ly, lz, distance):
    """Whether the way from a point to a light passes through the ground (ground.ground_of) from above."""
    if len(ground) == 0:
        return False
    toward = lx * ground[1, 0] + ly * ground[1, 1] + lz * ground[1, 2]
    x, y, z = x - ground[0, 0], y - ground[0, 1], z - ground[0, 2]
    height = x * ground[1, 0] + y * ground[1, 1] + z * ground[1, 2]
    if not (toward < 0 and height > 0) or height >= -toward * distance:
        return False
    reach = -height / toward
    x, y, z = x + reach * lx, y + reach * ly, z + reach * lz
    u = x * ground[2, 0] + y * ground[2, 1] + z * ground[2, 2]
    v = x * ground[3, 0] + y * ground[3, 1] + z * ground[3, 2]
    for edge in range(4, len(ground)):  # noqa: SIM110 - a generator is slow here
        if ground[edge, 0] * u + ground[edge, 1] * v > ground[edge, 2]:
            return False
    return True


@compiled
def face_light(lights, ground, position, geometric, normal, first, last, state):
    """The states of points first..last as far as they are known without a ray."""
    lx, ly, lz = lights[0, PLACE], lights[0, PLACE + 1], lights[0, PLACE + 2]
    from_above = len(ground) == 0 or lx * ground[1, 0] + ly * ground[1, 1] + lz * ground[1, 2] > 0
    if lights[0, KIND] == AT_INFINITY and from_above:
        out = state[first:last]
        nx, ny, nz = normal[0, first:last], normal[1, first:last], normal[2, first:last]
        for i in range(len(out)):
            out[i] = ASKS if nx[i] * lx + ny[i] * ly + nz[i] * lz > 0 else AWAY
        nx, ny, nz = geometric[0, first:last], geometric[1, first:last], geometric[2, first:last]
        for i in range(len(out)):
            out[i] = out[i] if nx[i] * lx + ny[i] * ly + nz[i] * lz > 0 else AWAY
        return
    for p in range(first, last):
        x, y, z = position[0, p], position[1, p], position[2, p]
        lx, ly, lz, falloff, distance = incident(lights, 0, x, y, z)
        if not (dot(normal, p, lx, ly, lz) > 0 and dot(geometric, p, lx, ly, lz) > 0):
            state[p] = AWAY
        elif not falloff > 0 or ground_blocks(ground, x, y, z, lx, ly, lz, distance):
            state[p] = DARK
        else:
            state[p] = ASKS


@compiled
def gather(first, last, state, index):
    """The points among first..last that ask for a ray. Returns how many."""
    count = 0
    for p in range(first, last):
        index[count] = p
        count += state[p] == ASKS
    return count


@compiled
def rays_to_light(lights, position, geometric, offset, index, origins, ways, limits):
    """A ray from each point of `index` to the light; `ways` and `limits` only for a lamp."""
    for ray in range(len(index)):
        p = index[ray]
        x, y, z = position[0, p], position[1, p], position[2, p]
        origins[ray, 0] = x + geometric[0, p] * offset
        origins[ray, 1] = y + geometric[1, p] * offset
        origins[ray, 2] = z + geometric[2, p] * offset
        if lights[0, KIND] != AT_INFINITY:
            ways[ray, 0], ways[ray, 1], ways[ray, 2], _, distance = incident(lights, 0, x, y, z)
            limits[ray] = distance - 2 * offset


@compiled
def settle(index, blocked, state, seen):
    """What the rays found, written to their points."""
    for i in range(len(index)):
        state[index[i]] = DARK if blocked[i] else LIT
        seen[index[i]] = 0 if blocked[i] else FULL


@compiled
def find_borders(neighbour, state, first, last, pairs):
    """Neighbours that face the light and are in different states, one of them among points first..last.

    `pairs`: the lit point, the dark one, and which neighbour of the lit one that is. Returns how many.
    """
    count = 0
    for p in range(first, last):
        mine = state[p]
        if mine == AWAY:
            continue
        for k in (0, 2):  # the other two neighbours find this one
            q = neighbour[p, k]
            if q >= 0 and state[q] != AWAY and state[q] != mine:
                lit, dark, way = (p, q, k) if mine == LIT else (q, p, k + 1)
                pairs[count, 0], pairs[count, 1], pairs[count, 2] = lit, dark, way
                count += 1
    return count


@compiled
def ask_borders(lights, position, geometric, step, offset, pairs, place, half, origins, ways, limits):
    """A ray from between the two points of each pair, `half` places farther than the edge is known to be from the lit one.

    `step` is the lit points' (View.step).
    """
    for ray in range(len(pairs)):
        p, axis = pairs[ray, 0], pairs[ray, 2] // 2
        part = np.float32((1 - 2 * (pairs[ray, 2] % 2)) * (place[ray] + half)) / np.float32(PLACES)
        x = position[0, p] + part * step[ray, axis, 0]
        y = position[1, p] + part * step[ray, axis, 1]
        z = position[2, p] + part * step[ray, axis, 2]
        origins[ray, 0] = x + geometric[0, p] * offset
        origins[ray, 1] = y + geometric[1, p] * offset
        origins[ray, 2] = z + geometric[2, p] * offset
        if lights[0, KIND] != AT_INFINITY:
            lx, ly, lz, _, distance = incident(lights, 0, x, y, z)
            ways[ray, 0], ways[ray, 1], ways[ray, 2] = lx, ly, lz
            limits[ray] = distance - 2 * offset


@compiled
def narrow_borders(blocked, half, place):
    """Where the ray came through, the edge is farther from the lit point."""
    for i in range(len(place)):
        place[i] += 0 if blocked[i] else half


@inlined
def _nearest(one, other):
    """The nearer of two edges of a pixel, where 0 is none."""
    return min(one, other) if one > 0 and other > 0 else max(one, other)


@inlined
def _own_part(edges, beside_line):
    """pixel_parts.own_part."""
    right, left, below, above = edges[0], edges[1], edges[2], edges[3]
    x, y = _nearest(right, left), _nearest(below, above)
    if right > 0 and left > 0 and y == 0:
        return beside_line[right, 0] + beside_line[left, 0] - FULL
    if below > 0 and above > 0 and x == 0:
        return beside_line[below, 0] + beside_line[above, 0] - FULL
    return beside_line[x, y]


@compiled
def settle_borders(pairs, place, beside_line, edges, seen):
    """How much of each pixel beside an edge is lit. `edges` (all 0, and left so) takes the edges of all pixels."""
    for i in range(len(pairs)):
        edges[pairs[i, 0], pairs[i, 2]] = place[i] + 1
        edges[pairs[i, 1], pairs[i, 2] ^ 1] = PLACES - place[i]
    for i in range(len(pairs)):
        for side in range(2):
            mine = edges[pairs[i, side]]
            if mine[0] + mine[1] + mine[2] + mine[3] > 0:  # else it was another pair's too, and is done
                own = _own_part(mine, beside_line)
                seen[pairs[i, side]] = own if side == 0 else FULL - own
                mine[0] = mine[1] = mine[2] = mine[3] = 0


@compiled
def _near_mirror(lights, plane, offset, position, first, last, is_near):
    """Which points stand before a mirror and, for a light at infinity, look at it within its disc."""
    x, y, z, out = position[0, first:last], position[1, first:last], position[2, first:last], is_near[first:last]
    nx, ny, nz, at = plane[3], plane[4], plane[5], plane[0] * plane[3] + plane[1] * plane[4] + plane[2] * plane[5]
    for i in range(len(out)):
        out[i] = x[i] * nx + y[i] * ny + z[i] * nz - at > 0
    if lights[0, KIND] != AT_INFINITY:
        return
    lx, ly, lz = lights[0, PLACE], lights[0, PLACE + 1], lights[0, PLACE + 2]
    per_height = -ONE / min(lx * nx + ly * ny + lz * nz, np.float32(-1e-6))
    room = (plane[6] + 8 * offset) ** 2 * np.float32(1.001)  # the exact test comes after
    for i in range(len(out)):
        reach = (x[i] * nx + y[i] * ny + z[i] * nz - at) * per_height
        cx, cy, cz = x[i] + reach * lx - plane[0], y[i] + reach * ly - plane[1], z[i] + reach * lz - plane[2]
        out[i] &= cx * cx + cy * cy + cz * cz <= room


@compiled
def ask_thrown(
    lights, real_lights, ground, plane, position, geometric, normal, offset, first, last, is_near, origins, ways,
    limits, crossings, index,
):  # fmt: skip
    """Points that a virtual lamp may light through a mirror (`plane`: point, normal, radius), by the conditions of
    shading.cast_thrown: rays to the mirror, their way to it (`limits`) and where they meet it. Returns how many.
    """
    _near_mirror(lights, plane, offset, position, first, last, is_near)
    count = first
    for p in range(first, last):
        if not is_near[p]:
            continue
        x, y, z = position[0, p], position[1, p], position[2, p]
        height = (x - plane[0]) * plane[3] + (y - plane[1]) * plane[4] + (z - plane[2]) * plane[5]
        if height <= 4 * offset:
            continue
        lx, ly, lz, falloff, distance = incident(lights, 0, x, y, z)
        toward = lx * plane[3] + ly * plane[4] + lz * plane[5]
        if not (toward < 0 and falloff > 0):
            continue
        if not (dot(normal, p, lx, ly, lz) > 0 and dot(geometric, p, lx, ly, lz) > 0):
            continue
        reach = height / max(-toward, np.float32(1e-6))
        x, y, z = x + reach * lx, y + reach * ly, z + reach * lz
        if (x - plane[0]) ** 2 + (y - plane[1]) ** 2 + (z - plane[2]) ** 2 > plane[6] ** 2 or reach >= distance:
            continue
        sx, sy, sz, _, left = incident(real_lights, 0, x, y, z)
        if ground_blocks(ground, x, y, z, sx, sy, sz, left):
            continue
        for axis in range(3):
            origins[count, axis] = position[axis, p] + geometric[axis, p] * offset
        ways[count, 0], ways[count, 1], ways[count, 2] = lx, ly, lz
        crossings[count, 0], crossings[count, 1], crossings[count, 2] = x, y, z
        limits[count], index[count] = reach, p
        count += 1
    return count - first
