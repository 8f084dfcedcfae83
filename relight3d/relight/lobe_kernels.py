"""The compiled loops of highlights: Lafortune lobes of a run of points of one surface, and their powers."""

import math

import numpy as np

from relight3d.relight.kernels import COLOR, ONE, ZERO, bits_of, float_of, fused_inlined

# Rows of a block's workspace: radiance; direction to the light; form; lobes' colour; bases, and what they are made of.
TOTAL, WAY, FORM, LOBES, BASE, ALONG, ACROSS, NUM_ROWS = 0, 3, 6, 7, 10, 11, 12, 13
TWO, HALF, LN2, PER_LN2 = np.float32(2), np.float32(0.5), np.float32(math.log(2)), np.float32(1 / math.log(2))
LOG_3, LOG_5, LOG_7, LOG_9 = (np.float32(1 / k) for k in (3, 5, 7, 9))  # atanh's series, for the logarithm
EXP_3, EXP_4, EXP_5, EXP_6 = (np.float32(1 / math.factorial(k)) for k in (3, 4, 5, 6))
TURNS_AT, TINY = np.float32(1e-4), np.float32(1e-12)
SQRT_HALF_BITS, MANTISSA_BITS, EXPONENT_OF_ONE = 0x3F3504F3, 23, 127


@fused_inlined
def power(base, exponent):
    """base ** exponent for a base in (0, 1], as exact as float32 lets the exponent's product be."""
    # base = 2^e * m with m in [sqrt(1/2), sqrt(2)): near 1, where lobes peak, e = 0 and nothing cancels.
    bits = bits_of(base)  # pyright: ignore[reportCallIssue]
    e = (bits - SQRT_HALF_BITS) >> MANTISSA_BITS
    m = float_of(np.int32(bits - (e << MANTISSA_BITS)))
    s = (m - ONE) / (m + ONE)
    q = s * s
    tail = LOG_3 + q * (LOG_5 + q * (LOG_7 + q * LOG_9))
    raised = exponent * (np.float32(e) * LN2 + TWO * (s + s * q * tail))
    k = np.floor(raised * PER_LN2 + HALF)
    f = raised - k * LN2
    tail = EXP_4 + f * (EXP_5 + f * EXP_6)
    scale = float_of(np.int32((np.int32(k) + EXPONENT_OF_ONE) << MANTISSA_BITS))
    return (ONE + f * (ONE + f * (HALF + f * (EXP_3 + f * tail)))) * scale


@fused_inlined
def _split_facing(normal, viewer, a, b, way, along, across):
    """What an isotropic lobe is made of, eq. (4): along = (n.l)(n.v), across = l.v less that, for unit vectors."""
    nx, ny, nz = normal[0, a:b], normal[1, a:b], normal[2, a:b]
    vx, vy, vz = viewer[0, a:b], viewer[1, a:b], viewer[2, a:b]
    wx, wy, wz = way
    for i in range(len(along)):
        along[i] = nx[i] * wx[i] + ny[i] * wy[i] + nz[i] * wz[i]
    for i in range(len(along)):
        along[i] *= nx[i] * vx[i] + ny[i] * vy[i] + nz[i] * vz[i]
    for i in range(len(along)):
        across[i] = wx[i] * vx[i] + wy[i] * vy[i] + wz[i] * vz[i] - along[i]


@fused_inlined
def brushed_base(lobe, normal, viewer, a, b, way, base):
    """The base of an anisotropic lobe, in the frame of maths.lafortune.tangent_frame."""
    for i in range(len(base)):
        nx, ny, nz = normal[0, a + i], normal[1, a + i], normal[2, a + i]
        vx, vy, vz = viewer[0, a + i], viewer[1, a + i], viewer[2, a + i]
        lx, ly, lz = way[0][i], way[1][i], way[2][i]
        sign = ONE if nz >= 0 else -ONE
        t = -ONE / (sign + nz)
        tx, ty, tz = ONE + sign * nx * nx * t, sign * nx * ny * t, -sign * nx
        along = nx * lobe[7] + ny * lobe[8] + nz * lobe[9]
        px, py, pz = lobe[7] - nx * along, lobe[8] - ny * along, lobe[9] - nz * along
        length = np.float32(math.sqrt(px * px + py * py + pz * pz))
        if length > 1e-4:
            tx, ty, tz = px / length, py / length, pz / length
        bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        base[i] = lobe[3] * (tx * lx + ty * ly + tz * lz) * (tx * vx + ty * vy + tz * vz)
        base[i] += lobe[4] * (bx * lx + by * ly + bz * lz) * (bx * vx + by * vy + bz * vz)
        base[i] += lobe[5] * (nx * lx + ny * ly + nz * lz) * (nx * vx + ny * vy + nz * vz)


@fused_inlined
def halfway_base(lobe, position, normal, viewer, a, b, way, base):
    """The base of a brushed highlight, maths.halfway."""
    for i in range(len(base)):
        nx, ny, nz = normal[0, a + i], normal[1, a + i], normal[2, a + i]
        qx, qy, qz = position[0, a + i], position[1, a + i], position[2, a + i]
        sign = ONE if nz >= 0 else -ONE
        t = -ONE / (sign + nz)
        tx, ty, tz = ONE + sign * nx * nx * t, sign * nx * ny * t, -sign * nx
        ux = lobe[7] + lobe[13] * qz - lobe[14] * qy
        uy = lobe[8] + lobe[14] * qx - lobe[12] * qz
        uz = lobe[9] + lobe[12] * qy - lobe[13] * qx
        along = nx * ux + ny * uy + nz * uz
        px, py, pz = ux - nx * along, uy - ny * along, uz - nz * along
        length = np.float32(math.sqrt(px * px + py * py + pz * pz))
        if length > TURNS_AT * np.float32(math.sqrt(ux * ux + uy * uy + uz * uz)):
            tx, ty, tz = px / length, py / length, pz / length
        hx, hy, hz = viewer[0, a + i] + way[0][i], viewer[1, a + i] + way[1][i], viewer[2, a + i] + way[2][i]
        bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        along, aside, ahead = tx * hx + ty * hy + tz * hz, bx * hx + by * hy + bz * hz, nx * hx + ny * hy + nz * hz
        spread = lobe[3] * along * along + lobe[4] * aside * aside + lobe[5] * ahead * ahead
        base[i] = (hx * hx + hy * hy + hz * hz + TINY) / (spread + TINY)


@fused_inlined
def _add_lobes_of_surface(lights, light, lobes, rows, position, normal, viewer, gloss, a, first, last, work):
    """The highlights of the points a + first to a + last, of one surface, whose lobes are `rows`."""
    way = (work[WAY, first:last], work[WAY + 1, first:last], work[WAY + 2, first:last])
    base, along, across = work[BASE, first:last], work[ALONG, first:last], work[ACROSS, first:last]
    red, green, blue = work[LOBES, first:last], work[LOBES + 1, first:last], work[LOBES + 2, first:last]
    ends = (a + first, a + last)
    begun, is_split = False, False
    for k in range(rows[0], rows[1]):
        if lobes[k, 10] > 0:
            if not is_split:
                _split_facing(normal, viewer, *ends, way, along, across)
                is_split = True
            aside, ahead = lobes[k, 3], lobes[k, 5]
            for i in range(len(base)):
                base[i] = aside * across[i] + ahead * along[i]
        elif lobes[k, 10] < 0:
            halfway_base(lobes[k], position, normal, viewer, *ends, way, base)
        else:
            brushed_base(lobes[k], normal, viewer, *ends, way, base)
        dark, num = lobes[k, 11], 0
        for i in range(len(base)):
            num += base[i] > dark
        if num == 0:
            continue
        if not begun:
            red[:], green[:], blue[:] = ZERO, ZERO, ZERO
            begun = True
        exponent, r, g, b = lobes[k, 6], lobes[k, 0], lobes[k, 1], lobes[k, 2]
        for i in range(len(base)):  # below `dark` the power is too small to be seen; a NaN is dark
            value = base[i]
            strength = power(min(max(value, dark), ONE), exponent)
            base[i] = strength if value > dark else ZERO
        for i in range(len(base)):
            red[i] += r * base[i]
            green[i] += g * base[i]
            blue[i] += b * base[i]
    if not begun:
        return
    form = work[FORM, first:last]
    for c in range(3):
        strength, gain = lights[light, COLOR + c], gloss[c, a + first : a + last]
        lobe, total = work[LOBES + c, first:last], work[TOTAL + c, first:last]
        for i in range(len(form)):
            total[i] += form[i] * strength * gain[i] * lobe[i]


@fused_inlined
def add_lobes(lights, light, lobes, lobe_start, surface, position, normal, viewer, gloss, a, b, work):
    """The highlights of the points a to b, run by run of one surface: mostly the whole block."""
    mine, num = surface[a:b], 0
    for i in range(len(mine)):
        num += mine[i] == mine[0]
    first = a
    while first < b:
        last = b if num == b - a else first + 1
        while last < b and surface[last] == surface[first]:
            last += 1
        rows = (lobe_start[surface[first]], lobe_start[surface[first] + 1])
        if rows[0] < rows[1]:
            ends = (first - a, last - a)
            _add_lobes_of_surface(lights, light, lobes, rows, position, normal, viewer, gloss, a, *ends, work)
        first = last
