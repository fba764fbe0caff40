"""How long each way of convolving takes, so that the cheapest can be taken.

The numbers are nanoseconds on one thread of an Intel Xeon with AVX-512 (model 207), float32, measured by `benchmarks/filter.py --calibrate`,
which prints them for any machine. Only their ratios matter, and those are much alike everywhere; float64 doubles all of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from luxel.filter.tile_fft import SIZES

METHODS = ("separable", "direct", "tiles", "fft", "dct")

_SEPARABLE = (1.15, 0.035)  # a number of the picture, and a tap for it
_DIRECT = (0.65, 0.027)
_FFT = 0.67  # a number of the extended picture and a factor of 2 in its size
_DCT = 0.60
_PAIR = {32: 2.3e3, 64: 10.5e3, 128: 52e3, 256: 270e3, 512: 1.55e6, 1024: 8.5e6, 2048: 38e6}  # two planes of a tile, there and back
_KEPT = 5.0  # a pixel of the two that is kept: brought in and out
_START = {"separable": 20e3, "direct": 20e3, "tiles": 60e3, "fft": 100e3, "dct": 100e3}  # a call


class Plan(NamedTuple):
    """A way to convolve, its tile size where it has one, and its cost in nanoseconds on one thread."""

    method: str
    size: int
    cost: float


def separable(shape: tuple[int, int, int], taps: int) -> Plan:
    """`taps`: of both passes together."""
    return Plan("separable", 0, _START["separable"] + math.prod(shape) * (_SEPARABLE[0] + _SEPARABLE[1] * taps))


def direct(shape: tuple[int, int, int], taps: int) -> Plan:
    """`taps`: weights that are not zero."""
    return Plan("direct", 0, _START["direct"] + math.prod(shape) * (_DIRECT[0] + _DIRECT[1] * taps))


def tiles(shape: tuple[int, int, int], kernel: tuple[int, int], threads: int = 1) -> Plan | None:
    """The best size of overlap-save tiles; None where the kernel is larger than all."""
    plans = []
    for size in SIZES:
        tall, wide = size + 1 - kernel[0], size + 1 - kernel[1]
        if tall > 0 and wide > 0:
            pairs = math.ceil(math.ceil(shape[0] / tall) * math.ceil(shape[1] / wide) * shape[2] / 2)
            rounds = math.ceil(pairs / threads) * threads  # the last ones may leave threads idle
            pair = _PAIR[size] + _KEPT * tall * wide
            plans.append(Plan("tiles", size, _START["tiles"] + rounds * pair + 0.5 * threads * _PAIR[size]))  # and the kernel's own, forward
    return min(plans, key=lambda plan: plan.cost) if plans else None


def fft(shape: tuple[int, int, int], kernel: tuple[int, int]) -> Plan:
    """One transform of the whole extended picture."""
    numbers = (shape[0] + kernel[0] - 1) * (shape[1] + kernel[1] - 1)
    return Plan("fft", 0, _START["fft"] + numbers * (shape[2] + 0.5) * _FFT * math.log2(numbers + 1))


def dct(shape: tuple[int, int, int], reach: int) -> Plan:
    """One cosine transform of the whole picture, extended by `reach` pixels."""
    numbers = (shape[0] + 2 * reach) * (shape[1] + 2 * reach)
    return Plan("dct", 0, _START["dct"] + numbers * shape[2] * _DCT * math.log2(numbers + 1))
