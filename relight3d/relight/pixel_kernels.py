"""The compiled loops over a view's pixels: points added up, the residual, and the clamp at 0."""

import numpy as np

from relight3d.relight.kernels import ZERO, fused, fused_inlined, take
from relight3d.relight.lobe_kernels import TOTAL
from relight3d.relight.residual_kernels import LANES, PIXELS, add_residual
from relight3d.relight.shade_kernels import shade_points

CHUNK = 16 * LANES  # pixels shaded at once: long runs from each of a dozen arrays, and all of it stays in the cache


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
def finish_block(first, last, a, start, pixel, lights, seen, lit, dark, is_captured, work, pixels, out):
    """A block's points, which begin at `a` in `work`, with the residual of a captured view, onto `out`; at least 0."""
    _add_up(start, first, last, a, work, pixels)
    if is_captured and len(lit[1]):
        add_residual(first, last, start, lights, seen, lit, dark, pixels)
    red, green, blue = pixels[PIXELS], pixels[PIXELS + 1], pixels[PIXELS + 2]
    for lane in range(last - first):
        place = np.uint32(3) * np.uint32(pixel[first + lane])  # unsigned: no look from the end
        for c, mine in ((np.uint32(0), red[lane]), (np.uint32(1), green[lane]), (np.uint32(2), blue[lane])):
            value = mine + out[place + c]
            out[place + c] = ZERO if value < 0 else value  # a NaN passes, to be seen


@fused
def shade(
    counter, start, pixel, lights, seen, position, normal, viewer, tangent, diffuse, gloss, surface, lobe_start,
    lobes, site_source, site_share, irradiance, source, share, images, made, lit, dark, work, pixels, out,
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
            site_source, site_share, irradiance, source, share, images, made, lit, dark, pixels, work,
        )  # fmt: skip
        for block in range(begin, end, LANES):
            finish_block(
                block, min(block + LANES, end), a, start, pixel, lights, seen, lit, dark, len(images) == 0, work, pixels, out
            )  # fmt: skip
