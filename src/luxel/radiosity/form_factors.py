"""Form factors between surfaces, partly hidden ones too: `luxel.form_factors`.

F_ij is the share of what surface i radiates, evenly and diffusely, that reaches surface j directly:

    F_ij = 1 / A_i  integral over A_i  integral over A_j  cos_i cos_j V / (pi r^2)

Howell, Mengüç, Daun, Siegel, "Thermal radiation heat transfer", chapter 4. One double integral serves both directions, so A_i F_ij = A_j F_ji
holds to rounding; rows are not scaled to sum to 1, so that their sums tell how good they are.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError, LuxelWarning
from luxel.radiosity.bvh import build
from luxel.radiosity.occlusion import prepare
from luxel.radiosity.pairs import Wanted, World, exchange, make_scratch
from luxel.radiosity.surfaces import obstacles_of, polygons_of
from luxel.scene.mesh import Mesh

TOLERANCE, REFERENCE = 1e-3, 2e-5
_ROWS = 1 << 22  # numbers in a block of rows


class FormFactors(csr_array):
    """The (n, n) matrix of form factors F_ij, a `scipy.sparse.csr_array` of float64.

    Attributes:
        areas: (n,) float64, of one side of each surface, square metres.
        row_sums: (n,) float64: 1 inside a closed room, less where rays escape; for two-sided surfaces both sides count, so up to 2.
        errors: (n,) float64: estimated error of each row's sum, all errors of a row taken as if they had one sign.
    """

    areas: Array
    row_sums: Array
    errors: Array


def form_factors(
    meshes: Iterable[Mesh],
    *,
    one_sided: bool = False,
    tolerance: float | None = None,
    reference: bool = False,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
    device: str = "cpu",
) -> FormFactors:
    """Form factors between n surfaces, each an obstacle to all others.

    Args:
        meshes: n meshes, each one surface of any number of triangles, in metres. It may see itself.
        one_sided: Surfaces radiate and receive on their front only, where their triangles run counter-clockwise; they hide from both sides.
            Otherwise on both sides.
        tolerance: Relative error aimed at in each F_ij, or absolute error of so much over n (or 1000), whichever allows more: 1e-3, or 2e-5 for the
            reference.
        reference: Look closer at partly hidden pairs.
        threads: How many; default all cores. The result does not depend on it.
        progress: Called with the part done, 0..1.
        device: "cpu"; "cuda": a GPU integrates; or "auto": a GPU if one can be used and has the memory. The result is the same but for rounding.

    Returns:
        `FormFactors`, sparse: pairs that do not see each other are left out.

    Raises:
        InputError: Something is not a mesh, a vertex is not finite, or the tolerance is not between 1e-9 and 0.5.
        DeviceError: Device "cuda", and there is no GPU, no driver, too old a card, or too little memory on it.
        ExtraMissingError: Device "cuda", and numba-cuda is not installed.
    """
    surfaces = _checked(meshes)
    tolerance = (REFERENCE if reference else TOLERANCE) if tolerance is None else float(tolerance)
    if not 1e-9 <= tolerance <= 0.5:
        raise InputError(f"tolerance: expected a number from 1e-9 to 0.5, got {tolerance!r}")
    n = len(surfaces)
    wanted = Wanted(tolerance, tolerance / max(n, 1000), 3 if reference else 2, 4096 if reference else 64, one_sided)
    world, starts = _world(surfaces)
    areas = np.bincount(world.polygons.surface, world.polygons.area, n)
    if n and not areas.all():
        empty = np.flatnonzero(areas == 0)
        which = f"surface {empty[0]} has no area: its" if len(empty) == 1 else f"{len(empty)} surfaces have no area (the first is {empty[0]}): their"
        warnings.warn(f"{which} form factors are 0", LuxelWarning, stacklevel=2)
    fill = _filler(device, world, starts, wanted, jit.checked_threads(threads))
    rows, columns, values, errors = _exchanges(n, fill, progress)
    return _matrix(rows, columns, values, errors, areas)


def _checked(meshes: Iterable[Mesh]) -> list[Mesh]:
    surfaces = list(meshes)
    for number, mesh in enumerate(surfaces):
        if not isinstance(mesh, Mesh):
            raise InputError(f"meshes[{number}]: expected a luxel.Mesh, got {type(mesh).__name__}")
    return surfaces


def _world(surfaces: list[Mesh]) -> tuple[World, Array]:
    """The surfaces as polygons with what finds obstacles, and (n + 1,) int64: where each surface's polygons begin."""
    polygons = polygons_of(surfaces)
    obstacles, owner = obstacles_of(polygons)
    corners = obstacles.corners
    boxes = build(corners.min(1).astype(np.float32), corners.max(1).astype(np.float32))
    faces = np.arange(4 * len(corners), dtype=np.int32).reshape(-1, 4)
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[obstacles.sides == 4][:, [0, 2, 3]]])
    occlusion = prepare(corners.reshape(-1, 3).astype(np.float32), triangles)
    starts = np.searchsorted(polygons.surface, np.arange(len(surfaces) + 1))
    return World(polygons, obstacles, owner, boxes.box, boxes.link, boxes.order, occlusion), starts.astype(np.int64)


@jit.parallel_kernel
def _fill_rows(queue, world, starts, wanted, first, block, errors):
    """Exchanges of the surfaces first, first + 1, ... with those not before them, into the rows of `block` and `errors` (k, n)."""
    own = make_scratch()
    world, scratch = jit.borrow(world), jit.borrow(own)
    surface = world.polygons.surface
    row = jit.take(queue)
    while row < len(block):
        i = first + row
        for p in range(starts[i], starts[i + 1]):
            for q in range(p + 1, len(surface)):
                value, error = exchange(world, p, q, wanted, scratch)
                times = 2.0 if surface[q] == i else 1.0
                block[row, surface[q]] += times * value
                errors[row, surface[q]] += times * error
        row = jit.take(queue)
    own.bounds[0] = 0.0  # the scratch must live until here


def _filler(device: str, world: World, starts: Array, wanted: Wanted, threads: int) -> Callable[[int, Array, Array], None]:
    """What fills `block` and `errors` (k, n) from surface `first` on, as `_fill_rows`, on a device."""
    if device != "cpu":
        from luxel.cuda.form_factors import pairs_on

        there = pairs_on(device, world, starts, wanted)
        if there is not None:
            return there.fill

    def fill(first: int, block: Array, errors: Array) -> None:
        jit.run(_fill_rows, min(threads, len(block)), world, starts, wanted, first, block, errors)

    return fill


def _exchanges(
    n: int, fill: Callable[[int, Array, Array], None], progress: Callable[[float], None] | None
) -> tuple[Array, Array, Array, Array]:
    """Rows, columns and values (square metres) of the exchanges of n surfaces that are not 0, row <= column, and their errors."""
    step = max(1, min(-(-n // 16), _ROWS // max(n, 1)))
    parts = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))]
    for first in range(0, n, step):
        block, errors = np.zeros((min(step, n - first), n)), np.zeros((min(step, n - first), n))
        fill(first, block, errors)
        rows, columns = np.nonzero(block)
        parts.append((rows + first, columns, block[rows, columns], errors[rows, columns]))
        if progress is not None:
            progress(1 - (1 - min(first + step, n) / n) ** 2)
    rows, columns, values, wrong = (np.concatenate(column) for column in zip(*parts))
    return rows, columns, values, wrong


def _matrix(rows: Array, columns: Array, values: Array, errors: Array, areas: Array) -> FormFactors:
    """Both halves, divided by the areas."""
    n = len(areas)
    apart = rows != columns
    i, j = np.concatenate([rows, columns[apart]]), np.concatenate([columns, rows[apart]])
    per_area = 1 / np.where(areas > 0, areas, 1)

    def assembled(numbers: Array) -> Any:
        return coo_array((np.concatenate([numbers, numbers[apart]]) * per_area[i], (i, j)), shape=(n, n)).tocsr()

    factors = FormFactors(assembled(values))
    factors.areas = areas
    factors.row_sums = np.asarray(factors.sum(axis=1)).reshape(n)
    factors.errors = np.asarray(assembled(errors).sum(axis=1)).reshape(n)
    return factors
