"""Files that ranks lay out: a binary PLY file of triangles without any rank holding it; of every other, rank 0 has the rest order parts."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.cluster.layout import Layout
from luxel.cluster.ply_table import Table, tables_of
from luxel.cluster.soup_sum import soup_sum
from luxel.errors import FileError
from luxel.io.files import beside, door, mode_of, open_plain, tell
from luxel.io.ply import read_header
from luxel.layout import files
from luxel.layout.optimize import Options, Progress, Report
from luxel.layout.partition import Work
from luxel.unfinished import unfinished


def optimize_file(source: Path, target: Path | None, options: Options, comm: Comm, *, measures: bool = True, check: bool = False,
                  progress: Progress | None = None) -> tuple[Report, list[Any], bool]:  # fmt: skip
    """As `luxel.layout.files.optimize_file`, with all ranks, each of which calls it.

    A binary PLY file of triangles, laid out as PLY, is read and written by all ranks in shares and parts: see `luxel.cluster.layout`. Every other
    file rank 0 reads and writes, and the ranks order the parts of its large meshes: the bytes are those of one process.

    Returns:
        On rank 0 the report; the scenes before and after, where the file was read whole; and whether it was read in shares. On others, a report of
        what they did.
    """
    told = progress or (lambda done: None)
    summed = check and options.drop_duplicates  # sums over all triangles cannot prove that
    if source.suffix.lower() == ".ply" and (target is None or target.suffix.lower() == ".ply") and not summed:
        report = _in_shares(source, target, options, comm, measures, check, told)
        if report is not None:
            return report, [], True
    if comm.rank:
        _help(comm)
        return Report(options.target), [], False
    if comm.size > 1:
        why = "dropped duplicates are checked in the whole file" if summed else "cannot be read in parts"
        tell(source.name, f"{why}: rank 0 reads all of it, and all ranks order the parts of its meshes")
    whole = replace(options, crew=_crew(comm), threads=comm.threads(options.threads))
    report, scenes = files.optimize_file(source, target, whole, measures=measures, check=check, progress=progress)
    comm.share(None)  # not if that failed: then all are ended, and the others wait elsewhere
    return report, scenes, False


def _crew(comm: Comm) -> Callable[[Work, Iterable[tuple[Array, int]]], Iterator[Array]]:
    """What has all ranks order parts, called by rank 0 alone."""

    def order(work: Work, parts: Iterable[tuple[Array, int]]) -> Iterator[Array]:
        comm.share(work)
        return comm.spread(_swapped(work), ((count, faces) for faces, count in parts))

    return order


def _help(comm: Comm) -> None:
    """Order the parts that rank 0 has, until it has none."""
    while (work := comm.share(None)) is not None:
        deque(comm.spread(_swapped(work), ()), 0)


def _swapped(work: Work) -> Callable[[int, Array], Array]:
    return lambda count, faces: work(faces, count)


def _in_shares(source: Path, target: Path | None, options: Options, comm: Comm, measures: bool, check: bool, told: Progress) -> Report | None:
    """The report; None if the file cannot be read in shares."""
    with door(source.name), open_plain(source) as file:
        order, elements, _ = read_header(file, source.name)
        begin = file.tell()
        tables = tables_of(elements, begin) if order and len(elements) == 2 else None
        if tables is None or not tables[1].rows or max(table.end for table in tables) > source.stat().st_size:
            return None  # if it is too short, the reader of whole files says so
        report = Report(options.target)
        folder = None if target is None else target.parent
        layout = Layout(file, tables, options, comm, report, folder, lambda done: told(0.15 + 0.7 * done), measures)
        if not layout.look():
            return None
        told(0.08)
        layout.deal()
        told(0.15)
        layout.order()
        layout.number()
        told(0.88)
        if target is not None:
            file.seek(0)
            header = file.read(begin).decode("utf-8", "surrogateescape").splitlines()
            _write(layout, target, header, [table.element.name for table in sorted(tables, key=lambda table: table.begin)], comm, check)
        if measures:
            report.before, report.after = layout.measured()
        layout.spill.close()
        told(1.0)
    return _merged(report, comm)


def _write(layout: Layout, target: Path, header: list[str], names: list[str], comm: Comm, check: bool) -> None:
    tables = {"vertex": layout.vertex, "face": layout.face}
    counts = {"vertex": layout.rows, "face": int(layout.starts[-1])}
    text = "".join(_counted(line, counts) + "\n" for line in header).encode("utf-8", "surrogateescape")
    begins, end = {}, len(text)
    for name in names:
        begins[name] = end
        end += counts[name] * tables[name].dtype.itemsize
    with _whole_or_not(target, end, comm) as out:
        if comm.rank == 0:
            out.write(text)
        layout.write(out, begins)
        comm.gather(None)
        if check:
            _prove(layout, target, out, begins, counts, comm)


def _counted(line: str, counts: dict[str, int]) -> str:
    words = line.split()
    return f"element {words[1]} {counts[words[1]]}" if words[:1] == ["element"] else line


def _prove(layout: Layout, target: Path, out: IO[bytes], begins: dict[str, int], counts: dict[str, int], comm: Comm) -> None:
    """That old and new triangles have one sum."""
    vertex = Table(replace(layout.vertex.element, rows=counts["vertex"]), begins["vertex"])
    face = Table(replace(layout.face.element, rows=counts["face"]), begins["face"])
    drop = layout.options.drop_degenerate
    before = soup_sum(layout.file, layout.vertex, layout.face, comm, drop)
    after = soup_sum(out, vertex, face, comm, drop)
    if not np.array_equal(before, after):
        raise files.DifferenceError(target, "not written, because it would not be the same: triangles differ")


@contextmanager
def _whole_or_not(target: Path, size: int, comm: Comm) -> Iterator[IO[bytes]]:
    """A file of `size` bytes that all ranks write; it takes the place of `target` when they are done."""
    name = comm.share(str(beside(target)) if comm.rank == 0 else None)
    with unfinished(name) if comm.rank == 0 else nullcontext():
        try:
            if comm.rank == 0:
                with open(name, "xb") as out:
                    out.truncate(size)
            comm.gather(None)
            with open(name, "r+b") as out:
                yield out
                out.flush()
                os.fsync(out.fileno())  # on a shared disk, what it lacks room for is told only now
            comm.gather(None)
            if comm.rank == 0:
                os.chmod(name, mode_of(target))
                os.replace(name, target)
            comm.gather(None)
        except OSError as error:
            raise FileError(target, f"cannot write: {error.strerror or error}") from error
        finally:
            if comm.rank == 0:
                with suppress(OSError):
                    os.unlink(name)


def _merged(report: Report, comm: Comm) -> Report:
    """What all ranks did, on rank 0; stages take as long as on the slowest."""
    reports = comm.gather(report)
    stages = list(dict.fromkeys(stage for each in reports for stage in each.seconds))
    sums: dict[str, Any] = {name: sum(getattr(each, name) for each in reports) for name in ("welded", "degenerate", "duplicates", "unused")}
    found = replace(report, **sums, orders=[name for each in reports for name in each.orders],
                    seconds={stage: max(each.seconds.get(stage, 0.0) for each in reports) for stage in stages})  # fmt: skip
    found.refuse_nothing()
    return found
