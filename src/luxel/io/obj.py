"""Wavefront OBJ, with its MTL libraries.

Read here and not through trimesh, which takes relative (negative) indices from the end of the file instead of from the line where they
stand, drops the texture coordinates of faces in mixed notation, and costs most of a second to import.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.build import build_mesh, turned
from luxel.io.files import read_bytes, tell
from luxel.io.mtl import Library
from luxel.io.polygons import triangulate, unify
from luxel.io.text import table_lines, words_per_line
from luxel.scene.colour import linear_from_srgb
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Instance, Scene

_VERTEX_KEYS = {b"v": 3, b"vt": 1, b"vn": 3}  # and the least numbers on a line
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
    tables = {key: _table(lines, path.name, key, runs) for key, runs in vertices.items()}
    before = {key: np.cumsum([0] + [b - a for a, b in runs]) for key, runs in vertices.items()}
    at = {key: np.array([a for a, _ in runs], np.int64) for key, runs in vertices.items()}

    def count_before(key: bytes, line: Array) -> Array:
        run = np.searchsorted(at[key], line)  # a line of faces never lies inside a run of vertices
        return before[key][run]

    positions, colors = _positions(tables[b"v"])
    whole = len(parts) == 1
    for part in parts:
        material = -1 if part.material is None else library.number(part.material)
        mesh = _mesh(lines, path.name, part, tables, positions, colors, count_before, whole)
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
                    for library_name in _library_names(lines.rest(line), library.folder):
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


def _library_names(text: str, folder: Path) -> list[str]:
    """One name that may hold blanks if such a file is there (or it names no second .mtl), else several."""
    several = re.findall(r"\S+\.mtl", text, re.IGNORECASE)
    return several if len(several) > 1 and not (folder / text).exists() else [text]


def _parse(text: bytes, dtype: type, lines: _Lines, where: str, runs: list[tuple[int, int]]) -> Array:
    """All numbers of `text`; the first line that holds something else is named."""
    try:
        return np.fromstring(text, dtype, sep=" ")
    except (ValueError, DeprecationWarning):
        numbers = [line for a, b in runs for line in range(a, b)]
        for line, content in zip(numbers, text.split(b"\n"), strict=False):
            try:
                [dtype(word) for word in content.split()]
            except (ValueError, OverflowError):
                shown = lines.text[lines.starts[line] : lines.starts[line + 1]].decode("utf-8", "replace").strip()[:80]
                raise FileError(f"{where}, line {line + 1}", f"expected numbers, got {shown!r}") from None
        raise


def _table(lines: _Lines, where: str, key: bytes, runs: list[tuple[int, int]]) -> Array:
    """(lines, widest) float64: the numbers of all lines `key`; NaN where a line has fewer than the longest."""
    if not runs:
        return np.zeros((0, _VERTEX_KEYS[key]))
    text = lines.block(runs, key)
    counts = words_per_line(text)
    short = np.flatnonzero(counts < _VERTEX_KEYS[key])
    if len(short):
        line = [line for a, b in runs for line in range(a, b)][short[0]]
        raise FileError(
            f"{where}, line {line + 1}", f"`{key.decode()}` needs {_VERTEX_KEYS[key]} numbers, got {counts[short[0]]}"
        )
    return table_lines(_parse(text, float, lines, where, runs), counts)


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


def _corners(lines: _Lines, where: str, runs: list[tuple[int, int]]) -> tuple[Array, Array]:
    """Corners of each face line (f,), and the references of all corners (k, 3) to v, vt, vn, as written; 0 where left out."""
    text = lines.block(runs, b"f")
    counts = words_per_line(text)
    if b"/" not in text:
        flat = _parse(text, int, lines, where, runs)
        return counts, np.stack([flat, np.zeros_like(flat), np.zeros_like(flat)], 1)
    spread = text.replace(b"//", b"/0/").replace(b"/", b" ")
    numbers = words_per_line(spread)
    each = int(numbers.sum()) // max(int(counts.sum()), 1)
    if each not in (2, 3) or not np.array_equal(numbers, each * counts) or re.search(rb"/\s", text):
        spread = re.sub(
            rb"([^\s/]+)(?:/([^\s/]*))?(?:/([^\s/]*))?",
            lambda m: b"%b %b %b" % (m[1], m[2] or b"0", m[3] or b"0"),
            text,
        )
        each = 3
        if not np.array_equal(words_per_line(spread), 3 * counts):
            raise FileError(where, "a face reference has more than three parts")
    flat = _parse(spread, int, lines, where, runs).reshape(-1, each)
    return counts, flat if each == 3 else np.concatenate([flat, np.zeros_like(flat[:, :1])], 1)


def _mesh(
    lines: _Lines,
    where: str,
    part: _Part,
    tables: dict[bytes, Array],
    positions: Array,
    colors: Array | None,
    count_before: Any,
    whole: bool,
) -> Mesh:
    """The mesh of one part; `whole` keeps the file's vertices as they are where faces index nothing else."""
    counts, references = _corners(lines, where, part.runs)
    if references.size and int(references.min()) < 0:
        line = np.concatenate([np.arange(a, b) for a, b in part.runs])
        for k, key in enumerate(_VERTEX_KEYS):
            seen = np.repeat(count_before(key, line), counts)
            references[:, k] = np.where(references[:, k] < 0, references[:, k] + seen + 1, references[:, k])
    few = int(np.count_nonzero(counts < 3))
    if few:
        tell(where, f"{few} faces with fewer than 3 corners are dropped")
    vertex = references[:, 0] - 1
    cut = (
        triangulate(counts, np.clip(vertex, 0, max(len(positions) - 1, 0)), positions)
        if len(positions)
        else np.zeros((0, 3), np.int64)
    )
    name = part.name or part.material or ""
    corners, used = cut.reshape(-1), [0]
    good = (vertex >= 0) & (vertex < len(positions))
    for k, key in ((1, b"vt"), (2, b"vn")):
        column = references[:, k] - 1
        if len(tables[key]) and (column[corners] >= 0).any():
            inside = (column >= 0) & (column < len(tables[key]))
            if inside[corners].all():
                used.append(k)
            else:
                tell(
                    where,
                    f"{np.count_nonzero(~inside[corners])} corners have no proper {key.decode()}; all {key.decode()} of {name!r} are dropped",
                )
    if used == [0] and whole:
        return build_mesh(where, positions, vertex[cut], colors=colors, name=name)
    columns = [np.where(good, references[:, k] - 1, 0)[corners] for k in used]
    first, number = unify(columns)
    triangles = np.where(good[corners], number, -1).reshape(-1, 3)
    source = {k: column[first] for k, column in zip(used, columns, strict=True)}
    texcoords = normals = None
    if 1 in used:
        texcoords = np.zeros((len(first), 2))
        table = np.nan_to_num(tables[b"vt"][:, :2], nan=0.0)
        texcoords[:, : table.shape[1]] = table[source[1]]
        texcoords = turned(texcoords)
    if 2 in used:
        normals = tables[b"vn"][source[2], :3]
    picked = None if colors is None else colors[source[0]]
    return build_mesh(
        where, positions[source[0]], triangles, texcoords=texcoords, normals=normals, colors=picked, name=name
    )
