"""Highlights and the residual of a row of items at half resolution (half_kernels.py)."""

import numpy as np

from relight3d.relight.kernels import COLOR, ONE, TINY, ZERO, fused, fused_inlined
from relight3d.relight.lanes import add_rows, shines
from relight3d.relight.lobe_kernels import BRUSHED, LONG, ROUND, long_base, power
from relight3d.relight.modes import LANES

# Rows of a thread's workspace: radiance; irradiance; how much is lit, form, cosine, along and across (lobe_kernels); way
# to a lamp and its falloff; a lobe's sum and base; how much is dark; how far a block's light and viewer lie along tangents.
TOTAL, ARRIVING, LIT_PART, FORM, COSINE, ALONG, ACROSS = 0, 3, 6, 7, 8, 9, 10
WAY, FALLOFF, SUM, BASE, REST, OF_LIGHT, OF_VIEWER, NUM_HALF_ROWS = 11, 14, 15, 18, 19, 20, 21, 22
TWO = np.float32(2)


@fused
def split_facing(facing, step, first, n, work):
    """What lobes are made of (lobe_kernels), from ACROSS, the direction to the light along that to the viewer."""
    along, across, cosine, out_of = work[ALONG, :n], work[ACROSS, :n], work[COSINE, :n], facing[first : first + n]
    for i in range(n):
        along[i] = cosine[i] * (step * np.float32(out_of[i]))
    for i in range(n):
        across[i] -= along[i]


@fused_inlined
def _along_tangent(tangent, plane, step, begin, way, of_light, of_viewer):
    """How far the light and the viewer lie along the tangents of a block of items."""
    tx, ty, tz = (
        tangent[plane, begin : begin + LANES],
        tangent[plane + 1, begin : begin + LANES],
        tangent[plane + 2, begin : begin + LANES],
    )
    along = tangent[plane + 3, begin : begin + LANES]
    wx, wy, wz = way
    for i in range(LANES):
        of_light[i] = step * (np.float32(tx[i]) * wx[i] + np.float32(ty[i]) * wy[i] + np.float32(tz[i]) * wz[i])
    for i in range(LANES):
        of_viewer[i] = step * np.float32(along[i])


@fused_inlined
def _brushed_base(lobe, along, across, cosine, facing, step, of_light, of_viewer, base):
    """The base of a brushed highlight (maths.halfway) from the half-way vector's length and its parts."""
    for i in range(LANES):
        whole = TWO + TWO * (across[i] + along[i])
        ahead, aside = cosine[i] + step * np.float32(facing[i]), of_light[i] + of_viewer[i]
        forward, sideways = ahead * ahead, aside * aside
        rest = max(whole - forward - sideways, ZERO)
        base[i] = min((whole + TINY) / (lobe[3] * sideways + lobe[4] * rest + lobe[5] * forward + TINY), ONE)


@fused_inlined
def _round_halfway_base(lobe, along, across, cosine, facing, step, base):
    """The same of a round one."""
    for i in range(LANES):
        whole, ahead = TWO + TWO * (across[i] + along[i]), cosine[i] + step * np.float32(facing[i])
        forward = ahead * ahead
        rest = max(whole - forward, ZERO)
        base[i] = min((whole + TINY) / (lobe[3] * rest + lobe[5] * forward + TINY), ONE)


@fused_inlined
def _shows(base, dark, form, surface, which):
    """Whether one of a block's items is of the surface, lit, and of a base above `dark`."""
    num = 0
    for i in range(LANES):
        num += (base[i] > dark) & (form[i] > 0) & (surface[i] == which)
    return num > 0


@fused_inlined
def _add_highlights_of_block(
    lights, light, lobes, lobe_start, shining, surface, gloss, facing, tangent, steps, first, block, work
):
    """The highlights of a block of items: of the surfaces in it that have lobes (`shining`: -1 for none), where seen."""
    a = block * LANES
    begin = first + a
    way = (work[WAY, a : a + LANES], work[WAY + 1, a : a + LANES], work[WAY + 2, a : a + LANES])
    of_light, of_viewer = work[OF_LIGHT, :LANES], work[OF_VIEWER, :LANES]
    cosine, outward = work[COSINE, a : a + LANES], facing[begin : begin + LANES]
    all_along, all_across, all_form, all_of = work[ALONG], work[ACROSS], work[FORM], surface[first:]
    along, across, form = work[ALONG, a : a + LANES], work[ACROSS, a : a + LANES], work[FORM, a : a + LANES]
    mine, base = surface[begin : begin + LANES], work[BASE, :LANES]
    red, green, blue = work[SUM, :LANES], work[SUM + 1, :LANES], work[SUM + 2, :LANES]
    begun = False
    for s in range(shining.shape[1]):
        which = shining[begin // LANES, s]
        if which < 0:
            break
        plane = 0
        for k in range(lobe_start[which], lobe_start[which + 1]):
            aside, ahead, dark, form_of_lobe = lobes[k, 3], lobes[k, 5], lobes[k, 11], lobes[k, 10]
            if form_of_lobe in (BRUSHED, LONG):
                _along_tangent(tangent, plane, steps[8], begin, way, of_light, of_viewer)
                plane += 4
            if form_of_lobe == ROUND:
                if not shines(all_along, all_across, all_of, all_form, a, LANES, aside, ahead, dark, which):  # pyright: ignore[reportCallIssue]
                    continue
                for i in range(LANES):
                    base[i] = aside * across[i] + ahead * along[i]
            elif form_of_lobe == LONG:
                long_base(lobes[k], along, across, of_light, of_viewer, base)
            elif form_of_lobe == BRUSHED:
                _brushed_base(lobes[k], along, across, cosine, outward, steps[7], of_light, of_viewer, base)
            else:
                _round_halfway_base(lobes[k], along, across, cosine, outward, steps[7], base)
            if form_of_lobe != ROUND and not _shows(base, dark, form, mine, which):
                continue
            if not begun:
                red[:], green[:], blue[:] = ZERO, ZERO, ZERO
                begun = True
            exponent, r, g, b = lobes[k, 6], lobes[k, 0], lobes[k, 1], lobes[k, 2]
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
def add_highlights(
    lights, light, lobes, lobe_start, shining, surface, gloss, facing, tangent, steps, first, length, work
):
    """The highlights of a row's items, block by block."""
    for block in range(length // LANES):
        if shining[first // LANES + block, 0] >= 0:
            _add_highlights_of_block(
                lights, light, lobes, lobe_start, shining, surface, gloss, facing, tangent, steps, first, block, work
            )  # fmt: skip


@fused_inlined
def _exceeds(values, first, limit):
    """Whether one of a block's values does."""
    num = 0
    for i in range(first, first + LANES):
        num += values[i] > limit
    return num > 0


@fused
def add_residual(lights, light, lit, dark, first, length, work):
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
