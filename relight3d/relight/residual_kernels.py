"""The compiled loops of the residual: modes of blocks of captured pixels, weighted for a light, and how points read them.

At the captured view pixels take their own. At another one points read images: what captured pixels' modes make of a light.
A block of an image is made by whoever reads it first, while it is needed: of most only one state is, lit or dark, and
of a viewpoint far off next to none.
"""

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from relight3d.relight.kernels import COLOR, FULL, ONE, ZERO, fused, fused_inlined
from relight3d.relight.lanes import BYTE, COLORS, INDEX, WORD, address_of, blend_colors, load_vector, store_vector
from relight3d.relight.lobe_kernels import BASE, LOBES, TOTAL

BLOCK_BITS = 6
LANES = 1 << BLOCK_BITS  # pixels side by side in a block
# Rows of a block's workspace: radiance; one light's modes; how far its pixels see that light, and do not.
# The last: the blocks of images that were read last, for either state, as integers.
PIXELS, SUM, LIT_PART, DARK_PART, LAST_READ, NUM_PIXEL_ROWS = 0, 3, 6, 7, 8, 9
READ_LIT, READ_DARK = LOBES, BASE  # rows into which points read captured pixels
PER_FULL = np.float32(1 / FULL)
NOTHING, SAME, OTHERS = 0, 1, 2  # what a point reads: no block, those that the last one did, others


@intrinsic
def _reads(_typing, source, share, point, pixels, state):
    """Which blocks of an image a point reads: NOTHING, SAME, OTHERS; then they are the last ones, in LAST_READ."""

    def generate(context, builder, signature, given):
        kinds = signature.args
        rows = address_of(context, builder, kinds[0], given[0], given[2])
        shares = load_vector(builder, address_of(context, builder, kinds[1], given[1], given[2]), COLORS)
        last = address_of(context, builder, kinds[3], given[3], WORD(LAST_READ), builder.mul(given[4], WORD(4)))
        four, mask = ir.VectorType(INDEX, 4), ir.IntType(4)
        blocks = builder.lshr(load_vector(builder, rows, four), ir.Constant(four, [BLOCK_BITS] * 4))
        is_other = builder.bitcast(builder.icmp_unsigned("!=", blocks, load_vector(builder, last, four)), mask)
        is_held = builder.bitcast(builder.fcmp_ordered(">", shares, ir.Constant(COLORS, [0.0] * 4)), mask)
        is_held = builder.icmp_unsigned("!=", is_held, mask(0))
        found = cgutils.alloca_once_value(builder, WORD(NOTHING))
        with builder.if_then(is_held):
            builder.store(WORD(SAME), found)
            with builder.if_then(builder.icmp_unsigned("!=", is_other, mask(0)), likely=False):
                store_vector(builder, blocks, last)
                builder.store(WORD(OTHERS), found)
        return builder.load(found)

    return types.intp(source, share, types.intp, pixels, types.intp), generate


@intrinsic
def _is_made(_typing, made, block):
    """Whether an element of a row of bytes is set; then what was written before it was set can be read."""

    def generate(context, builder, signature, given):
        flag = address_of(context, builder, signature.args[0], given[0], given[1])
        return builder.icmp_unsigned("!=", builder.load_atomic(flag, "acquire", 1), BYTE(0))

    return types.boolean(made, types.intp), generate


@intrinsic
def _set_made(_typing, made, block):
    """Sets an element of a row of bytes, after all that this thread wrote before."""

    def generate(context, builder, signature, given):
        flag = address_of(context, builder, signature.args[0], given[0], given[1])
        builder.store_atomic(BYTE(1), flag, "release", 1)
        return context.get_dummy_value()

    return types.void(made, types.intp), generate


@fused
def _sum_modes(rows, block, weights, light, pixels):
    """A block's modes (modes.Rows), weighted for one light, in SUM."""
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


@fused
def _add_modes(rows, block, weights, light, share, colors, pixels):
    """Adds a block's modes, weighted for one light, to its pixels, each by its share."""
    _sum_modes(rows, block, weights, light, pixels)
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
def add_residual(first, last, start, lights, seen, lit, dark, pixels):
    """The residual of a block of the captured view: lit and dark modes by how far each pixel sees the light.

    `lit` and `dark` are rows of modes, and weights by light.
    """
    for light in range(len(lit[1])):
        any_lit, any_dark = _parts(first, last, start, seen, light, pixels)
        if any_lit:
            _add_modes(lit[0], first // LANES, lit[1], light, pixels[LIT_PART], lights, pixels)
        if any_dark:
            _add_modes(dark[0], first // LANES, dark[1], light, pixels[DARK_PART], lights, pixels)


@fused
def _make_image(block, light, rows, weights, pixels, image):
    """The residual of a block's captured points in one state, for a light of power 1."""
    _sum_modes(rows, block, weights, light, pixels)
    first = block * LANES
    num = min(LANES, len(image) - first)
    for lane in range(num):
        for c in range(3):
            image[first + lane, c] = pixels[SUM + c, lane]


@fused
def _make_read(source, point, light, modes, image, made, pixels):
    """Makes those blocks of an image that a point reads and nobody made before.

    Two threads may make a block at once: they write the same numbers.
    """
    for k in range(4):
        block = source[point, k] // LANES
        if not _is_made(made, block):  # pyright: ignore[reportCallIssue]
            _make_image(block, light, modes[0], modes[1], pixels, image)
            _set_made(made, block)  # pyright: ignore[reportCallIssue]


@fused_inlined
def _read_image(source, share, point, light, state, modes, images, made, pixels, work, row, i):
    """What a point has of a state's image, in three rows of `work` at `i`."""
    reads = _reads(source, share, point, pixels, state)  # pyright: ignore[reportCallIssue]
    if reads == NOTHING:
        return
    if reads == OTHERS:
        _make_read(source, point, light, modes, images[light, state], made[light, state], pixels)
    blend_colors(source, share, point, images[light, state], 0, work, row, i)  # pyright: ignore[reportCallIssue]


@fused_inlined
def add_read_residual(lights, seen, source, share, images, made, lit, dark, a, b, pixels, work):
    """The residual of points a..b of another view, read from the captured pixels'; colours and states go by light.

    `images` (light x state x captured point x 4) are filled as they are read; `made` says which blocks are.
    """
    n = b - a
    for light in range(len(images)):
        part = seen[light, a:b]
        work[READ_LIT : READ_LIT + 3, :n], work[READ_DARK : READ_DARK + 3, :n] = ZERO, ZERO
        pixels[LAST_READ, :8] = -ONE  # no block has the number that these bits are
        for i in range(n):
            if part[i] > 0:
                _read_image(source, share, a + i, light, 0, lit, images, made, pixels, work, READ_LIT, i)
            if part[i] < FULL:
                _read_image(source, share, a + i, light, 1, dark, images, made, pixels, work, READ_DARK, i)
        for c in range(3):
            in_light, in_shadow, total = work[READ_LIT + c, :n], work[READ_DARK + c, :n], work[TOTAL + c, :n]
            color = lights[light, COLOR + c]
            for i in range(n):
                total[i] += color * (in_shadow[i] + np.float32(part[i]) * PER_FULL * (in_light[i] - in_shadow[i]))
