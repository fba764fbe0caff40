"""Joint: a small triangle drawn at four samples of each pixel at once, eight pixels at a time, in LLVM's vector instructions.

Sample by sample, most of the time goes into beginning: where the box is, how many rows, and the branches in between, which nobody can predict. Here
four samples share that, and a box that holds what any of them needs; the four do not depend on each other, so the processor works on
all of them at a time. Every lane does the operations of `lanes.draw_pixel`, in `cover`'s order, so the bits are those of one sample after the other.
"""

from __future__ import annotations

from luxel import jit
from luxel.raster.lanes import LANES
from luxel.raster.setup import (
    A0,
    A1,
    A2,
    ACROSS,
    AT,
    AT_X,
    AT_Y,
    B0,
    B1,
    B2,
    BATCH,
    DEPTH,
    DOWN,
    EDGES,
    HIGH,
    LOW,
    MOST0,
    OFFSETS,
    ROW0,
    SPAN_LEFT,
    SPAN_RIGHT,
    STEP_X,
    STEP_Y,
    T,
)

TOGETHER = 4
"""Samples."""

COLUMNS = LANES
"""Groups of eight pixels; tiles that are no wider are drawn so."""

WIDEST = 96
"""Pixels; triangles no wider and no higher are drawn so: their edge functions near such a tile fit int32."""

if jit.DISABLED:
    import numpy as np

    from luxel.jit import bits_float
    from luxel.raster.lanes import draw_inside

    def draw_four(depth, ids, c, i, first, pixels, tile):
        """Draw triangle `i` of the batch at four samples, for which it is placed; the elements of the first one's pixels begin at `first`,
        and those of the others `pixels` apart."""
        i = int(i)
        z, zx, zy, low, high, at_x, at_y = (bits_float(c[int(row) + i]) for row in (DEPTH, STEP_X, STEP_Y, LOW, HIGH, AT_X, AT_Y))
        a, b = ([int(c[int(row) + i]) for row in rows] for rows in ((A0, A1, A2), (B0, B1, B2)))
        for s in range(TOGETHER):
            e = [int(c[int(EDGES) + (3 * s + k) * BATCH + i]) for k in range(3)]
            x, y = at_x + bits_float(c[int(OFFSETS) + s]), at_y + bits_float(c[int(OFFSETS) + TOGETHER + s])
            for row in range(int(c[int(DOWN) + i]) + 1):
                at = first + s * pixels + int(c[int(AT) + i]) + row * tile
                draw_inside(depth, ids, at, int(c[int(ACROSS) + i]) + 1, *(e[k] + b[k] * row for k in range(3)), *a, x,
                            z + zy * (y + np.float32(row)), zx, low, high, c[int(T) + i], None)  # fmt: skip

else:
    from contextlib import contextmanager

    from luxel.jit import array_data, intrinsic, ir, types
    from luxel.raster.lanes import IOTA, VF, VI
    from luxel.vectors import FLOAT, INT, LONG, load, splat, store

    _BEYOND, _SPARE = 1e4, 1 / 32  # rows
    _V4 = ir.VectorType(FLOAT, TOGETHER)
    _IOTA_I = ir.Constant(VI, list(range(LANES)))
    _GROUP_I, _GROUP_F = ir.Constant(VI, [LANES] * LANES), ir.Constant(VF, [float(LANES)] * LANES)

    @contextmanager
    def _loop(builder, count, growing):
        """Loop from 0 to `count`, at least once: gives the values `growing`, pairs of what they are at first and what is added each time."""
        entry, loop, done = builder.block, builder.append_basic_block("joint"), builder.append_basic_block("joint_done")
        builder.branch(loop)
        builder.position_at_end(loop)
        k, values = builder.phi(LONG), [builder.phi(start.type) for start, _ in growing]
        for value, start in ((k, ir.Constant(LONG, 0)), *((value, start) for value, (start, _) in zip(values, growing, strict=True))):
            value.add_incoming(start, entry)
        yield values
        for value, (start, step) in zip(values, growing, strict=True):
            whole = start.type in (VI, LONG)
            value.add_incoming((builder.add if whole else builder.fadd)(value, step), builder.block)
        k.add_incoming(builder.add(k, ir.Constant(LONG, 1)), builder.block)
        more = builder.icmp_signed("<", k, count)
        builder.cbranch(more, loop, done)
        builder.position_at_end(done)

    def _spread(builder, vector, which):
        """Element `which` of a vector of four, in all lanes."""
        return builder.shuffle_vector(vector, ir.Constant(_V4, ir.Undefined), ir.Constant(ir.VectorType(INT, LANES), [which] * LANES))

    def _whole(builder, *numbers):
        return [splat(builder, number, VI) for number in numbers]

    def _columns(builder, rows, a, b, number, down):
        """Write between which rows each of eight columns of groups may be inside: a superset, in float32."""
        first, last = ir.Constant(VF, [0.0] * LANES), splat(builder, builder.sitofp(down, FLOAT), VF)
        for k in range(3):
            change = builder.mul(a[k], ir.Constant(VI, list(range(0, LANES**2, LANES))))
            most = builder.add(splat(builder, number(int(MOST0) + k * BATCH), VI), change)
            by = splat(builder, builder.bitcast(number(int(ROW0) + k * BATCH), FLOAT), VF)
            row, none = builder.fmul(builder.sitofp(most, VF), by), ir.Constant(VI, [0] * LANES)
            begins = builder.and_(builder.icmp_signed(">", b[k], none), builder.fcmp_ordered(">", row, first))
            ends = builder.and_(builder.icmp_signed("<", b[k], none), builder.fcmp_ordered("<", row, last))
            first, last = builder.select(begins, row, first), builder.select(ends, row, last)
        beyond, before = ir.Constant(VF, [_BEYOND] * LANES), ir.Constant(VF, [-1.0] * LANES)
        first = builder.select(builder.fcmp_ordered("<", first, beyond), first, beyond)
        last = builder.select(builder.fcmp_ordered(">", last, before), last, before)
        up, down = ir.Constant(VF, [1 - _SPARE] * LANES), ir.Constant(VF, [1 + _SPARE] * LANES)
        store(builder, builder.fptosi(builder.fadd(first, up), VI), rows, ir.Constant(LONG, int(SPAN_LEFT)))
        end = builder.sub(builder.fptosi(builder.fadd(last, down), VI), ir.Constant(VI, [1] * LANES))
        store(builder, end, rows, ir.Constant(LONG, int(SPAN_RIGHT)))

    def _draw_group(builder, depth, ids, place, pixels, edges, bases, slopes, low, high, t):
        """Draw eight pixels at four samples. The four lie multiples of 4096 bytes apart, and what is loaded after another of them is stored waits
        until the processor knows both places: so all are loaded first."""
        places = [builder.add(place, builder.mul(pixels, ir.Constant(LONG, s))) for s in range(TOGETHER)]
        before = [(load(builder, depth, place, VF), load(builder, ids, place, VI)) for place in places]
        for s, (place, (old_depth, old_id)) in enumerate(zip(places, before, strict=True)):
            e0, e1, e2 = edges[3 * s : 3 * s + 3]
            inside = builder.icmp_signed(">=", builder.or_(builder.or_(e0, e1), e2), ir.Constant(VI, [0] * LANES))
            d = builder.fadd(_spread(builder, bases, s), slopes[s])
            d = builder.select(builder.fcmp_ordered(">", d, low), d, low)
            d = builder.select(builder.fcmp_ordered("<", d, high), d, high)
            nearer = builder.and_(inside, builder.fcmp_ordered(">", d, old_depth))
            store(builder, builder.select(nearer, d, old_depth), depth, place)
            store(builder, builder.select(nearer, t, old_id), ids, place)

    @intrinsic
    def draw_four(typingctx, depth, ids, c, i, first, pixels, tile):
        """Draw triangle `i` of the batch at four samples, for which it is placed; the elements of the first one's pixels begin at `first`,
        and those of the others `pixels` apart."""

        def codegen(context, builder, signature, arguments):
            depth, ids, rows = (array_data(context, builder, signature, arguments, which) for which in range(3))
            _, _, _, i, first, pixels, tile = arguments

            def number(row):
                return builder.load(builder.gep(rows, [builder.add(i, ir.Constant(LONG, int(row)))]))

            def decimal(row):
                return builder.bitcast(number(row), FLOAT)

            def long(row):
                return builder.sext(number(row), LONG)

            a, b = _whole(builder, *map(number, (A0, A1, A2))), _whole(builder, *map(number, (B0, B1, B2)))
            z, zx, zy, low, high, x = map(decimal, (DEPTH, STEP_X, STEP_Y, LOW, HIGH, AT_X))
            z, zy, y = (splat(builder, value, _V4) for value in (z, zy, decimal(AT_Y)))
            offsets = [load(builder, builder.bitcast(rows, FLOAT.as_pointer()), ir.Constant(LONG, int(OFFSETS) + k), _V4) for k in (0, TOGETHER)]
            y, x = builder.fadd(y, offsets[1]), builder.fadd(splat(builder, x, _V4), offsets[0])
            xs = [builder.fadd(_spread(builder, x, s), IOTA) for s in range(TOGETHER)]
            edges = [splat(builder, number(int(EDGES) + k * BATCH), VI) for k in range(3 * TOGETHER)]
            edges = [builder.add(edge, builder.mul(a[k % 3], _IOTA_I)) for k, edge in enumerate(edges)]
            steps = [builder.shl(step, ir.Constant(VI, [3] * LANES)) for step in a]
            slope, low, high = (splat(builder, value, VF) for value in (zx, low, high))
            t, down, one = splat(builder, number(T), VI), long(DOWN), ir.Constant(_V4, [1.0] * TOGETHER)
            columns = builder.ashr(long(ACROSS), ir.Constant(LONG, 3))
            _columns(builder, rows, a, b, number, down)
            across = [*((edge, steps[k % 3]) for k, edge in enumerate(edges)), *((place, _GROUP_F) for place in xs)]
            at, eight = builder.add(first, long(AT)), ir.Constant(LONG, LANES)
            with _loop(builder, columns, [(ir.Constant(LONG, 0), ir.Constant(LONG, 1)), (at, eight), *across]) as (k, at, *found):
                begin, end = (builder.sext(builder.load(builder.gep(rows, [builder.add(k, ir.Constant(LONG, int(row)))])), LONG)
                              for row in (SPAN_LEFT, SPAN_RIGHT))  # fmt: skip
                with builder.if_then(builder.icmp_signed("<=", begin, end)):
                    edges, slopes = found[: 3 * TOGETHER], [builder.fmul(slope, place) for place in found[3 * TOGETHER :]]
                    skipped = splat(builder, builder.trunc(begin, INT), VI)
                    skipped = [builder.mul(step, skipped) for step in b]
                    y0 = builder.fadd(y, splat(builder, builder.sitofp(begin, FLOAT), _V4))
                    growing = [(builder.add(at, builder.mul(begin, tile)), tile), (y0, one)]
                    growing += [(builder.add(edge, skipped[k % 3]), b[k % 3]) for k, edge in enumerate(edges)]
                    with _loop(builder, builder.sub(end, begin), growing) as (place, row, *edges):
                        bases = builder.fadd(z, builder.fmul(zy, row))
                        _draw_group(builder, depth, ids, place, pixels, edges, bases, slopes, low, high, t)
            return context.get_dummy_value()

        j = types.int64
        return types.none(depth, ids, c, j, j, j, j), codegen
