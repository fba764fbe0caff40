"""Shares of what comes in units, each of which can be read without the others: the primitives of a glTF file, the files of a folder.

Units stand in the scene's order, each with the size that it seems to have before it is read. The sizes are cut evenly; a rank reads the units that
its part touches, and of one that others touch too it keeps its fraction of the triangles. So a rank never has more than its share and two units.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.cluster.slices import check_count, part_of, sliced
from luxel.io import READERS, load
from luxel.io.files import tell
from luxel.io.folder import joined, model_files, object_count
from luxel.io.gltf.read import Later, outline
from luxel.scene.mesh import Mesh
from luxel.scene.normals import with_normals
from luxel.scene.scene import Scene

_LARGE = 2  # times its share that a unit may have before it is told


def touched(sizes: list[int], comm: Comm) -> Iterator[tuple[int, Callable[[int], tuple[int, int]]]]:
    """The units of this rank; and for each, of how many triangles it turns out to have, the first and last + 1 that are this rank's."""
    first, last = comm.share_out(sum(sizes))[comm.rank]
    start = 0
    for unit, size in enumerate(sizes):
        low, high = max(first - start, 0), min(last - start, size)
        if low < high:
            yield unit, partial(_fraction, low, high, size)
        start += size


def _fraction(low: int, high: int, size: int, count: int) -> tuple[int, int]:
    return low * count // size, high * count // size


def _tell_large(path: Path, sizes: list[int], noun: str, comm: Comm) -> None:
    """Say it if one unit makes shares pointless: more than one rank reads it, and each of them all of it."""
    if comm.rank == 0 and comm.size > 1 and max(sizes, default=0) * comm.size > _LARGE * sum(sizes):
        share = max(sizes) / sum(sizes)
        tell(path.name, f"its largest {noun} is {share:.0%} of it, and read whole by every rank that has a part of it")


class _Read:
    """In place of a mesh in a scene that a camera is framed with: its positions, read when they are asked for, and those of one mesh at a time."""

    last: tuple[Any, Mesh | None] = (None, None)

    def __init__(self, count: int, make: Callable[[], Mesh]) -> None:
        self.triangles, self.material, self._make = np.broadcast_to(np.int32(0), (count, 3)), -1, make

    @property
    def _mesh(self) -> Mesh:
        if _Read.last[0] is not self:
            _Read.last = None, None
            _Read.last = self, self._make()
        mesh = _Read.last[1]
        assert mesh is not None
        return mesh

    @property
    def positions(self) -> Array:
        return self._mesh.positions

    def bounds(self) -> Array:
        """As of `Mesh`."""
        return self._mesh.bounds()


def gltf_share(path: Path, comm: Comm, crease_angle: float | None) -> tuple[Scene, Scene] | None:
    """This rank's part of a glTF file, and one to frame a camera with; None for files with skins.

    Args:
        path: Of the file; of its buffers only what is needed is read.
        comm: The ranks that share it.
        crease_angle: As of `luxel.load`.
    """
    whole = outline(path)
    if whole is None:
        return None
    later: Any = whole.meshes
    sizes = [later[instance.mesh].count for instance in whole.instances]
    check_count(path.name, sum(sizes))
    _tell_large(path, sizes, "primitive", comm)
    made: dict[int, Mesh] = {}
    share = replace(whole, meshes=[], instances=[])
    for unit, own in touched(sizes, comm):
        instance = whole.instances[unit]
        if instance.mesh not in made:
            made[instance.mesh] = _made(later[instance.mesh], crease_angle)
        mesh = made[instance.mesh]
        first, last = own(len(mesh.triangles))
        if first < last:
            share.meshes.append(mesh if last - first == len(mesh.triangles) else part_of(mesh, first, last))
            share.instances.append(replace(instance, mesh=len(share.meshes) - 1))
    share.check()
    frame: Any = [_Read(each.count, each.make) for each in later]
    return share, replace(whole, meshes=frame)


def _made(later: Later, crease_angle: float | None) -> Mesh:
    mesh = later.make()
    return mesh if mesh.normals is not None else with_normals(mesh, 0.0 if crease_angle is None else crease_angle)


def folder_share(folder: Path, comm: Comm, crease_angle: float | None) -> tuple[Scene, Scene]:
    """This rank's part of a folder of model files, with the materials, textures, lights and cameras of all; and one to frame a camera with.

    Args:
        folder: All ranks see the same files in it.
        comm: The ranks that share it.
        crease_angle: As of `luxel.load`.

    Raises:
        FileError: There is no model in it, or one cannot be read.
    """
    paths = model_files(folder, READERS)
    sizes = [max(1, path.stat().st_size) for path in paths]
    _tell_large(folder, sizes, "file", comm)
    own: dict[int, Scene] = {}
    told: dict[int, tuple[Scene, int, list[int]]] = {}
    for unit, mine in touched(sizes, comm):
        scene = load(paths[unit], crease_angle=crease_angle)
        first, last = mine(scene.triangle_count)
        own[unit] = sliced(scene, first, last)
        told[unit] = replace(scene, meshes=[]), object_count(scene), [len(mesh.triangles) for mesh in scene.meshes]
    known: dict[int, tuple[Scene, int, list[int]]] = {unit: each for every in comm.gather(told) for unit, each in every.items()}
    objects = [known[unit][1] for unit in range(len(paths))]
    parts = [replace(known[unit][0], meshes=own[unit].meshes, instances=own[unit].instances) if unit in own else
             replace(known[unit][0], instances=[]) for unit in range(len(paths))]  # fmt: skip
    frame = [replace(known[unit][0], meshes=_frame(paths[unit], known[unit][2])) for unit in range(len(paths))]
    outline_of = joined(folder.name, [(replace(scene, meshes=[], instances=[]), count) for scene, count in zip(frame, objects, strict=True)])
    start = 0
    for scene in frame:
        outline_of.instances += [replace(each, mesh=each.mesh + start) for each in scene.instances]
        outline_of.meshes += scene.meshes
        start += len(scene.meshes)
    return joined(folder.name, zip(parts, objects, strict=True)), outline_of


def _frame(path: Path, counts: list[int]) -> Any:
    return [_Read(count, partial(_mesh_of, path, k)) for k, count in enumerate(counts)]


def _mesh_of(path: Path, number: int) -> Mesh:
    return load(path, normals=False).meshes[number]
