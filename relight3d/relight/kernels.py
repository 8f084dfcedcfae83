"""What the compiled loops of a frame share: how they are compiled, and how a light reaches a point.

Each loop walks a slice of the points and holds no lock, so that tiles run on any thread. They compute what forward.py
computes, in float32 and in its order where a comparison hangs on it; no fast maths, so that a NaN stays one. A light
is one row of numbers (`light_row`), for power 1 but for its colour; vectors of points are planes (3 x point).

Trap: what numba keeps on disk goes by the file of the function that is called, not of those that it calls. Who changes a
helper that another file uses removes `__pycache__/*.nb?` there, or goes on running the old one.
"""

import math

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from relight3d.maths.pixel_parts import FULL as FULL  # `seen` of a lit point

# Helpers are inlined whatever their size and nothing is reference-counted (kernels own no array): handing a dozen
# arrays to a function at every point took ten times as long as shading it.
# A division by zero is not asked about either, which would keep loops out of vector registers.
SETTINGS = {"nogil": True, "cache": True, "_nrt": False, "error_model": "numpy"}
compiled = numba.njit(**SETTINGS)  # pyright: ignore[reportCallIssue]
inlined = numba.njit(**SETTINGS, forceinline=True)  # pyright: ignore[reportCallIssue]
# Shading may multiply and add in one step, which rounds once instead of twice; what compares keeps the reference's steps.
fused = numba.njit(**SETTINGS, fastmath={"contract"})  # pyright: ignore[reportCallIssue]
fused_inlined = numba.njit(**SETTINGS, fastmath={"contract"}, forceinline=True)  # pyright: ignore[reportCallIssue]
# Columns of a light's row: place or direction, colour, the cone's axis, cosine, scale and power.
KIND, PLACE, COLOR, AXIS, CONE_COSINE, CONE_SCALE, CONE_POWER, HAS_RESIDUAL = 0, 1, 4, 7, 10, 11, 12, 13
ROW = 14
AT_INFINITY = 0.0
ONE_ON = np.uintp(1)  # unsigned: an index that could be negative is asked about at every access
ONE, ZERO, TINY, SMALL = np.float32(1), np.float32(0), np.float32(1.1754944e-38), np.float32(1.0842022e-19)


@inlined
def dot(a, i, x, y, z):
    return a[0, i] * x + a[1, i] * y + a[2, i] * z


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


@fused_inlined
def add_arriving(lights, light, form, arriving):
    """Adds a light's colours to three rows of irradiance, by its form at each point."""
    for c in range(3):
        color, row = lights[light, COLOR + c], arriving[c]
        for i in range(len(form)):
            row[i] += form[i] * color


@intrinsic
def bits_of(_typing, value):
    """The bits of a float32, within a loop that stays in vector registers (a view of an array does not)."""

    def generate(_context, builder, _signature, given):
        return builder.bitcast(given[0], ir.IntType(32))

    return types.int32(types.float32), generate


@intrinsic
def float_of(_typing, bits):
    """The float32 of some bits."""

    def generate(_context, builder, _signature, given):
        return builder.bitcast(given[0], ir.FloatType())

    return types.float32(types.int32), generate


@intrinsic
def take(_typing, counter):
    """The next number of a counter (an array of one int64) that several threads count on: each gets its own."""

    def generate(context, builder, signature, given):
        place = make_array(signature.args[0])(context, builder, given[0]).data
        return builder.atomic_rmw("add", place, ir.IntType(64)(1), "monotonic")

    return types.int64(counter), generate
