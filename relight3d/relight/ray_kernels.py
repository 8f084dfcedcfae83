"""The compiled loops that decide which shadow rays a frame casts, and write down what they found.

Each walks a slice of the points and holds no lock, so that tiles run on any thread. The rays themselves are traced by
tracing.RayScene between two of these.
"""

import numpy as np

from relight3d.relight.kernels import AT_INFINITY, FULL, KIND, compiled, dot, incident, inlined

LIT, DARK, AWAY = 2, 1, 0  # states of a point: lit; turned to the light but shadowed; turned away


@inlined
def _ground_blocks(ground, x, y, z, lx, ly, lz, distance):
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
def ask(lights, ground, position, geometric, normal, offset, first, last, chosen, state, origins, ways, limits, index):
    """Which points of first..last need a shadow ray; writes the rays packed from `first` on. Returns how many.

    `chosen` (length 0 for all) leaves points out. Sets `state` to AWAY, or to DARK until the ray is back.
    """
    count = first
    for p in range(first, last):
        if len(chosen) and not chosen[p]:
            continue
        x, y, z = position[0, p], position[1, p], position[2, p]
        lx, ly, lz, falloff, distance = incident(lights, 0, x, y, z)
        if not (dot(normal, p, lx, ly, lz) > 0 and dot(geometric, p, lx, ly, lz) > 0):
            state[p] = AWAY
            continue
        state[p] = DARK
        if not falloff > 0 or _ground_blocks(ground, x, y, z, lx, ly, lz, distance):
            continue
        for axis in range(3):
            origins[count, axis] = position[axis, p] + geometric[axis, p] * offset
        if lights[0, KIND] != AT_INFINITY:
            ways[count, 0], ways[count, 1], ways[count, 2] = lx, ly, lz
            limits[count] = distance - 2 * offset
        index[count] = p
        count += 1
    return count - first


@compiled
def settle(index, blocked, state, seen):
    """What the rays found, written to their points."""
    for i in range(len(index)):
        state[index[i]] = DARK if blocked[i] else LIT
        seen[index[i]] = 0 if blocked[i] else FULL


@compiled
def find_borders(neighbour, state, first, last, index):
    """Points that face the light and have a neighbour that does too and is in the other state. Returns how many."""
    count = first
    for p in range(first, last):
        if state[p] == AWAY:
            continue
        for k in range(4):
            other = neighbour[p, k]
            if other >= 0 and state[other] != AWAY and state[other] != state[p]:
                index[count] = p
                count += 1
                break
    return count - first


@compiled
def ask_borders(lights, position, geometric, step, offset, pattern, index, origins, ways, limits):
    """Rays from `pattern` places about each border point, one place after the other for each point."""
    ray = 0
    for p in index:
        for k in range(len(pattern)):
            x = position[0, p] + pattern[k, 0] * step[p, 0, 0] + pattern[k, 1] * step[p, 1, 0]
            y = position[1, p] + pattern[k, 0] * step[p, 0, 1] + pattern[k, 1] * step[p, 1, 1]
            z = position[2, p] + pattern[k, 0] * step[p, 0, 2] + pattern[k, 1] * step[p, 1, 2]
            origins[ray, 0] = x + geometric[0, p] * offset
            origins[ray, 1] = y + geometric[1, p] * offset
            origins[ray, 2] = z + geometric[2, p] * offset
            if lights[0, KIND] != AT_INFINITY:
                lx, ly, lz, _, distance = incident(lights, 0, x, y, z)
                ways[ray, 0], ways[ray, 1], ways[ray, 2] = lx, ly, lz
                limits[ray] = distance - 2 * offset
            ray += 1


@compiled
def settle_borders(index, blocked, num_rays_each, seen):
    """The share of each border point's rays that came through."""
    for i in range(len(index)):
        free = 0
        for k in range(num_rays_each):
            free += not blocked[i * num_rays_each + k]
        seen[index[i]] = FULL * free // num_rays_each


@compiled
def ask_thrown(
    lights, real_lights, ground, plane, position, geometric, normal, offset, first, last, origins, ways, limits,
    crossings, index,
):  # fmt: skip
    """Points that a virtual lamp may light through a mirror (`plane`: point, normal, radius), by the conditions of
    shading.cast_thrown: rays to the mirror, their way to it (`limits`) and where they meet it. Returns how many.
    """
    count = first
    for p in range(first, last):
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
        if _ground_blocks(ground, x, y, z, sx, sy, sz, left):
            continue
        for axis in range(3):
            origins[count, axis] = position[axis, p] + geometric[axis, p] * offset
        ways[count, 0], ways[count, 1], ways[count, 2] = lx, ly, lz
        crossings[count, 0], crossings[count, 1], crossings[count, 2] = x, y, z
        limits[count], index[count] = reach, p
        count += 1
    return count - first


@compiled
def spread(lights, position, geometric, normal, corners, first, last, chosen, state, seen, asks):
    """Points between four lattice points that agree take their state; `asks` says which of the others need a ray."""
    for p in range(first, last):
        asks[p] = False
        if chosen[p]:
            continue
        lx, ly, lz, falloff, _ = incident(lights, 0, position[0, p], position[1, p], position[2, p])
        if not (dot(normal, p, lx, ly, lz) > 0 and dot(geometric, p, lx, ly, lz) > 0):
            continue
        agreed = state[corners[p, 0]]
        for k in range(1, 4):
            if state[corners[p, k]] != agreed:
                agreed = AWAY
        asks[p] = agreed == AWAY
        if agreed != AWAY:
            state[p] = agreed
            seen[p] = FULL if agreed == LIT and falloff > 0 else 0


@compiled
def look_up_table(lights, position, geometric, normal, side, bits, first, last, seen):
    """How far points see a light by a table of directions (`bits`: octahedral map x points), between four of them."""
    for p in range(first, last):
        lx, ly, lz, falloff, _ = incident(lights, 0, position[0, p], position[1, p], position[2, p])
        if not (dot(normal, p, lx, ly, lz) > 0 and dot(geometric, p, lx, ly, lz) > 0 and falloff > 0):
            continue
        scale = 1 / (abs(lx) + abs(ly) + abs(lz))
        u, v = lx * scale, ly * scale
        if lz < 0:
            u, v = (1 - abs(v)) * (1 if u >= 0 else -1), (1 - abs(u)) * (1 if v >= 0 else -1)
        u, v = (u + 1) * 0.5 * side - 0.5, (v + 1) * 0.5 * side - 0.5
        left, top = int(np.floor(u)), int(np.floor(v))
        total = 0.0
        for k in range(4):
            dx, dy = k % 2, k // 2
            weight = (u - left if dx else left + 1 - u) * (v - top if dy else top + 1 - v)
            # The map's edge: its outermost directions stand in for what lies across.
            row = min(max(top + dy, 0), side - 1) * side + min(max(left + dx, 0), side - 1)
            total += weight * ((bits[row, p >> 3] >> (p & 7)) & 1)
        seen[p] = int(total * FULL + 0.5)
