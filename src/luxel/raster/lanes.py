"""The two innermost loops of `cover`, eight pixels at a time, written in LLVM's vector instructions.

The compiler's own vectoriser does not take these loops (spans are short, their ends vary), and they are where rasterising spends its time.
LLVM lowers eight lanes to whatever the machine has; every lane does the plain float32 operations of `draw_pixel` below, which is also
what runs where Numba is switched off, so the bits are the same everywhere.

Groups begin at multiples of eight pixels from the tile's edge, so that what one triangle has stored is loaded by the next as it was stored:
a processor hands such data on at once, and stalls where a load overlaps two stores. Lanes that are not drawn are written unchanged.
"""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial

from luxel import jit

LANES = 8


def draw_pixel(depth, ids, i, d, low, high, t, counting):
    """Depth `d`, clamped to low .. high, and id `t` replace what is at `i` if nearer; if `counting` is not None, then also if as near, and
    in place of the id one is added."""
    d = d if d > low else low
    d = d if d < high else high
    if d > depth[i] or (counting is not None and d == depth[i]):
        depth[i] = d
        ids[i] = t if counting is None else ids[i] + 1


if jit.DISABLED:
    import numpy as np

    def draw_span(depth, ids, first, skip, count, x, z, slope, low, high, t, counting):
        """Draw `count` pixels from element `first` + `skip` on; pixel k from `first` has depth z + slope * (x + k)."""
        for k in range(skip, skip + count):
            draw_pixel(depth, ids, first + k, z + slope * (x + np.float32(k)), low, high, t, counting)

    def draw_inside(depth, ids, first, count, e0, e1, e2, a0, a1, a2, x, z, slope, low, high, t, counting):
        """Draw those pixels of the groups that hold the first `count` from `first` on where all three e + a * k are >= 0; int32."""
        for k in range(-(-count // LANES) * LANES):
            if min(int(e0) + int(a0) * k, int(e1) + int(a1) * k, int(e2) + int(a2) * k) >= 0:
                draw_pixel(depth, ids, first + k, z + slope * (x + np.float32(k)), low, high, t, counting)

    def prefetch(array, i):
        """Nothing to do."""

    def prefetch_to_write(array, i):
        """Nothing to do."""

else:
    from luxel.jit import array_data, cgutils, intrinsic, ir, types
    from luxel.vectors import FLOAT, INT, LONG, load, splat, store

    VF, VI = ir.VectorType(FLOAT, LANES), ir.VectorType(INT, LANES)
    _IOTA_I = ir.Constant(VI, list(range(LANES)))
    IOTA = ir.Constant(VF, [float(k) for k in range(LANES)])

    def _blend(builder, depth, ids, i, mask, d, low, high, t, counting):
        """Eight lanes of `draw_pixel` from element `i` on, where `mask`."""
        low, high = splat(builder, low, VF), splat(builder, high, VF)
        d = builder.select(builder.fcmp_ordered(">", d, low), d, low)
        d = builder.select(builder.fcmp_ordered("<", d, high), d, high)
        old_depth, old_ids = load(builder, depth, i, VF), load(builder, ids, i, VI)
        counts = not isinstance(counting, types.NoneType)
        mask = builder.and_(mask, builder.fcmp_ordered(">=" if counts else ">", d, old_depth))
        new_ids = builder.add(old_ids, ir.Constant(VI, [1] * LANES)) if counts else splat(builder, t, VI)
        store(builder, builder.select(mask, d, old_depth), depth, i)
        store(builder, builder.select(mask, new_ids, old_ids), ids, i)

    def counting_from(builder, start, vector):
        """start, start + 1, ... and what to add for the next group."""
        first = splat(builder, start, vector)
        return (builder.fadd(first, IOTA), ir.Constant(VF, [float(LANES)] * LANES)) if vector is VF else (
            builder.add(first, _IOTA_I), ir.Constant(VI, [LANES] * LANES))  # fmt: skip

    def _depths(builder, x, z, slope):
        return builder.fadd(splat(builder, z, VF), builder.fmul(splat(builder, slope, VF), x))

    @contextmanager
    def groups(builder, count, *growing):
        """Loop over groups of lanes, at least once: gives the first pixel k of the group, and the vectors `growing`, pairs of what they are
        in the first group and what is added for each next."""
        entry, loop = builder.block, builder.append_basic_block("group")
        done = builder.append_basic_block("groups_done")
        builder.branch(loop)
        builder.position_at_end(loop)
        k, values = builder.phi(LONG), [builder.phi(start.type) for start, _ in growing]
        k.add_incoming(ir.Constant(LONG, 0), entry)
        for value, (start, _) in zip(values, growing, strict=True):
            value.add_incoming(start, entry)
        yield k, values
        for value, (_, step) in zip(values, growing, strict=True):
            value.add_incoming((builder.fadd if value.type == VF else builder.add)(value, step), builder.block)
        following = builder.add(k, ir.Constant(LONG, LANES))
        k.add_incoming(following, builder.block)
        builder.cbranch(builder.icmp_signed("<", following, count), loop, done)
        builder.position_at_end(done)

    @intrinsic
    def draw_span(typingctx, depth, ids, first, skip, count, x, z, slope, low, high, t, counting):
        """Draw `count` pixels from element `first` + `skip` on; pixel k from `first` has depth z + slope * (x + k)."""

        def codegen(context, builder, signature, arguments):
            _, _, first, skip, count, x, z, slope, low, high, t, _ = arguments
            depth = array_data(context, builder, signature, arguments, 0)
            ids = array_data(context, builder, signature, arguments, 1)
            end = builder.add(skip, count)
            begun, ended = (splat(builder, builder.trunc(number, INT), VI) for number in (skip, end))
            with groups(builder, end, counting_from(builder, ir.Constant(INT, 0), VI), counting_from(builder, x, VF)) as (k, (lane, x)):
                i = builder.add(first, k)
                mask = builder.and_(builder.icmp_signed(">=", lane, begun), builder.icmp_signed("<", lane, ended))
                _blend(builder, depth, ids, i, mask, _depths(builder, x, z, slope), low, high, t, counting)
            return context.get_dummy_value()

        f, i = types.float32, types.int64
        return types.none(depth, ids, i, i, i, f, f, f, f, f, types.int32, counting), codegen

    @intrinsic
    def draw_inside(typingctx, depth, ids, first, count, e0, e1, e2, a0, a1, a2, x, z, slope, low, high, t, counting):
        """Draw those pixels of the groups that hold the first `count` from `first` on where all three e + a * k are >= 0; int32."""

        def codegen(context, builder, signature, arguments):
            _, _, first, count, *edges, x, z, slope, low, high, t, _ = arguments
            depth = array_data(context, builder, signature, arguments, 0)
            ids = array_data(context, builder, signature, arguments, 1)
            growing = []
            for e, a in zip(edges[:3], edges[3:], strict=True):
                a = splat(builder, a, VI)
                growing.append((builder.add(splat(builder, e, VI), builder.mul(a, _IOTA_I)), builder.shl(a, ir.Constant(VI, [3] * LANES))))
            with groups(builder, count, *growing, counting_from(builder, x, VF)) as (k, (e0, e1, e2, x)):
                inside = builder.icmp_signed(">=", builder.or_(builder.or_(e0, e1), e2), ir.Constant(VI, [0] * LANES))
                i = builder.add(first, k)
                _blend(builder, depth, ids, i, inside, _depths(builder, x, z, slope), low, high, t, counting)
            return context.get_dummy_value()

        f, i, e = types.float32, types.int64, types.int32
        return types.none(depth, ids, i, i, e, e, e, e, e, e, f, f, f, f, f, e, counting), codegen

    def _prefetch(context, builder, signature, arguments, writing):
        pointer = builder.gep(array_data(context, builder, signature, arguments, 0), [arguments[1]])
        pointer = builder.bitcast(pointer, ir.IntType(8).as_pointer())
        function_type = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer(), INT, INT, INT])
        function = cgutils.get_or_insert_function(builder.module, function_type, "llvm.prefetch.p0")
        builder.call(function, [pointer, ir.Constant(INT, writing), ir.Constant(INT, 3), ir.Constant(INT, 1)])
        return context.get_dummy_value()

    @intrinsic
    def prefetch(typingctx, array, i):
        """Ask for the cache line of element `i` of `array`, seen as flat, ahead of its use."""
        return types.none(array, types.int64), partial(_prefetch, writing=0)

    @intrinsic
    def prefetch_to_write(typingctx, array, i):
        """The same, to be written."""
        return types.none(array, types.int64), partial(_prefetch, writing=1)
