"""The compiled shading pass: every term of sixteen pixels at a time, added up where it is made.

It computes what forward.py computes, in float32. The points of a block stand side by side in each plane of the
buffers, so that the loops below run in vector registers: no branch in them, and few arrays in each (a loop over many
arrays is not vectorised, since the compiler must rule out that they overlap).
"""

import math

import numpy as np

from relight3d.relight.kernels import (
    AT_INFINITY,
    AXIS,
    COLOR,
    CONE_COSINE,
    CONE_POWER,
    CONE_SCALE,
    FULL,
    KIND,
    ONE,
    PLACE,
    SMALL,
    TINY,
    ZERO,
    inlined,
)

LANES = 64  # pixels of a block
# Rows of a block's workspace: radiance; direction to the light; form; lobes' colour; powers.
TOTAL, WAY, FORM, LOBES, BASE, MANTISSA, POWER, NUM_ROWS = 0, 3, 6, 7, 10, 11, 12, 13
PER_FULL = np.float32(1 / FULL)
TWO, HALF, LN2, PER_LN2 = np.float32(2), np.float32(0.5), np.float32(math.log(2)), np.float32(1 / math.log(2))
LOG_3, LOG_5, LOG_7, LOG_9 = (np.float32(1 / k) for k in (3, 5, 7, 9))  # atanh's series, for the logarithm
EXP_3, EXP_4, EXP_5, EXP_6 = (np.float32(1 / math.factorial(k)) for k in (3, 4, 5, 6))
SQRT_HALF_BITS, MANTISSA_BITS, EXPONENT_OF_ONE = 0x3F3504F3, 23, 127


@inlined
def _aim(lights, light, position, a, b, work):
    """Direction to the light, and in FORM its falloff for power 1."""
    n = b - a
    wx, wy, wz, form = work[WAY, :n], work[WAY + 1, :n], work[WAY + 2, :n], work[FORM, :n]
    px, py, pz = lights[light, PLACE], lights[light, PLACE + 1], lights[light, PLACE + 2]
    if lights[light, KIND] == AT_INFINITY:
        wx[:], wy[:], wz[:], form[:] = px, py, pz, ONE
        return
    x, y, z = position[0, a:b], position[1, a:b], position[2, a:b]
    for i in range(n):
        wx[i], wy[i], wz[i] = px - x[i], py - y[i], pz - z[i]
    for i in range(n):
        squared = wx[i] * wx[i] + wy[i] * wy[i] + wz[i] * wz[i]
        inverse = ONE / max(np.float32(math.sqrt(squared)), SMALL)
        wx[i], wy[i], wz[i] = wx[i] * inverse, wy[i] * inverse, wz[i] * inverse
        form[i] = ONE / max(squared, TINY) if squared > TINY else ZERO
    if lights[light, CONE_POWER] > 0:
        ax, ay, az = lights[light, AXIS], lights[light, AXIS + 1], lights[light, AXIS + 2]
        for i in range(n):
            cosine = -(wx[i] * ax + wy[i] * ay + wz[i] * az)
            ramp = min(max((cosine - lights[light, CONE_COSINE]) * lights[light, CONE_SCALE], ZERO), ONE)
            form[i] *= ramp * ramp if lights[light, CONE_POWER] > 1 else ramp


@inlined
def _is_seen(seen, light, a, b):
    """Whether any of the points a to b sees a light: most see nothing of one behind a mirror."""
    part, most = seen[light, a:b], np.uint8(0)
    for i in range(len(part)):
        most = max(most, part[i])
    return most > 0


@inlined
def _light_up(seen, light, normal, a, b, work):
    """FORM becomes falloff * cosine where the light is seen. Returns at how many points it is."""
    n = b - a
    nx, ny, nz, part, form = normal[0, a:b], normal[1, a:b], normal[2, a:b], seen[light, a:b], work[FORM, :n]
    wx, wy, wz = work[WAY, :n], work[WAY + 1, :n], work[WAY + 2, :n]
    count = 0
    for i in range(n):
        value = form[i] * (nx[i] * wx[i] + ny[i] * wy[i] + nz[i] * wz[i]) * (np.float32(part[i]) * PER_FULL)
        form[i] = value if value > 0 else ZERO
        count += value > 0
    return count


@inlined
def _add_diffuse(lights, light, diffuse, a, b, work):
    n = b - a
    form = work[FORM, :n]
    for c in range(3):
        color, albedo, total = lights[light, COLOR + c], diffuse[c, a:b], work[TOTAL + c, :n]
        for i in range(n):
            total[i] += form[i] * color * albedo[i]


@inlined
def _raise(base, exponent, dark, mantissa, power):
    """power = base ** exponent for bases in (dark, 1], as exact as float32 lets the exponent's product be; else 0."""
    bits, whole = base.view(np.int32), mantissa.view(np.int32)
    for i in range(len(base)):
        # base = 2^e * m with m in [sqrt(1/2), sqrt(2)): near 1, where lobes peak, e = 0 and nothing cancels.
        whole[i] = bits[i] - ((bits[i] - SQRT_HALF_BITS) >> MANTISSA_BITS << MANTISSA_BITS)
    for i in range(len(base)):
        e = np.float32((bits[i] - SQRT_HALF_BITS) >> MANTISSA_BITS)
        s = (mantissa[i] - ONE) / (mantissa[i] + ONE)
        q = s * s
        tail = LOG_3 + q * (LOG_5 + q * (LOG_7 + q * LOG_9))
        power[i] = exponent * (e * LN2 + TWO * (s + s * q * tail))
    for i in range(len(base)):
        k = np.floor(power[i] * PER_LN2 + HALF)
        f = power[i] - k * LN2
        tail = EXP_4 + f * (EXP_5 + f * EXP_6)
        power[i] = ONE + f * (ONE + f * (HALF + f * (EXP_3 + f * tail)))
        whole[i] = (np.int32(k) + EXPONENT_OF_ONE) << MANTISSA_BITS
    for i in range(len(base)):
        power[i] = power[i] * mantissa[i] if base[i] > dark else ZERO


@inlined
def _mirror_like_base(lobe, normal, viewer, a, b, way, base):
    """The base of an isotropic lobe, eq. (4), for unit vectors."""
    nx, ny, nz = normal[0, a:b], normal[1, a:b], normal[2, a:b]
    vx, vy, vz = viewer[0, a:b], viewer[1, a:b], viewer[2, a:b]
    wx, wy, wz = way
    across, along = lobe[3], lobe[5]
    for i in range(len(base)):
        base[i] = nx[i] * wx[i] + ny[i] * wy[i] + nz[i] * wz[i]
    for i in range(len(base)):
        base[i] *= nx[i] * vx[i] + ny[i] * vy[i] + nz[i] * vz[i]
    for i in range(len(base)):
        facing = wx[i] * vx[i] + wy[i] * vy[i] + wz[i] * vz[i]
        base[i] = across * (facing - base[i]) + along * base[i]


@inlined
def _brushed_base(lobe, normal, viewer, a, b, way, base):
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


@inlined
def _add_lobes(lights, light, lobes, rows, normal, viewer, gloss, a, first, last, work):
    """The highlights of the points a + first to a + last, of one surface, whose lobes are `rows`."""
    way = (work[WAY, first:last], work[WAY + 1, first:last], work[WAY + 2, first:last])
    base, mantissa, power = work[BASE, first:last], work[MANTISSA, first:last], work[POWER, first:last]
    ends = (a + first, a + last)
    begun = False
    for k in range(rows[0], rows[1]):
        if lobes[k, 10] > 0:
            _mirror_like_base(lobes[k], normal, viewer, *ends, way, base)
        else:
            _brushed_base(lobes[k], normal, viewer, *ends, way, base)
        dark, num = lobes[k, 11], 0
        for i in range(len(base)):
            num += base[i] > dark
        if num == 0:
            continue
        if not begun:
            for c in range(3):
                work[LOBES + c, first:last] = ZERO
            begun = True
        for i in range(len(base)):  # below `dark` the power is too small to be seen; a NaN is dark
            base[i] = min(base[i], ONE) if base[i] > dark else dark
        _raise(base, lobes[k, 6], dark, mantissa, power)
        for c in range(3):
            tint, out = lobes[k, c], work[LOBES + c, first:last]
            for i in range(len(base)):
                out[i] += tint * power[i]
    if not begun:
        return
    form = work[FORM, first:last]
    for c in range(3):
        strength, gain = lights[light, COLOR + c], gloss[c, a + first : a + last]
        lobe, total = work[LOBES + c, first:last], work[TOTAL + c, first:last]
        for i in range(len(form)):
            total[i] += form[i] * strength * gain[i] * lobe[i]


@inlined
def _add_indirect(source, share, irradiance, diffuse, a, b, work):
    """Irradiance blended from the sites, times the albedo."""
    for i in range(b - a):
        red, green, blue = ZERO, ZERO, ZERO
        for k in range(source.shape[1]):
            weight, row = share[a + i, k], source[a + i, k]
            red += weight * irradiance[row, 0]
            green += weight * irradiance[row, 1]
            blue += weight * irradiance[row, 2]
        work[TOTAL, i] += diffuse[0, a + i] * red
        work[TOTAL + 1, i] += diffuse[1, a + i] * green
        work[TOTAL + 2, i] += diffuse[2, a + i] * blue


@inlined
def _add_read_residual(lights, seen, source, share, images, a, b, work):
    """The residual of points of another view, read from the captured pixels' (`images`: lit rgb, dark rgb)."""
    for light in range(len(images)):
        for p in range(a, b):
            part = np.float32(seen[light, p]) * PER_FULL
            for k in range(4):
                if share[p, k] > 0:
                    for c in range(3):
                        value = part * images[light, source[p, k], c]
                        value += (ONE - part) * images[light, source[p, k], 3 + c]
                        work[TOTAL + c, p - a] += share[p, k] * lights[light, COLOR + c] * value


@inlined
def shade_points(
    a, b, lights, seen, position, normal, viewer, diffuse, gloss, surface, lobe_start, lobes, site_source, site_share,
    irradiance, source, share, images, work,
):  # fmt: skip
    """Leaves in `work` the radiance of the points a to b. Arrays of an absent effect have length 0."""
    for c in range(3):
        work[TOTAL + c, : b - a] = ZERO
    for light in range(len(lights)):
        if not _is_seen(seen, light, a, b):
            continue
        _aim(lights, light, position, a, b, work)
        if _light_up(seen, light, normal, a, b, work) == 0:
            continue
        _add_diffuse(lights, light, diffuse, a, b, work)
        first = a
        while first < b and len(lobes):  # runs of one surface: mostly the whole block
            last = first + 1
            while last < b and surface[last] == surface[first]:
                last += 1
            rows = (lobe_start[surface[first]], lobe_start[surface[first] + 1])
            if rows[0] < rows[1]:
                _add_lobes(lights, light, lobes, rows, normal, viewer, gloss, a, first - a, last - a, work)
            first = last
    if len(irradiance):
        _add_indirect(site_source, site_share, irradiance, diffuse, a, b, work)
    if len(images):
        _add_read_residual(lights, seen, source, share, images, a, b, work)
