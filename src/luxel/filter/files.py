"""Low-pass filters from file to file: whole, or, where that does not fit in memory, in bands from disk to disk."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError, InputError
from luxel.filter import light, png_rows
from luxel.filter.filters import checked_picture
from luxel.io.files import atomic_write, door

ENCODED = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
EXTENSIONS = (*ENCODED, ".exr", ".npy")
_BAND = 1 << 25  # bytes of rows read at once


class Source(NamedTuple):
    """A picture in a file: (h, w, c) numbers, in memory or on disk (a memory map), and how wide a PNG of it should be."""

    array: Array
    bits: int


@contextmanager
def opened(path: Path, memory: int) -> Iterator[Source]:
    """The picture in a file. Where it has more than `memory` bytes as float32 it stays on disk: .npy as it is, .png unpacked beside the
    system's temporary files.

    Raises:
        FileError: The file is missing or damaged, or holds no picture.
    """
    head = png_rows.header(path)
    if path.suffix.lower() == ".npy":
        yield _npy(path)
    elif head is None:
        yield _whole(path)
    elif 4 * np.prod(head.shape, dtype=float) <= memory:
        out = np.empty(head.shape, f"u{head.bits // 8}")
        yield Source(_filled(out, path), head.bits)
    else:
        with tempfile.TemporaryFile(prefix="luxel") as file:
            yield Source(_filled(np.memmap(file, f"u{head.bits // 8}", shape=head.shape), path), head.bits)


def _filled(out: Array, path: Path) -> Array:
    first, stride = 0, int(np.prod(out.shape[1:])) * out.dtype.itemsize
    for band in png_rows.bands(path, max(1, _BAND // stride)):
        out[first : first + len(band)] = band
        first += len(band)
    return out


def _npy(path: Path) -> Source:
    with door(path, "not an array of NumPy's"):
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    try:
        checked, _ = checked_picture(array)
    except InputError as error:
        raise FileError(path, str(error)) from error
    return Source(checked, 16 if array.dtype == np.uint16 else 8)


def _whole(path: Path) -> Source:
    from luxel.io.images import read_image

    image = read_image(path)
    with open(path, "rb") as file:
        start = file.read(4)
    if image.dtype == np.float32 and start != b"\x76\x2f\x31\x01" and start[:2] != b"#?":  # 16-bit grey, still encoded
        return Source(np.round(image * np.float32(65535)).astype(np.uint16), 16)
    return Source(image, 8)


class Sink:
    """Writes rows of linear light, in order, encoded as the file's name says; the file appears whole or not at all.

    Args:
        path: .png, .npy and whatever holds 8 bits take rows as they come; .exr and 8-bit files other than .png are collected first.
        shape: (h, w, c).
        dtype: Of the source: integers in, integers out, where the file can hold them.
        bits: Of a PNG.
        threads: For encoding.
    """

    def __init__(self, path: str | Path, shape: tuple[int, int, int], dtype: object, bits: int, threads: int) -> None:
        self.path, self.shape, self.threads = Path(path), shape, threads
        self.extension = self.path.suffix.lower()
        if self.extension not in EXTENSIONS:
            raise InputError(f"expected a file name that ends in one of {', '.join(EXTENSIONS)}, got {str(path)!r}")
        self.dtype = stored_dtype(self.path, dtype, bits)
        self._stack: Any = None
        self._rows: list[Array] = []
        self._stream: Any = None

    def __enter__(self) -> Sink:
        from luxel.io.png import PngStream

        self._stack = ExitStack()
        height, width, channels = self.shape
        if self.extension == ".png":
            self._stream = self._stack.enter_context(PngStream(self.path, width, height, channels, 8 * self.dtype.itemsize))
        elif self.extension == ".npy":
            file = self._stack.enter_context(atomic_write(self.path))
            np.lib.format.write_array_header_1_0(file, {"descr": self.dtype.str, "fortran_order": False, "shape": self.shape})
            self._stream = file
        return self

    def write(self, rows: Array) -> None:
        """Append (k, w, c): linear light, float32 or float64, or numbers as they are stored (`encoded`)."""
        rows = encoded(rows, self.dtype, self.threads)
        if self.extension == ".png":
            self._stream.write(rows)
        elif self.extension == ".npy":
            self._stream.write(np.ascontiguousarray(rows).data)
        else:
            self._rows.append(rows)

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)
        if self._rows and error[0] is None:
            from luxel.io.images import write_exr, write_image

            whole = np.concatenate(self._rows)
            if self.extension == ".exr":
                write_exr(self.path, {"": whole})
            else:
                write_image(self.path, whole)


def decoded(rows: Array, threads: int) -> Array:
    """Rows as they are stored to linear light, float32 or float64."""
    if rows.dtype.kind == "u":
        return light.decode(rows, True, threads)
    return np.ascontiguousarray(rows, np.float32 if rows.dtype.itemsize < 8 else np.float64)


def encoded(rows: Array, dtype: Any, threads: int) -> Array:
    """The inverse of `decoded`; rows that are stored as `dtype` already stay as they are."""
    if dtype.kind == "u" and rows.dtype != dtype:
        return light.encode(np.ascontiguousarray(rows, np.float32), dtype, True, threads)
    return rows.astype(dtype, copy=False)


def stored_dtype(path: Path, dtype: object, bits: int) -> Any:
    """What a file of this name holds of a picture of `dtype`, with so many bits where it is a PNG."""
    extension = path.suffix.lower()
    if extension == ".npy":
        return np.dtype(dtype)  # type: ignore[call-overload]
    if extension == ".exr":
        return np.dtype(np.float32)
    return np.dtype(f"u{bits // 8}" if extension == ".png" else np.uint8)


def kernel_file(path: Path, memory: int = 1 << 26) -> Array:
    """Weights from a file: .npy as they are; a picture as grey values in linear light, scaled to sum to 1.

    Raises:
        FileError: It cannot be read, or is black.
    """
    with opened(path, memory) as source:
        array = np.array(source.array)
    if path.suffix.lower() == ".npy" and array.dtype.kind == "f":
        return array.astype(np.float64)[..., 0]
    linear = decoded(array, 1).astype(np.float64)
    grey = linear[..., :3].mean(-1) if linear.shape[2] >= 3 else linear[..., 0]
    if not grey.sum() > 0:
        raise FileError(path, "a kernel is scaled to sum to 1, this one is black")
    return grey / grey.sum()

