"""Packing: the one door to xatlas, which cuts surfaces into charts and packs them on pages.

It holds Python's lock while it works, can work for minutes, and has been seen to crash, one time in hundreds, on what it charts well the next time.
So it works in a process of its own, which leaves progress bars moving and can be interrupted; if it crashes it is started anew, and if it goes
on crashing, an exception says so.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from tempfile import TemporaryFile
from typing import IO, Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import ExtraMissingError, LuxelError

TRIES = 3

_SECONDS_A_TRIANGLE = 7e-5
_PACE = 1.5  # four fifths are said to be done when as long as expected has passed


class Sheet(NamedTuple):
    """One mesh for xatlas: positions (n, 3) float32 in texels, triangles (m, 3) uint32, normals (n, 3) float32."""

    positions: Array
    triangles: Array
    normals: Array


class Flat(NamedTuple):
    """What xatlas makes of it.

    Attributes:
        source: (k,) uint32, the vertex that each new vertex is a copy of.
        triangles: (m, 3) uint32, of new vertices.
        texcoords: (k, 2) float32, 0 to 1 over a page.
        chart: (m,) int32, from 0 on in each mesh; -1 for triangles that it leaves out.
        page: (m,) int32.
    """

    source: Array
    triangles: Array
    texcoords: Array
    chart: Array
    page: Array


class Wishes(NamedTuple):
    """How to chart and pack: width and height of a page and free texels around each chart; largest chart in square texels, and the cost up to
    which charts grow."""

    page: int
    padding: int
    largest: float
    cost: float


def pack(sheets: list[Sheet], wishes: Wishes, progress: Callable[[float], None] | None = None) -> list[Flat]:
    """Chart the sheets and pack all charts on common pages; `progress` is called with the share that is probably done.

    Raises:
        ExtraMissingError: xatlas is not installed.
        LuxelError: Its process died.
    """
    try:
        import xatlas  # noqa: F401
    except ImportError as error:
        raise ExtraMissingError("xatlas", "bake", "making lightmap coordinates") from error
    count = sum(len(sheet.triangles) for sheet in sheets)
    if not count:
        return []
    if not sys.executable:
        return _pack(sheets, wishes)
    for _ in range(TRIES - 1):
        with suppress(_CrashedError):
            return _elsewhere(sheets, wishes, count * _SECONDS_A_TRIANGLE, progress)
    return _elsewhere(sheets, wishes, count * _SECONDS_A_TRIANGLE, progress)


class _CrashedError(LuxelError):
    """The process was ended by a signal."""


def _pack(sheets: list[Sheet], wishes: Wishes, atlas: Any = None) -> list[Flat]:
    """What `atlas`, or a new one, makes of the sheets."""
    import xatlas

    atlas = xatlas.Atlas() if atlas is None else atlas  # an empty one counts as false
    options, packing = xatlas.ChartOptions(), xatlas.PackOptions()
    for sheet in sheets:
        atlas.add_mesh(*sheet)
    options.max_chart_area, options.max_cost = wishes.largest, wishes.cost
    packing.resolution, packing.padding, packing.texels_per_unit = wishes.page, wishes.padding, 1.0
    packing.rotate_charts_to_axis = True
    atlas.generate(options, packing)
    return [_flat(atlas, number) for number in range(len(sheets))]


def _flat(atlas: Any, number: int) -> Flat:
    source, triangles, texcoords = atlas.get_mesh(number)
    chart, page = np.full(len(triangles), -1, np.int32), np.zeros(len(triangles), np.int32)
    for k in range(atlas.get_mesh_chart_count(number)):
        found = atlas.get_mesh_chart(number, k)
        faces = np.asarray(found.faces, np.int64)
        chart[faces], page[faces] = k, found.atlas_index
    return Flat(source, triangles, texcoords, chart, page)


def _elsewhere(sheets: list[Sheet], wishes: Wishes, expected: float, progress: Callable[[float], None] | None) -> list[Flat]:
    """`_pack` in a process of its own."""
    started = time.monotonic()
    with TemporaryFile() as sent, TemporaryFile() as answer, TemporaryFile() as said:
        _write(sent, [sheet._asdict() for sheet in sheets] + [{"wishes": np.array(wishes)}])
        sent.seek(0)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(place for place in sys.path if place)}
        with subprocess.Popen([sys.executable, "-m", __name__], stdin=sent, stdout=answer, stderr=said, env=environment) as child:
            try:
                while _running(child):
                    if progress:  # xatlas tells nothing; so that what takes longer than expected goes on, ever more slowly
                        progress(min(0.99, 1 - math.exp(-_PACE * (time.monotonic() - started) / expected)))
            except BaseException:
                child.kill()
                raise
        if child.returncode:
            said.seek(0)
            last = said.read().decode(errors="replace").strip().rpartition("\n")[2]
            kind = _CrashedError if child.returncode < 0 else LuxelError
            raise kind(f"xatlas, which makes lightmap coordinates, ended with {child.returncode}" + (f": {last}" if last else ""))
        answer.seek(0)
        return [Flat(**fields) for fields in _read(answer)]


def _running(child: subprocess.Popen[bytes]) -> bool:
    """Wait a moment for the end."""
    try:
        child.wait(0.1)
    except subprocess.TimeoutExpired:
        return True
    return False


def _write(file: IO[bytes], records: list[dict[str, Array]]) -> None:
    arrays: dict[str, Any] = {f"{i} {name}": value for i, fields in enumerate(records) for name, value in fields.items()}
    np.savez(file, **arrays)


def _read(source: IO[bytes]) -> list[dict[str, Array]]:
    records: list[dict[str, Array]] = []
    with np.load(source) as file:
        for key in file.files:
            number, name = key.split()
            records += [{} for _ in range(int(number) + 1 - len(records))]
            records[int(number)][name] = file[key]
    return records


def _serve() -> None:
    """The other process: sheets and wishes on standard input, flats on standard output.

    It ends without taking anything down: once in thousands of times xatlas waits for ever for threads that have ended when an atlas goes.
    """
    import xatlas

    answer, atlas = os.dup(1), xatlas.Atlas()
    os.dup2(2, 1)  # what the library prints is no part of the answer
    *sheets, last = _read(sys.stdin.buffer)
    page, padding, largest, cost = last["wishes"].tolist()
    made = _pack([Sheet(**fields) for fields in sheets], Wishes(int(page), int(padding), largest, cost), atlas)
    with os.fdopen(answer, "wb") as file:
        _write(file, [flat._asdict() for flat in made])
    os._exit(0)


if __name__ == "__main__":
    _serve()
