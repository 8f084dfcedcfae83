"""The compiled loop of the indirect light: low-order functions of the light at the sites, eq. (7)."""

import math

import numpy as np

from relight3d.relight.kernels import ZERO, compiled, inlined, take


@inlined
def _direction_within_reach(x, y, z, anchors, reach_cosine, reach_sine):
    """maths.light_basis.within_reach for one direction."""
    if len(anchors) == 0:
        return x, y, z
    best, nearest = -2.0, 0
    for a in range(len(anchors)):
        cosine = x * anchors[a, 0] + y * anchors[a, 1] + z * anchors[a, 2]
        if cosine > best:
            best, nearest = cosine, a
    if best >= reach_cosine:
        return x, y, z
    best = max(best, -1.0)
    ax, ay, az = anchors[nearest, 0], anchors[nearest, 1], anchors[nearest, 2]
    sx, sy, sz = x - best * ax, y - best * ay, z - best * az
    scale = reach_sine / max(math.sqrt(sx * sx + sy * sy + sz * sz), 1e-9)
    mx, my, mz = reach_cosine * ax + scale * sx, reach_cosine * ay + scale * sy, reach_cosine * az + scale * sz
    inverse = 1.0 / max(math.sqrt(mx * mx + my * my + mz * mz), 1e-12)
    return mx * inverse, my * inverse, mz * inverse


@inlined
def _add_functions(x, y, z, color, anchors, reach_cosine, reach_sine, to_basis, terms, rows):
    """The functions of the basis at a direction, times a colour, added to `rows`."""
    x, y, z = _direction_within_reach(x, y, z, anchors, reach_cosine, reach_sine)
    count, px = 0, 1.0
    for i in range(4):
        py = px
        for j in range(4 - i):
            pz = py
            for _ in range(4 - i - j):
                terms[count] = pz
                count += 1
                pz *= z
            py *= y
        px *= x
    for b in range(len(to_basis)):
        value = 0.0
        for t in range(20):
            value += to_basis[b, t] * terms[t]
        for c in range(3):
            rows[b, c] += np.float32(value * color[c])


@compiled
def far_functions(ways, colors, anchors, reach_cosine, reach_sine, to_basis, terms, rows):
    """The functions of lights at infinity, times their colours, added to `rows` (basis x 3)."""
    for light in range(len(ways)):
        x, y, z = ways[light, 0], ways[light, 1], ways[light, 2]
        _add_functions(x, y, z, colors[light], anchors, reach_cosine, reach_sine, to_basis, terms, rows)


@compiled
def far_irradiance(counter, size, coefficients, ambient, rows, work, out):
    """site_irradiance for lights at infinity alone, whose functions are the same at all sites; tile by tile.

    Planes: `coefficients` basis x 3 x site, `ambient` 3 x site. `work`: room for `size` sites.
    """
    num = ambient.shape[1]
    while True:
        first = take(counter) * size  # pyright: ignore[reportCallIssue]
        if first >= num:
            return
        last = min(first + size, num)
        for c in range(3):
            total, begin = work[: last - first], ambient[c, first:last]
            for i in range(len(total)):
                total[i] = begin[i]
            for b in range(len(rows)):
                weight, part = rows[b, c], coefficients[b, c, first:last]
                for i in range(len(total)):
                    total[i] += part[i] * weight
            for i in range(len(total)):
                out[first + i, c] = ZERO if total[i] < 0 else total[i]


@compiled
def site_irradiance(
    first, last, coefficients, ambient, far_rows, ways, colors, places, powers, anchors, reach_cosine, reach_sine,
    softening, positions, to_basis, rows, terms, out,
):  # fmt: skip
    """Indirect and ambient irradiance at sites first..last, eq. (7), never below 0.

    `far_rows` (basis x 3) begins with what is known of the lights at infinity; the functions of those of directions
    `ways` are added there. Lamps (`places`, `powers`) have others at every site. `rows` and `terms` (20) are scratch.
    """
    far_functions(ways, colors, anchors, reach_cosine, reach_sine, to_basis, terms, far_rows)
    for v in range(first, last):
        for b in range(len(rows)):
            for c in range(3):
                rows[b, c] = far_rows[b, c]
        for lamp in range(len(places)):
            dx, dy, dz = (
                places[lamp, 0] - positions[v, 0], places[lamp, 1] - positions[v, 1], places[lamp, 2] - positions[v, 2]
            )  # fmt: skip
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            strength = 1.0 / max(distance, softening) ** 2
            inverse = 1.0 / max(distance, 1e-150)
            r, g, b = strength * powers[lamp, 0], strength * powers[lamp, 1], strength * powers[lamp, 2]
            _add_functions(
                dx * inverse, dy * inverse, dz * inverse, (r, g, b), anchors, reach_cosine, reach_sine, to_basis,
                terms, rows,
            )  # fmt: skip
        for c in range(3):
            total = ambient[v, c]
            for b in range(len(rows)):
                total += coefficients[v, b, c] * rows[b, c]
            out[v, c] = ZERO if total < 0 else total
