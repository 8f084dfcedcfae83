"""The compiled loops over a view's pixels: points added up, the residual, and the clamp at 0."""

import numpy as np

from relight3d.relight.kernels import COLOR, FULL, ONE, ZERO, fused, fused_inlined, take
from relight3d.relight.lobe_kernels import TOTAL
from relight3d.relight.shade_kernels import DARK_COLUMN, LANES, PER_FULL, shade_points

CHUNK = 16 * LANES  # pixels shaded at once: long runs from each of a dozen arrays, and all of it stays in the cache
# Rows of a block's second workspace: radiance; one light's modes; how far its pixels see that light, and do not.
PIXELS, SUM, LIT_PART, DARK_PART, NUM_PIXEL_ROWS = 0, 3, 6, 7, 8


@fused
def _add_modes(rows, block, weights, light, share, colors, pixels):
    """Adds a block's modes (modes.Rows), weighted for one light, to its pixels, each by its share."""
    entries, step, mode, start = rows
    total = pixels[SUM : SUM + 3].reshape(3 * LANES)
    for i in range(3 * LANES):
        total[i] = ZERO
    first, last = start[block], start[block + 1]
    # Four rows at a time: the sums are read and written once for them.
    for row in range(first, last - 3, 4):
        a, b, c, d = entries[row], entries[row + 1], entries[row + 2], entries[row + 3]
        of_a, of_b = weights[light, mode[row]] * step[row], weights[light, mode[row + 1]] * step[row + 1]
        of_c, of_d = weights[light, mode[row + 2]] * step[row + 2], weights[light, mode[row + 3]] * step[row + 3]
        for i in range(3 * LANES):
            low = of_a * np.float32(a[i]) + of_b * np.float32(b[i])
            total[i] += low + (of_c * np.float32(c[i]) + of_d * np.float32(d[i]))
    for row in range(last - (last - first) % 4, last):
        weight, values = weights[light, mode[row]] * step[row], entries[row]
        for i in range(3 * LANES):
            total[i] += weight * np.float32(values[i])
    for c in range(3):
        color, out, mine = colors[light, COLOR + c], pixels[PIXELS + c], pixels[SUM + c]
        for lane in range(LANES):
            out[lane] += color * share[lane] * mine[lane]


@fused
def _parts(first, last, start, seen, light, pixels):
    """How far each pixel of a block sees a light, in LIT_PART, and does not, in DARK_PART. Returns whether any does."""
    a, b = start[first], start[last]
    of_points, part, rest = seen[light, a:b], pixels[LIT_PART], pixels[DARK_PART]
    least, most = np.uint8(255), np.uint8(0)
    for p in range(b - a):
        least, most = min(least, of_points[p]), max(most, of_points[p])
    if least == most or b - a == last - first:  # all alike, or a point a pixel
        for lane in range(last - first):
            part[lane] = np.float32(of_points[lane]) * PER_FULL
    else:
        p = 0
        for lane in range(last - first):
            num = start[first + lane + 1] - a - p
            total = np.float32(of_points[p])
            if num > 1:
                for k in range(1, num):
                    total += np.float32(of_points[p + k])
                total /= np.float32(num)
            part[lane] = total * PER_FULL
            p += num
    for lane in range(last - first):
        rest[lane] = ONE - part[lane]
    return most > 0, least < FULL


@fused
def _add_residual(first, last, start, lights, seen, lit, dark, pixels):
    """The residual of a block of the captured view: lit and dark modes by how far each pixel sees the light.

    `lit` and `dark` are rows of modes, and weights by light.
    """
    for light in range(len(lit[1])):
        any_lit, any_dark = _parts(first, last, start, seen, light, pixels)
        if any_lit:
            _add_modes(lit[0], first // LANES, lit[1], light, pixels[LIT_PART], lights, pixels)
        if any_dark:
            _add_modes(dark[0], first // LANES, dark[1], light, pixels[DARK_PART], lights, pixels)


@fused_inlined
def _add_up(start, first, last, a, work, pixels):
    """The radiance of each pixel's points, which begin at `a` in `work`."""
    begin, end = start[first] - a, start[last] - a
    if end - begin == last - first:  # no outline here: a point a pixel
        for c in range(3):
            total, of_points = pixels[PIXELS + c], work[TOTAL + c, begin:end]
            for lane in range(len(of_points)):
                total[lane] = of_points[lane]
        return
    red, green, blue = work[TOTAL, begin:end], work[TOTAL + 1, begin:end], work[TOTAL + 2, begin:end]
    p = 0
    for lane in range(last - first):
        num = start[first + lane + 1] - a - begin - p
        r, g, b = red[p], green[p], blue[p]
        for k in range(1, num):
            r, g, b = r + red[p + k], g + green[p + k], b + blue[p + k]
        pixels[PIXELS, lane], pixels[PIXELS + 1, lane], pixels[PIXELS + 2, lane] = r, g, b
        p += num


@fused_inlined
def finish_block(first, last, a, start, pixel, lights, seen, lit, dark, work, pixels, out):
    """A block's points, which begin at `a` in `work`, added up, with the residual, onto `out`; clamped at 0."""
    _add_up(start, first, last, a, work, pixels)
    if len(lit[1]):
        _add_residual(first, last, start, lights, seen, lit, dark, pixels)
    red, green, blue = pixels[PIXELS], pixels[PIXELS + 1], pixels[PIXELS + 2]
    for lane in range(last - first):
        place = np.uint32(3) * np.uint32(pixel[first + lane])  # unsigned: no look from the end
        for c, mine in ((np.uint32(0), red[lane]), (np.uint32(1), green[lane]), (np.uint32(2), blue[lane])):
            value = mine + out[place + c]
            out[place + c] = ZERO if value < 0 else value  # a NaN passes, to be seen


@fused
def shade(
    counter, start, pixel, lights, seen, position, normal, viewer, tangent, diffuse, gloss, surface, lobe_start,
    lobes, site_source, site_share, irradiance, source, share, images, lit, dark, work, pixels, out,
):  # fmt: skip
    """Radiance of chunks of pixels, as long as there are any: every term, added up, clamped at 0.

    `out` (pixel x 3, flat) holds what else each pixel shows. Arrays of an absent effect have length 0. `work` has room for
    a chunk's points (shade_kernels.NUM_ROWS rows), `pixels` for its pixels (NUM_PIXEL_ROWS rows).
    """
    while True:
        begin = take(counter) * CHUNK  # pyright: ignore[reportCallIssue]
        if begin >= len(pixel):
            return
        end = min(begin + CHUNK, len(pixel))
        a, b = start[begin], start[end]
        shade_points(
            a, b, lights, seen, position, normal, viewer, tangent, diffuse, gloss, surface, lobe_start, lobes,
            site_source, site_share, irradiance, source, share, images, work,
        )  # fmt: skip
        for block in range(begin, end, LANES):
            finish_block(
                block, min(block + LANES, end), a, start, pixel, lights, seen, lit, dark, work, pixels, out
            )  # fmt: skip


@fused
def residual_images(first, last, lit, dark, light, ones, pixels, images):
    """The residual of captured points in blocks first..last, lit and dark, for one light of power 1.

    `ones` stands in for the lights' colours.
    """
    share = pixels[LIT_PART]
    share[:] = ONE
    for block in range(first, last):
        for state in range(2):
            pixels[PIXELS : PIXELS + 3] = ZERO
            if state == 0:
                _add_modes(lit[0], block, lit[1], light, share, ones, pixels)
            else:
                _add_modes(dark[0], block, dark[1], light, share, ones, pixels)
            for lane in range(min(LANES, len(images) - LANES * block)):
                for c in range(3):
                    images[LANES * block + lane, DARK_COLUMN * state + c] = pixels[PIXELS + c, lane]
