"""The innermost loops of the filters, a cache line of numbers at a time, written in LLVM's vector instructions.

The compiler's vectoriser does not take them: it cannot know that the places of a butterfly do not overlap, nor keep a row of sums in
registers over a loop of taps. LLVM lowers the vectors to whatever the machine has. Products are added with `llvm.fmuladd`: fused where the
machine can, two roundings where it cannot, so results differ between machines by rounding (and by nothing between numbers of threads).

All take flat arrays of one dtype, float32 (16 lanes) or float64 (8 lanes), and places in elements. With Numba switched off the same steps
run in NumPy.
"""

from __future__ import annotations

import numpy as np

from luxel import jit

LINE = 64
"""Bytes in a vector."""
SUMS = 4
"""Vectors of sums that `weighted_sums` makes at once: 64 float32 or 32 float64."""
ROWS = 3
"""Rows of sums that `weighted_rows` makes at once: loading is what `weighted_sums` waits for, and neighbouring rows are made of the same numbers."""
SQUARE = 8
"""Side of the squares that `transpose_pair` turns over."""

if jit.DISABLED:

    def weighted_sums(out, at, x, start, offsets, weights):
        """out[at + i] = sum over k of weights[k] * x[start + offsets[k] + i], for the `SUMS` vectors of i."""
        count = SUMS * LINE // x.itemsize
        total = np.zeros(count, x.dtype)
        for offset, weight in zip(offsets, weights):
            total += weight * x[start + offset : start + offset + count]
        out[at : at + count] = total

    def weighted_rows(out, at, apart, x, start, offsets, weights):
        """`weighted_sums` for each r below ROWS, at out[at + r * apart + i] with weights[k * ROWS + r]."""
        for row in range(ROWS):
            weighted_sums(out, at + row * apart, x, start, offsets, weights[row::ROWS])

    def _vectors(re, im, at, step, count):
        lanes = LINE // re.itemsize
        return [re[at + k * step : at + k * step + lanes] + 1j * im[at + k * step : at + k * step + lanes] for k in range(count)]

    def _store(re, im, at, step, values):
        lanes = LINE // re.itemsize
        for k, value in enumerate(values):
            re[at + k * step : at + k * step + lanes] = value.real
            im[at + k * step : at + k * step + lanes] = value.imag

    def _factors(twiddles, place, count):
        return [complex(twiddles[place + 2 * k], twiddles[place + 2 * k + 1]) for k in range(count)]

    def forward4(re, im, at, step, twiddles, place):
        """A radix-4 butterfly of decimation in frequency on the vectors at `at`, `at + step`, ..."""
        a, b, c, d = _vectors(re, im, at, step, 4)
        u, v, w = _factors(twiddles, place, 3)
        turned = -1j * (b - d)
        _store(re, im, at, step, [a + c + (b + d), (a - c + turned) * u, (a + c - (b + d)) * v, (a - c - turned) * w])

    def backward4(re, im, at, step, twiddles, place):
        """The inverse of `forward4`, times 4."""
        a, b, c, d = _vectors(re, im, at, step, 4)
        u, v, w = _factors(twiddles, place, 3)
        b, c, d = b * u.conjugate(), c * v.conjugate(), d * w.conjugate()
        turned = 1j * (b - d)
        _store(re, im, at, step, [a + c + (b + d), a - c + turned, a + c - (b + d), a - c - turned])

    def forward2(re, im, at, step, twiddles, place):
        """A radix-2 butterfly of decimation in frequency on the vectors at `at` and `at + step`."""
        a, b = _vectors(re, im, at, step, 2)
        _store(re, im, at, step, [a + b, (a - b) * _factors(twiddles, place, 1)[0]])

    def backward2(re, im, at, step, twiddles, place):
        """The inverse of `forward2`, times 2."""
        a, b = _vectors(re, im, at, step, 2)
        b = b * _factors(twiddles, place, 1)[0].conjugate()
        _store(re, im, at, step, [a + b, a - b])

    def transpose_pair(array, p, q, stride):
        """Exchange the 8 x 8 squares at `p` and `q` (rows `stride` apart), each transposed; p may equal q."""
        rows = np.arange(SQUARE)[:, None] * stride + np.arange(SQUARE)
        first, second = array[p + rows].copy(), array[q + rows].copy()
        array[q + rows] = first.T
        array[p + rows] = second.T

    def pick_line(part, at, source, start, channels):
        """A vector of every `channels`-th number (1 to 4) from `start` on; reads to the end of the last one's pixel."""
        count = LINE // part.itemsize
        part[at : at + count] = source[start : start + count * channels : channels]

    def put_line(out, start, channels, part, at):
        """The inverse of `pick_line`; what lies between is left as it is."""
        count = LINE // part.itemsize
        out[start : start + count * channels : channels] = part[at : at + count]

    def multiply_line(re, im, at, kre, kim, place):
        """Multiply a vector of complex numbers by another."""
        value = _vectors(re, im, at, 0, 1)[0] * _vectors(kre, kim, place, 0, 1)[0]
        _store(re, im, at, 0, [value])

else:
    from luxel.jit import array_data, intrinsic, ir, types
    from luxel.vectors import BIT, INT, LONG, load, multiply_add, splat, store, store_where

    class _Vectors:
        """Writes vector instructions for arrays of one dtype."""

        def __init__(self, builder, element, lanes=None):
            self.builder = builder
            self.lanes = lanes or LINE // (4 if isinstance(element, ir.FloatType) else 8)
            self.type = ir.VectorType(element, self.lanes)
            # Where LLVM prefers half the machine's width, for the sake of other code's clock rate, ask for the whole width (unknown names
            # are checked by `add`, hence set.add; machines without such vectors ignore it).
            set.add(builder.function.attributes, f'"min-legal-vector-width"="{8 * LINE}"')

        def splat(self, value):
            return splat(self.builder, value, self.type)

        def load(self, pointer, place):
            return load(self.builder, pointer, place, self.type)

        def store(self, value, pointer, place):
            store(self.builder, value, pointer, place)

        def fma(self, a, b, c):
            return multiply_add(self.builder, a, b, c)

        def times(self, a, b, conjugate=False):
            """(re, im) of the product of two pairs; of `a` and the conjugate of `b` where wanted."""
            build = self.builder
            real, imaginary = build.fmul(a[1], b[1]), build.fmul(a[0], b[1])
            if conjugate:
                return self.fma(a[0], b[0], real), self.fma(a[1], b[0], build.fneg(imaginary))
            return self.fma(a[0], b[0], build.fneg(real)), self.fma(a[1], b[0], imaginary)

        def add(self, a, b):
            return self.builder.fadd(a[0], b[0]), self.builder.fadd(a[1], b[1])

        def sub(self, a, b):
            return self.builder.fsub(a[0], b[0]), self.builder.fsub(a[1], b[1])

    def _element(signature, context, which):
        return context.get_value_type(signature.args[which].dtype)

    def _long(value):
        return ir.Constant(LONG, value)

    def _weighted(rows):
        """Code for `weighted_sums` of `rows` rows at once: what is loaded serves all of them."""

        def codegen(context, builder, signature, arguments):
            out, at, *apart, x, start, offsets, weights = range(len(arguments))
            vectors = _Vectors(builder, _element(signature, context, x))
            pointers = {i: array_data(context, builder, signature, arguments, i) for i in (out, x, offsets, weights)}
            count = context.make_array(signature.args[offsets])(context, builder, arguments[offsets]).nitems
            x_start, zeros = builder.gep(pointers[x], [arguments[start]]), ir.Constant(vectors.type, [0.0] * vectors.lanes)
            entry, loop = builder.block, builder.append_basic_block("taps")
            done = builder.append_basic_block("taps_done")
            builder.branch(loop)
            builder.position_at_end(loop)
            k, sums = builder.phi(LONG), [[builder.phi(vectors.type) for _ in range(SUMS)] for _ in range(rows)]
            places = [builder.add(builder.mul(k, _long(rows)), _long(row)) for row in range(rows)]
            factors = [vectors.splat(builder.load(builder.gep(pointers[weights], [place]))) for place in places]
            line = builder.gep(x_start, [builder.load(builder.gep(pointers[offsets], [k]))])
            loaded = [vectors.load(line, _long(i * vectors.lanes)) for i in range(SUMS)]
            grown = [[vectors.fma(factor, value, total) for value, total in zip(loaded, row)] for factor, row in zip(factors, sums)]
            following = builder.add(k, _long(1))
            k.add_incoming(_long(0), entry)
            k.add_incoming(following, loop)
            for row, later in zip(sums, grown):
                for phi, total in zip(row, later):
                    phi.add_incoming(zeros, entry)
                    phi.add_incoming(total, loop)
            builder.cbranch(builder.icmp_signed("<", following, count), loop, done)
            builder.position_at_end(done)
            place = arguments[at]
            for totals in grown:
                for i, total in enumerate(totals):
                    vectors.store(total, pointers[out], builder.add(place, _long(i * vectors.lanes)))
                place = builder.add(place, arguments[apart[0]]) if apart else place
            return context.get_dummy_value()

        return codegen

    @intrinsic
    def weighted_sums(typingctx, out, at, x, start, offsets, weights):
        """out[at + i] = sum over k of weights[k] * x[start + offsets[k] + i], for the `SUMS` vectors of i; at least one weight."""
        return types.void(out, types.int64, x, types.int64, offsets, weights), _weighted(1)

    @intrinsic
    def weighted_rows(typingctx, out, at, apart, x, start, offsets, weights):
        """`weighted_sums` for each r below ROWS, at out[at + r * apart + i] with weights[k * ROWS + r]."""
        return types.void(out, types.int64, types.int64, x, types.int64, offsets, weights), _weighted(ROWS)

    def _butterfly(radix, inverse):
        """An intrinsic that loads `radix` vectors of complex numbers, `step` apart, and stores their butterfly in place."""

        def butterfly(typingctx, re, im, at, step, twiddles, place):
            def codegen(context, builder, signature, arguments):
                vectors = _Vectors(builder, _element(signature, context, 0))
                pointers = [array_data(context, builder, signature, arguments, i) for i in (0, 1)]
                factors = array_data(context, builder, signature, arguments, 4)
                places = [arguments[2]]
                for _ in range(radix - 1):
                    places.append(builder.add(places[-1], arguments[3]))
                values = [tuple(vectors.load(p, place) for p in pointers) for place in places]
                turns = [
                    tuple(vectors.splat(builder.load(builder.gep(factors, [builder.add(arguments[5], _long(2 * k + i))]))) for i in (0, 1))
                    for k in range(radix - 1)
                ]
                if inverse:
                    values[1:] = [vectors.times(v, t, conjugate=True) for v, t in zip(values[1:], turns)]
                values = _mix4(vectors, values, inverse) if radix == 4 else [vectors.add(*values), vectors.sub(*values)]
                if not inverse:
                    values[1:] = [vectors.times(v, t) for v, t in zip(values[1:], turns)]
                for value, place in zip(values, places):
                    for half, pointer in zip(value, pointers):
                        vectors.store(half, pointer, place)
                return context.get_dummy_value()

            return types.void(re, im, types.int64, types.int64, twiddles, types.int64), codegen

        return intrinsic(butterfly)

    def _mix4(vectors, values, inverse):
        """The four-point transform without twiddles: products with i are exchanges of the parts."""
        a, b, c, d = values
        even, odd, apart, (re, im) = vectors.add(a, c), vectors.add(b, d), vectors.sub(a, c), vectors.sub(b, d)
        build = vectors.builder
        plus = build.fadd(apart[0], im), build.fsub(apart[1], re)  # apart - i (b - d)
        minus = build.fsub(apart[0], im), build.fadd(apart[1], re)
        if inverse:
            plus, minus = minus, plus
        return [vectors.add(even, odd), plus, vectors.sub(even, odd), minus]

    forward4, backward4 = _butterfly(4, False), _butterfly(4, True)
    forward2, backward2 = _butterfly(2, False), _butterfly(2, True)

    def _turned(builder, rows):
        """The 8 vectors of 8 of a transposed square: exchange the off-diagonal quarters of blocks of 4, 2 and 1."""
        for size in (4, 2, 1):
            low = [i if not i & size else i - size + SQUARE for i in range(SQUARE)]  # of a row and the one `size` below
            high = [i + size if not i & size else i + SQUARE for i in range(SQUARE)]
            masks = [ir.Constant(ir.VectorType(INT, SQUARE), mask) for mask in (low, high)]
            turned = list(rows)
            for i in range(SQUARE):
                if not i & size:
                    turned[i] = builder.shuffle_vector(rows[i], rows[i + size], masks[0])
                    turned[i + size] = builder.shuffle_vector(rows[i], rows[i + size], masks[1])
            rows = turned
        return rows

    @intrinsic
    def transpose_pair(typingctx, array, p, q, stride):
        """Exchange the 8 x 8 squares at `p` and `q` (rows `stride` apart), each transposed; p may equal q."""

        def codegen(context, builder, signature, arguments):
            vectors = _Vectors(builder, _element(signature, context, 0), SQUARE)
            pointer = array_data(context, builder, signature, arguments, 0)
            starts = [builder.add(at, builder.mul(arguments[3], _long(i))) for at in arguments[1:3] for i in range(SQUARE)]
            squares = [vectors.load(pointer, start) for start in starts]
            turned = _turned(builder, squares[SQUARE:]) + _turned(builder, squares[:SQUARE])
            for value, start in zip(turned, starts):
                vectors.store(value, pointer, start)
            return context.get_dummy_value()

        return types.void(array, types.int64, types.int64, types.int64), codegen

    @intrinsic
    def multiply_line(typingctx, re, im, at, kre, kim, place):
        """Multiply a vector of complex numbers by another."""

        def codegen(context, builder, signature, arguments):
            vectors = _Vectors(builder, _element(signature, context, 0))
            re, im, kre, kim = (array_data(context, builder, signature, arguments, i) for i in (0, 1, 3, 4))
            at, place = arguments[2], arguments[5]
            product = vectors.times((vectors.load(re, at), vectors.load(im, at)), (vectors.load(kre, place), vectors.load(kim, place)))
            vectors.store(product[0], re, at)
            vectors.store(product[1], im, at)
            return context.get_dummy_value()

        return types.void(re, im, types.int64, kre, kim, types.int64), codegen

    def _by_channels(write):
        """Code for 1 to 4 channels, and a switch over the five: `write(vectors, channels)` makes one vector's worth of it."""

        def codegen(builder, vectors, channels):
            done = builder.append_basic_block("line_done")
            switch = builder.switch(channels, done)
            for count in (1, 2, 3, 4):
                block = builder.append_basic_block(f"channels{count}")
                switch.add_case(ir.Constant(channels.type, count), block)
                builder.position_at_end(block)
                write(vectors, count)
                builder.branch(done)
            builder.position_at_end(done)

        return codegen

    @intrinsic
    def pick_line(typingctx, part, at, source, start, channels):
        """A vector of every `channels`-th number (1 to 4) from `start` on; reads to the end of the last one's pixel."""

        def codegen(context, builder, signature, arguments):
            element = _element(signature, context, 0)
            part, source = (array_data(context, builder, signature, arguments, i) for i in (0, 2))

            def write(vectors, count):
                wide = _Vectors(builder, element, vectors.lanes * count)
                numbers = wide.load(source, arguments[3])
                mask = ir.Constant(ir.VectorType(INT, vectors.lanes), [count * lane for lane in range(vectors.lanes)])
                vectors.store(builder.shuffle_vector(numbers, ir.Constant(wide.type, ir.Undefined), mask), part, arguments[1])

            _by_channels(write)(builder, _Vectors(builder, element), arguments[4])
            return context.get_dummy_value()

        return types.void(part, types.int64, source, types.int64, types.int64), codegen

    @intrinsic
    def put_line(typingctx, out, start, channels, part, at):
        """The inverse of `pick_line`; what lies between is left as it is."""

        def codegen(context, builder, signature, arguments):
            out, part = (array_data(context, builder, signature, arguments, i) for i in (0, 3))

            def write(vectors, count):
                value, lanes = vectors.load(part, arguments[4]), vectors.lanes
                for k in range(count):
                    places = [k * lanes + lane for lane in range(lanes)]
                    spread = ir.Constant(ir.VectorType(INT, lanes), [place // count for place in places])
                    mask = ir.Constant(ir.VectorType(BIT, lanes), [int(place % count == 0) for place in places])
                    numbers = builder.shuffle_vector(value, ir.Constant(vectors.type, ir.Undefined), spread)
                    store_where(builder, mask, numbers, out, builder.add(arguments[1], _long(k * lanes)))

            _by_channels(write)(builder, _Vectors(builder, _element(signature, context, 0)), arguments[2])
            return context.get_dummy_value()

        return types.void(out, types.int64, types.int64, part, types.int64), codegen
