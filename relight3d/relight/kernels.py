"""The compiled loops of a frame. Each walks a slice of the points and holds no lock, so that tiles run on any thread.

They compute what forward.py computes, in float32 and in its order where a comparison hangs on it; no fast maths, so
that a NaN stays one. A light is one row of numbers (`light_row`), for power 1 but for its colour.
"""

import math

import numba
import numpy as np

FULL = 252  # `seen` of a lit point: divisible by 4, so that a border's quarters are exact
# Helpers are inlined whatever their size and nothing is reference-counted (kernels own no array): handing a dozen
# arrays to a function at every point took ten times as long as shading it.
compiled = numba.njit(nogil=True, cache=True, _nrt=False)  # pyright: ignore[reportCallIssue]
inlined = numba.njit(nogil=True, cache=True, _nrt=False, forceinline=True)  # pyright: ignore[reportCallIssue]
# Columns of a light's row: place or direction, colour, the cone's axis, cosine, scale and power.
KIND, PLACE, COLOR, AXIS, CONE_COSINE, CONE_SCALE, CONE_POWER, HAS_RESIDUAL = 0, 1, 4, 7, 10, 11, 12, 13
ROW = 14
AT_INFINITY = 0.0
ONE, ZERO, TINY, SMALL = np.float32(1), np.float32(0), np.float32(1.1754944e-38), np.float32(1.0842022e-19)


@inlined
def dot(a, i, x, y, z):
    return a[i, 0] * x + a[i, 1] * y + a[i, 2] * z


@inlined
def incident(lights, light, x, y, z):
    """Unit direction to the light, falloff for power 1, distance, at a point."""
    if lights[light, KIND] == AT_INFINITY:
        return lights[light, PLACE], lights[light, PLACE + 1], lights[light, PLACE + 2], ONE, np.float32(1e30)
    dx, dy, dz = lights[light, PLACE] - x, lights[light, PLACE + 1] - y, lights[light, PLACE + 2] - z
    squared = dx * dx + dy * dy + dz * dz
    distance = np.float32(math.sqrt(squared))
    inverse = ONE / max(distance, SMALL)
    dx, dy, dz = dx * inverse, dy * inverse, dz * inverse
    falloff = ONE / max(squared, TINY) if squared > TINY else ZERO
    if lights[light, CONE_POWER] > 0:
        cosine = -(dx * lights[light, AXIS] + dy * lights[light, AXIS + 1] + dz * lights[light, AXIS + 2])
        ramp = min(max((cosine - lights[light, CONE_COSINE]) * lights[light, CONE_SCALE], ZERO), ONE)
        falloff *= ramp * ramp if lights[light, CONE_POWER] > 1 else ramp
    return dx, dy, dz, falloff, distance


@inlined
def _lobe(lobes, k, normal, p, lx, ly, lz, vx, vy, vz):
    """The value of a lobe of colour 1, eq. (4)."""
    nx, ny, nz = normal[p, 0], normal[p, 1], normal[p, 2]
    u_n, v_n = nx * lx + ny * ly + nz * lz, nx * vx + ny * vy + nz * vz
    if lobes[k, 10] > 0:
        base = lobes[k, 3] * (lx * vx + ly * vy + lz * vz - u_n * v_n) + lobes[k, 5] * u_n * v_n
    else:
        sign = ONE if nz >= 0 else -ONE  # the frame of Duff et al. (2017), as maths.lafortune.tangent_frame
        a = -ONE / (sign + nz)
        tx, ty, tz = ONE + sign * nx * nx * a, sign * nx * ny * a, -sign * nx
        ax, ay, az = lobes[k, 7], lobes[k, 8], lobes[k, 9]
        along = nx * ax + ny * ay + nz * az
        px, py, pz = ax - nx * along, ay - ny * along, az - nz * along
        length = math.sqrt(px * px + py * py + pz * pz)
        if length > 1e-4:
            tx, ty, tz = np.float32(px / length), np.float32(py / length), np.float32(pz / length)
        bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        base = lobes[k, 3] * (tx * lx + ty * ly + tz * lz) * (tx * vx + ty * vy + tz * vz)
        base += lobes[k, 4] * (bx * lx + by * ly + bz * lz) * (bx * vx + by * vy + bz * vz)
        base += lobes[k, 5] * u_n * v_n
    if not base > lobes[k, 11]:
        return ZERO
    return np.float32(math.exp(lobes[k, 6] * math.log(min(base, ONE))))


@inlined
def _shade_point(p, lights, seen, position, normal, to_viewer, diffuse, gloss, lobe_range, lobes, lane, out):
    """Adds the direct light and the lobes of one point to out[:, lane]."""
    x, y, z = position[p, 0], position[p, 1], position[p, 2]
    for light in range(len(lights)):
        if seen[light, p] == 0:
            continue
        lx, ly, lz, falloff, _ = incident(lights, light, x, y, z)
        form = falloff * max(dot(normal, p, lx, ly, lz), ZERO) * (np.float32(seen[light, p]) / np.float32(FULL))
        if not form > 0:
            continue
        for c in range(3):
            out[c, lane] += form * lights[light, COLOR + c] * diffuse[p, c]
        if lobe_range[p, 0] == lobe_range[p, 1]:
            continue
        red, green, blue = ZERO, ZERO, ZERO
        for k in range(lobe_range[p, 0], lobe_range[p, 1]):
            value = _lobe(lobes, k, normal, p, lx, ly, lz, to_viewer[p, 0], to_viewer[p, 1], to_viewer[p, 2])
            red += value * lobes[k, 0]
            green += value * lobes[k, 1]
            blue += value * lobes[k, 2]
        out[0, lane] += form * lights[light, COLOR] * gloss[p, 0] * red
        out[1, lane] += form * lights[light, COLOR + 1] * gloss[p, 1] * green
        out[2, lane] += form * lights[light, COLOR + 2] * gloss[p, 2] * blue


@inlined
def _add_modes(modes, block, weights, light, share, colors, scratch, out):
    """Adds a block's modes, weighted for one light, to out, each lane by its share."""
    for i in range(48):
        scratch[i] = 0
    for k in range(weights.shape[1]):
        weight = weights[light, k]
        for i in range(48):
            scratch[i] += weight * np.float32(modes[block, k, i])
    for c in range(3):
        for lane in range(16):
            out[c, lane] += colors[light, COLOR + c] * share[lane] * scratch[16 * c + lane]


@compiled
def _add_block_residual(
    first, last, start, lights, seen, lit, dark, lit_weights, dark_weights, part, rest, scratch, out
):
    """The residual of sixteen pixels of the captured view: lit and dark modes by how far each pixel sees the light."""
    block = first // 16
    for light in range(len(lit_weights)):
        any_lit, any_dark = False, False
        for r in range(first, last):
            total = 0
            for p in range(start[r], start[r + 1]):
                total += seen[light, p]
            part[r - first] = np.float32(total) / np.float32(FULL * (start[r + 1] - start[r]))
            rest[r - first] = ONE - part[r - first]
            any_lit |= part[r - first] > 0
            any_dark |= rest[r - first] > 0
        if any_lit:
            _add_modes(lit, block, lit_weights, light, part, lights, scratch, out)
        if any_dark:
            _add_modes(dark, block, dark_weights, light, rest, lights, scratch, out)


@inlined
def _add_read_residual(p, lights, seen, source, share, images, lane, out):
    """The residual of a point of another view, read from the captured pixels' (`images`: lit rgb, dark rgb)."""
    for light in range(len(images)):
        part = np.float32(seen[light, p]) / np.float32(FULL)
        for k in range(4):
            if share[p, k] > 0:
                for c in range(3):
                    value = part * images[light, source[p, k], c] + (ONE - part) * images[light, source[p, k], 3 + c]
                    out[c, lane] += share[p, k] * lights[light, COLOR + c] * value


@compiled
def shade(
    first, last, lights, seen, position, normal, to_viewer, diffuse, gloss, lobe_range, lobes, start, pixel,
    site_source, site_share, irradiance, lit, dark, lit_weights, dark_weights, source, share, images, scratch, out,
):  # fmt: skip
    """Radiance of the pixels of rank first..last (first a multiple of 16): every term, added up, clamped at 0.

    `out` (pixel x 3) holds what else each pixel shows. Arrays of an absent effect have length 0. `scratch`: 8 x 16.
    """
    total, work, part, rest = scratch[:3], scratch[3:6].reshape(48), scratch[6], scratch[7]
    for begin in range(first, last, 16):
        end = min(begin + 16, last)
        total[:] = 0
        for r in range(begin, end):
            lane = r - begin
            for p in range(start[r], start[r + 1]):
                _shade_point(
                    p, lights, seen, position, normal, to_viewer, diffuse, gloss, lobe_range, lobes, lane, total
                )
                if len(irradiance):
                    for k in range(site_source.shape[1]):
                        weight, row = site_share[p, k], site_source[p, k]
                        for c in range(3):
                            total[c, lane] += weight * diffuse[p, c] * irradiance[row, c]
                if len(images):
                    _add_read_residual(p, lights, seen, source, share, images, lane, total)
        if len(lit_weights):
            _add_block_residual(
                begin,
                end,
                start,
                lights,
                seen,
                lit,
                dark,
                lit_weights,
                dark_weights,
                part,
                rest,
                work,
                total,
            )
        for r in range(begin, end):
            for c in range(3):
                value = total[c, r - begin] + out[pixel[r], c]
                out[pixel[r], c] = ZERO if value < 0 else value  # a NaN passes, to be seen


@compiled
def residual_images(first, last, lit, dark, lit_weights, dark_weights, light, ones, scratch, images):
    """The residual of captured points in blocks first..last, lit and dark, for one light of power 1.

    `ones` stands in for the lights' colours; `scratch`: 8 x 16.
    """
    scratch[7] = 1
    for block in range(first, last):
        for state in range(2):
            total = scratch[:3]
            total[:] = 0
            if state == 0:
                _add_modes(lit, block, lit_weights, light, scratch[7], ones, scratch[3:6].reshape(48), total)
            else:
                _add_modes(dark, block, dark_weights, light, scratch[7], ones, scratch[3:6].reshape(48), total)
            for lane in range(min(16, len(images) - 16 * block)):
                for c in range(3):
                    images[16 * block + lane, 3 * state + c] = total[c, lane]
