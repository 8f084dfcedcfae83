"""The compiled shading pass with fewer evaluations: what varies slowly is read off anchors, the rest is computed.

Per pixel stay the albedo, the cosine at the pixel's own normal, the highlights where they can be seen, and the shadows;
indirect light is a bilinear patch over a cell of 4 x 4 pixels, whose shares are constants: no index and no share is
read there.
"""

import numpy as np

from relight3d.relight.kernels import ZERO, add_arriving, fused, fused_inlined, take
from relight3d.relight.lanes import blend_colors
from relight3d.relight.lobe_kernels import FORM, NUM_ROWS, TOTAL, add_lobes
from relight3d.relight.pixel_kernels import CHUNK, finish_block
from relight3d.relight.residual_kernels import LANES, add_read_residual
from relight3d.relight.shade_kernels import aim, is_seen, light_up

IRRADIANCE, NUM_FILL_ROWS = NUM_ROWS, NUM_ROWS + 3
QUARTER, TWO, THREE = np.float32(0.25), np.float32(2), np.float32(3)


@fused
def blend(source, share, irradiance, out):
    """Irradiance at anchors from the sites that they read."""
    for i in range(len(source)):
        red, green, blue = ZERO, ZERO, ZERO
        for k in range(source.shape[1]):
            weight, row = share[i, k], source[i, k]
            red += weight * irradiance[row, 0]
            green += weight * irradiance[row, 1]
            blue += weight * irradiance[row, 2]
        out[i, 0], out[i, 1], out[i, 2] = red, green, blue


@fused_inlined
def _read_cells(cell, corner, first, last, a, values, work):
    """Irradiance of cells first..last from their corners."""
    for i in range(first, last):
        place = cell[i] - a
        for c in range(3):
            nw, ne, sw, se = (
                values[corner[i, 0], c], values[corner[i, 1], c], values[corner[i, 2], c], values[corner[i, 3], c]
            )  # fmt: skip
            out = work[IRRADIANCE + c, place : place + 16]
            for y in range(4):
                left = nw + (sw - nw) * np.float32(y) * QUARTER
                step = (ne + (se - ne) * np.float32(y) * QUARTER - left) * QUARTER
                out[4 * y] = left
                out[4 * y + 1] = left + step
                out[4 * y + 2] = left + step * TWO
                out[4 * y + 3] = left + step * THREE


@fused_inlined
def _read_loose(loose, corner, share, first, last, a, values, work):
    """Irradiance of the loose points first..last from their anchors."""
    for i in range(first, last):
        blend_colors(corner, share, i, values, 0, work, IRRADIANCE, loose[i] - a)  # pyright: ignore[reportCallIssue]


@fused
def fill(
    counter, start, pixel, cells, loose, lights, seen, position, normal, viewer, tangent, diffuse, gloss,
    surface, lobe_start, lobes, irradiance, source, share, images, made, lit, dark, work, pixels, out,
):  # fmt: skip
    """pixel_kernels.shade with indirect light read off anchors (`irradiance`; length 0 for none).

    `cells`: each chunk's first, then places and corners; `loose`: the same, and shares. `lobes` say below which base they
    cannot be seen. `work` has NUM_FILL_ROWS rows.
    """
    cell_start, cell, cell_corner = cells
    loose_start, loose_point, loose_corner, loose_share = loose
    while True:
        chunk = take(counter)  # pyright: ignore[reportCallIssue]
        begin = chunk * CHUNK
        if begin >= len(pixel):
            return
        end = min(begin + CHUNK, len(pixel))
        a, b = start[begin], start[end]
        n = b - a
        if len(irradiance):
            _read_cells(cell, cell_corner, cell_start[chunk], cell_start[chunk + 1], a, irradiance, work)
            ends = (loose_start[chunk], loose_start[chunk + 1])
            _read_loose(loose_point, loose_corner, loose_share, *ends, a, irradiance, work)
        else:
            for c in range(3):
                work[IRRADIANCE + c, :n] = ZERO
        for c in range(3):
            work[TOTAL + c, :n] = ZERO
        for light in range(len(lights)):
            if not is_seen(seen, light, a, b):
                continue
            aim(lights, light, position, a, b, work)
            if light_up(seen, light, normal, a, b, work) == 0:
                continue
            add_arriving(lights, light, work[FORM, :n], work[IRRADIANCE : IRRADIANCE + 3, :n])
            if len(lobes):
                add_lobes(lights, light, lobes, lobe_start, surface, normal, viewer, tangent, gloss, a, b, work)
        for c in range(3):
            albedo, total, arriving = diffuse[c, a:b], work[TOTAL + c, :n], work[IRRADIANCE + c, :n]
            for i in range(n):
                total[i] += albedo[i] * arriving[i]
        if len(images):
            add_read_residual(lights, seen, source, share, images, made, lit, dark, a, b, pixels, work)
        for block in range(begin, end, LANES):
            finish_block(
                block, min(block + LANES, end), a, start, pixel, lights, seen, lit, dark, len(images) == 0, work, pixels, out
            )  # fmt: skip
