"""The rows of a PLY file: whole tables where all rows are alike, else list by list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.text import parse

ROWS = 1 << 20
"""Rows read or written at a time."""


@dataclass
class Property:
    """A property of an element, as the header declares it."""

    name: str
    dtype: np.dtype[Any]
    count: np.dtype[Any] | None = None  # of a list


@dataclass
class Element:
    """An element, as the header declares it: so many rows of its properties."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)


@dataclass
class Lists:
    """A list property: (rows,) counts and all values in one flat array."""

    counts: Array
    values: Array


Columns = dict[str, Any]  # an array (rows,) for a scalar property, Lists for a list


def row_fields(element: Element, counts: dict[str, int]) -> tuple[np.dtype[Any], list[int]]:
    """The dtype of a row when the lists have `counts` values each, and which fields are list lengths."""
    fields: list[Any] = []
    lengths = []
    for prop in element.properties:
        if prop.count is not None:
            lengths.append(len(fields))
            fields.append((f"f{len(fields)}", prop.count))
            fields.append((f"f{len(fields)}", prop.dtype, (counts[prop.name],)))
        else:
            fields.append((f"f{len(fields)}", prop.dtype))
    return np.dtype(fields), lengths


def binary_reader(file: IO[bytes], path: Path) -> Callable[[Element], Columns]:
    """A function that reads the next element: by whole rows where lists are equally long, else list by list."""
    size = path.stat().st_size

    def read(element: Element) -> Columns:
        at = f"{path.name}, element {element.name}"
        left = size - file.tell()
        least = sum((p.count or p.dtype).itemsize for p in element.properties)
        if element.rows * least > left:
            raise FileError(at, f"{element.rows} rows take at least {element.rows * least} bytes, {left} are left")
        counts, begin = _first_counts(file, element), file.tell()
        dtype, lengths = row_fields(element, counts)
        columns = _read_rows(file, element, dtype, lengths, counts) if element.rows * dtype.itemsize <= left else None
        if columns is None:
            file.seek(begin)
            data = file.read()
            columns, used = _walk_bytes(data, element, at)
            file.seek(begin + used)
        return columns

    return read


def _first_counts(file: IO[bytes], element: Element) -> dict[str, int]:
    """The lengths of the lists of the element's first row; leaves `file` where it was."""
    counts, begin = {}, file.tell()
    for prop in element.properties:
        if prop.count is None:
            file.seek(prop.dtype.itemsize, 1)
            continue
        raw = file.read(prop.count.itemsize)
        count = int(np.frombuffer(raw, prop.count)[0]) if len(raw) == prop.count.itemsize else 0
        counts[prop.name] = min(max(count, 0), 1 << 20)  # a wrong length shows when rows are compared, or the file ends
        file.seek(counts[prop.name] * prop.dtype.itemsize, 1)
    file.seek(begin)
    return counts


def _read_rows(file: IO[bytes], element: Element, dtype: np.dtype[Any], lengths: list[int], counts: dict[str, int]) -> Columns | None:
    """Columns of rows that all have `dtype`, read in parts so that no second copy of the whole piles up; None if lists differ."""
    columns: Columns = {}
    for prop in element.properties:
        shape: Any = element.rows if prop.count is None else (element.rows, counts[prop.name])
        columns[prop.name] = np.empty(shape, prop.dtype.newbyteorder("="))
    names = [name for i, name in enumerate(dtype.names or ()) if i not in lengths]
    expected = [(f"f{i}", counts[p.name]) for i, p in zip(lengths, (p for p in element.properties if p.count is not None), strict=True)]
    for start in range(0, element.rows, ROWS):
        part = np.fromfile(file, dtype, min(ROWS, element.rows - start))
        if any((part[name] != count).any() for name, count in expected):
            return None
        for prop, name in zip(element.properties, names, strict=True):
            columns[prop.name][start : start + len(part)] = part[name]
    for prop in element.properties:
        if prop.count is not None:
            full = np.broadcast_to(np.int64(counts[prop.name]), element.rows)
            columns[prop.name] = Lists(full, columns[prop.name].reshape(-1))
    return columns


def _walk_bytes(data: bytes, element: Element, at: str) -> tuple[Columns, int]:
    """Columns of rows whose lists differ in length, and how many bytes they took: one step a list."""
    steps = [(p.count.itemsize if p.count is not None else 0, p.dtype.itemsize, p.count) for p in element.properties]
    places: list[list[int]] = [[] for _ in steps]  # where each row's value or list begins
    counts: list[list[int]] = [[] for _ in steps]
    place, end = 0, len(data)
    for row in range(element.rows):
        for k, (head, item, kind) in enumerate(steps):
            if kind is not None:
                count = int.from_bytes(data[place : place + head], "big" if kind.str[0] == ">" else "little", signed=kind.kind == "i")
                place += head
                if count < 0:
                    raise FileError(f"{at}, row {row}", f"a list of {count} values")
                counts[k].append(count)
                item *= count
            places[k].append(place)
            place += item
            if place > end:
                raise FileError(f"{at}, row {row}", "the file ends")
    raw = np.frombuffer(data, np.uint8)
    columns: Columns = {}
    for prop, begin, many in zip(element.properties, places, counts, strict=True):
        if prop.count is None:
            columns[prop.name] = _gather(raw, np.array(begin), np.ones(len(begin), np.int64), prop.dtype)
        else:
            length = np.array(many, np.int64)
            columns[prop.name] = Lists(length, _gather(raw, np.array(begin), length, prop.dtype))
    return columns, place


def _gather(raw: Array, begin: Array, counts: Array, dtype: np.dtype[Any]) -> Array:
    """The values of all lists, (sum of counts,), in native byte order; list k begins at byte begin[k]."""
    ends = np.cumsum(counts)
    inside = np.arange(int(ends[-1]) if len(ends) else 0) - np.repeat(ends - counts, counts)
    at = np.repeat(begin, counts) + inside * dtype.itemsize
    packed = np.empty((len(at), dtype.itemsize), np.uint8)
    for k in range(dtype.itemsize):
        packed[:, k] = raw[at + k]
    return packed.view(dtype)[:, 0].astype(dtype.newbyteorder("="))


def ascii_reader(file: IO[bytes], path: Path) -> Callable[[Element], Columns]:
    """A function that reads the next element from the numbers of the whole body."""
    begin = file.tell()
    file.seek(0)
    before = file.read(begin).count(b"\n")
    values = parse(file.read(), float, path.name, lambda k: before + k + 1)
    place = 0

    def read(element: Element) -> Columns:
        nonlocal place
        at = f"{path.name}, element {element.name}"
        least = element.rows * len(element.properties)
        if least > len(values) - place:
            raise FileError(at, f"{element.rows} rows take at least {least} numbers, {len(values) - place} are left")
        columns, used = _walk_numbers(values[place:], element, at)
        place += used
        return columns

    return read


def _walk_numbers(values: Array, element: Element, at: str) -> tuple[Columns, int]:
    """Columns of an element whose numbers start `values`, and how many it took."""
    lists = [k for k, prop in enumerate(element.properties) if prop.count is not None]
    width = len(element.properties)
    if lists:
        head = values[lists[0]]  # the length of the first row's list
        width += int(head) if 0 <= head <= len(values) else len(values)
    if len(lists) <= 1 and element.rows * width <= len(values):
        table = values[: element.rows * width].reshape(element.rows, width)
        if not lists or (table[:, lists[0]] == table[0, lists[0]]).all():
            return _table_columns(table, element), element.rows * width
    places: list[list[int]] = [[] for _ in element.properties]
    counts: list[list[int]] = [[] for _ in element.properties]
    place = 0
    for row in range(element.rows):
        for k, prop in enumerate(element.properties):
            count = 1
            if prop.count is not None and place < len(values):
                if not 0 <= values[place] < 2**53:
                    raise FileError(f"{at}, row {row}", f"a list of {values[place]:g} values")
                count = int(values[place])
            place += prop.count is not None
            places[k].append(place)
            counts[k].append(count)
            place += count
            if place > len(values):
                raise FileError(f"{at}, row {row}", "the file ends")
    columns: Columns = {}
    for prop, begin, many in zip(element.properties, places, counts, strict=True):
        length = np.array(many, np.int64)
        starts = np.repeat(np.array(begin, np.int64) - (np.cumsum(length) - length), length)
        column = values[starts + np.arange(len(starts))]
        columns[prop.name] = _typed(column, prop) if prop.count is None else Lists(length, column)
    return columns, place


def _table_columns(table: Array, element: Element) -> Columns:
    columns: Columns = {}
    k = 0
    for prop in element.properties:
        if prop.count is None:
            columns[prop.name] = _typed(table[:, k], prop)
            k += 1
        else:
            many = int(table[0, k])
            columns[prop.name] = Lists(table[:, k].astype(np.int64), table[:, k + 1 : k + 1 + many].reshape(-1))
            k += 1 + many
    return columns


def _typed(column: Array, prop: Property) -> Array:
    """Numbers of an ASCII file in the type that the header gives them; integers that do not fit are clamped."""
    if prop.dtype.kind == "f":
        return column
    info = np.iinfo(prop.dtype)
    return np.clip(np.nan_to_num(column), info.min, info.max).astype(prop.dtype)
