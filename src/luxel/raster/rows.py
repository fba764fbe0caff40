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
    from luxel.jit import array_data, cgutils, intrinsic, ir, types
    from luxel.raster.lanes import _B, _F, _I, _IOTA_F, _L, _VF, _VI, _from, _groups, _splat

    _BITS = ir.IntType(LANES)

    def _ids(builder, data, index):
        loaded = builder.load(builder.bitcast(builder.gep(data, [index]), _VI.as_pointer()))
        loaded.align = 4
        return loaded

    @intrinsic
    def where_same(typingctx, ids, first, second, count):
        """Bits k of `count` (1 to 64) where ids[first + k] is ids[second + k]."""

        def codegen(context, builder, signature, arguments):
            data, (_, first, second, count) = array_data(context, builder, signature, arguments, 0), arguments
            entry, loop, done = builder.block, builder.append_basic_block("bits"), builder.append_basic_block("bits_done")
            builder.branch(loop)
            builder.position_at_end(loop)
            k, word = builder.phi(_L), builder.phi(_L)
            k.add_incoming(ir.Constant(_L, 0), entry)
            word.add_incoming(ir.Constant(_L, 0), entry)
            same = builder.icmp_signed("==", _ids(builder, data, builder.add(first, k)), _ids(builder, data, builder.add(second, k)))
            more = builder.or_(word, builder.shl(builder.zext(builder.bitcast(same, _BITS), _L), k))
            following = builder.add(k, ir.Constant(_L, LANES))
            k.add_incoming(following, loop)
            word.add_incoming(more, loop)
            builder.cbranch(builder.icmp_signed("<", following, count), loop, done)
            builder.position_at_end(done)
            unused = builder.sub(ir.Constant(_L, WORD), count)
            return builder.lshr(builder.shl(more, unused), unused)

        return types.uint64(ids, types.int64, types.int64, types.int64), codegen

    @intrinsic
    def same_samples(typingctx, ids, first, pixels, samples, s, same, at):
        """same[at + k] = the bits of the samples whose id at `first` + k is that of sample `s`, for `LANES` pixels; planes lie `pixels` apart."""

        def codegen(context, builder, signature, arguments):
            _, first, pixels, samples, s, _, at = arguments
            data, target = (array_data(context, builder, signature, arguments, which) for which in (0, 5))
            mine = _ids(builder, data, builder.add(first, builder.mul(s, pixels)))
            none = ir.Constant(_VI, [0] * LANES)
            entry, loop, done = builder.block, builder.append_basic_block("samples"), builder.append_basic_block("samples_done")
            builder.branch(loop)
            builder.position_at_end(loop)
            other, plane, bit, bits = builder.phi(_L), builder.phi(_L), builder.phi(_VI), builder.phi(_VI)
            for value, start in ((other, ir.Constant(_L, 0)), (plane, first), (bit, ir.Constant(_VI, [1] * LANES)), (bits, none)):
                value.add_incoming(start, entry)
            same = builder.icmp_signed("==", mine, _ids(builder, data, plane))
            more, following = builder.or_(bits, builder.select(same, bit, none)), builder.add(other, ir.Constant(_L, 1))
            other.add_incoming(following, loop)
            plane.add_incoming(builder.add(plane, pixels), loop)
            bit.add_incoming(builder.add(bit, bit), loop)
            bits.add_incoming(more, loop)
            builder.cbranch(builder.icmp_signed("<", following, samples), loop, done)
            builder.position_at_end(done)
            builder.store(more, builder.bitcast(builder.gep(target, [at]), _VI.as_pointer()), align=4)
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
                return [builder.add(start, builder.mul(by, ir.Constant(_L, s))) for s in range(4)]

            loaded = [_ids(builder, data, index) for index in step(first, pixels)]
            bits = [ir.Constant(_VI, [1 << s] * LANES) for s in range(4)]
            sums = list(bits)
            for s in range(4):
                for other in range(s + 1, 4):
                    equal = builder.sext(builder.icmp_signed("==", loaded[s], loaded[other]), _VI)
                    sums[s] = builder.or_(sums[s], builder.and_(equal, bits[other]))
                    sums[other] = builder.or_(sums[other], builder.and_(equal, bits[s]))
            for value, index in zip(sums, step(at, pitch), strict=True):
                builder.store(value, builder.bitcast(builder.gep(target, [index]), _VI.as_pointer()), align=4)
            return context.get_dummy_value()

        i = types.int64
        return types.none(ids, i, i, same, i, i), codegen

    @intrinsic
    def copy(typingctx, to, at, codes, first, count):
        """to[at + k] = codes[first + k]; uint32, and nothing beyond is written."""

        def codegen(context, builder, signature, arguments):
            _, at, _, first, count = arguments
            target, source = (array_data(context, builder, signature, arguments, which) for which in (0, 2))
            pointer = _VI.as_pointer()
            function_type = ir.FunctionType(ir.VoidType(), [_VI, pointer, _I, ir.VectorType(_B, LANES)])
            store = cgutils.get_or_insert_function(builder.module, function_type, "llvm.masked.store.v8i32.p0")
            end = _splat(builder, builder.trunc(count, _I), _VI)
            with _groups(builder, count, _from(builder, ir.Constant(_I, 0), _VI)) as (k, (lane,)):
                mask = builder.icmp_signed("<", lane, end)
                where = builder.bitcast(builder.gep(target, [builder.add(at, k)]), pointer)
                builder.call(store, [_ids(builder, source, builder.add(first, k)), where, ir.Constant(_I, 4), mask])
            return context.get_dummy_value()

        return types.none(to, types.int64, codes, types.int64, types.int64), codegen

    def _row(builder, data, index):
        """Pointer to eight elements."""
        return builder.bitcast(builder.gep(data, [index]), _VF.as_pointer())

    def _read(builder, data, index):
        loaded = builder.load(_row(builder, data, index))
        loaded.align = 4
        return loaded

    def _filler(numbers, value_at):
        """An intrinsic f(g, first, count, *rows and numbers): `numbers` spells their types, i for a row and f for a number, and
        `value_at(builder, data, k, arguments)` gives eight elements from fragment k on."""
        kinds = [types.int64 if letter == "i" else types.float32 for letter in numbers]

        def codegen(context, builder, signature, arguments):
            data, (_, first, count, *rest) = array_data(context, builder, signature, arguments, 0), arguments
            with _groups(builder, count) as (k, _):
                builder.store(value_at(builder, data, k, rest), _row(builder, data, builder.add(first, k)), align=4)
            return context.get_dummy_value()

        return lambda g: (types.none(g, types.int64, types.int64, *kinds), codegen)

    def _ramp(builder, k, x, slope, base):
        xs = builder.fadd(_splat(builder, builder.fadd(x, builder.sitofp(k, _F)), _VF), _IOTA_F)
        return builder.fadd(builder.fmul(_splat(builder, slope, _VF), xs), _splat(builder, base, _VF))

    def _inverse_at(builder, data, k, numbers):
        return builder.fdiv(ir.Constant(_VF, [1.0] * LANES), _ramp(builder, k, *numbers))

    def _scaled_at(builder, data, k, numbers):
        scale, x, slope, base, origin = numbers
        value = builder.fmul(_ramp(builder, k, x, slope, base), _read(builder, data, builder.add(scale, k)))
        return builder.fadd(value, _splat(builder, origin, _VF))

    def _derivative_at(builder, data, k, numbers):
        scale, value, *rest = numbers
        origin, slope, slope_w, footprint = (_splat(builder, number, _VF) for number in rest)
        from_origin = builder.fsub(_read(builder, data, builder.add(value, k)), origin)
        change = builder.fsub(slope, builder.fmul(from_origin, slope_w))
        return builder.fmul(change, builder.fmul(_read(builder, data, builder.add(scale, k)), footprint))

    _fill = _filler("f", lambda builder, data, k, numbers: _splat(builder, numbers[0], _VF))
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
