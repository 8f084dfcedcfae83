"""The compiled shading pass at half resolution: what light does at slots is read at items, the rest is computed there.

Per item stay the albedo, the cosine at the item's own normal, highlights and the residual; indirect light, the directions
to a lamp and the viewer, and the shadows' edges (half_cast_kernels.py) are read off slots. The items of a row of the grid
stand side by side, phase by phase, so that vector registers take all but the loose ones.
"""

import numpy as np

from relight3d.relight.kernels import AT_INFINITY, COLOR, KIND, ONE, PLACE, ZERO, fused, fused_inlined, incident, take
from relight3d.relight.lanes import add_rows, put_color, shines
from relight3d.relight.lobe_kernels import brushed_base, power
from relight3d.relight.modes import LANES

HALF, QUARTER = np.float32(0.5), np.float32(0.25)
# Rows of a thread's workspace: radiance; irradiance; how much is lit, form, cosine, along and across (lobe_kernels);
# way to a lamp and its falloff; a lobe's sum and base.
TOTAL, ARRIVING, LIT_PART, FORM, COSINE, ALONG, ACROSS, WAY, FALLOFF, SUM, BASE, REST, NUM_HALF_ROWS = 0, 3, 6, 7, 8, 9, 10, 11, 14, 15, 18, 19, 20


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
def _add_arriving(lights, light, n, work):
    form = work[FORM, :n]
    for c in range(3):
        color, arriving = lights[light, COLOR + c], work[ARRIVING + c, :n]
        for i in range(n):
            arriving[i] += form[i] * color


@fused
def _split_facing(facing, step, first, n, work):
    """What lobes are made of (lobe_kernels), from ACROSS, the direction to the light along that to the viewer."""
    along, across, cosine, out_of = work[ALONG, :n], work[ACROSS, :n], work[COSINE, :n], facing[first : first + n]
    for i in range(n):
        along[i] = cosine[i] * (step * np.float32(out_of[i]))
    for i in range(n):
        across[i] -= along[i]


@fused
def _add_diffuse(diffuse, steps, first, n, work):
    for c in range(3):
        albedo, total, arriving = diffuse[c, first : first + n], work[TOTAL + c, :n], work[ARRIVING + c, :n]
        step = steps[1 + c]
        for i in range(n):
            total[i] += np.float32(albedo[i]) * (step * arriving[i])


@fused_inlined
def _add_highlights_of_block(lights, light, lobes, lobe_start, shining, surface, gloss, steps, viewer, first, block, work):
    """The highlights of a block of items: of the surfaces in it that have lobes (`shining`: -1 for none), where seen."""
    way = (work[WAY, block * LANES :], work[WAY + 1, block * LANES :], work[WAY + 2, block * LANES :])
    a = block * LANES
    begin = first + a
    all_along, all_across, all_form, all_of = work[ALONG], work[ACROSS], work[FORM], surface[first:]
    along, across, form = work[ALONG, a : a + LANES], work[ACROSS, a : a + LANES], work[FORM, a : a + LANES]
    mine, base = surface[begin : begin + LANES], work[BASE, :LANES]
    red, green, blue = work[SUM, :LANES], work[SUM + 1, :LANES], work[SUM + 2, :LANES]
    begun = False
    for s in range(shining.shape[1]):
        which = shining[begin // LANES, s]
        if which < 0:
            break
        for k in range(lobe_start[which], lobe_start[which + 1]):
            aside, ahead, dark = lobes[k, 3], lobes[k, 5], lobes[k, 11]
            if lobes[k, 10] > 0:
                if not shines(all_along, all_across, all_of, all_form, a, LANES, aside, ahead, dark, which):  # pyright: ignore[reportCallIssue]
                    continue
            else:
                brushed_base(lobes[k], viewer[3:], viewer[:3], begin, begin + LANES, way, base)
            if not begun:
                red[:], green[:], blue[:] = ZERO, ZERO, ZERO
                begun = True
            exponent, r, g, b = lobes[k, 6], lobes[k, 0], lobes[k, 1], lobes[k, 2]
            if lobes[k, 10] > 0:
                for i in range(LANES):
                    base[i] = aside * across[i] + ahead * along[i]
            for i in range(LANES):
                value = base[i]
                strength = power(min(max(value, dark), ONE), exponent)
                base[i] = strength if (value > dark) & (mine[i] == which) else ZERO
            for i in range(LANES):
                red[i] += r * base[i]
                green[i] += g * base[i]
                blue[i] += b * base[i]
    if not begun:
        return
    for c in range(3):
        strength, gain = lights[light, COLOR + c] * steps[4 + c], gloss[c, begin : begin + LANES]
        lobe, total = work[SUM + c, :LANES], work[TOTAL + c, a : a + LANES]
        for i in range(LANES):
            total[i] += form[i] * strength * np.float32(gain[i]) * lobe[i]


@fused
def _add_highlights(lights, light, lobes, lobe_start, shining, surface, gloss, steps, viewer, first, length, work):
    """The highlights of a row's items, block by block."""
    for block in range(length // LANES):
        if shining[first // LANES + block, 0] >= 0:
            _add_highlights_of_block(
                lights, light, lobes, lobe_start, shining, surface, gloss, steps, viewer, first, block, work
            )  # fmt: skip


@fused
def _add_residual(lights, light, lit, dark, first, length, work):
    """The residual of a row's items: lit and dark modes (modes.Rows and weights), by how much of each item is lit."""
    lit_rows, lit_step, lit_mode, lit_start = lit[0]
    dark_rows, dark_step, dark_mode, dark_start = dark[0]
    part, rest = work[LIT_PART, :length], work[REST, :length]
    for i in range(length):
        rest[i] = ONE - part[i]
    for block in range(length // LANES):
        a, place = block * LANES, first // LANES + block
        begin, end = lit_start[place], lit_start[place + 1]
        if begin < end and _exceeds(part, a, ZERO):
            add_rows(lit_rows, lit_step, lit_mode, begin, end, lit[1], light, lights, COLOR, part, work, TOTAL, a)  # pyright: ignore[reportCallIssue]
        begin, end = dark_start[place], dark_start[place + 1]
        if begin < end and _exceeds(rest, a, ZERO):
            add_rows(dark_rows, dark_step, dark_mode, begin, end, dark[1], light, lights, COLOR, rest, work, TOTAL, a)  # pyright: ignore[reportCallIssue]


@fused_inlined
def _exceeds(values, first, limit):
    """Whether one of a block's values does."""
    num = 0
    for i in range(first, first + LANES):
        num += values[i] > limit
    return num > 0


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
    diffuse, facing, viewer, surface, shining, gloss, steps, lobe_start, lobes, lit, dark, adds, work, out,
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
                _add_arriving(lights, light, n, work)
                if len(lobes):
                    _read(toward[light], row, columns, corner, share, loose, work[ACROSS])
                    work[FORM, n:length] = ZERO
                    _split_facing(facing, steps[7], first, n, work)
                    if len(viewer) and lights[light, KIND] == AT_INFINITY:
                        for k in range(3):
                            work[WAY + k, :length] = lights[light, PLACE + k]
                    _add_highlights(
                        lights, light, lobes, lobe_start, shining, surface, gloss, steps, viewer, first, length, work
                    )  # fmt: skip
            if light < len(lit[1]):
                _add_residual(lights, light, lit, dark, first, length, work)
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
            vx, vy, vz, out = viewer[0, first:last], viewer[1, first:last], viewer[2, first:last], toward[light, first:last]
            if lights[light, KIND] == AT_INFINITY:
                for i in range(len(out)):
                    out[i] = vx[i] * x + vy[i] * y + vz[i] * z
            else:
                wx, wy, wz = ways[light, 0, first:last], ways[light, 1, first:last], ways[light, 2, first:last]
                for i in range(len(out)):
                    out[i] = vx[i] * wx[i] + vy[i] * wy[i] + vz[i] * wz[i]
