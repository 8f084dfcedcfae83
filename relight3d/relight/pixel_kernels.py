"""The compiled loops over a view's pixels: points added up, the residual, and the clamp at 0."""

import numpy as np

from relight3d.relight.kernels import COLOR, FULL, ONE, ZERO, compiled, inlined
from relight3d.relight.shade_kernels import LANES, TOTAL, shade_points

CHUNK = 2 * LANES  # pixels shaded at once: long enough loops for wide registers, and all of it stays in the cache
# Rows of a block's second workspace: radiance; one light's modes; how far its pixels see that light, and do not.
PIXELS, SUM, LIT_PART, DARK_PART, NUM_PIXEL_ROWS = 0, 3, 6, 7, 8


@compiled
def _add_modes(rows, block, weights, light, share, colors, pixels):
    """Adds a block's modes (modes.Rows), weighted for one light, to its pixels, each by its share."""
    entries, step, mode, start = rows
    total = pixels[SUM : SUM + 3].reshape(3 * LANES)
    for i in range(3 * LANES):
        total[i] = ZERO
    for row in range(start[block], start[block + 1]):
        weight, values = weights[light, mode[row]] * step[row], entries[row]
        for i in range(3 * LANES):
            total[i] += weight * np.float32(values[i])
    for c in range(3):
        color, out, mine = colors[light, COLOR + c], pixels[PIXELS + c], pixels[SUM + c]
        for lane in range(LANES):
            out[lane] += color * share[lane] * mine[lane]


@compiled
def _parts(first, last, start, seen, light, pixels):
    """How far each pixel of a block sees a light, in LIT_PART, and does not, in DARK_PART. Returns whether any does."""
    a, b = start[first], start[last]
    of_points, part, rest = seen[light, a:b], pixels[LIT_PART], pixels[DARK_PART]
    least, most = np.uint8(255), np.uint8(0)
    for p in range(b - a):
        least, most = min(least, of_points[p]), max(most, of_points[p])
    if least == most or b - a == last - first:  # all alike, or a point a pixel
        for lane in range(last - first):
            part[lane] = np.float32(of_points[lane]) / np.float32(FULL)
    else:
        for r in range(first, last):
            total = 0
            for p in range(start[r], start[r + 1]):
                total += seen[light, p]
            part[r - first] = np.float32(total) / np.float32(FULL * (start[r + 1] - start[r]))
    for lane in range(last - first):
        rest[lane] = ONE - part[lane]
    return most > 0, least < FULL


@compiled
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


@inlined
def _add_up(start, first, last, a, work, pixels):
    """The radiance of each pixel's points, which begin at `a` in `work`."""
    begin, end = start[first] - a, start[last] - a
    if end - begin == last - first:  # no outline here: a point a pixel
        for c in range(3):
            total, of_points = pixels[PIXELS + c], work[TOTAL + c, begin:end]
            for lane in range(len(of_points)):
                total[lane] = of_points[lane]
        return
    for r in range(first, last):
        for c in range(3):
            total = ZERO
            for p in range(start[r] - a, start[r + 1] - a):
                total += work[TOTAL + c, p]
            pixels[PIXELS + c, r - first] = total


@compiled
def shade(
    first, last, start, pixel, lights, seen, position, normal, viewer, diffuse, gloss, surface, lobe_start, lobes,
    site_source, site_share, irradiance, source, share, images, lit, dark, work, pixels, out,
):  # fmt: skip
    """Radiance of the pixels of rank first..last (first a multiple of 16): every term, added up, clamped at 0.

    `out` (pixel x 3) holds what else each pixel shows. Arrays of an absent effect have length 0. `work` has room for
    a chunk's points (shade_kernels.NUM_ROWS rows), `pixels` for its pixels (NUM_PIXEL_ROWS rows).
    """
    for begin in range(first, last, CHUNK):
        end = min(begin + CHUNK, last)
        a, b = start[begin], start[end]
        shade_points(
            a, b, lights, seen, position, normal, viewer, diffuse, gloss, surface, lobe_start, lobes, site_source,
            site_share, irradiance, source, share, images, work,
        )  # fmt: skip
        for block in range(begin, end, LANES):
            stop = min(block + LANES, end)
            _add_up(start, block, stop, a, work, pixels)
            if len(lit[1]):
                _add_residual(block, stop, start, lights, seen, lit, dark, pixels)
            for r in range(block, stop):
                for c in range(3):
                    value = pixels[PIXELS + c, r - block] + out[pixel[r], c]
                    out[pixel[r], c] = ZERO if value < 0 else value  # a NaN passes, to be seen


@compiled
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
                    images[LANES * block + lane, 3 * state + c] = pixels[PIXELS + c, lane]
