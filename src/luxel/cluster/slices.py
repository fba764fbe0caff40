"""Slices: a run of a scene's triangles, as a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from luxel.errors import InputError
from luxel.raster.geometry import made_normals
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

MOST = 1 << 31
"""Triangles, from which on int32 cannot number them."""

FILLS = {"texcoords": (2, 0.0), "texcoords1": (2, 0.0), "colors": (4, 1.0), "tangents": (4, 0.0)}
"""Attributes that meshes may lack: their width, and the value that stands for none."""


def check_count(where: object, triangles: int) -> None:
    """See that all triangles of a scene have numbers of their own.

    Raises:
        InputError: There are too many for int32, which all ids are.
    """
    if triangles >= MOST:
        raise InputError(f"{where}: {triangles:,} triangles; expected fewer than 2^31 in one scene: cut it up, and draw the parts")


def sliced(scene: Scene, first: int, last: int) -> Scene:
    """`scene` with its triangles first .. last - 1 alone, and the vertices that they have; materials, lights and the like stay."""
    out = replace(scene, meshes=[], instances=[])
    start = 0
    for instance in scene.instances:
        mesh = scene.meshes[instance.mesh]
        begin, end = max(first - start, 0), min(last - start, len(mesh.triangles))
        start += len(mesh.triangles)
        if begin < end:
            out.meshes.append(mesh if end - begin == len(mesh.triangles) else part_of(mesh, begin, end))
            out.instances.append(replace(instance, mesh=len(out.meshes) - 1))
    return out


def part_of(mesh: Mesh, first: int, last: int) -> Mesh:
    """Triangles first .. last - 1 of a mesh, with normals as they are in the whole."""
    if mesh.normals is None:
        mesh = replace(mesh, normals=made_normals(mesh))
    used, triangles = np.unique(mesh.triangles[first:last], return_inverse=True)
    arrays: dict[str, Any] = {
        name: value[used] for name in ("positions", "normals", *FILLS) if (value := getattr(mesh, name)) is not None
    }
    return replace(mesh, triangles=triangles.reshape(-1, 3).astype(np.int32), **arrays)
