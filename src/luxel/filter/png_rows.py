"""PNG files read in bands of rows, 8 and 16 bits a channel (PNG, third edition, W3C 2025): Pillow reads whole files, and 16-bit colours as 8."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.files import open_plain

_MAGIC = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}
_READ = 1 << 20


class Header(NamedTuple):
    """What a PNG holds: height, width and channels, and bits a channel."""

    shape: tuple[int, int, int]
    bits: int


def header(path: Path) -> Header | None:
    """The header of a file that `bands` can read; None for any other: no PNG, palettes, fewer than 8 bits, interlaced, a transparent colour.

    Raises:
        FileError: The file cannot be opened.
    """
    with open_plain(path) as file:
        start = file.read(33)
        if len(start) < 33 or start[:8] != _MAGIC or start[12:16] != b"IHDR":
            return None
        width, height, bits, kind, _, _, interlaced = struct.unpack(">IIBBBBB", start[16:29])
        if kind not in _CHANNELS or bits not in (8, 16) or interlaced or not (width and height):
            return None
        while True:
            length, name = _chunk(file, path)
            if name == b"tRNS":
                return None
            if name in (b"IDAT", b"IEND"):
                return Header((height, width, _CHANNELS[kind]), bits)
            file.seek(length + 4, 1)


def _chunk(file: IO[bytes], path: Path) -> tuple[int, bytes]:
    head = file.read(8)
    if len(head) < 8:
        raise FileError(path, "the file ends before its picture does")
    length, name = struct.unpack(">I4s", head)
    return length, name


def bands(path: Path, rows: int) -> Iterator[Array]:
    """Bands (up to `rows`, w, c) uint8 or uint16 of a file that `header` knows, from the top.

    Raises:
        FileError: The file ends early, or is damaged.
    """
    known = header(path)
    assert known is not None
    (height, width, channels), pixel = known.shape, known.shape[2] * known.bits // 8
    stride = width * pixel
    above = np.zeros(stride, np.uint8)
    with open_plain(path) as file:
        file.seek(8)
        stream = _inflated(file, path)
        held = b""
        for first in range(0, height, rows):
            count = min(rows, height - first)
            pieces, have = [held], len(held)
            while have < count * (stride + 1):
                piece = next(stream, b"")
                if not piece:
                    raise FileError(path, f"the picture ends in row {first + have // (stride + 1)} of {height}")
                pieces.append(piece)
                have += len(piece)
            data = b"".join(pieces)
            held = data[count * (stride + 1) :]
            filtered = np.frombuffer(data, np.uint8, count * (stride + 1)).reshape(count, stride + 1)
            plain = np.empty((count, stride), np.uint8)
            odd = _unfilter(filtered, above, plain, pixel)
            if odd >= 0:
                raise FileError(path, f"row {first + odd}: {filtered[odd, 0]} is no filter of PNG")
            above = plain[-1].copy()
            if known.bits == 16:
                yield plain.view(">u2").astype(np.uint16).reshape(count, width, channels)
            else:
                yield plain.reshape(count, width, channels)


def _inflated(file: IO[bytes], path: Path) -> Iterator[bytes]:
    """The bytes of all IDAT chunks, unpacked, in pieces of bounded size."""
    packed = zlib.decompressobj()
    while True:
        length, name = _chunk(file, path)
        if name == b"IEND":
            return
        if name != b"IDAT":
            file.seek(length + 4, 1)
            continue
        check = zlib.crc32(name)
        while length:
            data = file.read(min(length, _READ))
            if not data:
                raise FileError(path, "the file ends before its picture does")
            length -= len(data)
            check = zlib.crc32(data, check)
            try:
                while data:
                    piece = packed.decompress(data, _READ)
                    data = packed.unconsumed_tail
                    if piece:
                        yield piece
            except zlib.error as error:
                raise FileError(path, f"damaged: {error}") from error
        if file.read(4) != struct.pack(">I", check):
            raise FileError(path, "damaged: a checksum is wrong")


@jit.kernel
def _unfilter(filtered, above, plain, pixel):
    """Undo the filters of rows; the first row whose filter there is not, or -1."""
    for y in range(len(filtered)):
        kind, row = filtered[y, 0], plain[y]
        if kind > 4:
            return y
        for x in range(len(row)):
            value = np.int64(filtered[y, x + 1])
            a = np.int64(row[x - pixel]) if x >= pixel else 0
            b = np.int64(above[x])
            if kind == 1:
                value += a
            elif kind == 2:
                value += b
            elif kind == 3:
                value += (a + b) >> 1
            elif kind == 4:
                c = np.int64(above[x - pixel]) if x >= pixel else 0
                p = a + b - c
                if abs(p - a) <= abs(p - b) and abs(p - a) <= abs(p - c):
                    value += a
                else:
                    value += b if abs(p - b) <= abs(p - c) else c
            row[x] = value & 255
        above = row
    return -1
