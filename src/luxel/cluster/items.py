"""Items: what hemicubes show, as few bytes.

Item buffers are runs of one triangle along a row. A run is its length, its triangle, and its depths, which over a triangle are a plane: each is told
by how far its bits are from where the two before it lead, mostly not at all or by one. All numbers are written in bytes of seven bits, the last of
each without the eighth (LEB128), signed ones as zigzag; so nothing is lost, and of the eight bytes of a pixel about one is sent.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import bits_float, float_bits
from luxel.radiosity.hemicube import FACES, ItemBuffers
from luxel.raster.constants import NOTHING
from luxel.raster.cover import BEHIND

_MOST = 12
"""Bytes of a pixel that is a run of its own, at most."""


@jit.inlined
def _write(value, at, out):
    """Returns where the next number goes."""
    while value > 127:
        out[at] = np.uint8(value & 127 | 128)
        value >>= 7
        at += 1
    out[at] = np.uint8(value)
    return at + 1


@jit.inlined
def _read(at, data):
    """A number, and where the next one is."""
    value, shift = np.int64(0), 0
    while data[at] > 127:
        value |= np.int64(data[at] & 127) << shift
        shift += 7
        at += 1
    return value | np.int64(data[at]) << shift, at + 1


@jit.inlined
def _guess(before, last, k):
    """The bits of depth `k` of a run, from the two before."""
    return 2 * last - before if k > 1 else last


@jit.parallel_kernel
def _pack(queue, start, resolutions, depth, ids, out, lengths):
    depth, ids, out = jit.borrow(depth), jit.borrow(ids), jit.borrow(out)
    s = jit.take(queue)
    while s < len(lengths):
        into, at, last = out[s], 0, np.int64(0)
        i, end, width = np.int64(start[s]), np.int64(start[s + 1]), np.int64(resolutions[s])
        while i < end:
            row_end, first = i + width - (i - start[s]) % width, i
            while i < row_end and ids[i] == ids[first]:
                i += 1
            at = _write(np.int64(ids[first]) - NOTHING, _write(i - first, at, into), into)
            before = last
            for k in range(i - first if ids[first] != NOTHING else 0):
                bits = np.int64(float_bits(depth[first + k]))
                off = bits - _guess(before, last, k)
                at = _write(2 * off if off >= 0 else -2 * off - 1, at, into)
                before, last = last, bits
        lengths[s] = at
        s = jit.take(queue)


@jit.parallel_kernel
def _unpack(queue, start, begin, data, depth, ids):
    depth, ids, data = jit.borrow(depth), jit.borrow(ids), jit.borrow(data)
    s = jit.take(queue)
    while s < len(begin) - 1:
        at, i, last = np.int64(begin[s]), np.int64(start[s]), np.int64(0)
        while i < start[s + 1]:
            count, at = _read(at, data)
            item, at = _read(at, data)
            item += NOTHING
            before = last
            for k in range(count):
                ids[i + k] = item
                if item == NOTHING:
                    depth[i + k] = BEHIND
                    continue
                off, at = _read(at, data)
                bits = _guess(before, last, k) + (off >> 1 if off & 1 == 0 else -(off + 1 >> 1))
                depth[i + k] = bits_float(np.int32(bits))
                before, last = last, bits
            i += count
        s = jit.take(queue)


def pack(seen: ItemBuffers, threads: int) -> tuple[Array, Array]:
    """What s shooters see, as bytes (n,) uint8; and how many each of them has, (s,) int64."""
    count = len(seen.resolution)
    most = FACES * int(seen.resolution.max(initial=0)) ** 2 * _MOST
    out, lengths = np.empty((count, most), np.uint8), np.zeros(count, np.int64)
    jit.run(_pack, threads, seen.start, seen.resolution, seen.depth, seen.ids, out, lengths)
    return np.concatenate([np.zeros(0, np.uint8), *(row[:length] for row, length in zip(out, lengths, strict=True))]), lengths


def unpack(data: Array, lengths: Array, start: Array, depth: Array, ids: Array, threads: int) -> None:
    """Write what `pack` told of s shooters to `depth` and `ids`, from `start` (s + 1,) on; see `ItemBuffers`."""
    jit.run(_unpack, threads, start, np.append(0, np.cumsum(lengths)), data, depth, ids)
