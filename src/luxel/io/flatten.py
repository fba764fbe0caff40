"""A scene as one mesh, for formats that hold no more."""

from __future__ import annotations

from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.io.files import tell
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Instance, Scene

_FILL = {
    "normals": (0, 0, 1),
    "texcoords": (0, 0),
    "texcoords1": (0, 0),
    "colors": (1, 1, 1, 1),
    "tangents": (1, 0, 0, 1),
}


def flatten(scene: Scene, where: str, keeps: tuple[str, ...]) -> Mesh:
    """All instances in world space as one mesh with the attributes in `keeps`; what the format cannot hold is said."""
    meshes = [placed(scene, instance) for instance in scene.instances]
    lost = [name for name in _FILL if name not in (*keeps, "normals", "tangents") and any(getattr(mesh, name) is not None for mesh in meshes)]
    if scene.materials:
        lost.append("materials")
    if lost:
        tell(where, f"the format does not hold {', '.join(lost)}")
    if len(meshes) == 1:
        mesh = meshes[0]
        return Mesh(mesh.positions, mesh.triangles, **{name: getattr(mesh, name) for name in keeps})
    starts = np.cumsum([0] + [len(mesh.positions) for mesh in meshes])[:-1].tolist()
    triangles = [mesh.triangles + np.int32(start) for mesh, start in zip(meshes, starts, strict=True)]
    joined: dict[str, Any] = {name: _joined(meshes, name) for name in keeps}
    return Mesh(
        np.concatenate([np.zeros((0, 3), np.float32), *(mesh.positions for mesh in meshes)]),
        np.concatenate([np.zeros((0, 3), np.int32), *triangles]),
        **joined,
    )


def _joined(meshes: list[Mesh], name: str) -> Array | None:
    """The attribute of all meshes, filled in where one has none; None where none has."""
    if all(getattr(mesh, name) is None for mesh in meshes):
        return None
    filled = [np.broadcast_to(np.array(_FILL[name], np.float32), (len(mesh.positions), len(_FILL[name]))) for mesh in meshes]
    return np.concatenate([fill if (own := getattr(mesh, name)) is None else own for mesh, fill in zip(meshes, filled, strict=True)])


def placed(scene: Scene, instance: Instance) -> Mesh:
    """The mesh of `instance` in world space; the same object where it stands at the origin already."""
    mesh, matrix = scene.meshes[instance.mesh], instance.world_from_mesh
    assert matrix is not None
    if np.array_equal(matrix, np.eye(4)):
        return mesh
    linear = matrix[:3, :3]
    positions = (mesh.positions @ linear.T + matrix[:3, 3]).astype(np.float32)
    mirrored = np.linalg.det(linear) < 0
    triangles = mesh.triangles[:, ::-1] if mirrored else mesh.triangles
    normals = None
    if mesh.normals is not None:
        a, b, c = linear.T
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1)
        turned = mesh.normals @ cofactors.T * (-1 if mirrored else 1)
        length = np.linalg.norm(turned, axis=1, keepdims=True)
        normals = np.where(length > 0, turned / np.where(length > 0, length, 1), (0, 0, 1)).astype(np.float32)
    others = {name: getattr(mesh, name) for name in ("texcoords", "texcoords1", "colors")}
    return Mesh(positions, np.ascontiguousarray(triangles), normals, material=mesh.material, name=mesh.name, **others)
