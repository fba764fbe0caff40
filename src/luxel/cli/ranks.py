"""luxel render under mpiexec: all ranks draw, rank 0 writes and speaks."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from luxel.cli.console import Console, seconds
from luxel.errors import InputError, LuxelWarning
from luxel.memory import peak_bytes

if TYPE_CHECKING:
    from luxel.cli.drawing import View
    from luxel.cluster.comm import Comm
    from luxel.cluster.shares import Shared
    from luxel.layout.optimize import Options, Report
    from luxel.scene.scene import Scene

_KINDS = {"screen": "the screen", "objects": "the triangles", "both": "the screen and the triangles"}


def draw_file(console: Console, comm: Comm, file: Path, output: Path, size: tuple[int, int], view: View, options: dict[str, Any],
              lightmap: Path | None, crease_angle: float | None, divide: str, composition: str, balance: str) -> None:  # fmt: skip
    """Draw a file with all ranks, one picture a camera, and write them on rank 0."""
    from luxel.cluster.agree import agree
    from luxel.cluster.render import Renderer
    from luxel.cluster.shares import share_scene

    start = time.perf_counter()
    if options.pop("device") != "cpu":
        raise InputError("--device: ranks of MPI draw on the processor; expected cpu")
    files = (file,) if lightmap is None else (file, lightmap)
    agree(comm, files, output=output, divide=divide, composition=composition, balance=balance, size=size, options=options,
          camera=view, crease_angle=crease_angle)  # fmt: skip
    warn_of_crowds(comm, options["threads"])
    shared = share_scene(file, comm, divide, composition, None if crease_angle is None else radians(crease_angle))
    if not shared.triangles and comm.rank == 0:
        warnings.warn(f"{file}: no triangles: the picture is empty", LuxelWarning, stacklevel=2)
    if lightmap is not None:
        share_lightmap(shared, lightmap, comm)
    cameras, before = comm.share(_cameras(view, shared, size) if comm.rank == 0 else None)
    shading, cull = options.pop("shading"), options.pop("cull")
    renderer = Renderer(shared._replace(outline=shared.scene), comm, divide, composition, balance, shading, cull)
    if len(cameras):
        compile_first(comm, lambda: _draw_little(shared, cameras[0], options, (divide, composition, balance, shading, cull)))
    loaded = time.perf_counter()
    paths = view.paths(output, len(cameras))
    with console.work("drawing") as report:
        for i, path in enumerate(paths):
            told = report if len(paths) == 1 else None
            try:
                picture = renderer.render(cameras[i], size, previous_camera=before[i], progress=told, **options)
            except MemoryError as error:
                raise InputError(f"--size {size[0]}x{size[1]}: not enough memory for {', '.join(options['outputs'])}") from error
            if picture is not None:
                picture.save(path)
            report((i + 1) / len(paths))
    peaks = comm.gather(peak_bytes())
    took = {"load": loaded - start, "draw": time.perf_counter() - loaded}
    ranks = [{**each, "peak": peak} for each, peak in zip(renderer.ranks, peaks, strict=True)]
    data = {"output": [str(path) for path in paths], "size": list(size), "triangles": shared.triangles, "seconds": took, "divide": divide,
            "composition": composition, "balance": balance, "ranks": ranks}  # fmt: skip
    kind = "objects" if divide == "both" and shared.division is not None and shared.division.groups == 1 else divide
    what = str(paths[0]) if len(paths) == 1 else f"{paths[0]} .. {paths[-1].name}"
    times = f"loaded in {seconds(took['load'])}, drawn in {seconds(took['draw'])}"
    console.result(data, f"{what}  ({size[0]}x{size[1]}, {shared.triangles:,} triangles; {comm.size} ranks share {_KINDS[kind]}; {times})")


def compile_first(comm: Comm, work: Callable[[], Any]) -> None:
    """Have rank 0 do a little of the work by itself, so that it compiles what is not compiled yet, once, and the others find it in the cache."""
    if comm.rank == 0 and comm.size > 1:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LuxelWarning)
            work()
    comm.gather(None)


def _draw_little(shared: Shared, camera: Any, options: dict[str, Any], ways: tuple[str, str, str, str | None, str]) -> None:
    from luxel.cluster.comm import Comm
    from luxel.cluster.render import Renderer
    from luxel.cluster.slices import sliced
    from luxel.cluster.sort_last import Division

    scene = sliced(shared.scene, 0, 64)
    count = scene.triangle_count
    division = shared.division
    if division is not None:
        division = Division(Comm(), Comm(), 0, np.ones(1, np.int64), np.array([0, count]), division.composition)
    Renderer(shared._replace(scene=scene, outline=scene, division=division, triangles=count, stream=None), Comm(), *ways).render(
        camera, (48, 27), previous_camera=camera if "motion" in options["outputs"] else None, **options)  # fmt: skip


def _cameras(view: View, shared: Shared, size: tuple[int, int]) -> tuple[Any, Any]:
    cameras = view.cameras(shared.outline, size)
    return cameras, view.cameras_before(cameras, shared.outline, size)


def optimize_with_ranks(comm: Comm, console: Console, file: Path, output: Path | None, options: Options, measures: bool, check: bool,
                        picture: Path | None) -> tuple[Report, list[Scene]] | None:  # fmt: skip
    """Lay a file out with all ranks: what rank 0 tells of; None on the others."""
    from luxel.cluster.agree import agree
    from luxel.cluster.layout_file import optimize_file

    if comm.rank:
        console.quiet, console.as_json = True, False
    agree(comm, (file,), options=options, output=output, measures=measures, check=check, picture=picture)
    warn_of_crowds(comm, options.threads)
    with console.work("ordering") as told:
        compile_first(comm, lambda: _order_little(options))
        report, scenes, shared = optimize_file(file, output, options, comm, measures=measures, check=check, progress=told)
    if picture is not None and shared:
        raise InputError("--picture: ranks that share a file hold no whole mesh to draw; without mpiexec it is drawn")
    return None if comm.rank else (report, scenes)


def _order_little(options: Options) -> None:
    from luxel.layout.optimize import Report, optimize_scene
    from luxel.scene.builtin import bumpy_sphere
    from luxel.scene.scene import Scene

    optimize_scene(Scene.from_mesh(bumpy_sphere(4)), options, Report(options.target))


def share_lightmap(shared: Shared, path: Path, comm: Comm) -> None:
    """Give a scene that ranks share a lightmap, as `with_lightmap` does it: materials are lightmapped for all ranks, or none.

    Raises:
        InputError: No rank has a mesh with lightmap coordinates.
    """
    from luxel.cli.drawing import give_lightmap, with_lightmap
    from luxel.scene.material import Material

    if shared.division is None:
        with_lightmap(shared.scene, path)
        return
    scene = shared.scene
    meshes = [mesh for mesh in scene.meshes if mesh.texcoords1 is not None]
    chosen = set().union(*comm.gather({mesh.material for mesh in meshes}))
    if not chosen:
        raise InputError("--lightmap: no mesh of the file has lightmap coordinates (TEXCOORD_1)")
    if -1 in chosen:  # what has no material gets one, for the lightmap
        scene.materials.append(Material())
        for mesh in meshes:
            mesh.material = mesh.material if mesh.material >= 0 else len(scene.materials) - 1
        chosen = chosen - {-1} | {len(scene.materials) - 1}
    give_lightmap(scene, path, chosen)


def share_work(comm: Comm, **told: Any) -> None:
    """See that ranks that share a command's work were given the same, by name, and tell of crowds; nothing for one."""
    if comm.size > 1:
        from luxel.cluster.agree import agree

        agree(comm, **told)
        warn_of_crowds(comm, told["threads"])


def shares_of(comm: Comm) -> list[dict[str, float]]:
    """Of each rank: bytes it has sent, seconds it has waited for others, and the most memory it has had, bytes."""
    own = {"sent": comm.sent, "waited": comm.waited, "peak": peak_bytes()}
    return comm.gather(own)


def warn_of_crowds(comm: Comm, threads: int | None) -> None:
    """Tell of a machine that has fewer cores than its ranks have threads."""
    from luxel.jit import own_cores

    cores = len(own_cores())
    asked = comm.threads(threads) * comm.neighbours
    if comm.rank == 0 and asked > cores and comm.neighbours > 1:
        warnings.warn(
            f"{comm.neighbours} ranks of {comm.threads(threads)} threads on a machine with {cores} cores wait for each other; "
            f"{'fewer ranks' if comm.neighbours > cores else f'--threads {cores // comm.neighbours}'} would be faster",
            LuxelWarning, stacklevel=2,
        )  # fmt: skip
