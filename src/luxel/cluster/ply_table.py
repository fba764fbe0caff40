"""Tables of a binary PLY file: elements whose rows are alike, so that any rank can read any of them without the others."""

from __future__ import annotations

import mmap
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import IO, Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.ply import INDEX_NAMES
from luxel.io.ply_rows import Element, row_fields

PIECE = 1 << 17
"""Rows that are read together."""
_TOGETHER = 1 << 14  # rows here and there whose pages are in memory at one time


class Table:
    """An element of a binary file whose rows are alike.

    Attributes:
        rows: How many.
        dtype: Of a row; the fields that are list lengths are in `lengths`.
        fields: The field of each property.
        begin, end: Its bytes.
    """

    def __init__(self, element: Element, begin: int) -> None:
        self.element, self.rows, self.begin = element, element.rows, begin
        self.dtype, self.lengths = row_fields(element, {prop.name: 3 for prop in element.properties if prop.count is not None})
        self.fields = dict(zip((prop.name for prop in element.properties), (n for i, n in enumerate(self.dtype.names or ()) if i not in self.lengths),
                               strict=True))  # fmt: skip
        self.end = begin + self.rows * self.dtype.itemsize

    def stacked(self, rows: Any, names: Iterable[str]) -> Array:
        """(n, 3) float32: three properties of rows."""
        return np.stack([rows[self.fields[name]].astype(np.float32) for name in names], 1)

    def read(self, file: IO[bytes], first: int, last: int, piece: int = PIECE) -> Iterator[tuple[int, Any]]:
        """Rows first .. last - 1, some at a time."""
        file.seek(self.begin + first * self.dtype.itemsize)
        for start in range(first, last, piece):
            with self._reading(file):
                rows = np.fromfile(file, self.dtype, min(piece, last - start))
            if len(rows) < min(piece, last - start):
                raise FileError(f"{file.name}, element {self.element.name}", f"the file ends in row {start + len(rows)} of {self.rows}")
            yield start, rows

    @contextmanager
    def _reading(self, file: IO[bytes]) -> Iterator[None]:
        """Around reading alone, so that what a disk says is told of the file that it is about."""
        try:
            yield
        except OSError as error:
            raise FileError(f"{file.name}, element {self.element.name}", f"cannot read: {error.strerror or error}") from error

    def take(self, file: IO[bytes], numbers: Array) -> Any:
        """The rows `numbers` (k,), which had better ascend; their pages do not stay in memory."""
        out = np.empty(len(numbers), self.dtype)
        if not len(numbers):
            return out
        with self._reading(file), mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as pages:
            whole = np.ndarray(self.rows, self.dtype, pages, self.begin)
            if hasattr(mmap, "MADV_RANDOM"):
                pages.madvise(mmap.MADV_RANDOM)
            for start in range(0, len(numbers), _TOGETHER):
                out[start : start + _TOGETHER] = whole[numbers[start : start + _TOGETHER]]
                if hasattr(mmap, "MADV_DONTNEED"):
                    pages.madvise(mmap.MADV_DONTNEED)
            del whole
        return out


def tables_of(elements: list[Element], begin: int) -> tuple[Table, Table] | None:
    """The vertices and the faces, if every row of them can be found without the others."""
    found = {}
    for element in elements:
        lists = [prop.name for prop in element.properties if prop.count is not None]
        if len(lists) != (element.name == "face") or (lists and lists[0] not in INDEX_NAMES):
            break  # where the next element begins is not known
        found[element.name] = Table(element, begin)
        begin = found[element.name].end
    if not {"vertex", "face"} <= found.keys() or "tristrips" in {element.name for element in elements}:
        return None
    if not {"x", "y", "z"} <= found["vertex"].fields.keys():
        return None
    return found["vertex"], found["face"]


def corners(face: Table, file: IO[bytes], first: int, last: int) -> Array | None:
    """(k, 3): vertices of the faces first .. last - 1, as the file has them; None if they are not all triangles."""
    name = next(prop.name for prop in face.element.properties if prop.count is not None)
    out = np.empty((last - first, 3), face.dtype[face.fields[name]].base.newbyteorder("="))
    if out.dtype.kind == "f":
        return None
    for start, rows in face.read(file, first, last):
        if (rows[face.dtype.names[face.lengths[0]]] != 3).any():  # type: ignore[index]
            return None
        out[start - first : start - first + len(rows)] = rows[face.fields[name]]
    return out


def compact(numbers: Array) -> tuple[Array, Array]:
    """The different numbers, ascending; and for each of `numbers` (any shape) which of them it is, int32."""
    low, high = (int(numbers.min()), int(numbers.max()) + 1) if numbers.size else (0, 0)
    if high - low > 8 * numbers.size:
        used, local = np.unique(numbers, return_inverse=True)
        return used, local.reshape(numbers.shape).astype(np.int32)
    there = np.zeros(high - low, bool)
    there[numbers - low] = True
    place = np.cumsum(there, dtype=np.int32) - np.int32(1)
    return np.flatnonzero(there) + low, place[numbers - low] if numbers.size else np.zeros(numbers.shape, np.int32)
