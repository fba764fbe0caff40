"""Wavefront OBJ, with its MTL libraries.

Read here and not through trimesh, which takes relative (negative) indices from the end of the file instead of from the line where they
stand, drops the texture coordinates of faces in mixed notation, and costs most of a second to import.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.build import build_mesh, turned
from luxel.io.files import read_bytes, tell
from luxel.io.mtl import Library
from luxel.io.polygons import triangulate, unify
from luxel.io.text import parse, table_lines, words_per_line
from luxel.scene.colour import linear_from_srgb
from luxel.scene.mesh import Mesh
from luxel.scene.normals import vertex_normals
from luxel.scene.scene import Instance, Scene

_VERTEX_KEYS = {b"v": 3, b"vt": 1, b"vn": 3}  # and the least numbers on a line
_CORNER = re.compile(rb"([^\s/]+)(?:/([^\s/]*))?(?:/([^\s/]*))?")
_NOWHERE = 2**40  # an index before the first: out of range, not left out
_KNOWN = {b"f", b"o", b"usemtl", b"mtllib", b"g", b"s", b"l", b"p", b"vp", b""}


@dataclass
class _Part:
    """Faces of one object and material, as runs of lines."""

    object: int
    name: str
    material: str | None
    runs: list[tuple[int, int]] = field(default_factory=list)  # (first line, one past the last)


class _Lines:
    """The text of the file as lines that begin with their keyword."""

    def __init__(self, raw: Array) -> None:
        text = raw.tobytes().replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b"  ")
        if re.search(rb"(?m)^[ \t]", text):
            text = re.sub(rb"(?m)^[ \t]+", b"", text)
        if b"#" in text:
            text = re.sub(rb"#[^\n]*", b"", text)
        self.text = text + b"\n"
        data = np.frombuffer(self.text, np.uint8)
        ends = np.flatnonzero(data == 10)
        self.starts = np.r_[0, ends + 1]  # line k is text[starts[k] : starts[k + 1]]
        # Lines of one kind mostly stand together: the keyword (two bytes tell them apart) cuts the file into runs.
        first = data[self.starts[:-1]]
        second = np.r_[data, 10, 10][self.starts[:-1] + 1]
        kind = first.astype(np.int32) << 8 | np.where((second == 9) | (second == 10), 32, second)
        kind[first == 10] = 0
        self.cuts = np.r_[np.flatnonzero(np.r_[True, kind[1:] != kind[:-1]]), len(kind)]

    def key(self, line: int) -> bytes:
        words = self.text[self.starts[line] : self.starts[line + 1]].split(None, 1)
        return words[0] if words else b""

    def rest(self, line: int) -> str:
        words = self.text[self.starts[line] : self.starts[line + 1]].split(None, 1)
        return words[1].decode("utf-8", "replace").strip() if len(words) > 1 else ""

    def block(self, runs: list[tuple[int, int]], key: bytes) -> bytes:
        """The text of all runs, with the keyword of each line blanked."""
        text = b"".join(self.text[self.starts[a] : self.starts[b]] for a, b in runs)
        return text.replace(key, b" " * len(key)) if key != b"f" else text.translate(bytes.maketrans(b"f", b" "))


def load(path: Path) -> Scene:
    """A scene with a mesh for each object (`o`) and material (`usemtl`); objects keep ids of their own.

    Colours after the coordinates are decoded from sRGB; texture coordinates are turned to glTF's v = 0 at the top.
    """
    lines = _Lines(read_bytes(path))
    scene = Scene(name=path.stem)
    library = Library(scene, path.parent, path.name)
    vertices, parts = _scan(lines, library, path.name)
    tables = _Tables(lines, path.name, vertices)
    for part in parts:
        material = -1 if part.material is None else library.number(part.material)
        mesh = _mesh(tables, part, whole=len(parts) == 1)
        mesh.material = material
        scene.meshes.append(mesh)
        scene.instances.append(Instance(len(scene.meshes) - 1, object=part.object, name=part.name))
    return scene


def _scan(lines: _Lines, library: Library, where: str) -> tuple[dict[bytes, list[tuple[int, int]]], list[_Part]]:
    """Runs of lines of v, vt and vn, and the parts with their runs of faces; reads the material libraries."""
    vertices: dict[bytes, list[tuple[int, int]]] = {key: [] for key in _VERTEX_KEYS}
    parts: dict[tuple[int, str | None], _Part] = {}
    number, name, material = 0, "", None
    begun = False  # the object has faces
    unknown: set[str] = set()
    points = False
    for begin, end in zip(lines.cuts[:-1].tolist(), lines.cuts[1:].tolist(), strict=True):
        key = lines.key(begin)
        if key in vertices:
            vertices[key].append((begin, end))
        elif key == b"f":
            part = parts.setdefault((number, material), _Part(number, name, material))
            part.runs.append((begin, end))
            begun = True
        else:
            for line in range(begin, end):
                key = lines.key(line)
                if key == b"o":
                    name = lines.rest(line)
                    number, begun = number + begun, False
                elif key == b"usemtl":
                    material = lines.rest(line) or None
                elif key == b"mtllib":
                    for library_name in library_names(lines.rest(line), library.folder):
                        library.read(library_name)
                elif key in (b"l", b"p"):
                    points = True
                elif key not in _KNOWN:
                    unknown.add(key[:20].decode("utf-8", "replace"))
    if points:
        tell(where, "points and lines are dropped")
    if unknown:
        tell(where, f"statements {', '.join(sorted(unknown)[:5])} are ignored")
    return vertices, list(parts.values())


def library_names(text: str, folder: Path) -> list[str]:
    """One name that may hold blanks if such a file is there (or it names no second .mtl), else several."""
    several = re.findall(r"\S+\.mtl", text, re.IGNORECASE)
    return several if len(several) > 1 and not (folder / text).exists() else [text]


class _Tables:
    """The vertex data of the whole file, which the faces index."""

    def __init__(self, lines: _Lines, where: str, runs: dict[bytes, list[tuple[int, int]]]) -> None:
        self.lines, self.where = lines, where
        self.arrays = {key: self._table(key, runs[key]) for key in _VERTEX_KEYS}
        self.positions, self.colors = _positions(self.arrays[b"v"])
        self._starts = {key: np.array([a for a, _ in runs[key]], np.int64) for key in _VERTEX_KEYS}
        self._before = {key: np.cumsum([0, *(b - a for a, b in runs[key])]) for key in _VERTEX_KEYS}

    def _table(self, key: bytes, runs: list[tuple[int, int]]) -> Array:
        """(lines, widest) float64: the numbers of all lines `key`; NaN where a line has fewer than the longest."""
        least = _VERTEX_KEYS[key]
        if not runs:
            return np.zeros((0, least))
        text = self.lines.block(runs, key)
        counts = words_per_line(text)
        if int(counts.min()) < least:
            at = _file_line(runs, int(counts.argmin()))
            raise FileError(f"{self.where}, line {at}", f"`{key.decode()}` needs {least} numbers, got {counts.min()}")
        values = parse(text, float, self.where, lambda k: _file_line(runs, k), int(counts.sum()))
        return table_lines(values, counts)

    def seen(self, key: bytes, line: Array) -> Array:
        """How many lines `key` stand before each `line` (of faces, so never inside a run of vertices)."""
        return self._before[key][np.searchsorted(self._starts[key], line)]


def _file_line(runs: list[tuple[int, int]], k: int) -> int:
    """The number, from 1, of the k-th line of `runs` in the file."""
    for begin, end in runs:
        if k < end - begin:
            return begin + k + 1
        k -= end - begin
    return 0


def _positions(table: Array) -> tuple[Array, Array | None]:
    """Positions (n, 3) and linear RGBA (n, 4), or None: of lines x y z [w] or x y z r g b."""
    if table.shape[1] < 6:
        return table[:, :3], None
    encoded = table[:, 3:6]
    given = np.isfinite(encoded).all(1)
    if encoded[given].max(initial=0) > 1:
        encoded = encoded / 255
    colors = np.ones((len(table), 4), np.float32)
    colors[given, :3] = linear_from_srgb(np.clip(encoded[given], 0, 1))
    return table[:, :3], colors


def face_corners(lines: _Lines, where: str, runs: list[tuple[int, int]]) -> tuple[Array, Array]:
    """Corners of each face line (f,), and what all corners (k, 3) name of v, vt and vn, as written; 0 where left out."""
    text = lines.block(runs, b"f")
    counts = words_per_line(text)
    spread, each = text, 1
    if b"/" in text:
        spread = text.replace(b"//", b"/0/").replace(b"/", b" ")
        each = int(words_per_line(spread).sum()) // max(int(counts.sum()), 1)
        if each not in (2, 3) or not np.array_equal(words_per_line(spread), each * counts) or re.search(rb"/\s", text):
            spread, each = _CORNER.sub(lambda m: b"%b %b %b" % (m[1], m[2] or b"0", m[3] or b"0"), text), 3
    wrong = np.flatnonzero(words_per_line(spread) != each * counts)
    if len(wrong):
        at = _file_line(runs, int(wrong[0]))
        shown = text.split(b"\n")[int(wrong[0])].strip()[:80].decode("utf-8", "replace")
        raise FileError(f"{where}, line {at}", f"expected corners of the form v, v/vt, v//vn or v/vt/vn, got {shown!r}")
    flat = parse(spread, int, where, lambda k: _file_line(runs, k), each * int(counts.sum()))
    references = np.zeros((int(counts.sum()), 3), np.int64)
    references[:, :each] = flat.reshape(-1, each)
    return counts, references


def _resolved(tables: _Tables, runs: list[tuple[int, int]]) -> tuple[Array, Array]:
    """As `face_corners`, counted from 0: relative indices made absolute; below 0 where left out."""
    counts, references = face_corners(tables.lines, tables.where, runs)
    if references.size and int(references.min()) < 0:
        line = np.concatenate([np.arange(a, b) for a, b in runs])
        for k, key in enumerate(_VERTEX_KEYS):
            seen = np.repeat(tables.seen(key, line), counts)
            column = references[:, k]
            references[:, k] = np.where(column < 0, np.where(column + seen < 0, _NOWHERE, column + seen + 1), column)
    return counts, references - 1


def _mesh(tables: _Tables, part: _Part, whole: bool) -> Mesh:
    """The mesh of one part; `whole` keeps the file's vertices as they are where faces index nothing else."""
    where, name = tables.where, part.name or part.material or ""
    positions, colors = tables.positions, tables.colors
    counts, references = _resolved(tables, part.runs)
    few = int(np.count_nonzero(counts < 3))
    if few:
        tell(where, f"{few} faces with fewer than 3 corners are dropped")
    vertex = references[:, 0]
    good = (vertex >= 0) & (vertex < len(positions))
    if not len(positions):
        return build_mesh(where, positions, np.full((int(np.maximum(counts - 2, 0).sum()), 3), -1), name=name)
    cut = triangulate(counts, np.where(good, vertex, 0), positions)
    corners = cut.reshape(-1)
    columns = {b"v": np.where(good, vertex, 0)[corners]}
    for k, key in ((1, b"vt"), (2, b"vn")):
        column, rows = references[corners, k], len(tables.arrays[key])
        if rows and (column >= 0).any():
            beyond = int(np.count_nonzero(column >= rows))
            if beyond:
                tell(where, f"{beyond} corners name a {key.decode()} that is not there")
            columns[key] = np.where((column >= 0) & (column < rows), column, rows)  # `rows`: a filler
    if len(columns) == 1 and whole:
        return build_mesh(where, positions, vertex[cut], colors=colors, name=name)
    first, number = unify(list(columns.values()))
    triangles = np.where(good[corners], number, -1).reshape(-1, 3)
    source = {key: column[first] for key, column in columns.items()}
    at, picked = positions[source[b"v"]], None if colors is None else colors[source[b"v"]]
    texcoords = normals = None
    if b"vt" in source:
        table = np.nan_to_num(tables.arrays[b"vt"][:, :2], nan=0.0)
        texcoords = np.zeros((len(table) + 1, 2))
        texcoords[:-1, : table.shape[1]] = table
        texcoords = turned(texcoords[source[b"vt"]])
    if b"vn" in source:
        table = tables.arrays[b"vn"][:, :3]
        normals = np.append(table, [[0.0, 0.0, 0.0]], 0)[source[b"vn"]]
        bare = source[b"vn"] == len(table)
        if bare.any():
            with_vertex = triangles[(triangles >= 0).all(1)]
            normals[bare] = vertex_normals(at.astype(np.float32), with_vertex)[bare]
    return build_mesh(where, at, triangles, texcoords=texcoords, normals=normals, colors=picked, name=name)
