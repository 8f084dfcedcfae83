"""The compiled passes of half resolution: light at slots, and what items make of it.

At slots are indirect light, highlights and the residual, directions to a lamp, and the shadows' edges
(half_cast_kernels.py). Per item stay the albedo, the cosine at the item's own normal, and how much of it is lit. The items
of a row of the grid stand side by side, phase by phase, so that vector registers take all but the loose ones.
"""

import numpy as np

from relight3d.relight.kernels import AT_INFINITY, COLOR, KIND, ONE, PLACE, ZERO, fused, fused_inlined, take
from relight3d.relight.lanes import add_rows, put_color
from relight3d.relight.lobe_kernels import FORM, NUM_ROWS, TOTAL, WAY, add_lobes
from relight3d.relight.modes import LANES
from relight3d.relight.shade_kernels import aim

HALF, QUARTER = np.float32(0.5), np.float32(0.25)
# Rows of a thread's workspace for lanes, after those of highlights: how much is lit, and is not.
LIT_PART, DARK_PART, NUM_LANE_ROWS = NUM_ROWS, NUM_ROWS + 1, NUM_ROWS + 2
# The same for items: radiance, irradiance; how much is lit, form; way to a lamp and its falloff.
OUT, ARRIVING, COVER, ITEM_FORM, ITEM_WAY, FALLOFF, NUM_ITEM_ROWS = 0, 3, 6, 7, 8, 11, 12


# --------------------------------------------------------------------------------------------- lanes


@fused_inlined
def _part_lit(distance, slot, first, last, work):
    """How much of the lanes' surroundings is lit, and is not. Returns at how many anything is."""
    part, rest, count = work[LIT_PART], work[DARK_PART], 0
    for i in range(last - first):
        value = min(max(distance[np.uintp(slot[first + i])] + HALF, ZERO), ONE)
        part[i], rest[i] = value, ONE - value
        count += value > 0
    return count


@fused_inlined
def _light_up(normal, first, last, work):
    """FORM becomes falloff * cosine * lit part."""
    n = last - first
    nx, ny, nz, part, form = normal[0, first:last], normal[1, first:last], normal[2, first:last], work[LIT_PART, :n], work[FORM, :n]
    wx, wy, wz = work[WAY, :n], work[WAY + 1, :n], work[WAY + 2, :n]
    for i in range(n):
        form[i] *= max(nx[i] * wx[i] + ny[i] * wy[i] + nz[i] * wz[i], ZERO) * part[i]


@fused
def _add_modes(lights, light, rows, weights, part, first, last, work):
    """The residual of blocks of lanes in one state (modes.Rows), by how far each lane (row `part`) is in it."""
    entries, step, mode, start = rows
    share = work[part]
    for block in range(first // LANES, last // LANES):
        begin, end, a, num = start[block], start[block + 1], block * LANES - first, 0
        for i in range(a, a + LANES):
            num += share[i] > 0
        if begin < end and num > 0:
            add_rows(entries, step, mode, begin, end, weights, light, lights, COLOR, share, work, TOTAL, a)  # pyright: ignore[reportCallIssue]


@fused_inlined
def _scatter(values, row, slot, first, last, out):
    mine = values[row]
    for i in range(last - first):
        out[np.uintp(slot[first + i])] = mine[i]


@fused_inlined
def _blend(source, share, at_sites, slot, first, last, out):
    """Irradiance at lanes from the sites that they read, written to their slots."""
    for i in range(first, last):
        red, green, blue = ZERO, ZERO, ZERO
        for k in range(source.shape[1]):
            weight, row = share[i, k], np.uintp(source[i, k])
            red += weight * at_sites[row, 0]
            green += weight * at_sites[row, 1]
            blue += weight * at_sites[row, 2]
        place = np.uintp(slot[i])
        out[0, place], out[1, place], out[2, place] = red, green, blue


@fused
def light_lanes(
    counter, size, slot, lights, distance, position, normal, viewer, gloss, surface, lobe_start, lobes, source, share,
    at_sites, lit, dark, work, irradiance, shine, ways,
):  # fmt: skip
    """What of light is read at items, tiles of `size` lanes (whole blocks) as long as there are any.

    Written by slots: `irradiance` of the sites (`at_sites`), `shine`, the radiance of highlights and residual, and of lamps
    direction and falloff in `ways`; what has length 0 is left out. `lit` and `dark`: modes.Rows, and weights by light.
    `work` has NUM_LANE_ROWS rows of `size`.
    """
    num = len(slot)
    while True:
        first = take(counter) * size  # pyright: ignore[reportCallIssue]
        if first >= num:
            return
        last = min(first + size, num)
        if len(irradiance):
            _blend(source, share, at_sites, slot, first, last, irradiance)
        work[TOTAL : TOTAL + 3] = ZERO
        for light in range(len(lights)):
            is_lit = _part_lit(distance[light], slot, first, last, work) > 0
            is_lamp = lights[light, KIND] != AT_INFINITY
            if is_lamp or (is_lit and len(lobes)):
                aim(lights, light, position, first, last, work)
            if is_lamp:
                for k in range(4):
                    _scatter(work, WAY + k, slot, first, last, ways[light, k])  # FORM follows WAY
            if is_lit and len(lobes):
                _light_up(normal, first, last, work)
                add_lobes(lights, light, lobes, lobe_start, surface, normal, viewer, gloss, first, last, work)
            if light < len(lit[1]):
                _add_modes(lights, light, lit[0], lit[1], LIT_PART, first, last, work)
                _add_modes(lights, light, dark[0], dark[1], DARK_PART, first, last, work)
        for c in range(len(shine)):
            _scatter(work, TOTAL + c, slot, first, last, shine[c])


# --------------------------------------------------------------------------------------------- items


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
def _add_arriving(lights, light, normal, step, first, n, work):
    """The light that arrives at each item's own normal, where it is lit, added to ARRIVING."""
    nx, ny, nz = normal[0, first : first + n], normal[1, first : first + n], normal[2, first : first + n]
    form, part = work[ITEM_FORM, :n], work[COVER, :n]
    if lights[light, KIND] == AT_INFINITY:
        x, y, z = step * lights[light, PLACE], step * lights[light, PLACE + 1], step * lights[light, PLACE + 2]
        for i in range(n):
            form[i] = part[i] * max(np.float32(nx[i]) * x + np.float32(ny[i]) * y + np.float32(nz[i]) * z, ZERO)
    else:
        wx, wy, wz, falloff = work[ITEM_WAY, :n], work[ITEM_WAY + 1, :n], work[ITEM_WAY + 2, :n], work[FALLOFF, :n]
        for i in range(n):
            form[i] = np.float32(nx[i]) * wx[i] + np.float32(ny[i]) * wy[i] + np.float32(nz[i]) * wz[i]
        for i in range(n):
            form[i] = part[i] * max(step * form[i], ZERO) * falloff[i]
    for c in range(3):
        color, arriving = lights[light, COLOR + c], work[ARRIVING + c, :n]
        for i in range(n):
            arriving[i] += form[i] * color


@fused
def _add_diffuse(diffuse, steps, first, n, work):
    for c in range(3):
        albedo, out, arriving = diffuse[c, first : first + n], work[OUT + c, :n], work[ARRIVING + c, :n]
        step = steps[1 + c]
        for i in range(n):
            out[i] += np.float32(albedo[i]) * (step * arriving[i])


@fused
def _write(row, size, columns, loose, pixel, empty_start, empty, least, work, out):
    """A row's items to their pixels, not below `least`; 0 to the pixels without any."""
    width, height = size
    for phase in range(4):
        dx, y = phase % 2, 2 * row + phase // 2
        if y >= height:
            continue
        num, place = (width - dx + 1) // 2, 3 * (y * width + dx)
        a = phase * columns
        red, green, blue = work[OUT, a : a + num], work[OUT + 1, a : a + num], work[OUT + 2, a : a + num]
        for i in range(num):
            r, g, b = red[i], green[i], blue[i]
            put_color(out, place, least if r < least else r, least if g < least else g, least if b < least else b)  # pyright: ignore[reportCallIssue]
            place += 6
    at, first, last = np.uintp(4 * columns), loose[row], loose[row + 1]
    for k in range(first, last):
        place = np.uintp(3 * pixel[k])
        is_first, is_last = k == first or pixel[k] != pixel[k - 1], k + 1 == last or pixel[k] != pixel[k + 1]
        for c in (np.uintp(0), np.uintp(1), np.uintp(2)):
            value = work[OUT + c, at] + (ZERO if is_first else out[place + c])
            out[place + c] = least if is_last and value < least else value
        at += np.uintp(1)
    for k in range(empty_start[row], empty_start[row + 1]):
        put_color(out, 3 * empty[k], ZERO, ZERO, ZERO)  # pyright: ignore[reportCallIssue]


@fused
def fill(
    counter, shape, size, row_start, loose, corner, share, part_share, pixel, lights, distance, ways, irradiance, shine,
    normal, diffuse, steps, empty_start, empty, least, work, out,
):  # fmt: skip
    """Radiance of rows of the grid, as long as there are any.

    `shape`: columns and rows of the grid; `size`: width and height of the picture. Of slots: `distance` (light x slot) to
    shadows' edges, and what light_lanes wrote (length 0 for none). Loose items read by `share`, and what is of whole pixels
    (`shine`) by `part_share`. `normal` and `diffuse` are planes of items in `steps`. `work` has NUM_ITEM_ROWS rows for the
    longest row's items. `empty`: the pixels without any. `out` (pixel x 3, flat) is nowhere below `least`.
    """
    columns, rows = shape
    while True:
        row = take(counter)  # pyright: ignore[reportCallIssue]
        if row >= rows - 1:
            return
        first = row_start[row]
        n = 4 * columns + loose[row + 1] - loose[row]
        for c in range(3):
            if len(shine):
                _read(shine[c], row, columns, corner, part_share, loose, work[OUT + c])
            else:
                work[OUT + c, :n] = ZERO
            if len(irradiance):
                _read(irradiance[c], row, columns, corner, share, loose, work[ARRIVING + c])
            else:
                work[ARRIVING + c, :n] = ZERO
        for light in range(len(lights)):
            _read(distance[light], row, columns, corner, share, loose, work[COVER])
            if _cover(work[COVER, :n]) == 0:
                continue
            if lights[light, KIND] != AT_INFINITY:
                for k in range(4):
                    _read(ways[light, k], row, columns, corner, share, loose, work[ITEM_WAY + k])
            _add_arriving(lights, light, normal, steps[0], first, n, work)
        _add_diffuse(diffuse, steps, first, n, work)
        _write(row, size, columns, loose, pixel, empty_start, empty, least, work, out)
