"""PLY laid out as it is: rows of vertices and faces move, with every property they have; header, format and other elements stay.

Polygons and strips become triangles. Elements that luxel does not know stay too; their properties vertex1, vertex2, vertex_index and
vertex_indices are renumbered.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.files import atomic_write, open_plain
from luxel.io.ply import INDEX_NAMES, integers, read_header
from luxel.io.ply_rows import Columns, Element, Lists, Property, ascii_reader, binary_reader, row_fields
from luxel.io.polygons import strip, triangulate
from luxel.layout.clean import vertex_rows
from luxel.layout.measure import Draw
from luxel.layout.optimize import Options, Progress, Report, lay_out, tell_polygons
from luxel.layout.same import Soup

_NAMES_VERTICES = ("vertex1", "vertex2", *INDEX_NAMES)


class Content:
    """A PLY file taken apart.

    Attributes:
        header: Its lines, as they stand, without `end_header`.
        order: Byte order, "" for ASCII.
        elements: As the header declares them.
        columns: Of each element.
        corners: (m, 3) int64: the triangles, as places in the flat list of all corners of faces.
        flat: The vertex at each corner of a face.
        face: (m,) int64: the face of each triangle.
    """

    def __init__(self, path: Path) -> None:
        self.where = path.name
        with open_plain(path) as file:
            self.order, self.elements, _ = read_header(file, path.name)
            end = file.tell()
            file.seek(0)
            self.header = file.read(end).decode("utf-8", "surrogateescape").splitlines()[:-1]
            read = binary_reader(file, path) if self.order else ascii_reader(file, path)
            self.columns: dict[str, Columns] = {e.name: read(e) if e.rows and e.properties else {} for e in self.elements}
        self.vertices = self._element("vertex")
        self.count = 0 if self.vertices is None else self.vertices.rows
        self._triangles()

    def _element(self, name: str) -> Element | None:
        return next((e for e in self.elements if e.name == name), None)

    def _triangles(self) -> None:
        self.strips = isinstance(self.columns.get("tristrips", {}).get("vertex_indices"), Lists)
        self.faces = self._element("tristrips" if self.strips else "face")
        columns = self.columns.get("tristrips" if self.strips else "face", {})
        self.index = "vertex_indices" if self.strips else next((n for n in INDEX_NAMES if isinstance(columns.get(n), Lists)), "")
        if columns and not self.index:
            raise FileError(f"{self.where}, element face", "expected a list property vertex_indices")
        lists = columns.get(self.index, Lists(np.zeros(0, np.int64), np.zeros(0, np.int64)))
        flat = integers(lists.values, f"{self.where}, element face").astype(np.int64)
        counts = np.asarray(lists.counts, np.int64)
        if self.strips:
            self.flat, self.corners = _strip_corners(flat, counts)
            self.face = np.zeros(len(self.corners), np.int64)
            counts = np.zeros(0, np.int64)
        else:
            self.flat, self.corners = flat, np.zeros((0, 3), np.int64)
            if self.count:
                self.corners = triangulate(counts, np.clip(flat, 0, self.count - 1), self.positions(np.float64))
            self.face = np.repeat(np.arange(len(counts)), counts)[self.corners[:, 0]] if len(self.corners) else np.zeros(0, np.int64)
        self.counts = counts
        used = self.flat[self.corners]
        if used.size and not 0 <= int(used.min()) <= int(used.max()) < self.count:
            wrong = int(used.min()) if int(used.min()) < 0 else int(used.max())
            raise FileError(f"{self.where}, element face", f"a face names vertex {wrong} of {self.count}")

    def positions(self, dtype: Any = np.float32) -> Array:
        """(n, 3) coordinates."""
        vertex = self.columns.get("vertex", {})
        if self.count and any(not isinstance(vertex.get(axis), np.ndarray) for axis in "xyz"):
            raise FileError(f"{self.where}, element vertex", "expected rows with the properties x, y and z")
        return np.stack([vertex[axis].astype(dtype) for axis in "xyz"], 1) if self.count else np.zeros((0, 3), dtype)

    def faces_by_vertex(self) -> Array:
        """(m, 3) int32."""
        return np.ascontiguousarray(self.flat[self.corners], np.int32)

    def rows(self) -> Array:
        """Everything of the vertices, to compare them by."""
        return vertex_rows(_attributes(self.columns.get("vertex", {}), self.count))

    def spread(self) -> dict[str, int]:
        """List properties of faces that have something for each corner (texcoord: 2), and how much."""
        columns = self.columns.get("face", {}) if not self.strips else {}
        found = {}
        for name, value in columns.items():
            if isinstance(value, Lists) and name != self.index and len(self.counts) and self.counts.sum():
                each, rest = divmod(int(np.sum(value.counts)), int(self.counts.sum()))
                if each and not rest and np.array_equal(value.counts, each * self.counts):
                    found[name] = each
        return found


def _strip_corners(flat: Array, counts: Array) -> tuple[Array, Array]:
    """The corners of strips that -1 or the end of a list cuts, and triangles of them by place."""
    cuts = np.union1d(np.flatnonzero(flat == -1), np.cumsum(counts))
    parts = [strip(part[flat[part] >= 0]) for part in np.split(np.arange(len(flat)), cuts)]
    corners = np.concatenate([part for part in parts if len(part)] or [np.zeros((0, 3), np.int64)])
    a, b, c = flat[corners].T
    return flat, corners[(a != b) & (b != c) & (c != a)]


def _attributes(columns: Columns, rows: int) -> list[Array]:
    """All properties of rows as arrays (rows, k); ragged lists by their length and their values, filled up."""
    out = []
    for value in columns.values():
        if isinstance(value, Lists):
            table = np.zeros((rows, 1 + int(value.counts.max(initial=0))))
            table[:, 0] = value.counts
            inside = np.arange(int(value.counts.sum())) - np.repeat(np.cumsum(value.counts) - value.counts, value.counts)
            table[np.repeat(np.arange(rows), value.counts), 1 + inside] = value.values
            out.append(table)
        else:
            out.append(value[:, None])
    return out


def _taken(column: Any, source: Array) -> Any:
    """Rows of a column."""
    if not isinstance(column, Lists):
        return column[source]
    counts = np.asarray(column.counts, np.int64)
    begin, many = (np.cumsum(counts) - counts)[source], counts[source]
    inside = np.arange(int(many.sum())) - np.repeat(np.cumsum(many) - many, many)
    return Lists(many, column.values[np.repeat(begin, many) + inside])


@dataclass
class Package:
    """A file laid out, to be written."""

    header: list[str]
    order: str
    elements: list[Element]
    columns: dict[str, Columns]

    def save(self, path: Path, home: Path) -> None:
        """Write the file."""
        with atomic_write(path) as file:
            file.write("".join(line + "\n" for line in [*self.header, "end_header"]).encode("utf-8", "surrogateescape"))
            for element in self.elements:
                if element.rows and element.properties:
                    (_write_binary if self.order else _write_ascii)(file, element, self.columns[element.name])


def optimize(path: Path, options: Options, report: Report, progress: Progress | None = None) -> Package:
    """The file laid out; `save` writes it.

    Raises:
        FileError: The file is malformed, or a face names a vertex that is not there.
    """
    content = Content(path)
    tell_polygons(content.where, content.counts)
    others = [e for e in content.elements if e is not content.vertices and e is not content.faces]
    needed = [_numbers(content.columns[e.name][p.name], content.count) for e in others for p in e.properties if p.name in _NAMES_VERTICES and e.rows]
    laid = lay_out([content.faces_by_vertex()], content.count, options, report, content.positions(), content.rows,
                   needed=np.unique(np.concatenate(needed)) if needed else None, progress=progress)  # fmt: skip
    faces, source = laid.triangles[0], laid.triangle_source[0]
    columns = dict(content.columns)
    columns["vertex"] = {name: _taken(value, laid.vertex_source) for name, value in columns.get("vertex", {}).items()}
    for element in others:
        columns[element.name] = {name: _renumbered(name, value, laid.vertex_target) for name, value in columns[element.name].items()}
    if content.faces is not None:
        columns["face"] = _face_columns(content, faces, source, laid.vertex_target)
    counts = {"vertex": len(laid.vertex_source), "face": len(faces)}
    elements = [_resized(content, element, counts) for element in content.elements]
    return Package(_header(content, counts), content.order, elements, columns)


def _numbers(column: Any, count: int) -> Array:
    """The vertices that a column names."""
    values = (column.values if isinstance(column, Lists) else column).astype(np.int64)
    return np.asarray(values[(values >= 0) & (values < count)])


def _renumbered(name: str, value: Any, target: Array) -> Any:
    if name not in _NAMES_VERTICES:
        return value
    numbers = value.values if isinstance(value, Lists) else value
    inside = (numbers >= 0) & (numbers < len(target))
    moved = np.where(inside, target[np.where(inside, numbers, 0).astype(np.int64)] if len(target) else numbers, numbers)
    return Lists(value.counts, moved) if isinstance(value, Lists) else moved.astype(numbers.dtype)


def _face_columns(content: Content, faces: Array, source: Array, target: Array) -> Columns:
    three = np.full(len(faces), 3, np.int64)
    if content.strips:
        return {"vertex_indices": Lists(three, faces.reshape(-1))}
    spread, corners, face = content.spread(), content.corners[source], content.face[source]
    if spread:  # what corners carry must be turned with them
        corners = _turned(corners, target[content.flat[corners]], faces)
    columns: Columns = {}
    for name, value in content.columns["face"].items():
        if name == content.index:
            columns[name] = Lists(three, faces.reshape(-1))
        elif name in spread:
            each = spread[name]
            columns[name] = Lists(three * each, value.values.reshape(-1, each)[corners.reshape(-1)].reshape(-1))
        else:
            columns[name] = _taken(value, face)
    return columns


def _turned(corners: Array, before: Array, after: Array) -> Array:
    """`corners` (m, 3) turned as triangles `before` were to become `after`."""
    out = corners.copy()
    for k in (2, 1, 0):
        fits = (np.roll(before, -k, 1) == after).all(1)
        out[fits] = np.roll(corners, -k, 1)[fits]
    return out


def _resized(content: Content, element: Element, counts: dict[str, int]) -> Element:
    if element is content.vertices:
        return replace(element, rows=counts["vertex"])
    if element is not content.faces:
        return element
    if content.strips:
        return Element("face", counts["face"], [Property("vertex_indices", _native("i4", content), _native("u1", content))])
    return replace(element, rows=counts["face"])


def _native(kind: str, content: Content) -> np.dtype[Any]:
    return np.dtype((content.order or "<") + kind)


def _header(content: Content, counts: dict[str, int]) -> list[str]:
    """The header's lines with the new counts; strips declared as faces."""
    lines, skipping = [], False
    for line in content.header:
        words = line.split()
        if words[:1] == ["element"]:
            skipping = content.strips and words[1] == "tristrips"
            name = "face" if skipping else words[1]
            if name == "vertex" or (content.faces is not None and content.faces.name == words[1]):
                line = f"element {name} {counts[name]}"
            lines.append(line)
            if skipping:
                lines.append("property list uchar int vertex_indices")
        elif not (skipping and words[:1] == ["property"]):
            lines.append(line)
    return lines


def _write_binary(file: IO[bytes], element: Element, columns: Columns) -> None:
    lists = [p for p in element.properties if p.count is not None]
    lengths = {p.name: int(columns[p.name].counts[0]) for p in lists}
    if all((columns[name].counts == length).all() for name, length in lengths.items()):
        dtype, heads = row_fields(element, lengths)
        rows = np.empty(element.rows, dtype)
        field = 0
        for prop in element.properties:
            if field in heads:
                rows[f"f{field}"] = lengths[prop.name]
                rows[f"f{field + 1}"] = columns[prop.name].values.reshape(element.rows, -1)
                field += 2
            else:
                rows[f"f{field}"] = columns[prop.name]
                field += 1
        file.write(rows.tobytes())
        return
    for row in _row_values(element, columns):
        for prop, value in zip(element.properties, row, strict=True):
            if prop.count is not None:
                file.write(np.array(len(value), prop.count).tobytes())
            file.write(np.asarray(value, prop.dtype).tobytes())


def _row_values(element: Element, columns: Columns) -> Iterator[tuple[Any, ...]]:
    parts: list[Any] = []
    for prop in element.properties:
        column = columns[prop.name]
        parts.append(np.split(column.values, np.cumsum(column.counts)[:-1]) if isinstance(column, Lists) else column)
    return zip(*parts, strict=True)


def _write_ascii(file: IO[bytes], element: Element, columns: Columns) -> None:
    words: list[Any] = []
    for prop in element.properties:
        column = columns[prop.name]
        if isinstance(column, Lists):
            flat, ends = _words(column.values, prop), np.cumsum(column.counts).tolist()
            counts = np.asarray(column.counts).tolist()
            words.append([" ".join([str(n), *flat[end - n : end]]) for n, end in zip(counts, ends, strict=True)])
        else:
            words.append(_words(column, prop))
    file.write("".join(" ".join(row) + "\n" for row in zip(*words, strict=True)).encode())


def _words(values: Array, prop: Property) -> list[str]:
    """Numbers as the shortest text that reads as the same."""
    if prop.dtype.kind in "iu":
        return list(map(str, values.astype(np.int64).tolist() if prop.dtype.str[1:] != "u8" else values.tolist()))
    return [repr(value).removesuffix(".0") for value in values.tolist()]


# What a file holds, for measures and for proof


def contents(path: Path) -> tuple[list[Draw], dict[str, Soup]]:
    """The faces as one draw call, and as a soup: what is of vertices, of corners, and of faces."""
    content = Content(path)
    faces, rows, positions = content.faces_by_vertex(), content.rows(), content.positions()
    stride = sum(p.dtype.itemsize for p in content.vertices.properties) if content.vertices is not None else 12
    draws = [Draw(faces, content.count, stride)]
    spread = content.spread()
    columns = content.columns.get("face", {}) if not content.strips else {}
    plain = {name: _taken(value, content.face) for name, value in columns.items() if name != content.index and name not in spread}
    per_face = vertex_rows(_attributes(plain, len(faces))) if plain else None
    if spread:
        flat = content.corners.reshape(-1)
        own = [columns[name].values.reshape(-1, each)[flat] for name, each in spread.items()]
        rows, positions = np.concatenate([rows[faces.reshape(-1)], vertex_rows(own)], 1), positions[faces.reshape(-1)]
        faces = np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)
    return draws, {"faces": Soup(faces, rows, positions, per_face)}


def rest_differs(before: Path, after: Path) -> str | None:
    """What differs between two files beside vertices and faces; None if nothing does."""
    old, new = Content(before), Content(after)
    lines = [[line for line in c.header if line.split()[:1] not in (["element"], ["property"])] for c in (old, new)]
    if lines[0] != lines[1]:
        return "the headers are not the same"
    others = [e for e in old.elements if e is not old.vertices and e is not old.faces]
    rows = [content.rows() for content in (old, new)]
    for element in others:
        if old.columns[element.name].keys() != new.columns.get(element.name, {}).keys():
            return f"element {element.name} has other properties"
        for name, column in old.columns[element.name].items():
            pair = (column, new.columns[element.name][name])
            parts = [part.values if isinstance(part, Lists) else part for part in pair]
            if name in _NAMES_VERTICES:
                good = (parts[0] >= 0) & (parts[0] < old.count)
                parts = [table[part[good].astype(np.int64)] for table, part in zip(rows, parts, strict=True)]
            if not np.array_equal(parts[0], parts[1]):
                return f"element {element.name}, property {name} is not the same"
    return None
