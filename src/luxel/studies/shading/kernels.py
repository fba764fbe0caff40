"""The same schemes as compiled loops of this processor: RGB in 8.16, packed into the words of a picture.

Interleaved interpolators are the lanes of a vector register: one addition steps them all. What runs as a single interpolator is kept from being
vectorised, which the compiler would otherwise do by itself (`COMPILED`): it knows scheme 3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from luxel import jit

ONE, COMPILED, COUNTER, CORRECTED, LANES_2, LANES_3, LANES_4, LANES_8, LANES_16 = range(9)
"""Ways to fill a span."""

SPARE = 16
"""Words that a picture needs beyond its last."""

if jit.DISABLED:

    def kept(value: Any) -> Any:
        """The same, unknown to the optimiser."""
        return value

    def _filler(lanes: int) -> Any:
        def fill(picture, at, count, r, g, b, dr, dg, db):
            for k in range(count):
                picture[at + k] = pack(r + k * dr, g + k * dg, b + k * db)

        return fill

else:
    from luxel.jit import array_data, intrinsic, ir, types

    _I, _L = ir.IntType(32), ir.IntType(64)

    @intrinsic
    def kept(typingctx, value):
        """The same, unknown to the optimiser: an empty piece of assembly that may have changed it."""

        def codegen(context, builder, signature, arguments):
            return builder.asm(ir.FunctionType(_I, [_I]), "", "=r,0", [arguments[0]], True)

        return types.int32(types.int32), codegen

    def _splat(builder, value, vector):
        one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(_I, 0))
        return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), ir.Constant(vector, [0] * vector.count))

    def _all(vector, value):
        return ir.Constant(vector, [value] * vector.count)

    def _packed(builder, vector, values):
        red, green, blue = (builder.lshr(value, _all(vector, 16)) for value in values)
        word = builder.or_(red, builder.shl(green, _all(vector, 8)))
        return builder.or_(word, builder.or_(builder.shl(blue, _all(vector, 16)), _all(vector, -(1 << 24))))

    def _filler(lanes: int) -> Any:
        """fill(picture, at, count, r, g, b, dr, dg, db): words at .. at + count - 1, `lanes` at once, the last ones under a mask."""
        vector = ir.VectorType(_I, lanes)
        pointer = vector.as_pointer()

        def codegen(context, builder, signature, arguments):
            data, (_, at, count, *numbers) = array_data(context, builder, signature, arguments, 0), arguments
            iota = ir.Constant(vector, list(range(lanes)))
            slopes = [_splat(builder, slope, vector) for slope in numbers[3:]]
            first = [builder.add(_splat(builder, v, vector), builder.mul(s, iota)) for v, s in zip(numbers[:3], slopes, strict=True)]
            strides = [builder.mul(s, _all(vector, lanes)) for s in slopes]
            entry, test, body, done = builder.block, *(builder.append_basic_block(name) for name in ("lanes_test", "lanes", "lanes_done"))
            builder.branch(test)
            builder.position_at_end(test)
            k, values = builder.phi(_L), [builder.phi(vector) for _ in range(3)]
            for phi, start in zip((k, *values), (ir.Constant(_L, 0), *first), strict=True):
                phi.add_incoming(start, entry)
            following = builder.add(k, ir.Constant(_L, lanes))
            builder.cbranch(builder.icmp_signed("<=", following, count), body, done)
            builder.position_at_end(body)
            place = builder.bitcast(builder.gep(data, [builder.add(at, k)]), pointer)
            builder.store(_packed(builder, vector, values), place, align=4)
            for phi, after in zip((k, *values), (following, *(builder.add(v, s) for v, s in zip(values, strides, strict=True))), strict=True):
                phi.add_incoming(after, builder.block)
            builder.branch(test)
            builder.position_at_end(done)
            rest = builder.icmp_signed("<", iota, _splat(builder, builder.trunc(builder.sub(count, k), _I), vector))
            place = builder.bitcast(builder.gep(data, [builder.add(at, k)]), pointer)
            function_type = ir.FunctionType(ir.VoidType(), [vector, pointer, _I, ir.VectorType(ir.IntType(1), lanes)])
            store = jit.cgutils.get_or_insert_function(builder.module, function_type, f"llvm.masked.store.v{lanes}i32.p0")
            builder.call(store, [_packed(builder, vector, values), place, ir.Constant(_I, 4), rest])
            return context.get_dummy_value()

        @intrinsic
        def fill(typingctx, picture, at, count, r, g, b, dr, dg, db):
            return types.none(picture, types.int64, types.int64, *6 * [types.int32]), codegen

        return fill


fill_2, fill_3, fill_4, fill_8, fill_16 = (_filler(lanes) for lanes in (2, 3, 4, 8, 16))


@jit.inlined
def pack(r, g, b):
    """The word of a pixel, from 8.16."""
    return np.int32((r >> np.int32(16)) | ((g >> np.int32(16)) << np.int32(8)) | (b & np.int32(0xFF0000)) | np.int32(-0x1000000))


@jit.part
def one_way(picture, at, count, r, g, b, dr, dg, db):
    """One interpolator, kept as one."""
    for i in range(np.uint64(at), np.uint64(at + count)):
        picture[i] = pack(r, g, b)
        r, g, b = kept(np.int32(r + dr)), np.int32(g + dg), np.int32(b + db)


@jit.part
def compiled(picture, at, count, r, g, b, dr, dg, db):
    """The same loop, with which the compiler may do what it likes."""
    for i in range(np.uint64(at), np.uint64(at + count)):
        picture[i] = pack(r, g, b)
        r, g, b = np.int32(r + dr), np.int32(g + dg), np.int32(b + db)


@jit.part
def counter(picture, at, count, r, g, b, dr, dg, db):
    """Two interpolators, from both ends."""
    last = np.int32(count - 1)
    r1, g1, b1 = np.int32(r + last * dr), np.int32(g + last * dg), np.int32(b + last * db)
    i, j = np.uint64(at), np.uint64(at + count - 1)
    while i < j:
        picture[i], picture[j] = pack(r, g, b), pack(r1, g1, b1)
        r, g, b = kept(np.int32(r + dr)), np.int32(g + dg), np.int32(b + db)
        r1, g1, b1 = np.int32(r1 - dr), np.int32(g1 - dg), np.int32(b1 - db)
        i, j = i + np.uint64(1), j - np.uint64(1)
    if i == j:
        picture[i] = pack(r, g, b)


@jit.part
def corrected(picture, at, count, r, g, b, dr, dg, db):
    """One interpolator whose slope carries its remainder, so that it ends where the span does: whole divisions, once a span and channel."""
    last = np.int32(max(count - 1, 1))
    er, eg, eb = np.int32(last * dr), np.int32(last * dg), np.int32(last * db)
    qr, qg, qb = np.int32(er // last), np.int32(eg // last), np.int32(eb // last)
    rr, rg, rb = np.int32(er - qr * last), np.int32(eg - qg * last), np.int32(eb - qb * last)
    ar = ag = ab = np.int32((last - 1) >> 1)
    for i in range(np.uint64(at), np.uint64(at + count)):
        picture[i] = pack(r, g, b)
        ar, ag, ab = kept(np.int32(ar + rr)), np.int32(ag + rg), np.int32(ab + rb)
        over_r, over_g, over_b = np.int32(ar >= last), np.int32(ag >= last), np.int32(ab >= last)
        r, g, b = np.int32(r + qr + over_r), np.int32(g + qg + over_g), np.int32(b + qb + over_b)
        ar, ag, ab = np.int32(ar - over_r * last), np.int32(ag - over_g * last), np.int32(ab - over_b * last)


@jit.kernel
def fill_spans(way, spans, values, picture):
    """Fill spans in one of the ways.

    Args:
        spans: (n, 2) int32, first word and number of words; picture: flat int32, SPARE words longer than what is drawn.
        values: (n, 6) int32, RGB at the first word and its change from word to word, 8.16.
    """
    spans, values, picture = jit.borrow(spans), jit.borrow(values), jit.borrow(picture)
    for k in range(len(spans)):
        at, count = np.int64(spans[k, 0]), np.int64(spans[k, 1])
        r, g, b, dr, dg, db = values[k, 0], values[k, 1], values[k, 2], values[k, 3], values[k, 4], values[k, 5]
        if way == ONE:
            one_way(picture, at, count, r, g, b, dr, dg, db)
        elif way == COMPILED:
            compiled(picture, at, count, r, g, b, dr, dg, db)
        elif way == COUNTER:
            counter(picture, at, count, r, g, b, dr, dg, db)
        elif way == CORRECTED:
            corrected(picture, at, count, r, g, b, dr, dg, db)
        elif way == LANES_2:
            fill_2(picture, at, count, r, g, b, dr, dg, db)
        elif way == LANES_3:
            fill_3(picture, at, count, r, g, b, dr, dg, db)
        elif way == LANES_4:
            fill_4(picture, at, count, r, g, b, dr, dg, db)
        elif way == LANES_8:
            fill_8(picture, at, count, r, g, b, dr, dg, db)
        else:
            fill_16(picture, at, count, r, g, b, dr, dg, db)


@jit.kernel
def fill_midlines(first, spans, values, copies, constants, lanes, picture):
    """Fill templates, and their three copies with them.

    Args:
        first: (t + 1,) int32: where each triangle's template begins in `spans` and `values`, which are as for `fill_spans`.
        copies: (t, 3) int32: words from a template's pixel to its two moved copies; sum of the words of a pixel and of its turned copy.
        constants: (t, 9) int32: RGB to add in both moved copies, and to subtract from in the turned one.
        lanes: Whether eight lanes walk each of the four; otherwise one interpolator walks the template, and three additions make the others.
    """
    spans, values, picture = jit.borrow(spans), jit.borrow(values), jit.borrow(picture)
    for t in range(len(copies)):
        c = constants[t]
        r1, g1, b1, r2, g2, b2, r3, g3, b3 = c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8]
        for k in range(first[t], first[t + 1]):
            at, count = np.int64(spans[k, 0]), np.int64(spans[k, 1])
            r, g, b, dr, dg, db = values[k, 0], values[k, 1], values[k, 2], values[k, 3], values[k, 4], values[k, 5]
            one, two, turned = at + copies[t, 0], at + copies[t, 1], np.int64(copies[t, 2]) - at
            if lanes:  # each of the four has the template's slope and its own beginning
                fill_8(picture, at, count, r, g, b, dr, dg, db)
                fill_8(picture, one, count, np.int32(r + r1), np.int32(g + g1), np.int32(b + b1), dr, dg, db)
                fill_8(picture, two, count, np.int32(r + r2), np.int32(g + g2), np.int32(b + b2), dr, dg, db)
                n = np.int32(count - 1)  # the turned one from its other end
                r, g, b = np.int32(r3 - r - n * dr), np.int32(g3 - g - n * dg), np.int32(b3 - b - n * db)
                fill_8(picture, turned - n, count, r, g, b, dr, dg, db)
                continue
            for i in range(np.uint64(0), np.uint64(count)):
                picture[np.uint64(at) + i] = pack(r, g, b)
                picture[np.uint64(one) + i] = pack(np.int32(r + r1), np.int32(g + g1), np.int32(b + b1))
                picture[np.uint64(two) + i] = pack(np.int32(r + r2), np.int32(g + g2), np.int32(b + b2))
                picture[np.uint64(turned) - i] = pack(np.int32(r3 - r), np.int32(g3 - g), np.int32(b3 - b))
                r, g, b = kept(np.int32(r + dr)), np.int32(g + dg), np.int32(b + db)


@jit.kernel
def fill_waves(first, rows, values, down, stamp, stamps, queue, picture):
    """Fill triangles as waves from the middle of their longest row; what is not 4-connected is left.

    Args:
        first: (t + 1,) int32: where each triangle's rows begin; rows: (n, 4) int32: first word and number of words, first and last column.
        values: (n, 6) int32, as for `fill_spans`; down: (t, 3) int32: the change of RGB from row to row.
        stamp: A number that `stamps`, (words,) int32, do not have: what is stamped is active or done.
        queue: (words of the largest triangle, 5) int32 scratch.
    """
    rows, values, stamps, queue, picture = jit.borrow(rows), jit.borrow(values), jit.borrow(stamps), jit.borrow(queue), jit.borrow(picture)
    for t in range(len(down)):
        begin, end = first[t], first[t + 1]
        k = begin
        for other in range(begin, end):
            if rows[other, 1] > rows[k, 1]:
                k = other
        half = rows[k, 1] >> 1
        queue[0, 0], queue[0, 1] = k, rows[k, 2] + half
        for c in range(3):
            queue[0, 2 + c] = values[k, c] + half * values[k, 3 + c]
        stamps[rows[k, 0] + half] = stamp
        head, tail = 0, 1
        while head < tail:
            k, x, r, g, b = queue[head, 0], queue[head, 1], queue[head, 2], queue[head, 3], queue[head, 4]
            head += 1
            picture[rows[k, 0] + x - rows[k, 2]] = pack(r, g, b)
            for way in range(4):
                nx, nk = x + (way == 0) - (way == 1), k + (way == 2) - (way == 3)
                if nk < begin or nk >= end or nx < rows[nk, 2] or nx > rows[nk, 3]:
                    continue
                word = rows[nk, 0] + nx - rows[nk, 2]
                if stamps[word] == stamp:
                    continue
                stamps[word] = stamp
                dx, dy = nx - x, nk - k
                queue[tail, 0], queue[tail, 1] = nk, nx
                queue[tail, 2] = r + dx * values[k, 3] + dy * down[t, 0]
                queue[tail, 3] = g + dx * values[k, 4] + dy * down[t, 1]
                queue[tail, 4] = b + dx * values[k, 5] + dy * down[t, 2]
                tail += 1
