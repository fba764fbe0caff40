"""Form factors: errors against exact values as the tolerance falls, and time beside PyViewFactor.

    python benchmarks/form_factors.py            # print
    python benchmarks/form_factors.py --write    # and put the tables into RESULTS.md
    python benchmarks/form_factors.py --large    # with 5,000 surfaces too

The peer (extra `peers`) takes one ray a pair to decide whether it is hidden, so it has no partly hidden pairs; its time is given with its error.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import Any

import numpy as np

import luxel
from luxel import Mesh
from report import machine, table, write_section

QUAD = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def quad(*corners: Any) -> Mesh:
    return Mesh(np.array(corners, np.float32), QUAD)


def rectangle(width: float, depth: float, z: float, up: bool = True) -> Mesh:
    x, y = width / 2, depth / 2
    corners = [(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)]
    return quad(*(corners if up else corners[::-1]))


def disc(radius: float, z: float, n: int = 128) -> Mesh:
    angle, radius = np.arange(n) * (2 * np.pi / n), radius * math.sqrt(2 * math.pi / n / math.sin(2 * math.pi / n))
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, z)], 1)
    k = np.arange(n)
    return Mesh(np.concatenate([rim, [[0, 0, z]]]).astype(np.float32), np.stack([np.full(n, n), k, (k + 1) % n], 1))


def cases() -> list[tuple[str, list[Mesh], float]]:
    floor = quad((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))
    return [
        ("parallel squares, distance 1", [rectangle(1, 1, 0), rectangle(1, 1, 1, False)], 0.199824895698),
        ("parallel squares, distance 0.1", [rectangle(1, 1, 0), rectangle(1, 1, 0.1, False)], 0.826994522397),
        ("parallel 1 x 2", [rectangle(1, 2, 0), rectangle(1, 2, 1, False)], 0.285875384851),
        ("perpendicular, common edge", [floor, quad((0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1))], 0.200043776075),
        ("perpendicular, height 0.5", [floor, quad((0, 0, 0), (0, 1, 0), (0, 1, 0.5), (0, 0, 0.5))], 0.146186679106),
        ("discs, radius 1, distance 1", [disc(1, 0), disc(1, 1)], 0.381966011250),
        ("discs, radius 0.5 and 1", [disc(0.5, 0), disc(1, 1)], 0.468871125851),
        ("hidden by a square of 0.25", [rectangle(1, 1, 0), rectangle(1, 1, 1, False), rectangle(0.25, 0.25, 0.5)], 0.169474204912),
        ("hidden by a square of 0.5", [rectangle(1, 1, 0), rectangle(1, 1, 1, False), rectangle(0.5, 0.5, 0.5)], 0.0995062945990),
    ]


def convergence() -> str:
    steps: list[tuple[str, dict[str, Any]]] = [(f"{t:g}", {"tolerance": t}) for t in (0.1, 0.01)]
    steps += [("default", {}), ("1e-4", {"tolerance": 1e-4}), ("reference", {"reference": True})]
    rows = []
    for name, meshes, exact in cases():
        errors = [abs(luxel.form_factors(meshes, **options)[0, 1] / exact - 1) for _, options in steps]
        rows.append([name, f"{exact:.9f}", *(f"{100 * error:.1e} %" for error in errors)])
    return table(["case", "exact", *(name for name, _ in steps)], rows)


def grid(origin: Any, u: Any, v: Any, size: float) -> list[Mesh]:
    nu, nv = (max(1, round(float(np.linalg.norm(side)) / size)) for side in (u, v))

    def at(i: int, j: int) -> Any:
        return origin + u * (i / nu) + v * (j / nv)

    return [quad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)) for i in range(nu) for j in range(nv)]


def box(low: Any, high: Any, size: float, inward: bool) -> list[Mesh]:
    low, high = np.asarray(low, float), np.asarray(high, float)
    meshes: list[Mesh] = []
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3], v[(axis + 2) % 3] = (high - low)[(axis + 1) % 3], (high - low)[(axis + 2) % 3]
        for side in (0, 1):
            origin = low.copy()
            origin[axis] = (low, high)[side][axis]
            meshes += grid(origin, u, v, size) if (side == 0) == inward else grid(origin, v, u, size)
    return meshes


def room(size: float) -> list[Mesh]:
    """6 x 3 x 5 m with four boxes, in patches of about `size` metres."""
    meshes = box((0, 0, 0), (6, 3, 5), size, True)
    furniture = ((0.5, 0.5), (1, 1, 1)), ((2.5, 1.5), (1, 0.8, 2)), ((4.5, 0.5), (1, 2, 0.6)), ((4.2, 3.5), (0.8, 1.2, 1))
    for (x, z), extent in furniture:
        low = (x, 0.02, z)
        meshes += box(low, np.add(low, extent), size, False)
    return meshes


def ours(meshes: list[Mesh], **options: Any) -> tuple[float, float, Any]:
    start, cpu = time.perf_counter(), time.process_time()
    factors = luxel.form_factors(meshes, one_sided=True, **options)
    return time.perf_counter() - start, time.process_time() - cpu, factors


def peer(meshes: list[Mesh]) -> tuple[float, Any] | None:
    """Seconds and the dense matrix F_ij of PyViewFactor, or None if it is not installed."""
    try:
        import pyviewfactor
        import pyvista
    except ImportError:
        return None
    points = np.concatenate([m.positions for m in meshes]).astype(float)
    faces = np.concatenate([[4, 4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3] for k in range(len(meshes))])
    mesh = pyvista.PolyData(points, faces)
    start = time.perf_counter()
    matrix = pyviewfactor.compute_viewfactor_matrix(mesh, obstacles=[mesh.triangulate()])
    return time.perf_counter() - start, np.asarray(matrix).T


def speed(sizes: list[float]) -> str:
    small = room(1.5)
    ours(small)
    peer(small)
    rows = []
    for size in sizes:
        meshes = room(size)
        seconds, cpu, factors = ours(meshes)
        worst = np.abs(factors.row_sums - 1)
        pairs = len(meshes) * (len(meshes) - 1) / 2
        figures = [f"{len(meshes):,}", f"{factors.nnz:,}", f"{seconds:.1f}", f"{cpu:.1f}", f"{pairs / seconds:,.0f}", f"{worst.max():.1e}"]
        theirs = peer(meshes) if len(meshes) < 2500 else None
        figures += ["", ""] if theirs is None else [f"{theirs[0]:.1f}", f"{np.abs(theirs[1].sum(1) - 1).max():.1e}"]
        rows.append(figures)
        print(rows[-1], flush=True)
    head = ["surfaces", "factors", "luxel s", "of CPU", "pairs/s", "largest error of a row sum", "PyViewFactor s", "its largest error of a row sum"]
    return table(head, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--large", action="store_true", help="5,000 surfaces too")
    arguments = parser.parse_args()
    errors = convergence()
    print(errors)
    times = speed([0.75, 0.38, *([0.175] if arguments.large else [])])
    text = (
        f"{machine()}\n\nRelative error by tolerance; discs are polygons of 128 corners and the disc's area:\n\n{errors}\n\n"
        f"A closed room with four boxes, all of it in patches, one-sided, default tolerance, all cores:\n\n{times}"
    )
    print(text)
    if arguments.write:
        write_section("Form factors", text)


if __name__ == "__main__":
    main()
