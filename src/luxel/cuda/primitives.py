"""What is the GPU's own: its instructions for bits and for memory that threads share, and `luxel.raster` executed again with them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from luxel.cuda.again import Again
from luxel.cuda.door import SIMULATED, cuda, function, libdevice

if SIMULATED:

    def _float_bits(value):
        return np.float32(value).view(np.int32)

    def _bits_float(bits):
        return np.int32(bits).view(np.float32)

    def _lowest_bit(bits):
        return (int(bits) & -int(bits)).bit_length() - 1

    def _count_bits(bits):
        return int(bits).bit_count()

    def _floor(value):
        return np.floor(value)

    def _floor32(value):
        return np.floor(value)

else:

    def _float_bits(value):
        return libdevice.float_as_int(value)

    def _bits_float(bits):
        return libdevice.int_as_float(bits)

    def _lowest_bit(bits):
        return np.int64(cuda.ffs(bits)) - 1

    def _count_bits(bits):
        return np.int64(cuda.popc(bits))

    def _floor(value):
        return libdevice.floor(value)

    def _floor32(value):
        return libdevice.floorf(value)


def _prefetch(array, index):
    pass


@function
def keep_least(values, i, value):
    """values[i] = min(values[i], value)."""
    cuda.atomic.min(values, i, value)


@function
def keep_most(values, i, value):
    """values[i] = max(values[i], value)."""
    cuda.atomic.max(values, i, value)


@function
def add(values, i, value):
    """values[i] += value; returns what was there before."""
    return cuda.atomic.add(values, i, value)


def _nothing(kernel):
    return None


_JIT = SimpleNamespace(
    DISABLED=True, device=function, part=function, inlined=function, kernel=_nothing, parallel_kernel=_nothing, float_bits=function(_float_bits),
    bits_float=function(_bits_float), lowest_bit=function(_lowest_bit), count_bits=function(_count_bits), prefetch=function(_prefetch),
    floor=function(_floor), floor32=function(_floor32),
)  # fmt: skip
_MACHINE = SimpleNamespace(keep_least=keep_least, keep_most=keep_most, add=add)

again = Again("cuda", {"luxel.jit": _JIT, "luxel.cuda.machine": _MACHINE}, function).load
"""A module of `luxel.raster` or `luxel.cuda.threads`, for the GPU."""
