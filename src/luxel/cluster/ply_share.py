"""A rank's share of a binary PLY file: a range of the bytes of its faces, and those vertices that they have.

What decides for all vertices in a whole file (whether normals must be made unit again) is decided by all ranks together. Where there are no normals,
they are made with the faces around the share (`around`). Files that cannot be read in parts are left to the caller: ASCII, faces that are not all
triangles, normals without a direction.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.cluster.around import around
from luxel.cluster.codes import MOST
from luxel.cluster.comm import Comm
from luxel.cluster.ply_table import PIECE, Table, tables_of
from luxel.cluster.ply_table import corners as corners_of
from luxel.cluster.slices import check_count, part_of
from luxel.errors import InputError
from luxel.io.files import open_plain
from luxel.io.ply import read_header, scene_of
from luxel.io.ply_rows import ROWS, Columns, Lists
from luxel.scene.normals import CREASE_ANGLE, with_normals
from luxel.scene.scene import Scene

STREAMED = 1 << 20
"""Triangles of a rank: larger shares stay in the file."""
_UNIT = 1e-3  # as `io.build` judges normals
_NORMALS = {"nx", "ny", "nz"}


class Vertices:
    """Where the vertices of a file are, read when they are asked for: what a camera is framed with stands for the `positions` of a mesh."""

    def __init__(self, path: Path, table: Table) -> None:
        self.path, self.table, self.shape = path, table, (table.rows, 3)

    def __len__(self) -> int:
        return self.table.rows

    def __getitem__(self, rows: slice) -> Array:
        first, last, _ = rows.indices(len(self))
        with self.path.open("rb") as file:
            parts = [self.table.stacked(part, "xyz") for _, part in self.table.read(file, first, last)]
        return np.concatenate([np.zeros((0, 3), np.float32), *parts])


class Outline:
    """What framing asks a mesh for: where it is, and whether it has triangles."""

    def __init__(self, positions: Vertices, count: int) -> None:
        self.positions, self.triangles = positions, np.broadcast_to(np.int32(0), (count, 3))

    def bounds(self) -> Array:
        """As of `Mesh`: (2, 3) float64."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for start in range(0, len(self.positions), ROWS):
            points = self.positions[start : start + ROWS]
            points = points[np.isfinite(points).all(1)]
            if len(points):
                low, high = np.minimum(low, points.min(0)), np.maximum(high, points.max(0))
        return np.stack([low, high]) if np.isfinite(low).all() else np.zeros((2, 3))


class Source(NamedTuple):
    """A file, and how scenes are made of its triangles.

    Attributes:
        path, vertex, face, texture: Of the file.
        unit: Its normals have unit length, where it has any.
        crease: Radians, for those that are made.
    """

    path: Path
    vertex: Table
    face: Table
    texture: str
    unit: bool
    crease: float

    def scene(self, file: IO[bytes], numbers: Array, corners: Array) -> Scene:
        """The faces `numbers` (k,) int64, ascending, whose corners (k, 3) are known, with the normals that they have in the whole."""
        own, make = numbers, len(numbers) > 0 and _bare(self.vertex)
        if make:
            numbers, corners = around(self.vertex, self.face, file, corners)
        columns, local = _vertices(self.vertex, file, corners)
        if not self.unit:
            _make_unit(columns)
        faces: Columns = {"vertex_indices": Lists(np.broadcast_to(np.int64(3), len(local) // 3), local)} if len(local) else {}
        scene = scene_of(self.path, {"vertex": columns, "face": faces}, self.texture)
        if make:
            mesh = with_normals(scene.meshes[0], self.crease, numbers)
            triangles = mesh.triangles[np.searchsorted(numbers, own)]
            scene.meshes[0] = part_of(replace(mesh, triangles=triangles), 0, len(triangles))
        return scene


class Stream:
    """A share of a file that stays there: its triangles in pieces, and any of them with all that they have.

    Attributes:
        count: Its triangles.
    """

    def __init__(self, source: Source, first: int, last: int) -> None:
        self.source, self.first, self.count = source, first, last - first

    def pieces(self) -> Iterator[tuple[int, Array, Array]]:
        """Number of the first triangle, positions (n, 3) float32 and triangles (k, 3) int32, piece by piece."""
        vertex, face = self.source.vertex, self.source.face
        with self.source.path.open("rb") as file:
            for start in range(0, self.count, PIECE):
                corners = corners_of(face, file, self.first + start, self.first + min(self.count, start + PIECE))
                assert corners is not None
                columns, local = _vertices(vertex, file, corners, "xyz")
                positions = np.stack([columns[name].astype(np.float32, copy=False) for name in "xyz"], 1)
                yield start, positions, local.reshape(-1, 3)

    def scene(self, rows: Array) -> Scene:
        """The triangles `rows` (k,) int32, ascending."""
        face, chosen = self.source.face, []
        with self.source.path.open("rb") as file:
            for start in range(0, self.count, PIECE):
                wanted = rows[np.searchsorted(rows, start) : np.searchsorted(rows, start + PIECE)]
                if len(wanted):
                    corners = corners_of(face, file, self.first + start, self.first + min(self.count, start + PIECE))
                    assert corners is not None
                    chosen.append(corners[wanted - start])
            corners = np.concatenate(chosen or [np.zeros((0, 3), np.int32)])
            return self.source.scene(file, self.first + rows.astype(np.int64), corners)


def load_share(path: Path, comm: Comm, crease_angle: float | None = None) -> tuple[Scene | Stream, Scene] | None:
    """This rank's part of the scene, and one to frame a camera with; None on all ranks if the file cannot be read in parts.

    If shares are large, and all that is in the file can be drawn, they are left there.

    Args:
        path: Of the file, which all ranks can read.
        comm: The ranks that share it.
        crease_angle: As of `luxel.load`, where there are no normals. Then a rank reads the file through for the faces around its own (`around`).

    Raises:
        FileError: The file is missing or malformed.
    """
    with open_plain(path) as file:
        order, elements, texture = read_header(file, path.name)
        tables = tables_of(elements, file.tell()) if order else None
        if tables is None or not _whole_scene(tables[0]) or max(table.end for table in tables) > path.stat().st_size:
            return None  # if it is too short, the reader of whole files says so
        vertex, face = tables
        _check_counts(path, face.rows, comm.size)
        first, last = comm.share_out(face.rows)[comm.rank]
        streamed = face.rows > STREAMED * comm.size
        corners = None if streamed else corners_of(face, file, first, last)
        bare = _bare(vertex)
        good = _sound(face, vertex, file, first, last) if streamed or bare else corners is not None
        found = comm.gather((good, _normals(vertex, file, *comm.share_out(vertex.rows)[comm.rank], streamed or bare)))
        if not all(triangles and normals is not None for triangles, normals in found):
            return None
        unit = all(unit for _, unit in found)
        source = Source(path, vertex, face, texture, unit, CREASE_ANGLE if crease_angle is None else crease_angle)
        scene: Scene | Stream = Stream(source, first, last)
        if corners is not None:
            scene = source.scene(file, np.arange(first, last), corners)
    whole = scene_of(path, {"vertex": {name: np.zeros(0, np.float32) for name in "xyz"}}, "")
    whole.meshes[0] = Outline(Vertices(path, vertex), face.rows)  # type: ignore[call-overload]
    return scene, whole


def _check_counts(path: Path, faces: int, ranks: int) -> None:
    """See that numbers of triangles, and codes of those of a share, are int32.

    Raises:
        InputError: They are not; with the number of ranks that would do.
    """
    check_count(path.name, faces)
    enough = -(-faces // (MOST - 1))
    if ranks < enough:
        few = f"{ranks} ranks" if ranks > 1 else "one rank"
        raise InputError(f"{path.name}: {faces:,} triangles are too many for {few}: expected at least {enough} that share them (--divide objects)")


def _whole_scene(vertex: Table) -> bool:
    """Whether each vertex has all that a scene needs of it, whatever the others have."""
    colors = [prop.dtype.kind for prop in vertex.element.properties if prop.name.endswith("red")]
    return (_bare(vertex) or vertex.fields.keys() >= _NORMALS) and "f" not in colors  # what float colours mean hangs on the largest


def _bare(vertex: Table) -> bool:
    """Whether there are no normals."""
    return not vertex.fields.keys() & _NORMALS


def _sound(face: Table, vertex: Table, file: IO[bytes], first: int, last: int) -> bool:
    """Whether faces first .. last - 1 are triangles of vertices that are there."""
    for start in range(first, last, PIECE):
        corners = corners_of(face, file, start, min(last, start + PIECE))
        if corners is None or int(corners.min(initial=0)) < 0 or int(corners.max(initial=0)) >= vertex.rows:
            return False
    return True


def _normals(vertex: Table, file: IO[bytes], first: int, last: int, all_finite: bool) -> bool | None:
    """Whether the normals of vertices first .. last - 1, if they have any, are unit; None if one has no direction, or is nowhere and `all_finite` is
    asked for."""
    unit = True
    for _, rows in vertex.read(file, first, last):
        finite = np.isfinite(vertex.stacked(rows, "xyz")).all(1)
        if all_finite and not finite.all():
            return None
        if _bare(vertex):
            continue
        normals = vertex.stacked(rows, ("nx", "ny", "nz"))[finite]
        with np.errstate(all="ignore"):
            square = np.einsum("ij,ij->i", normals, normals)
        if not ((square > 1e-12) & np.isfinite(square)).all():
            return None
        unit &= bool((np.abs(square - 1) < _UNIT).all())
    return unit


def _vertices(vertex: Table, file: IO[bytes], corners: Array, names: Iterable[str] | None = None) -> tuple[Columns, Array]:
    """The columns (all, or those named) of the vertices that the triangles (k, 3) have, and the triangles' corners (3 k,) among them; what is out of
    range is -1."""
    fields = {name: vertex.fields[name] for name in names or vertex.fields}
    flat = corners.reshape(-1)
    parts = [flat[start : start + ROWS] for start in range(0, len(flat), ROWS)]  # no second copy of the whole
    low, high = vertex.rows, 0
    for part in parts:
        good = part[(part >= 0) & (part < vertex.rows)]
        low, high = min(low, int(good.min(initial=vertex.rows))), max(high, int(good.max(initial=-1)) + 1)
    used = np.zeros(max(0, high - low), bool)
    for part in parts:
        used[part[(part >= 0) & (part < vertex.rows)] - low] = True
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    local = corners.reshape(-1) if corners.dtype == np.int32 else np.empty(len(flat), np.int32)
    for start, part in zip(range(0, len(flat), ROWS), parts, strict=True):
        good = (part >= 0) & (part < vertex.rows)
        local[start : start + ROWS] = np.where(good, number[np.where(good, part, low) - low] if len(number) else 0, -1)
    del number
    columns = {name: np.empty(int(used.sum()), vertex.dtype[field].newbyteorder("=")) for name, field in fields.items()}
    at = 0
    for start, rows in vertex.read(file, low, high):
        chosen = rows[used[start - low : start - low + len(rows)]]
        for name, field in fields.items():
            columns[name][at : at + len(chosen)] = chosen[field]
        at += len(chosen)
    return columns, local


def _make_unit(columns: Columns) -> None:
    """Normals at unit length, with the arithmetic of `io.build`."""
    normals = np.stack([columns[name].astype(np.float32) for name in ("nx", "ny", "nz")], 1)
    normals = (normals / np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None]).astype(np.float32)
    columns |= dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
