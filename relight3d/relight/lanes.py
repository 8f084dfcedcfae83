"""Vector registers by hand, for loops that the compiler leaves to single steps.

It must take arrays for overlapping, and asks about that before a loop: dearer than the loop itself where that is sixteen
steps long. And it does not see that the colours of a table's row can be read and weighted at once.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from relight3d.packets import ORIGIN, WIDTH

WORD, INDEX, FLOAT, BYTE = ir.IntType(64), ir.IntType(32), ir.FloatType(), ir.IntType(8)
PACKET, MARKS, COLORS = ir.VectorType(FLOAT, WIDTH), ir.VectorType(BYTE, WIDTH), ir.VectorType(FLOAT, 4)
FUSED = ("contract",)  # one rounding, as in kernels.fused


def _place(context, builder, kind, array, *index):
    """The address of an array's element."""
    held = make_array(kind)(context, builder, array)
    place = builder.bitcast(held.data, BYTE.as_pointer())
    for axis, at in enumerate(index):
        place = builder.gep(place, [builder.mul(at, builder.extract_value(held.strides, axis))])
    return place


def _load(builder, place, kind):
    vector = builder.load(builder.bitcast(place, kind.as_pointer()))
    vector.align = 1
    return vector


def _store(builder, vector, place):
    builder.store(vector, builder.bitcast(place, vector.type.as_pointer())).align = 1


def _all(builder, value, kind):
    """A vector of one value."""
    nothing = ir.Constant(kind, ir.Undefined)
    same = ir.Constant(ir.VectorType(INDEX, kind.count), [0] * kind.count)
    return builder.shuffle_vector(builder.insert_element(nothing, value, INDEX(0)), nothing, same)


@intrinsic
def leave_surface(_typing, rays, position, geometric, first, offset):
    """Origins of a packet: the sixteen points from `first` on, moved along their normals by `offset`. All planes."""

    def generate(context, builder, signature, given):
        arrays, (first, offset) = list(zip(signature.args, given))[:3], given[3:]
        step = _all(builder, offset, PACKET)
        for axis in range(3):
            out = _place(context, builder, *arrays[0], WORD(ORIGIN + axis))
            place, normal = (
                _load(builder, _place(context, builder, *a, WORD(axis), first), PACKET) for a in arrays[1:]
            )
            _store(builder, builder.fadd(place, builder.fmul(normal, step)), out)
        return context.get_dummy_value()

    return types.void(rays, position, geometric, types.intp, types.float32), generate


@intrinsic
def mark_blocked(_typing, far, out, first, blocked, free):
    """out[first..first + 16] is `blocked` where `far` is below 0, as Embree leaves it, and else `free`."""

    def generate(context, builder, signature, given):
        values = _load(builder, _place(context, builder, signature.args[0], given[0]), PACKET)
        is_blocked = builder.fcmp_ordered("<", values, ir.Constant(PACKET, [0.0] * WIDTH))
        marks = builder.select(is_blocked, _all(builder, given[3], MARKS), _all(builder, given[4], MARKS))
        _store(builder, marks, _place(context, builder, signature.args[1], given[1], given[2]))
        return context.get_dummy_value()

    return types.void(far, out, types.intp, types.uint8, types.uint8), generate


@intrinsic
def blend_colors(_typing, source, share, point, table, column, out, row, lane):
    """The sum over k of share[point, k] * table[source[point, k]], in three columns from `column` on (a fourth is read).

    Written to out[row], out[row + 1] and out[row + 2] at `lane`.
    """

    def generate(context, builder, signature, given):
        kinds, (point, column, row, lane) = signature.args, (given[2], given[4], given[6], given[7])
        total = cgutils.alloca_once_value(builder, ir.Constant(COLORS, [0.0] * 4))
        num = builder.extract_value(make_array(kinds[0])(context, builder, given[0]).shape, 1)
        with cgutils.for_range(builder, num) as loop:
            index = _place(context, builder, kinds[0], given[0], point, loop.index)
            index = builder.sext(builder.load(builder.bitcast(index, INDEX.as_pointer())), WORD)
            weight = _place(context, builder, kinds[1], given[1], point, loop.index)
            weight = _all(builder, builder.load(builder.bitcast(weight, FLOAT.as_pointer())), COLORS)
            colors = _load(builder, _place(context, builder, kinds[3], given[3], index, column), COLORS)
            more = builder.fmul(colors, weight, flags=FUSED)
            builder.store(builder.fadd(builder.load(total), more, flags=FUSED), total)
        blended = builder.load(total)
        for c in range(3):
            place = _place(context, builder, kinds[5], given[5], builder.add(row, WORD(c)), lane)
            builder.store(builder.extract_element(blended, INDEX(c)), builder.bitcast(place, FLOAT.as_pointer()))
        return context.get_dummy_value()

    index = types.intp
    return types.void(source, share, index, table, index, out, index, index), generate
