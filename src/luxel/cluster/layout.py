"""Layout of a mesh that no rank holds: partitioned out of core, ordered in parts, joined.

    look       each rank reads a range of the faces; a sample of them makes the cells (`cells`), which depend on the mesh alone
    deal       triangles go to the ranks of their cells, which lay them aside on disk (`spill`)
    order      cell by cell, as one process orders a mesh
    number     vertices by first use, cell after cell: one that several cells have belongs to the first of them (`directory`)
    write      each rank its rows, in the places of the new file

Only a cell is in memory at a time, and a few bytes for each of a rank's share of the vertices. The bytes that come out are the same for any number of
ranks; and those of `luxel.layout` for a mesh of one cell.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.cluster.cells import cell_of, cells
from luxel.cluster.comm import Comm
from luxel.cluster.directory import Directory
from luxel.cluster.ply_table import PIECE, Table, compact, corners
from luxel.cluster.spill import Spill
from luxel.errors import FileError, InputError
from luxel.layout import batch, clean
from luxel.layout.cache import misses
from luxel.layout.measure import CACHES, Measures
from luxel.layout.optimize import Options, Report, lay_out

CELL = 1 << 18
"""Triangles of a cell, about; a mesh has as many cells as hold its triangles."""
_SAMPLED = 1 << 16  # triangles that the cells are cut by
_NONE = np.zeros(0, np.int32)


class Part(NamedTuple):
    """A cell in its new order.

    Attributes:
        triangles: (m, 3) int32, of `vertices`.
        source: (m,) int32: the face of the file that each was.
        vertices: (k,) int32: those of the file, by first use.
    """

    triangles: Array
    source: Array
    vertices: Array


class Layout:
    """A binary PLY file of triangles that ranks lay out together; every method is called by all of them, in turn.

    Args:
        file: Open for reading.
        tables: Its vertices and faces, and nothing else.
        options: What to do.
        comm: The ranks.
        report: Gets what this rank does.
        folder: Where what does not fit into memory is laid aside.
        told: Gets the part done of the ordering.
        measures: Count misses before and after.
    """

    def __init__(self, file: IO[bytes], tables: tuple[Table, Table], options: Options, comm: Comm, report: Report, folder: Path | None,
                 told: Callable[[float], None], measures: bool = True) -> None:  # fmt: skip
        self.file, (self.vertex, self.face), self.comm, self.report = file, tables, comm, report
        self.told, self.measures = told, measures
        if max(self.vertex.rows, self.face.rows) >= 2**31:
            raise InputError(f"{file.name}: {max(self.vertex.rows, self.face.rows)} rows; expected fewer than 2^31 vertices and faces")
        self.options = replace(options, threads=comm.threads(options.threads), weld=False, drop_unused=True)
        self.weld, self.drop_unused = options.weld, options.drop_unused
        self.spill = Spill(folder)
        self.missed = np.zeros((2, len(CACHES) + len(batch.MODELS)), np.int64)
        self.counts = np.zeros(2, np.int64)

    # Reading

    def _pieces(self) -> Iterator[tuple[int, Array]]:
        """This rank's share of the faces: the first one's number, and (k, 3) corners."""
        first, last = self.comm.share_out(math.ceil(self.face.rows / PIECE))[self.comm.rank]
        for piece in range(first, last):
            start = piece * PIECE
            found = corners(self.face, self.file, start, min(start + PIECE, self.face.rows))
            if found is None:
                raise _NoTrianglesError
            yield start, found

    def look(self) -> bool:
        """Read all faces once: whether they are triangles. Makes the cells.

        Raises:
            FileError: A face names a vertex that is not there.
        """
        start, step, chosen, good = time.perf_counter(), math.ceil(self.face.rows / _SAMPLED), [_NONE], True
        try:
            for first, piece in self._pieces():
                low, high = int(piece.min()), int(piece.max())
                if low < 0 or high >= self.vertex.rows:
                    raise FileError(f"{Path(self.file.name).name}, element face",
                                    f"a face names vertex {low if low < 0 else high} of {self.vertex.rows}")  # fmt: skip
                chosen.append(piece[-first % step :: step, 0].astype(np.int32))
                self._count(0, piece)
        except _NoTrianglesError:
            good = False
        if not all(self.comm.gather(good)):
            return False
        numbers = np.unique(np.concatenate(chosen))
        points = self.vertex.stacked(self.vertex.take(self.file, numbers), "xyz")
        points = np.unique(np.concatenate(self.comm.gather(points)), axis=0)
        self.cells = cells(points[np.isfinite(points).all(1)], math.ceil(self.face.rows / CELL))
        self.mine = range(*self.comm.share_out(self.cells.count)[self.comm.rank])
        self.rounds = math.ceil(self.cells.count / self.comm.size)
        self.report.lap("look", start)
        return True

    def _classes(self, numbers: Array) -> Array:
        """(k,) int32: the cells of vertices, which had better ascend."""
        return cell_of(self.cells, self.vertex.stacked(self.vertex.take(self.file, numbers), "xyz"))

    def _deal(self, key: str, share: Iterator[tuple[Array, Array]], rounds: int) -> None:
        """Lay rows (k, w) int32 aside with the ranks of their cells (k,)."""
        ends = np.array([last for _, last in self.comm.share_out(self.cells.count)])
        for _ in range(rounds):
            cell, rows = next(share, (_NONE, None))
            order = np.argsort(cell, kind="stable")
            width = 1 if rows is None else 1 + rows.shape[1]
            packed = np.zeros((0, width), np.int32) if rows is None else np.concatenate([cell[:, None], rows], 1)[order]
            cuts = np.searchsorted(np.searchsorted(ends, cell[order], side="right"), np.arange(1, self.comm.size))
            for got in self.comm.exchange(np.split(packed, cuts)):
                bounds = np.flatnonzero(np.diff(got[:, 0])) + 1
                for part in np.split(got, bounds) if len(got) else ():
                    self.spill.put((key, int(part[0, 0])), part[:, 1:])

    def deal(self) -> None:
        """Bring the triangles to the ranks of their cells. A triangle lies in the first of its corners' cells."""
        start = time.perf_counter()

        def share() -> Iterator[tuple[Array, Array]]:
            for first, piece in self._pieces():
                used, local = compact(piece)
                cell = self._classes(used)[local].min(1)
                numbers = np.arange(first, first + len(piece), dtype=np.int32)
                yield cell, np.concatenate([numbers[:, None], piece.astype(np.int32)], 1)

        pieces = math.ceil(self.face.rows / PIECE)
        self._deal("faces", share(), math.ceil(pieces / self.comm.size))
        self.same = self._welded() if self.weld else None
        self.report.lap("partition", start)

    def _welded(self) -> Directory:
        """For each vertex the first that is equal to it: they lie in one cell."""
        same = Directory(self.comm, self.vertex.rows)

        def share() -> Iterator[tuple[Array, Array]]:
            for first in range(same.first, same.last, PIECE):
                numbers = np.arange(first, min(first + PIECE, same.last), dtype=np.int32)
                yield self._classes(numbers), numbers[:, None]

        self._deal("rows", share(), max(self.comm.gather(math.ceil((same.last - same.first) / PIECE))))
        for cell in self._turns():
            numbers = np.sort(np.concatenate([_NONE, *(part[:, 0] for part in self.spill.get(("rows", cell)))]))
            rows = self.vertex.take(self.file, numbers)
            target, first_of = clean.weld(clean.vertex_rows([rows[name][:, None] for name in self.vertex.fields.values()]))
            same.put(numbers, numbers[first_of][target] if len(numbers) else numbers)
        self.report.welded = int((same.values != np.arange(same.first, same.last)).sum())
        return same

    def _turns(self) -> Iterator[int]:
        """This rank's cells, filled up with -1 so that all ranks have as many."""
        yield from self.mine
        yield from [-1] * (self.rounds - len(self.mine))

    # Ordering

    def order(self) -> None:
        """Order the cells, and let each vertex know the first that has it."""
        self.owner = Directory(self.comm, self.vertex.rows, self.cells.count)
        for turn, cell in enumerate(self._turns()):
            rows = np.concatenate([np.zeros((0, 4), np.int32), *self.spill.get(("faces", cell))])
            rows = rows[np.argsort(rows[:, 0])]
            triangles = rows[:, 1:]
            if self.same is not None:
                used, local = compact(triangles)
                triangles = self.same.get(used)[local].reshape(-1, 3)
            part = self._ordered(triangles, rows[:, 0], partial(self._tell, turn))
            for name, array in part._asdict().items():
                self.spill.put((name, cell), array)
            self.owner.put(part.vertices, np.full(len(part.vertices), cell, np.int32), least=True)
        self.report.unused = 0

    def _tell(self, turn: int, done: float) -> None:
        self.told((turn + done) / max(1, self.rounds))

    def _ordered(self, triangles: Array, source: Array, told: Callable[[float], None]) -> Part:
        if not len(triangles):
            return Part(triangles, source, _NONE)
        used, local = compact(triangles)
        positions = self.vertex.stacked(self.vertex.take(self.file, used), "xyz")
        options = self.options
        if options.seconds is not None:
            options = replace(options, seconds=options.seconds * len(triangles) * self.comm.size / self.face.rows)
        laid = lay_out([local], len(used), options, self.report, positions, progress=told)
        self._count(1, laid.triangles[0])
        return Part(laid.triangles[0], source[laid.triangle_source[0]], used[laid.vertex_source].astype(np.int32))

    def _part(self, cell: int) -> Part:
        def one(name: str, none: Array) -> Array:
            found = self.spill.get((name, cell))
            return found[0] if found else none

        return Part(one("triangles", np.zeros((0, 3), np.int32)), one("source", _NONE), one("vertices", _NONE))

    def number(self) -> None:
        """Number the vertices: those of the first cell first, and those that no triangle has last, if they stay."""
        start, comm = time.perf_counter(), self.comm
        own = [int((self.owner.get(self._part(cell).vertices) == cell).sum()) for cell in self._turns()]
        self.bases = self._before(own[: len(self.mine)])
        self.numbers = Directory(comm, self.vertex.rows, -1)
        for cell in self._turns():
            vertices = self._first_here(cell)
            self.numbers.put(vertices, np.arange(len(vertices), dtype=np.int32) + np.int32(self.bases[cell] if cell >= 0 else 0))
        left = self.owner.values == self.cells.count
        if self.same is not None:
            left &= self.same.values == np.arange(self.same.first, self.same.last)
        unused = np.array(comm.gather(int(left.sum())), np.int64)
        self.unused = (np.flatnonzero(left) + self.owner.first)[: 0 if self.drop_unused else None]
        self.unused_at = int(self.bases[-1] + unused[: comm.rank].sum())
        self.rows = int(self.bases[-1] + (0 if self.drop_unused else unused.sum()))
        self.report.unused = int(unused[comm.rank]) if self.drop_unused else 0
        self.starts = self._before([len(self._part(cell).source) for cell in self.mine])
        self.report.lap("renumber", start)

    def _before(self, counts: list[int]) -> Array:
        """(cells + 1,) int64: how many there are in the cells before each, of this rank's counts."""
        return np.cumsum([0, *np.concatenate([np.array(each, np.int64) for each in self.comm.gather(counts)])])

    def _first_here(self, cell: int) -> Array:
        vertices = self._part(cell).vertices
        return vertices[self.owner.get(vertices) == cell]

    # Writing

    def write(self, out: IO[bytes], begins: dict[str, int]) -> None:
        """Write this rank's rows.

        Args:
            out: The new file.
            begins: Where the rows of the elements "vertex" and "face" begin in it.
        """
        start = time.perf_counter()
        for cell in self._turns():
            part = self._part(cell)
            vertices, numbers = self._first_here(cell), self.numbers.get(part.vertices)
            corners = numbers[part.triangles] if len(part.triangles) else part.triangles
            if cell >= 0:
                self._write_rows(out, self.vertex, begins["vertex"], int(self.bases[cell]), vertices, None)
                self._write_rows(out, self.face, begins["face"], int(self.starts[cell]), part.source, corners)
        self._write_rows(out, self.vertex, begins["vertex"], self.unused_at, self.unused, None)
        out.flush()
        self.report.lap("write", start)

    def _write_rows(self, out: IO[bytes], table: Table, begin: int, first: int, source: Array, corners: Array | None) -> None:
        """Rows of the old file, faces with their new corners, from row `first` on."""
        for start in range(0, len(source), PIECE):
            numbers = source[start : start + PIECE]
            order = np.argsort(numbers)
            rows: Any = np.empty(len(numbers), table.dtype)
            rows[order] = table.take(self.file, numbers[order])
            if corners is not None:
                name = next(prop.name for prop in table.element.properties if prop.count is not None)
                rows[table.fields[name]] = corners[start : start + PIECE]
            out.seek(begin + (first + start) * table.dtype.itemsize)
            out.write(rows.tobytes())

    # Measures

    def _count(self, when: int, triangles: Array) -> None:
        """Add the misses of a run of triangles, from empty caches."""
        if not self.measures or not len(triangles):
            return
        used, local = compact(triangles)
        found = [misses(local, k, "fifo", len(used)) for k in CACHES] + [batch.misses(local, model, len(used)) for model in batch.MODELS]
        self.missed[when] += [int(each.sum(dtype=np.int64)) for each in found]
        self.counts[when] += len(triangles)

    def measured(self) -> tuple[Measures, Measures]:
        """Before and after: misses, each part of the file counted from empty caches."""
        missed, counts = self.comm.summed(self.missed), self.comm.summed(self.counts)
        vertices = int(self.bases[-1])
        made = []
        for missing, triangles in zip(missed, counts.tolist(), strict=True):
            acmr = {k: int(count) / max(1, triangles) for k, count in zip(CACHES, missing, strict=False)}
            atvr = {name: int(count) / max(1, vertices) for name, count in zip(batch.MODELS, missing[len(CACHES) :], strict=True)}
            made.append(Measures(triangles, vertices, acmr, atvr, overfetch=None, edge_span=None))
        return made[0], made[1]


class _NoTrianglesError(Exception):
    """A face is no triangle."""
