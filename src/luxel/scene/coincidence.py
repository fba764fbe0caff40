"""Instances that show the same triangles at the same place, through whichever meshes and matrices they do."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable
from functools import cache

import numpy as np

from luxel.arrays import Array
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

_STEP = 0.9e-6  # of the scene's largest coordinate: nearer than this is the same; no power of two, as coordinates like to be multiples of those


def coincident(scene: Scene, largest: float) -> list[list[int]]:
    """Groups of two and more instances, by index, whose triangles are the same at the same place.

    The order of triangles and of their corners does not count. Triangles are only looked at where two instances have as many of them
    around the same middle, so this costs nothing in most scenes.

    Args:
        largest: The world's largest coordinate, metres; places are compared to about a millionth of it.
    """
    meshes, step = scene.meshes, _STEP * (largest or 1.0)
    matrices = [np.asarray(instance.world_from_mesh) for instance in scene.instances]

    @cache
    def middle(mesh: int) -> Array:
        return np.nan_to_num(meshes[mesh].positions[meshes[mesh].triangles].mean((0, 1), np.float64))

    @cache
    def shown(mesh: int, matrix: bytes) -> int:
        return _signature(meshes[mesh], np.frombuffer(matrix).reshape(4, 4), step)

    def count(i: int) -> Hashable:
        return len(meshes[scene.instances[i].mesh].triangles)

    def place(i: int) -> Hashable:
        return tuple(_cells(middle(scene.instances[i].mesh)[None], matrices[i], step)[0])

    def triangles(i: int) -> Hashable:
        return shown(scene.instances[i].mesh, matrices[i].tobytes())

    groups = [[i for i in range(len(scene.instances)) if count(i)]]
    for key in (count, place, triangles):
        groups = [part for group in groups for part in _split(group, key)]
    return groups


def mixed(columns: list[Array]) -> Array:
    """(n,) uint64: one number a row of uint64 columns; rows that are equal give equal numbers, others nearly never."""
    key = np.zeros(len(columns[0]), np.uint64)
    for column in columns:
        key ^= column
        key *= np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
        key *= np.uint64(0xBF58476D1CE4E5B9)
        key ^= key >> np.uint64(32)
    return key


def _split(group: list[int], key: Callable[[int], Hashable]) -> list[list[int]]:
    """The members of a group by their keys; those that are alone are left out."""
    parts = defaultdict(list)
    for i in group:
        parts[key(i)].append(i)
    return [part for part in parts.values() if len(part) > 1]


def _cells(points: Array, matrix: Array, step: float) -> Array:
    """(n, 3) int64: the cells of a fine grid in which points (n, 3) lie once `matrix` has moved them."""
    with np.errstate(all="ignore"):
        moved = points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        return np.round(np.nan_to_num(moved / step)).astype(np.int64)


def _signature(mesh: Mesh, matrix: Array, step: float) -> int:
    """A number that equal sets of triangles share, and others nearly never."""
    places = mixed(list(_cells(mesh.positions, matrix, step).view(np.uint64).T))
    corners = np.sort(places[mesh.triangles], 1)
    return int(mixed(list(corners.T)).sum(dtype=np.uint64))
