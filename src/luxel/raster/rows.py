"""Runs of fragments, eight at a time, in LLVM's vector instructions: finding them in a row of ids, and filling rows of a batch for them.

Runs are short (a triangle's width), too short for the compiler's vectoriser, whose loops take 32 elements a turn and the rest one by one.
Positions x are multiples of 1/256 below 2^15, or stand for a single fragment: so x + k is exact in whatever order it is added up.
Whole groups of eight are written: what goes beyond a run is written again by the next. So rows need `LANES` spare elements.
"""

from __future__ import annotations

from luxel import jit
from luxel.raster.lanes import LANES

WORD = 64
"""Pixels that one mask of `where_same` tells of."""

if jit.DISABLED:
    import numpy as np

    def where_same(ids, first, second, count):
        """Bits k of `count` (1 to 64) where ids[first + k] is ids[second + k]."""
        return np.uint64(sum(1 << k for k in range(count) if ids[first + k] == ids[second + k]))

    def where_four_same(ids, first, pixels, count):
        """Bits k of `count` (1 to 64) where all four ids[first + k + s * pixels] are the same."""
        return where_same(ids, first, first + pixels, count) & where_same(ids, first, first + 2 * pixels, count) & where_same(
            ids, first, first + 3 * pixels, count)  # fmt: skip

    def same_samples(ids, first, pixels, samples, s, same, at):
        """same[at + k] = the bits of the samples whose id at `first` + k is that of sample `s`, for `LANES` pixels; planes lie `pixels` apart."""
        for k in range(LANES):
            mine = ids[first + s * pixels + k]
            same[at + k] = sum(1 << other for other in range(samples) if ids[first + other * pixels + k] == mine)

    def same_of_four(ids, first, pixels, same, at, pitch):
        """`same_samples` of all four samples at once, the bits of sample s from `at` + `pitch` * s on."""
        for s in range(4):
            same_samples(ids, first, pixels, 4, s, same, at + pitch * s)

    def copy(to, at, codes, first, count):
        """to[at + k] = codes[first + k]; uint32, and nothing beyond is written."""
        to[at : at + count] = codes[first : first + count]

    def fill(g, first, count, value):
        """g[first + k] = value."""
        g[first : first + count] = value

    def ramp(g, first, count, x, slope, base):
        """g[first + k] = slope * (x + k) + base."""
        for k in range(count):
            g[first + k] = slope * (x + np.float32(k)) + base

    def inverse_ramp(g, first, count, x, slope, base):
        """g[first + k] = 1 / (slope * (x + k) + base)."""
        for k in range(count):
            g[first + k] = np.float32(1) / (slope * (x + np.float32(k)) + base)

    def scaled_ramp(g, first, count, scale, x, slope, base, origin):
        """g[first + k] = (slope * (x + k) + base) * g[scale + k] + origin."""
        for k in range(count):
            g[first + k] = (slope * (x + np.float32(k)) + base) * g[scale + k] + origin

    def derivative(g, first, count, scale, value, origin, slope, slope_w, footprint):
        """g[first + k] = (slope - (g[value + k] - origin) * slope_w) * (g[scale + k] * footprint)."""
        for k in range(count):
            g[first + k] = (slope - (g[value + k] - origin) * slope_w) * (g[scale + k] * footprint)

else:
    from luxel.jit import array_data, intrinsic, ir, types
    from luxel.raster.lanes import IOTA, VF, VI, counting_from, groups
    from luxel.vectors import FLOAT, INT, LONG, load, splat, store, store_where

    _BITS = ir.IntType(LANES)

    def _bits(builder, count, same_at):
        """A word of the bits that `same_at(k)` gives for eight elements from k on, of `count` (1 to 64) elements."""
        entry, loop, done = builder.block, builder.append_basic_block("bits"), builder.append_basic_block("bits_done")
        builder.branch(loop)
        builder.position_at_end(loop)
        k, word = builder.phi(LONG), builder.phi(LONG)
        k.add_incoming(ir.Constant(LONG, 0), entry)
        word.add_incoming(ir.Constant(LONG, 0), entry)
        more = builder.or_(word, builder.shl(builder.zext(builder.bitcast(same_at(k), _BITS), LONG), k))
        following = builder.add(k, ir.Constant(LONG, LANES))
        k.add_incoming(following, loop)
        word.add_incoming(more, loop)
        builder.cbranch(builder.icmp_signed("<", following, count), loop, done)
        builder.position_at_end(done)
        unused = builder.sub(ir.Constant(LONG, WORD), count)
        return builder.lshr(builder.shl(more, unused), unused)

    @intrinsic
    def where_same(typingctx, ids, first, second, count):
        """Bits k of `count` (1 to 64) where ids[first + k] is ids[second + k]."""

        def codegen(context, builder, signature, arguments):
            data, (_, first, second, count) = array_data(context, builder, signature, arguments, 0), arguments

            def same_at(k):
                return builder.icmp_signed("==", load(builder, data, builder.add(first, k), VI), load(builder, data, builder.add(second, k), VI))

            return _bits(builder, count, same_at)

        return types.uint64(ids, types.int64, types.int64, types.int64), codegen

    @intrinsic
    def where_four_same(typingctx, ids, first, pixels, count):
        """Bits k of `count` (1 to 64) where all four ids[first + k + s * pixels] are the same."""

        def codegen(context, builder, signature, arguments):
            data, (_, first, pixels, count) = array_data(context, builder, signature, arguments, 0), arguments
            planes = [builder.add(first, builder.mul(pixels, ir.Constant(LONG, s))) for s in range(4)]

            def same_at(k):
                mine, *others = (load(builder, data, builder.add(plane, k), VI) for plane in planes)
                differ = ir.Constant(VI, [0] * LANES)
                for other in others:
                    differ = builder.or_(differ, builder.xor(mine, other))
                return builder.icmp_signed("==", differ, ir.Constant(VI, [0] * LANES))

            return _bits(builder, count, same_at)

        return types.uint64(ids, types.int64, types.int64, types.int64), codegen

    @intrinsic
    def same_samples(typingctx, ids, first, pixels, samples, s, same, at):
        """same[at + k] = the bits of the samples whose id at `first` + k is that of sample `s`, for `LANES` pixels; planes lie `pixels` apart."""

        def codegen(context, builder, signature, arguments):
            _, first, pixels, samples, s, _, at = arguments
            data, target = (array_data(context, builder, signature, arguments, which) for which in (0, 5))
            mine = load(builder, data, builder.add(first, builder.mul(s, pixels)), VI)
            none = ir.Constant(VI, [0] * LANES)
            entry, loop, done = builder.block, builder.append_basic_block("samples"), builder.append_basic_block("samples_done")
            builder.branch(loop)
            builder.position_at_end(loop)
            other, plane, bit, bits = builder.phi(LONG), builder.phi(LONG), builder.phi(VI), builder.phi(VI)
            for value, start in ((other, ir.Constant(LONG, 0)), (plane, first), (bit, ir.Constant(VI, [1] * LANES)), (bits, none)):
                value.add_incoming(start, entry)
            same = builder.icmp_signed("==", mine, load(builder, data, plane, VI))
            more, following = builder.or_(bits, builder.select(same, bit, none)), builder.add(other, ir.Constant(LONG, 1))
            other.add_incoming(following, loop)
            plane.add_incoming(builder.add(plane, pixels), loop)
            bit.add_incoming(builder.add(bit, bit), loop)
            bits.add_incoming(more, loop)
            builder.cbranch(builder.icmp_signed("<", following, samples), loop, done)
            builder.position_at_end(done)
            store(builder, more, target, at)
            return context.get_dummy_value()

        i = types.int64
        return types.none(ids, i, i, i, i, same, i), codegen

    @intrinsic
    def same_of_four(typingctx, ids, first, pixels, same, at, pitch):
        """`same_samples` of all four samples at once, the bits of sample s from `at` + `pitch` * s on."""

        def codegen(context, builder, signature, arguments):
            _, first, pixels, _, at, pitch = arguments
            data, target = (array_data(context, builder, signature, arguments, which) for which in (0, 3))

            def step(start, by):
                return [builder.add(start, builder.mul(by, ir.Constant(LONG, s))) for s in range(4)]

            loaded = [load(builder, data, index, VI) for index in step(first, pixels)]
            bits = [ir.Constant(VI, [1 << s] * LANES) for s in range(4)]
            sums = list(bits)
            for s in range(4):
                for other in range(s + 1, 4):
                    equal = builder.sext(builder.icmp_signed("==", loaded[s], loaded[other]), VI)
                    sums[s] = builder.or_(sums[s], builder.and_(equal, bits[other]))
                    sums[other] = builder.or_(sums[other], builder.and_(equal, bits[s]))
            for value, index in zip(sums, step(at, pitch), strict=True):
                store(builder, value, target, index)
            return context.get_dummy_value()

        i = types.int64
        return types.none(ids, i, i, same, i, i), codegen

    @intrinsic
    def copy(typingctx, to, at, codes, first, count):
        """to[at + k] = codes[first + k]; uint32, and nothing beyond is written."""

        def codegen(context, builder, signature, arguments):
            _, at, _, first, count = arguments
            target, source = (array_data(context, builder, signature, arguments, which) for which in (0, 2))
            end = splat(builder, builder.trunc(count, INT), VI)
            with groups(builder, count, counting_from(builder, ir.Constant(INT, 0), VI)) as (k, (lane,)):
                mask = builder.icmp_signed("<", lane, end)
                store_where(builder, mask, load(builder, source, builder.add(first, k), VI), target, builder.add(at, k))
            return context.get_dummy_value()

        return types.none(to, types.int64, codes, types.int64, types.int64), codegen

    def _filler(numbers, value_at):
        """An intrinsic f(g, first, count, *rows and numbers): `numbers` spells their types, i for a row and f for a number, and
        `value_at(builder, data, k, arguments)` gives eight elements from fragment k on."""
        kinds = [types.int64 if letter == "i" else types.float32 for letter in numbers]

        def codegen(context, builder, signature, arguments):
            data, (_, first, count, *rest) = array_data(context, builder, signature, arguments, 0), arguments
            with groups(builder, count) as (k, _):
                store(builder, value_at(builder, data, k, rest), data, builder.add(first, k))
            return context.get_dummy_value()

        return lambda g: (types.none(g, types.int64, types.int64, *kinds), codegen)

    def _ramp(builder, k, x, slope, base):
        xs = builder.fadd(splat(builder, builder.fadd(x, builder.sitofp(k, FLOAT)), VF), IOTA)
        return builder.fadd(builder.fmul(splat(builder, slope, VF), xs), splat(builder, base, VF))

    def _inverse_at(builder, data, k, numbers):
        return builder.fdiv(ir.Constant(VF, [1.0] * LANES), _ramp(builder, k, *numbers))

    def _scaled_at(builder, data, k, numbers):
        scale, x, slope, base, origin = numbers
        value = builder.fmul(_ramp(builder, k, x, slope, base), load(builder, data, builder.add(scale, k), VF))
        return builder.fadd(value, splat(builder, origin, VF))

    def _derivative_at(builder, data, k, numbers):
        scale, value, *rest = numbers
        origin, slope, slope_w, footprint = (splat(builder, number, VF) for number in rest)
        from_origin = builder.fsub(load(builder, data, builder.add(value, k), VF), origin)
        change = builder.fsub(slope, builder.fmul(from_origin, slope_w))
        return builder.fmul(change, builder.fmul(load(builder, data, builder.add(scale, k), VF), footprint))

    _fill = _filler("f", lambda builder, data, k, numbers: splat(builder, numbers[0], VF))
    _plain = _filler("fff", lambda builder, data, k, numbers: _ramp(builder, k, *numbers))
    _inverse = _filler("fff", _inverse_at)
    _scaled = _filler("iffff", _scaled_at)
    _derivative = _filler("iiffff", _derivative_at)

    @intrinsic
    def fill(typingctx, g, first, count, value):
        """g[first + k] = value."""
        return _fill(g)

    @intrinsic
    def ramp(typingctx, g, first, count, x, slope, base):
        """g[first + k] = slope * (x + k) + base."""
        return _plain(g)

    @intrinsic
    def inverse_ramp(typingctx, g, first, count, x, slope, base):
        """g[first + k] = 1 / (slope * (x + k) + base)."""
        return _inverse(g)

    @intrinsic
    def scaled_ramp(typingctx, g, first, count, scale, x, slope, base, origin):
        """g[first + k] = (slope * (x + k) + base) * g[scale + k] + origin."""
        return _scaled(g)

    @intrinsic
    def derivative(typingctx, g, first, count, scale, value, origin, slope, slope_w, footprint):
        """g[first + k] = (slope - (g[value + k] - origin) * slope_w) * (g[scale + k] * footprint)."""
        return _derivative(g)
