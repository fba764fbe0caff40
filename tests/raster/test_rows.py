"""Runs of fragments in vector instructions: bit for bit what the plain loops say, and nothing read or written beyond what is granted.

Rows lie in the middle of poisoned memory; and, in a process of their own, against pages that may not be touched.
"""

import ctypes
import mmap
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel import jit
from luxel.raster import rows
from luxel.raster.lanes import LANES

F = np.float32
POISON = 12345.0
COUNTS = st.integers(1, 70)
POSITIONS = st.integers(-(2**22), 2**22).map(lambda n: F(n / 256))  # multiples of 1/256 below 2^15
NUMBERS = st.floats(-1e3, 1e3, width=32).map(F)


@jit.kernel
def where_same(out, ids, first, second, count):
    out[0] = rows.where_same(ids, first, second, count)


@jit.kernel
def where_four_same(out, ids, first, pixels, count):
    out[0] = rows.where_four_same(ids, first, pixels, count)


@jit.kernel
def same_samples(ids, first, pixels, samples, s, same, at):
    rows.same_samples(ids, first, pixels, samples, s, same, at)


@jit.kernel
def same_of_four(ids, first, pixels, same, at, pitch):
    rows.same_of_four(ids, first, pixels, same, at, pitch)


@jit.kernel
def copy(to, at, codes, first, count):
    rows.copy(to, at, codes, first, count)


@jit.kernel
def fill(g, first, count, value):
    rows.fill(g, first, count, value)


@jit.kernel
def ramp(g, first, count, x, slope, base):
    rows.ramp(g, first, count, x, slope, base)


@jit.kernel
def inverse_ramp(g, first, count, x, slope, base):
    rows.inverse_ramp(g, first, count, x, slope, base)


@jit.kernel
def scaled_ramp(g, first, count, scale, x, slope, base, origin):
    rows.scaled_ramp(g, first, count, scale, x, slope, base, origin)


@jit.kernel
def derivative(g, first, count, scale, value, origin, slope, slope_w, footprint):
    rows.derivative(g, first, count, scale, value, origin, slope, slope_w, footprint)


def groups(count):
    """What is granted to a row of `count`: whole groups of lanes."""
    return -(-count // LANES) * LANES


def check_row(g, before, first, count, expected):
    """`count` numbers from `first` on are as expected, bit for bit, and beyond their groups nothing has changed."""
    assert np.array_equal(g[first : first + count].view(np.int32), expected.astype(F).view(np.int32))
    untouched = np.ones(len(g), bool)
    untouched[first : first + groups(count)] = False
    assert np.array_equal(g[untouched], before[untouched])


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), COUNTS, st.integers(0, 20), POSITIONS, NUMBERS, NUMBERS, NUMBERS, NUMBERS)
def test_rows_are_filled(seed, count, first, x, slope, base, origin, other):
    start = np.random.default_rng(seed).random(300).astype(F)
    at = x + np.arange(count, dtype=F)
    scale, value = 100, 200  # other rows
    with np.errstate(all="ignore"):
        line = slope * at + base
        s, v = start[scale : scale + count], start[value : value + count]
        cases = [(fill, (base,), np.full(count, base)), (ramp, (x, slope, base), line), (inverse_ramp, (x, slope, base), F(1) / line),
                 (scaled_ramp, (scale, x, slope, base, origin), line * s + origin),
                 (derivative, (scale, value, origin, slope, base, other), (slope - (v - origin) * base) * (s * other))]  # fmt: skip
        for kernel, arguments, expected in cases:
            g = start.copy()
            kernel(g, first, count, *arguments)
            check_row(g, start, first, count, expected)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, rows.WORD), st.integers(0, 9), st.integers(0, 9))
def test_equal_ids_are_bits(seed, count, first, second):
    ids = np.random.default_rng(seed).integers(-1, 2, 200, dtype=np.int32)
    out = np.zeros(1, np.uint64)
    where_same(out, ids, first, 80 + second, count)
    equal = ids[first : first + count] == ids[80 + second : 80 + second + count]
    assert int(out[0]) == sum(1 << k for k in range(count) if equal[k])


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, rows.WORD), st.integers(0, 9), st.integers(0, 9))
def test_pixels_whose_four_samples_are_equal_are_bits(seed, count, first, spare):
    pixels = 80 + spare
    ids = np.random.default_rng(seed).choice(np.array([5, 5, 5, 5, -1], np.int32), 4 * pixels)
    out = np.zeros(1, np.uint64)
    where_four_same(out, ids, first, pixels, count)
    planes = ids.reshape(4, pixels)[:, first : first + count]
    assert int(out[0]) == sum(1 << k for k in range(count) if (planes[:, k] == planes[0, k]).all())


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 4, 8, 16]), st.integers(0, 12), st.integers(0, 30))
def test_samples_of_one_id_are_bits(seed, samples, first, at):
    pixels, pitch = 40, 50
    ids = np.random.default_rng(seed).integers(-1, 3, samples * pixels, dtype=np.int32)
    planes = ids.reshape(samples, pixels)[:, first : first + LANES]
    expected = (planes[:, None] == planes[None]).astype(np.int64).transpose(0, 2, 1) @ (1 << np.arange(samples))
    for s in range(samples):
        same = np.full(200, -7, np.int32)
        same_samples(ids, first, pixels, samples, s, same, at)
        assert np.array_equal(same[at : at + LANES], expected[s])
        assert (np.delete(same, slice(at, at + LANES)) == -7).all()
    if samples == 4:
        same = np.full(300, -7, np.int32)
        same_of_four(ids, first, pixels, same, at, pitch)
        written = np.concatenate([np.arange(at + pitch * s, at + pitch * s + LANES) for s in range(4)])
        assert np.array_equal(same[written], expected.reshape(-1))
        assert (np.delete(same, written) == -7).all()


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), COUNTS, st.integers(0, 9), st.integers(0, 9))
def test_copies_end_where_they_are_told(seed, count, at, first):
    codes = np.random.default_rng(seed).integers(0, 2**32, 100, dtype=np.uint32)
    to = np.full(120, 7, np.uint32)
    copy(to, at, codes, first, count)
    assert np.array_equal(to[at : at + count], codes[first : first + count])
    assert (np.delete(to, slice(at, at + count)) == 7).all()


def against_a_wall(count, dtype):
    """`count` elements that end where a page begins that may not be touched."""
    size = np.dtype(dtype).itemsize
    pages = -(-count * size // mmap.PAGESIZE)
    memory = mmap.mmap(-1, (pages + 1) * mmap.PAGESIZE)
    whole = np.frombuffer(memory, np.uint8)
    wall = whole.ctypes.data + pages * mmap.PAGESIZE
    protect = ctypes.CDLL(None, use_errno=True).mprotect
    protect.argtypes = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
    assert protect(wall, mmap.PAGESIZE, 0) == 0, ctypes.get_errno()
    return whole[pages * mmap.PAGESIZE - count * size : pages * mmap.PAGESIZE].view(dtype)


def touch_nothing_else():
    for count in range(1, 66):
        room = groups(count)
        g = against_a_wall(3 * room, F)
        last = 2 * room
        for kernel, numbers in ((fill, (1,)), (ramp, (0, 1, 1)), (inverse_ramp, (0, 1, 1))):
            kernel(g, last, count, *map(F, numbers))
        scaled_ramp(g, 0, count, last, F(0), F(1), F(1), F(0))
        scaled_ramp(g, last, count, 0, F(0), F(1), F(1), F(0))
        derivative(g, 0, count, room, last, F(0), F(1), F(1), F(1))
        derivative(g, last, count, 0, room, F(0), F(1), F(1), F(1))
        copy(against_a_wall(count, np.uint32), 0, against_a_wall(room, np.uint32), 0, count)
        if count <= rows.WORD:
            where_same(np.zeros(1, np.uint64), against_a_wall(2 * room, np.int32), 0, room, count)
            where_four_same(np.zeros(1, np.uint64), against_a_wall(4 * room, np.int32), 0, room, count)
    for samples in (2, 4, 16):
        same_samples(against_a_wall(samples * LANES, np.int32), 0, LANES, samples, samples - 1, against_a_wall(LANES, np.int32), 0)
    same_of_four(against_a_wall(4 * LANES, np.int32), 0, LANES, against_a_wall(4 * LANES, np.int32), 0, LANES)
    try:
        wall = against_a_wall(4, F)
        print("nothing else was touched", flush=True)
        ctypes.memset(wall.ctypes.data, 0, 17)  # the wall holds
    finally:
        print("the wall does not hold")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="pages are protected by Linux's mprotect")
def test_nothing_beyond_is_touched():
    done = subprocess.run([sys.executable, __file__], capture_output=True, text=True, check=False)
    assert done.stdout == "nothing else was touched\n", done.stderr
    assert done.returncode < 0  # by the signal that says so


if __name__ == "__main__":
    touch_nothing_else()
