"""luxel form-factors: what share of each surface's radiation reaches which other."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet, seconds

if TYPE_CHECKING:
    from luxel.arrays import Array
    from luxel.radiosity.form_factors import FormFactors
    from luxel.scene import Mesh

EXAMPLE = "luxel form-factors room.glb -o factors.npz --one-sided"
_SHOWN = 20  # surfaces, in words


def form_factors(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="A .glb, .gltf, .obj, .ply, .stl or .off; each instance is one surface.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="The matrix as .npz, for scipy.sparse.load_npz.")] = None,
    one_sided: Annotated[bool, typer.Option("--one-sided", help="Surfaces radiate and receive on their front only.")] = False,
    each_triangle: Annotated[bool, typer.Option("--triangles", help="Each triangle is a surface of its own.")] = False,
    reference: Annotated[bool, typer.Option("--reference", help="Slower, to 0.05 %.")] = False,
    threads: Annotated[str | None, typer.Option("--threads", metavar="N", help="Default: all cores.")] = None,
    device: Annotated[str, typer.Option("--device", metavar="NAME", help="What integrates: cpu, cuda, or auto (a GPU if it can).")] = "cpu",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Compute the form factors (view factors) between surfaces that may partly hide each other."""
    if output is not None:
        values.output(output, (".npz",))
    number = None if threads is None else values.whole(threads, "--threads", 1)
    values.choice(device, ("cpu", "cuda", "auto"), "--device")
    console = Console(quiet, as_json)
    start = time.perf_counter()
    names, meshes = _surfaces(files, each_triangle)
    with console.work("form factors") as report:
        import luxel

        factors = luxel.form_factors(meshes, one_sided=one_sided, reference=reference, threads=number, progress=report, device=device)
    if output is not None:
        _save(output, factors)
    took = time.perf_counter() - start
    data = {
        "surfaces": len(meshes), "names": names, "areas": factors.areas.tolist(), "row_sums": factors.row_sums.tolist(),
        "errors": factors.errors.tolist(), "entries": int(factors.nnz), "output": None if output is None else str(output), "seconds": took,
    }  # fmt: skip
    if output is None:
        coordinates = factors.tocoo()
        data["factors"] = [[int(i), int(j), float(f)] for i, j, f in zip(*coordinates.coords, coordinates.data, strict=True)]
    rows = [f"  {name:24.24s} {area:12.6g} m2   row sum {total:.6f}" for name, area, total in zip(names, factors.areas, factors.row_sums)]
    more = [f"  ... and {len(rows) - _SHOWN:,} more"] if len(rows) > _SHOWN else []
    head = f"{len(meshes):,} surfaces, {factors.nnz:,} factors, {seconds(took)}{'' if output is None else f'  ->  {output}'}"
    console.result(data, "\n".join([head, *rows[:_SHOWN], *more]))


def _surfaces(files: list[Path], each_triangle: bool) -> tuple[list[str], list[Mesh]]:
    """Names and world-space meshes of what the files hold."""
    from luxel import Mesh, load
    from luxel.raster.geometry import flatten

    names, meshes = [], []
    for file in files:
        scene = load(file, normals=False)
        geometry = flatten(scene, cull="none")
        labels = [i.name for i in scene.instances if len(scene.meshes[i.mesh].triangles)]
        for part, label in enumerate(labels):
            faces = geometry.triangles[geometry.part_start[part] : geometry.part_start[part + 1]]
            name = label or f"{file.stem}:{part}"
            split = [faces[k : k + 1] for k in range(len(faces))] if each_triangle else [faces]
            for number, chosen in enumerate(split):
                names.append(f"{name}:{number}" if each_triangle else name)
                used, local = _used(chosen)
                meshes.append(Mesh(geometry.positions[used], local))
    return names, meshes


def _used(faces: Array) -> tuple[Array, Array]:
    """The vertices that faces use, and the faces in those."""
    import numpy as np

    used, local = np.unique(faces, return_inverse=True)
    return used, local.reshape(-1, 3).astype(np.int32)


def _save(path: Path, factors: FormFactors) -> None:
    """The matrix with areas and row sums, beside and then renamed."""
    import numpy as np

    from luxel.io.files import atomic_write

    with atomic_write(path) as file:
        np.savez_compressed(
            file, indices=factors.indices, indptr=factors.indptr, format=np.array(b"csr"), shape=np.array(factors.shape), data=factors.data,
            _is_array=True, areas=factors.areas, row_sums=factors.row_sums, errors=factors.errors,
        )  # fmt: skip
