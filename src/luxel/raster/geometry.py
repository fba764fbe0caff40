"""Geometry: a scene as the flat arrays that the rasteriser draws."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.raster.bin import BLEND, MASK, OPAQUE, Parts
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Instance, Scene
from luxel.scene.transforms import mapped


class Geometry(NamedTuple):
    """All instances of a scene in world space, one after the other.

    Attributes:
        positions: (n, 3) float32, metres.
        triangles: (m, 3) int32; the triangle id that pictures show is the row here.
        normals: (n, 3) float32, any length.
        texcoords, texcoords1: (n, 2) float32, or (0, 2) if no mesh has any.
        colors: (n, 4) float32, or (0, 4).
        tangents: (n, 4) float32, or (0, 4).
        part_start: (p + 1,) int32: part i, one instance, is the triangles part_start[i] .. part_start[i + 1] - 1.
        part_material: (p,) int32, index into the scene's materials; the default material is the last index.
        part_object: (p,) int32, object id.
        parts: What `bin_triangles` needs of them.
    """

    positions: Array
    triangles: Array
    normals: Array
    texcoords: Array
    texcoords1: Array
    colors: Array
    tangents: Array
    part_start: Array
    part_material: Array
    part_object: Array
    parts: Parts


_WIDTHS = {"normals": 3, "texcoords": 2, "texcoords1": 2, "colors": 4, "tangents": 4}
_MODES = {"OPAQUE": OPAQUE, "MASK": MASK, "BLEND": BLEND}


def flatten(scene: Scene, cull: str = "material") -> Geometry:
    """Lay a scene out flat; the arrays of a scene with one instance that stands where its mesh does are used as they are.

    Args:
        cull: "material": back faces of single-sided materials go; "back": all back faces; "none": none.
    """
    scene.check()
    instances = [i for i in scene.instances if len(scene.meshes[i.mesh].triangles)]
    meshes = [scene.meshes[i.mesh] for i in instances]
    starts = np.cumsum([0] + [len(mesh.triangles) for mesh in meshes]).astype(np.int32)
    material = np.array([mesh.material % (len(scene.materials) + 1) for mesh in meshes], np.int32)
    known = scene.materials
    modes = [OPAQUE if m >= len(known) else _MODES[known[m].alpha_mode] for m in material]
    single = [m >= len(known) or not known[m].double_sided for m in material]
    culls = {"material": single, "back": [True] * len(meshes), "none": [False] * len(meshes)}[cull]
    mirrored = [bool(np.linalg.det(_matrix(i)[:3, :3]) < 0) for i in instances]
    arrays = _gather(instances, meshes, mirrored)
    parts = Parts(starts, np.array(modes, np.int32), np.array(culls, np.int32))
    positions, triangles, *rest = arrays
    normals, texcoords, texcoords1, colors, tangents = rest
    objects = np.array([i.object for i in instances], np.int32)
    return Geometry(positions, triangles, normals, texcoords, texcoords1, colors, tangents, starts, material, objects, parts)


def _gather(instances: list[Instance], meshes: list[Mesh], mirrored: list[bool]) -> list[Array]:
    present = {name: any(getattr(mesh, name) is not None for mesh in meshes) for name in _WIDTHS}
    present["normals"] = True
    if len(meshes) == 1 and np.array_equal(_matrix(instances[0]), np.eye(4)):
        mesh = meshes[0]
        rows = [_attribute(mesh, name) if present[name] else np.zeros((0, width), np.float32) for name, width in _WIDTHS.items()]
        arrays = [mesh.positions, mesh.triangles, *rows]
        return [np.require(array, requirements="W") for array in arrays]  # kernels would be compiled anew for arrays that are read-only
    count = sum(len(mesh.positions) for mesh in meshes)
    positions, triangles = np.empty((count, 3), np.float32), np.empty((sum(len(mesh.triangles) for mesh in meshes), 3), np.int32)
    attributes = {name: np.empty((count if present[name] else 0, width), np.float32) for name, width in _WIDTHS.items()}
    vertex = triangle = 0
    for instance, mesh, mirror in zip(instances, meshes, mirrored, strict=True):
        matrix = _matrix(instance)
        here, faces = slice(vertex, vertex + len(mesh.positions)), slice(triangle, triangle + len(mesh.triangles))
        with np.errstate(all="ignore"):  # a vertex that is not finite is dropped later, with its triangles
            positions[here] = mapped(mesh.positions, matrix[:3, :3].T) + matrix[:3, 3]
        triangles[faces] = (mesh.triangles[:, ::-1] if mirror else mesh.triangles) + vertex  # keeps the front in front
        for name, array in attributes.items():
            if present[name]:
                array[here] = _attribute(mesh, name)
        cofactor = _cofactor(matrix[:3, :3])
        attributes["normals"][here] = mapped(attributes["normals"][here], cofactor.T)
        if present["tangents"]:
            attributes["tangents"][here, :3] = mapped(attributes["tangents"][here, :3], matrix[:3, :3].T)
            attributes["tangents"][here, 3] *= -1 if mirror else 1
        vertex, triangle = here.stop, faces.stop
    return [positions, triangles, *attributes.values()]


def _matrix(instance: Instance) -> Array:
    assert instance.world_from_mesh is not None
    return instance.world_from_mesh


def _attribute(mesh: Mesh, name: str) -> Array:
    value = getattr(mesh, name)
    if value is not None:
        return value
    if name == "normals":
        return made_normals(mesh)
    fill = 1.0 if name == "colors" else 0.0
    return np.full((len(mesh.positions), _WIDTHS[name]), fill, np.float32)


def made_normals(mesh: Mesh) -> Array:
    """(n, 3) float32: the normals that a mesh without any is drawn with."""
    from luxel.scene.normals import vertex_normals

    positions, triangles = mesh.positions, mesh.triangles
    finite = np.asarray(np.isfinite(positions).all(1))
    if not finite.all():  # triangles there are never drawn; their neighbours are
        positions, triangles = np.where(finite[:, None], positions, np.float32(0)), triangles[finite[triangles].all(1)]
    return vertex_normals(positions, triangles)


def _cofactor(matrix: Array) -> Array:
    """Maps normals like the inverse transpose, for singular matrices too; the sign follows the determinant's."""
    sign = -1.0 if np.linalg.det(matrix) < 0 else 1.0
    rows = [np.cross(matrix[:, 1], matrix[:, 2]), np.cross(matrix[:, 2], matrix[:, 0]), np.cross(matrix[:, 0], matrix[:, 1])]
    return sign * np.stack(rows, 1)
