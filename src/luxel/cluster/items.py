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
from luxel.memory import reusable
from luxel.radiosity.hemicube import FACES, ItemBuffers
from luxel.raster.constants import NOTHING
from luxel.raster.cover import BEHIND

_ONE = np.uint64(1)
_MOST = 12
"""Bytes of a pixel that is a run of its own, at most."""

_TOGETHER = 16  # shooters: room for the most bytes that all of them may take would be asked for, and cleared, in vain


@jit.inlined
def _write(value, at, out):
    """Returns where the next number goes."""
    while value > 127:
        out[at] = np.uint8(value & 127 | 128)
        value >>= 7
        at += _ONE
    out[at] = np.uint8(value)
    return at + _ONE


@jit.inlined
def _read(at, data):
    """A number, and where the next one is."""
    byte = np.int64(data[at])
    value, shift = byte & 127, 7
    while byte > 127:
        at += _ONE
        byte = np.int64(data[at])
        value |= (byte & 127) << shift
        shift += 7
    return value, at + _ONE


@jit.parallel_kernel
def _pack(queue, start, resolutions, depth, ids, out, lengths):
    depth, ids, out = jit.borrow(depth), jit.borrow(ids), jit.borrow(out)
    s = jit.take(queue)
    while s < len(lengths):
        into, at, last = out[s], np.uint64(0), np.int64(0)
        i, width = np.uint64(start[s]), np.uint64(resolutions[s])
        for _ in range(np.uint64(start[s + 1] - start[s]) // width):
            end = i + width
            while i < end:
                first, item = i, ids[i]
                while i < end and ids[i] == item:
                    i += _ONE
                at = _write(np.int64(item) - NOTHING, _write(np.int64(i - first), at, into), into)
                slope = np.int64(0)
                for k in range(first, i if item != NOTHING else first):
                    bits = np.int64(float_bits(depth[k]))
                    off = bits - last - slope
                    at = _write((off << 1) ^ (off >> 63), at, into)
                    slope = bits - last if k > first else np.int64(0)
                    last = bits
        lengths[s] = at
        s = jit.take(queue)


@jit.parallel_kernel
def _unpack(queue, start, begin, data, depth, ids):
    depth, ids, data = jit.borrow(depth), jit.borrow(ids), jit.borrow(data)
    s = jit.take(queue)
    while s < len(begin) - 1:
        at, i, last = np.uint64(begin[s]), np.uint64(start[s]), np.int64(0)
        while i < np.uint64(start[s + 1]):
            count, at = _read(at, data)
            item, at = _read(at, data)
            item += NOTHING
            end, slope = i + np.uint64(count), np.int64(0)
            for k in range(i, end):
                ids[k] = item
                if item == NOTHING:
                    depth[k] = BEHIND
                    continue
                off, at = _read(at, data)
                bits = last + slope + ((off >> 1) ^ -(off & 1))
                depth[k] = bits_float(np.int32(bits))
                slope = bits - last if k > i else np.int64(0)
                last = bits
            i = end
        s = jit.take(queue)


def pack(seen: ItemBuffers, threads: int) -> tuple[Array, Array]:
    """What s shooters see, as bytes (n,) uint8; and how many each of them has, (s,) int64."""
    count = len(seen.resolution)
    most = FACES * int(seen.resolution.max(initial=0)) ** 2 * _MOST
    out, lengths = reusable((min(count, _TOGETHER), most), np.uint8), np.zeros(count, np.int64)
    packed = [np.zeros(0, np.uint8)]
    for first in range(0, count, _TOGETHER):
        last = min(first + _TOGETHER, count)
        some = lengths[first:last]
        jit.run(_pack, threads, seen.start[first : last + 1], seen.resolution[first:last], seen.depth, seen.ids, out, some)
        packed += [row[:length].copy() for row, length in zip(out, some, strict=False)]
    return np.concatenate(packed), lengths


def unpack(data: Array, lengths: Array, seen: ItemBuffers, threads: int) -> None:
    """Write what `pack` told of s shooters to their item buffers."""
    jit.run(_unpack, threads, seen.start, np.append(0, np.cumsum(lengths)), data, seen.depth, seen.ids)
