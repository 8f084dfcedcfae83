"""The compiled loops of highlights: Lafortune lobes of a run of points of one surface, and their powers."""

import math

import numpy as np

from relight3d.relight.kernels import COLOR, ONE, ZERO, bits_of, float_of, fused, fused_inlined

# Rows of a block's workspace: radiance; direction to the light; form; lobes' colour; bases, and what they are made of, of
# lobes that are not round too.
TOTAL, WAY, FORM, LOBES, BASE, ALONG, ACROSS = 0, 3, 6, 7, 10, 11, 12
REST, LEVEL, FORWARD, SPARE, NUM_ROWS = 13, 16, 17, 18, 20
# Forms of a lobe, column 10 of its row: Lafortune's, round or long, and those about the half-way direction. Tangents go with
# the two in the middle.
ROUND, LONG, BRUSHED, ROUND_HALFWAY = 1.0, 0.0, -1.0, -2.0
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
def _split_facing(normal, viewer, way, along, across):
    """What an isotropic lobe is made of, eq. (4): along = (n.l)(n.v), across = l.v less that, for unit vectors."""
    (nx, ny, nz), (vx, vy, vz), (wx, wy, wz) = normal, viewer, way
    for i in range(len(along)):
        along[i] = nx[i] * wx[i] + ny[i] * wy[i] + nz[i] * wz[i]
    for i in range(len(along)):
        along[i] *= nx[i] * vx[i] + ny[i] * vy[i] + nz[i] * vz[i]
    for i in range(len(along)):
        across[i] = wx[i] * vx[i] + wy[i] * vy[i] + wz[i] * vz[i] - along[i]


@fused_inlined
def _planes(values, plane, a, b):
    return values[plane, a:b], values[plane + 1, a:b], values[plane + 2, a:b]


@fused_inlined
def _tangents(lobe, normal, position, tangent):
    """maths.lafortune.tangent_frame for a run of points: where the lobe's own direction stands on the normal, a frame of
    the normal alone.
    """
    (nx, ny, nz), (qx, qy, qz), (tx, ty, tz) = normal, position, tangent
    for i in range(len(tx)):
        sign = ONE if nz[i] >= 0 else -ONE
        t = -sign * nx[i] / (sign + nz[i])
        ux = lobe[7] + lobe[13] * qz[i] - lobe[14] * qy[i]
        uy = lobe[8] + lobe[14] * qx[i] - lobe[12] * qz[i]
        uz = lobe[9] + lobe[12] * qy[i] - lobe[13] * qx[i]
        along = nx[i] * ux + ny[i] * uy + nz[i] * uz
        px, py, pz = ux - nx[i] * along, uy - ny[i] * along, uz - nz[i] * along
        squared, whole = px * px + py * py + pz * pz, ux * ux + uy * uy + uz * uz
        inverse = ONE / np.float32(math.sqrt(max(squared, TINY)))
        turns = squared > TURNS_AT * TURNS_AT * whole
        tx[i] = px * inverse if turns else ONE + t * nx[i]
        ty[i] = py * inverse if turns else t * ny[i]
        tz[i] = pz * inverse if turns else -sign * nx[i]


@fused
def write_tangents(first, last, surface, lobe_start, lobes, position, normal, out):
    """The tangents of points first..last for the lobes of their surface that are not round: three planes for each such
    lobe. They do not depend on the light.
    """
    a = first
    while a < last:
        b, of, plane = a + 1, surface[a], 0
        while b < last and surface[b] == of:
            b += 1
        for k in range(lobe_start[of], lobe_start[of + 1]):
            if lobes[k, 10] == LONG or lobes[k, 10] == BRUSHED:
                _tangents(lobes[k], _planes(normal, 0, a, b), _planes(position, 0, a, b), _planes(out, plane, a, b))
                plane += 3
        a = b


@fused_inlined
def _add_dot(a_planes, b_planes, out):
    """out += a . b: of a loop over more arrays the compiler would make single steps."""
    ax, ay, az = a_planes
    bx, by, bz = b_planes
    for i in range(len(out)):
        out[i] += ax[i] * bx[i] + ay[i] * by[i] + az[i] * bz[i]


@fused_inlined
def long_base(lobe, along, across, of_light, of_viewer, base):
    """The base of an anisotropic Lafortune lobe, from what an isotropic one is made of and what lies along the tangent."""
    for i in range(len(base)):
        both = of_light[i] * of_viewer[i]
        base[i] = lobe[3] * both + lobe[4] * (across[i] - both) + lobe[5] * along[i]


@fused_inlined
def _split_halfway(normal, viewer, way, work, level, forward):
    """What lobes about the half-way vector are made of: its part in the surface, in `work`, and both parts' squares."""
    n = len(level)
    mx, my, mz = work[0, :n], work[1, :n], work[2, :n]
    forward[:] = ZERO
    _add_dot(normal, way, forward)
    _add_dot(normal, viewer, forward)
    for axis in range(3):  # nothing cancels in it, as it would in the whole's square less the other part's
        flat, of_way, of_viewer, of_normal = work[axis, :n], way[axis], viewer[axis], normal[axis]
        for i in range(n):
            flat[i] = of_way[i] + of_viewer[i] - forward[i] * of_normal[i]
    for i in range(n):
        level[i] = mx[i] * mx[i] + my[i] * my[i] + mz[i] * mz[i]
        forward[i] *= forward[i]


@fused_inlined
def _brushed_base(lobe, tangent, work, level, forward, base):
    """The base of a brushed highlight, maths.halfway."""
    n = len(base)
    base[:] = ZERO
    _add_dot(tangent, (work[0, :n], work[1, :n], work[2, :n]), base)
    for i in range(n):
        along = min(base[i] * base[i], level[i])
        spread = lobe[3] * along + lobe[4] * (level[i] - along) + lobe[5] * forward[i]
        base[i] = (level[i] + forward[i] + TINY) / (spread + TINY)


@fused_inlined
def _round_halfway_base(lobe, level, forward, base):
    """The base of a round one, maths.halfway."""
    for i in range(len(base)):
        base[i] = (level[i] + forward[i] + TINY) / (lobe[3] * level[i] + lobe[5] * forward[i] + TINY)


@fused_inlined
def _add_lobes_of_surface(lights, light, lobes, rows, normal, viewer, tangent, gloss, a, first, last, work):
    """The highlights of the points a + first to a + last, of one surface, whose lobes are `rows`."""
    way = (work[WAY, first:last], work[WAY + 1, first:last], work[WAY + 2, first:last])
    base, along, across = work[BASE, first:last], work[ALONG, first:last], work[ACROSS, first:last]
    red, green, blue = work[LOBES, first:last], work[LOBES + 1, first:last], work[LOBES + 2, first:last]
    ends, rest = (a + first, a + last), work[REST:]
    level, forward = work[LEVEL, first:last], work[FORWARD, first:last]
    normals, facing = _planes(normal, 0, *ends), _planes(viewer, 0, *ends)
    begun, is_split, is_halved, plane = False, False, False, 0
    for k in range(rows[0], rows[1]):
        form = lobes[k, 10]
        is_lafortune = form in (ROUND, LONG)
        if is_lafortune and not is_split:
            _split_facing(normals, facing, way, along, across)
            is_split = True
        if not is_lafortune and not is_halved:
            _split_halfway(normals, facing, way, rest, level, forward)
            is_halved = True
        if form == ROUND:
            aside, ahead = lobes[k, 3], lobes[k, 5]
            for i in range(len(base)):
                base[i] = aside * across[i] + ahead * along[i]
        elif form == ROUND_HALFWAY:
            _round_halfway_base(lobes[k], level, forward, base)
        else:
            turned = _planes(tangent, plane, *ends)
            plane += 3
            if form == BRUSHED:
                _brushed_base(lobes[k], turned, rest, level, forward, base)
            else:
                of_light, of_viewer = work[SPARE, first:last], work[SPARE + 1, first:last]
                of_light[:], of_viewer[:] = ZERO, ZERO
                _add_dot(turned, way, of_light)
                _add_dot(turned, facing, of_viewer)
                long_base(lobes[k], along, across, of_light, of_viewer, base)
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
def add_lobes(lights, light, lobes, lobe_start, surface, normal, viewer, tangent, gloss, a, b, work):
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
            _add_lobes_of_surface(lights, light, lobes, rows, normal, viewer, tangent, gloss, a, *ends, work)
        first = last
