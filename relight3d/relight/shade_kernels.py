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
    KIND,
    ONE,
    PLACE,
    SMALL,
    TINY,
    ZERO,
    fused_inlined,
)
from relight3d.relight.lanes import blend_colors
from relight3d.relight.lobe_kernels import FORM, LOBES, TOTAL, WAY, add_lobes
from relight3d.relight.residual_kernels import PER_FULL, add_read_residual


@fused_inlined
def aim(lights, light, position, a, b, work):
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


@fused_inlined
def is_seen(seen, light, a, b):
    """Whether any of the points a to b sees a light: most see nothing of one behind a mirror."""
    part, most = seen[light, a:b], np.uint8(0)
    for i in range(len(part)):
        most = max(most, part[i])
    return most > 0


@fused_inlined
def light_up(seen, light, normal, a, b, work):
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


@fused_inlined
def _add_diffuse(lights, light, diffuse, a, b, work):
    n = b - a
    form = work[FORM, :n]
    for c in range(3):
        color, albedo, total = lights[light, COLOR + c], diffuse[c, a:b], work[TOTAL + c, :n]
        for i in range(n):
            total[i] += form[i] * color * albedo[i]


@fused_inlined
def _add_indirect(source, share, irradiance, diffuse, a, b, work):
    """Irradiance blended from the sites, times the albedo."""
    n = b - a
    for i in range(n):
        blend_colors(source, share, a + i, irradiance, 0, work, LOBES, i)  # pyright: ignore[reportCallIssue]
    for c in range(3):
        albedo, arriving, total = diffuse[c, a:b], work[LOBES + c, :n], work[TOTAL + c, :n]
        for i in range(n):
            total[i] += albedo[i] * arriving[i]


@fused_inlined
def shade_points(
    a, b, lights, seen, position, normal, viewer, tangent, diffuse, gloss, surface, lobe_start, lobes, site_source,
    site_share, irradiance, source, share, images, made, lit, dark, pixels, work,
):  # fmt: skip
    """Leaves in `work` the radiance of the points a to b. Arrays of an absent effect have length 0."""
    for c in range(3):
        work[TOTAL + c, : b - a] = ZERO
    for light in range(len(lights)):
        if not is_seen(seen, light, a, b):
            continue
        aim(lights, light, position, a, b, work)
        if light_up(seen, light, normal, a, b, work) == 0:
            continue
        _add_diffuse(lights, light, diffuse, a, b, work)
        if len(lobes):
            add_lobes(lights, light, lobes, lobe_start, surface, normal, viewer, tangent, gloss, a, b, work)
    if len(irradiance):
        _add_indirect(site_source, site_share, irradiance, diffuse, a, b, work)
    if len(images):
        add_read_residual(lights, seen, source, share, images, made, lit, dark, a, b, pixels, work)
