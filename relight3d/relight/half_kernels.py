"""The compiled shading pass at half resolution: what light does at slots is read at items, the rest is computed there.

Per item stay the albedo, the cosine at the item's own normal, highlights and the residual; indirect light, the directions
to a lamp and the viewer, and the shadows' edges (half_cast_kernels.py) are read off slots. The items of a row of the grid
stand side by side, phase by phase, so that vector registers take all but the loose ones.
"""

import numpy as np

from relight3d.relight.half_shine_kernels import (
    ACROSS,
    ARRIVING,
    COSINE,
    FALLOFF,
    FORM,
    LIT_PART,
    TOTAL,
    WAY,
    add_highlights,
    add_residual,
    split_facing,
)  # fmt: skip
from relight3d.relight.kernels import (
    AT_INFINITY,
    KIND,
    ONE,
    PLACE,
    ZERO,
    add_arriving,
    fused,
    fused_inlined,
    incident,
    take,
)
from relight3d.relight.lanes import put_color

HALF, QUARTER = np.float32(0.5), np.float32(0.25)


@fused
def _read(values, row, columns, corner, share, loose, out):
    """Values of slots read at the items of a row of the grid: phase by phase, then the loose ones."""
    first = row * columns
    here, right = values[first : first + columns], values[first + 1 : first + 1 + columns]
    below, across = values[first + columns : first + 2 * columns], values[first + columns + 1 : first + 2 * columns + 1]
    b, c, d = out[columns : 2 * columns], out[2 * columns : 3 * columns], out[3 * columns : 4 * columns]
    for i in range(columns):
        out[i] = here[i]
    for i in range(columns):
        b[i] = HALF * (here[i] + right[i])
    for i in range(columns):
        c[i] = HALF * (here[i] + below[i])
    for i in range(len(across)):
        d[i] = QUARTER * (here[i] + right[i] + (below[i] + across[i]))
    at = np.uintp(4 * columns)
    for place in range(loose[row], loose[row + 1]):
        k = np.uintp(place)  # unsigned, like what is read from `corner`: no look from the end
        value = share[k, 0] * values[np.uintp(corner[k, 0])] + share[k, 1] * values[np.uintp(corner[k, 1])]
        out[at] = value + (share[k, 2] * values[np.uintp(corner[k, 2])] + share[k, 3] * values[np.uintp(corner[k, 3])])
        at += np.uintp(1)


@fused
def _cover(part):
    """How much of each item is lit, from its distance to the edge. Returns at how many anything is."""
    num_lit = 0
    for i in range(len(part)):
        value = min(max(part[i] + HALF, ZERO), ONE)
        part[i] = value
        num_lit += value > 0
    return num_lit


@fused
def _face(lights, light, normal, step, first, n, work):
    """The cosine at each item's own normal, and FORM: falloff * cosine * lit part."""
    nx, ny, nz = normal[0, first : first + n], normal[1, first : first + n], normal[2, first : first + n]
    cosine, form, part = work[COSINE, :n], work[FORM, :n], work[LIT_PART, :n]
    if lights[light, KIND] == AT_INFINITY:
        x, y, z = step * lights[light, PLACE], step * lights[light, PLACE + 1], step * lights[light, PLACE + 2]
        for i in range(n):
            cosine[i] = np.float32(nx[i]) * x + np.float32(ny[i]) * y + np.float32(nz[i]) * z
        for i in range(n):
            form[i] = part[i] * max(cosine[i], ZERO)
        return
    wx, wy, wz, falloff = work[WAY, :n], work[WAY + 1, :n], work[WAY + 2, :n], work[FALLOFF, :n]
    for i in range(n):
        cosine[i] = step * (np.float32(nx[i]) * wx[i] + np.float32(ny[i]) * wy[i] + np.float32(nz[i]) * wz[i])
    for i in range(n):
        form[i] = part[i] * max(cosine[i], ZERO) * falloff[i]


@fused
def _add_diffuse(diffuse, steps, first, n, work):
    for c in range(3):
        albedo, total, arriving = diffuse[c, first : first + n], work[TOTAL + c, :n], work[ARRIVING + c, :n]
        step = steps[1 + c]
        for i in range(n):
            total[i] += np.float32(albedo[i]) * (step * arriving[i])


@fused
def _write(row, size, columns, loose, pixel, adds, work, out):
    """A row's items to their pixels, clamped at 0; `adds`: to what is there, as mirrors show it."""
    width, height = size
    for phase in range(4):
        dx, y = phase % 2, 2 * row + phase // 2
        if y >= height:
            continue
        num, place = (width - dx + 1) // 2, 3 * (y * width + dx)
        a = phase * columns
        red, green, blue = work[TOTAL, a : a + num], work[TOTAL + 1, a : a + num], work[TOTAL + 2, a : a + num]
        if adds:
            for i in range(num):
                put_color(  # pyright: ignore[reportCallIssue]
                    out, place, red[i] + out[place], green[i] + out[place + 1], blue[i] + out[place + 2]
                )  # fmt: skip
                place += 6
        else:
            for i in range(num):
                r, g, b = red[i], green[i], blue[i]
                put_color(out, place, ZERO if r < 0 else r, ZERO if g < 0 else g, ZERO if b < 0 else b)  # pyright: ignore[reportCallIssue]
                place += 6
    at, first, last = np.uintp(4 * columns), loose[row], loose[row + 1]
    for k in range(first, last):
        place = np.uintp(3 * pixel[k])
        is_first, is_last = k == first or pixel[k] != pixel[k - 1], k + 1 == last or pixel[k] != pixel[k + 1]
        for c in (np.uintp(0), np.uintp(1), np.uintp(2)):
            value = work[TOTAL + c, at] + (ZERO if is_first and not adds else out[place + c])
            out[place + c] = ZERO if is_last and not adds and value < 0 else value
        at += np.uintp(1)


@fused
def fill(
    counter, shape, size, row_start, loose, corner, share, pixel, lights, distance, ways, toward, irradiance, normal,
    diffuse, facing, tangent, surface, shining, gloss, steps, lobe_start, lobes, lit, dark, adds, work, out,
):  # fmt: skip
    """Radiance of rows of the grid, as long as there are any.

    `shape`: columns and rows of the grid; `size`: width and height of the picture. Of slots: `distance` and `toward`
    (direction to the light along that to the viewer; light x slot), `ways` (light x 4 x slot: direction and falloff, of
    lamps), `irradiance` (3 x slot; length 0 for none). Of items: planes. `work` has NUM_HALF_ROWS rows for the longest row's
    items.
    """
    columns, rows = shape
    while True:
        row = take(counter)  # pyright: ignore[reportCallIssue]
        if row >= rows - 1:
            return
        first, length = row_start[row], row_start[row + 1] - row_start[row]
        n = 4 * columns + loose[row + 1] - loose[row]
        for c in range(3):
            work[TOTAL + c, :length] = ZERO
            if len(irradiance):
                _read(irradiance[c], row, columns, corner, share, loose, work[ARRIVING + c])
            else:
                work[ARRIVING + c, :n] = ZERO
        for light in range(len(lights)):
            _read(distance[light], row, columns, corner, share, loose, work[LIT_PART])
            work[LIT_PART, n:length] = ZERO
            if _cover(work[LIT_PART, :n]) > 0:
                if lights[light, KIND] != AT_INFINITY:
                    for k in range(4):
                        _read(ways[light, k], row, columns, corner, share, loose, work[WAY + k])
                _face(lights, light, normal, steps[0], first, n, work)
                add_arriving(lights, light, work[FORM, :n], work[ARRIVING : ARRIVING + 3, :n])
                if len(lobes):
                    _read(toward[light], row, columns, corner, share, loose, work[ACROSS])
                    work[FORM, n:length] = ZERO
                    split_facing(facing, steps[7], first, n, work)
                    if len(tangent) and lights[light, KIND] == AT_INFINITY:
                        for k in range(3):
                            work[WAY + k, :length] = lights[light, PLACE + k]
                    add_highlights(
                        lights, light, lobes, lobe_start, shining, surface, gloss, facing, tangent, steps, first,
                        length, work,
                    )  # fmt: skip
            if light < len(lit[1]):
                add_residual(lights, light, lit, dark, first, length, work)
        _add_diffuse(diffuse, steps, first, n, work)
        _write(row, size, columns, loose, pixel, adds, work, out)


@fused_inlined
def _aim_slots(lights, light, position, first, last, ways):
    """Unit directions to a lamp and its falloff for power 1."""
    for i in range(first, last):
        ways[0, i], ways[1, i], ways[2, i], ways[3, i], _ = incident(
            lights, light, position[0, i], position[1, i], position[2, i]
        )


@fused
def light_slots(counter, size, lights, position, viewer, source, share, at_sites, irradiance, toward, ways):
    """What of light varies slowly, at slots, tile by tile: irradiance of the sites (`at_sites`) blended, and of each light
    the direction to it along that to the viewer (`toward`), and of a lamp direction and falloff (`ways`).
    """
    num = position.shape[1]
    while True:
        first = take(counter) * size  # pyright: ignore[reportCallIssue]
        if first >= num:
            return
        last = min(first + size, num)
        if len(at_sites):
            for i in range(first, last):
                red, green, blue = ZERO, ZERO, ZERO
                for k in range(source.shape[1]):
                    weight, row = share[i, k], np.uintp(source[i, k])
                    red += weight * at_sites[row, 0]
                    green += weight * at_sites[row, 1]
                    blue += weight * at_sites[row, 2]
                irradiance[0, i], irradiance[1, i], irradiance[2, i] = red, green, blue
        for light in range(len(lights)):
            x, y, z = lights[light, PLACE], lights[light, PLACE + 1], lights[light, PLACE + 2]
            if lights[light, KIND] != AT_INFINITY:
                _aim_slots(lights, light, position, first, last, ways[light])
            if not len(toward):
                continue
            vx, vy, vz, out = (
                viewer[0, first:last],
                viewer[1, first:last],
                viewer[2, first:last],
                toward[light, first:last],
            )
            if lights[light, KIND] == AT_INFINITY:
                for i in range(len(out)):
                    out[i] = vx[i] * x + vy[i] * y + vz[i] * z
            else:
                wx, wy, wz = ways[light, 0, first:last], ways[light, 1, first:last], ways[light, 2, first:last]
                for i in range(len(out)):
                    out[i] = vx[i] * wx[i] + vy[i] * wy[i] + vz[i] * wz[i]
