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

WORD, INDEX, FLOAT, BYTE, SHORT = ir.IntType(64), ir.IntType(32), ir.FloatType(), ir.IntType(8), ir.IntType(16)
PACKET, MARKS, COLORS = ir.VectorType(FLOAT, WIDTH), ir.VectorType(BYTE, WIDTH), ir.VectorType(FLOAT, 4)
FUSED = ("contract",)  # one rounding, as in kernels.fused


def address_of(context, builder, kind, array, *index):
    """The address of an array's element."""
    held = make_array(kind)(context, builder, array)
    place = builder.bitcast(held.data, BYTE.as_pointer())
    for axis, at in enumerate(index):
        place = builder.gep(place, [builder.mul(at, builder.extract_value(held.strides, axis))])
    return place


def load_vector(builder, place, kind):
    vector = builder.load(builder.bitcast(place, kind.as_pointer()))
    vector.align = 1
    return vector


def store_vector(builder, vector, place):
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
            out = address_of(context, builder, *arrays[0], WORD(ORIGIN + axis))
            place, normal = (
                load_vector(builder, address_of(context, builder, *a, WORD(axis), first), PACKET) for a in arrays[1:]
            )
            store_vector(builder, builder.fadd(place, builder.fmul(normal, step)), out)
        return context.get_dummy_value()

    return types.void(rays, position, geometric, types.intp, types.float32), generate


@intrinsic
def mark_blocked(_typing, far, out, first, blocked, free):
    """out[first..first + 16] is `blocked` where `far` is below 0, as Embree leaves it, and else `free`."""

    def generate(context, builder, signature, given):
        values = load_vector(builder, address_of(context, builder, signature.args[0], given[0]), PACKET)
        is_blocked = builder.fcmp_ordered("<", values, ir.Constant(PACKET, [0.0] * WIDTH))
        marks = builder.select(is_blocked, _all(builder, given[3], MARKS), _all(builder, given[4], MARKS))
        store_vector(builder, marks, address_of(context, builder, signature.args[1], given[1], given[2]))
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
            index = address_of(context, builder, kinds[0], given[0], point, loop.index)
            index = builder.sext(builder.load(builder.bitcast(index, INDEX.as_pointer())), WORD)
            weight = address_of(context, builder, kinds[1], given[1], point, loop.index)
            weight = _all(builder, builder.load(builder.bitcast(weight, FLOAT.as_pointer())), COLORS)
            colors = load_vector(builder, address_of(context, builder, kinds[3], given[3], index, column), COLORS)
            more = builder.fmul(colors, weight, flags=FUSED)
            builder.store(builder.fadd(builder.load(total), more, flags=FUSED), total)
        blended = builder.load(total)
        for c in range(3):
            place = address_of(context, builder, kinds[5], given[5], builder.add(row, WORD(c)), lane)
            builder.store(builder.extract_element(blended, INDEX(c)), builder.bitcast(place, FLOAT.as_pointer()))
        return context.get_dummy_value()

    index = types.intp
    return types.void(source, share, index, table, index, out, index, index), generate


@intrinsic
def face_packet(_typing, geometric, first, x, y, z, active):
    """active[lane] = -1 where the point first + lane faces the direction, by its geometric normal, else 0; how many do."""

    def generate(context, builder, signature, given):
        planes = (signature.args[0], given[0])
        way = [_all(builder, given[2 + axis], PACKET) for axis in range(3)]
        normal = [
            load_vector(builder, address_of(context, builder, *planes, WORD(axis), given[1]), PACKET)
            for axis in range(3)
        ]
        cosine = builder.fmul(normal[0], way[0])  # in the reference's order, each step rounded
        for axis in (1, 2):
            cosine = builder.fadd(cosine, builder.fmul(normal[axis], way[axis]))
        faces = builder.fcmp_ordered(">", cosine, ir.Constant(PACKET, [0.0] * WIDTH))
        marks = builder.sext(faces, ir.VectorType(INDEX, WIDTH))
        store_vector(builder, marks, address_of(context, builder, signature.args[5], given[5]))
        bits = builder.zext(builder.bitcast(faces, ir.IntType(WIDTH)), WORD)
        return builder.call(builder.module.declare_intrinsic("llvm.ctpop", [WORD]), [bits])

    number = types.float32
    return types.intp(geometric, types.intp, number, number, number, active), generate


@intrinsic
def shines(_typing, along, across, surface, form, first, num, aside, ahead, dark, which):
    """Whether aside * across + ahead * along is above `dark` at one of the `num` items (whole packets) from `first` on that
    are of surface `which` and have a form above 0.
    """

    def generate(context, builder, signature, given):
        kinds, first = signature.args, given[4]
        aside, ahead, dark = (_all(builder, given[k], PACKET) for k in (6, 7, 8))
        which = _all(builder, builder.trunc(given[9], SHORT), ir.VectorType(SHORT, WIDTH))
        marks = ir.VectorType(ir.IntType(1), WIDTH)
        found = cgutils.alloca_once_value(builder, ir.Constant(marks, [0] * WIDTH))
        with cgutils.for_range_slice(builder, WORD(0), given[5], WORD(WIDTH)) as (step, _):
            at = builder.add(first, step)
            x, y, form = (
                load_vector(builder, address_of(context, builder, kinds[k], given[k], at), PACKET) for k in (0, 1, 3)
            )
            of = load_vector(builder, address_of(context, builder, kinds[2], given[2], at), ir.VectorType(SHORT, WIDTH))
            base = builder.fadd(builder.fmul(aside, y, flags=FUSED), builder.fmul(ahead, x, flags=FUSED), flags=FUSED)
            bright = builder.and_(builder.fcmp_ordered(">", base, dark), builder.icmp_signed("==", of, which))
            bright = builder.and_(bright, builder.fcmp_ordered(">", form, ir.Constant(PACKET, [0.0] * WIDTH)))
            builder.store(builder.or_(builder.load(found), bright), found)
        bits = builder.bitcast(builder.load(found), ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(WIDTH), 0))

    number = types.float32
    return types.boolean(
        along, across, surface, form, types.intp, types.intp, number, number, number, types.int32
    ), generate


@intrinsic
def add_rows(_typing, entries, step, mode, first, last, weights, light, colors, column, part, out, row, lane):
    """out[row + c, lane + i] += colors[light, column + c] * part[lane + i] * the sum over rows r of entries (first to last)
    of weights[light, mode[r]] * step[r] * entries[r, c * num + i], for three colours c and num = entries.shape[1] / 3.
    """

    def generate(context, builder, signature, given):
        kinds = signature.args
        first, last, light, column, row, lane = (given[k] for k in (3, 4, 6, 8, 11, 12))
        count = builder.sub(last, first)
        element = context.get_data_type(kinds[0].dtype)
        size = kinds[0].dtype.bitwidth // 8
        group = 4  # packets whose sums are in registers
        for c in range(3):
            sums = [cgutils.alloca_once_value(builder, ir.Constant(PACKET, [0.0] * WIDTH)) for _ in range(group)]
            with cgutils.for_range(builder, count) as loop:
                r = builder.add(first, loop.index)
                which = builder.load(
                    builder.bitcast(address_of(context, builder, kinds[2], given[2], r), INDEX.as_pointer())
                )
                weight = address_of(context, builder, kinds[5], given[5], light, builder.sext(which, WORD))
                scale = address_of(context, builder, kinds[1], given[1], r)
                weight, scale = (builder.load(builder.bitcast(p, FLOAT.as_pointer())) for p in (weight, scale))
                factor = _all(builder, builder.fmul(weight, scale), PACKET)
                for v in range(group):
                    at = WORD(c * group * WIDTH + v * WIDTH)
                    values = load_vector(
                        builder, address_of(context, builder, kinds[0], given[0], r, at), ir.VectorType(element, WIDTH)
                    )
                    if size < 4:
                        values = builder.sitofp(values, PACKET)
                    more = builder.fmul(factor, values, flags=FUSED)
                    builder.store(builder.fadd(builder.load(sums[v]), more, flags=FUSED), sums[v])
            color = address_of(context, builder, kinds[7], given[7], light, builder.add(column, WORD(c)))
            color = _all(builder, builder.load(builder.bitcast(color, FLOAT.as_pointer())), PACKET)
            for v in range(group):
                at = builder.add(lane, WORD(v * WIDTH))
                share = builder.fmul(
                    color,
                    load_vector(builder, address_of(context, builder, kinds[9], given[9], at), PACKET),
                    flags=FUSED,
                )
                place = address_of(context, builder, kinds[10], given[10], builder.add(row, WORD(c)), at)
                more = builder.fmul(share, builder.load(sums[v]), flags=FUSED)
                store_vector(builder, builder.fadd(load_vector(builder, place, PACKET), more, flags=FUSED), place)
        return context.get_dummy_value()

    index = types.intp
    given = (entries, step, mode, index, index, weights, index, colors, index, part, out, index, index)
    return types.void(*given), generate


@intrinsic
def put_color(_typing, out, place, red, green, blue):
    """out[place], out[place + 1], out[place + 2] = a colour, one store each: in a loop with a stride the compiler would
    scatter vector registers, which takes five times as long.
    """

    def generate(context, builder, signature, given):
        start = address_of(context, builder, signature.args[0], given[0], given[1])
        start = builder.bitcast(start, FLOAT.as_pointer())
        for c in range(3):
            builder.store_atomic(given[2 + c], builder.gep(start, [WORD(c)]), "monotonic", 4)
        return context.get_dummy_value()

    number = types.float32
    return types.void(out, types.intp, number, number, number), generate
