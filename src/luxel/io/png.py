"""A PNG writer that takes bands of rows, for pictures larger than memory (PNG, third edition, W3C 2025)."""

from __future__ import annotations

import os
import struct
import zlib
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from types import TracebackType
from typing import IO

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.io.files import atomic_write

_COLOR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}  # channels: colour type
_BAND = 1 << 22  # bytes compressed as one piece
_LEVEL = 1  # level 6 saves a tenth of the size of a rendering and takes four times as long


class PngStream:
    """Writes a PNG of 8 or 16 bits from bands of rows, top to bottom, in bounded memory; the file appears whole, or not at all.

    >>> with PngStream("large.png", 16384, 16384) as png:  # doctest: +SKIP
    ...     for rows in bands:
    ...         png.write(rows)
    """

    def __init__(self, path: str | os.PathLike[str], width: int, height: int, channels: int = 4, bits: int = 8) -> None:
        """`channels`: 1 grey, 2 grey and alpha, 3 RGB, 4 RGBA (alpha straight); `bits`: 8 or 16 a channel.

        Raises:
            InputError: A size or channel count that PNG cannot hold, or another extension than .png.
        """
        if os.path.splitext(os.fspath(path))[1].lower() != ".png":
            raise InputError(f"PNG: expected a file name that ends in .png, got {os.fspath(path)!r}")
        if not (0 < width < 2**31 and 0 < height < 2**31 and channels in _COLOR_TYPES):
            raise InputError(f"PNG: expected width and height in 1..2^31-1 and 1..4 channels, got {width} x {height} x {channels}")
        if bits not in (8, 16):
            raise InputError(f"PNG: expected 8 or 16 bits, got {bits}")
        self.path, self.width, self.height, self.channels, self.bits = path, width, height, channels, bits
        self.rows = 0
        self._above = np.zeros((1, width * channels * bits // 8), np.uint8)
        self._adler = 1
        self._stack = ExitStack()
        self._file: IO[bytes] | None = None
        self._pieces: list[Future[bytes]] = []

    def __enter__(self) -> PngStream:
        self._file = self._stack.enter_context(atomic_write(self.path))
        # Pieces are deflated on their own, so on several cores; the order of the threads does not change the file.
        self._pool = self._stack.enter_context(ThreadPoolExecutor(min(os.cpu_count() or 1, 4)))
        self._file.write(b"\x89PNG\r\n\x1a\n")
        self._chunk(b"IHDR", struct.pack(">IIBBBBB", self.width, self.height, self.bits, _COLOR_TYPES[self.channels], 0, 0, 0))
        self._chunk(b"sRGB", b"\0")
        self._chunk(b"IDAT", b"\x78\x01")
        return self

    def write(self, rows: Array) -> None:
        """Append rows (k, width, channels) uint8 (uint16 where there are 16 bits), or (k, width) for one channel.

        Raises:
            InputError: They do not fit the picture, or are more than are left.
        """
        rows = np.asarray(rows)
        shape = (self.width, self.channels)
        if self._file is None:
            raise InputError("PngStream: write is for inside its with block")
        if rows.dtype != np.dtype(f"u{self.bits // 8}") or (rows.shape[1:] != shape and (rows.shape[1:] != shape[:1] or self.channels > 1)):
            raise InputError(f"PNG rows: expected (k, {self.width}, {self.channels}) uint{self.bits}, got {rows.shape} {rows.dtype}")
        if self.rows + len(rows) > self.height:
            raise InputError(f"PNG rows: {self.rows} + {len(rows)} of {self.height}")
        stride = self._above.shape[1]
        step = max(1, _BAND // stride)
        for start in range(0, len(rows), step):
            piece = rows[start : start + step]
            plain = piece if self.bits == 8 else piece.astype(">u2").view(np.uint8)  # big-endian, says PNG
            self._piece(plain.reshape(-1, stride))
        self.rows += len(rows)

    def _piece(self, rows: Array) -> None:
        """Filter rows (differences to the row above: one pass, and nearly the best for renderings) and deflate them."""
        filtered = np.empty((len(rows), rows.shape[1] + 1), np.uint8)
        filtered[:, 0] = 2
        np.subtract(rows[:1], self._above, out=filtered[:1, 1:])
        np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
        self._above = rows[-1:].copy()
        self._adler = zlib.adler32(filtered.data, self._adler)
        self._pieces.append(self._pool.submit(_deflate, filtered))
        while len(self._pieces) > 4:
            self._chunk(b"IDAT", self._pieces.pop(0).result())

    def _chunk(self, kind: bytes, data: bytes) -> None:
        assert self._file is not None
        self._file.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            if kind is None:
                if self.rows != self.height:
                    raise InputError(f"PNG {self.path}: {self.rows} rows were written, expected {self.height}")
                for piece in self._pieces:
                    self._chunk(b"IDAT", piece.result())
                end = zlib.compressobj(_LEVEL, zlib.DEFLATED, -15).flush(zlib.Z_FINISH)
                self._chunk(b"IDAT", end + struct.pack(">I", self._adler))
                self._chunk(b"IEND", b"")
        except BaseException as failure:
            self._stack.__exit__(type(failure), failure, failure.__traceback__)
            raise
        finally:
            self._file = None
        self._stack.__exit__(kind, error, trace)


def _deflate(data: Array) -> bytes:
    """Raw deflate blocks that end on a byte, so that pieces follow one another."""
    packer = zlib.compressobj(_LEVEL, zlib.DEFLATED, -15)
    return packer.compress(data.data) + packer.flush(zlib.Z_FULL_FLUSH)
