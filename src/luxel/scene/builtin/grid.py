"""From rows and columns of points to a mesh: what every shape here is made of."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.scene.mesh import Mesh


def quads(rows: int, columns: int) -> Array:
    """(2 (rows - 1) (columns - 1), 3) int32: two triangles a cell of a grid of vertices; they face columns x rows."""
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    return strips(a, a + columns)


def strips(low: Array, high: Array) -> Array:
    """(2 k, 3) int32: cells with a lower edge from vertex `low[i]` to the next, an upper one from `high[i]`."""
    return np.stack([low, low + 1, high, low + 1, high + 1, high], -1).reshape(-1, 3).astype(np.int32)


def surface(points: object, name: str = "") -> Mesh:
    """A smooth open surface through a grid of points.

    Args:
        points: (rows, columns, 3), metres, at least 2 x 2. The front is where columns run to the right and rows up.
        name: Of the mesh.

    Returns:
        A mesh with normals by central differences, and texture coordinates 0..1 (v = 0 along the last row).
    """
    p = checked(points, ("rows", "columns", 3), np.float64, "points")
    rows, columns = p.shape[:2]
    if rows < 2 or columns < 2:
        raise InputError(f"points: expected at least 2 rows and 2 columns, got {rows} and {columns}")
    normals = np.cross(np.gradient(p, axis=1), np.gradient(p, axis=0))
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(1, 0, rows))
    return Mesh(
        p.reshape(-1, 3),
        quads(rows, columns),
        normalized(normals).reshape(-1, 3),
        np.stack([u, v], -1).reshape(-1, 2),
        name=name,
    )


def normalized(vectors: Array) -> Array:
    """The same directions, length 1; a zero vector becomes +y."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    up = np.array([0.0, 1.0, 0.0])
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), up)


def compact(mesh: Mesh) -> Mesh:
    """Without triangles two of whose corners coincide, and without vertices that nothing uses."""
    p = mesh.positions[mesh.triangles]
    same = [(p[:, i] == p[:, (i + 1) % 3]).all(-1) for i in range(3)]
    kept = mesh.triangles[~(same[0] | same[1] | same[2])]
    used, triangles = np.unique(kept, return_inverse=True)
    per_vertex = ("positions", "normals", "texcoords", "texcoords1", "colors", "tangents")
    arrays = {name: getattr(mesh, name) for name in per_vertex}
    kept_arrays: dict[str, Any] = {name: None if array is None else array[used] for name, array in arrays.items()}
    return replace(mesh, triangles=triangles.reshape(-1, 3), **kept_arrays)


def transformed(mesh: Mesh, matrix: object) -> Mesh:
    """A copy of `mesh` moved by `matrix` (4, 4), normals along with it; a mirror keeps the front outside."""
    m = checked(matrix, (4, 4), np.float64, "matrix")
    linear = m[:3, :3]
    mirrored = np.linalg.det(linear) < 0
    turn = np.linalg.inv(linear)  # normals go by the inverse transpose: n @ inv(L)
    return replace(
        mesh,
        positions=mesh.positions @ linear.T + m[:3, 3],
        triangles=mesh.triangles[:, ::-1] if mirrored else mesh.triangles,
        normals=None if mesh.normals is None else normalized(mesh.normals @ turn),
        tangents=None,
    )


def merged(meshes: list[Mesh], name: str = "") -> Mesh:
    """One mesh of several; an attribute stays when all of them have it. The material is the first one's."""
    if not meshes:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32), name=name)
    starts = np.cumsum([0] + [len(mesh.positions) for mesh in meshes[:-1]])

    def joined(attribute: str) -> Array | None:
        parts = [getattr(mesh, attribute) for mesh in meshes]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    return Mesh(
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)]),
        joined("normals"),
        joined("texcoords"),
        joined("texcoords1"),
        joined("colors"),
        material=meshes[0].material,
        name=name or meshes[0].name,
    )
