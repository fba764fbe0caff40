"""Primitives to meshes: triangles from lists, strips and fans; attributes; morph targets and skins in their default pose."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.build import build_mesh
from luxel.io.files import tell
from luxel.io.gltf.accessors import read
from luxel.io.gltf.document import Document, Part
from luxel.io.polygons import fan, strip
from luxel.scene.mesh import Mesh
from luxel.scene.normals import vertex_normals

_DRAWN_MODES = (4, 5, 6)


@dataclass
class Geometry:
    """A primitive's mesh, with what places its vertices besides the node."""

    mesh: Mesh
    joints: Array | None = None  # (n, 4) integer
    weights: Array | None = None  # (n, 4) float32


def drawn_attributes(part: Part) -> Part | None:
    """The attributes of a primitive; None, which is said, where it draws no triangles."""
    mode = part.integer("mode", 4)
    if mode not in _DRAWN_MODES:
        if mode > 6:
            raise FileError(part.where, f"mode: expected 0..6, got {mode}")
        tell(part.where, f"{'points are' if mode == 0 else 'lines are'} dropped")
        return None
    attributes = part.part("attributes")
    if attributes is None or not attributes.has("POSITION"):
        tell(part.where, "has no POSITION and is dropped")
        return None
    return attributes


def declared_triangles(document: Document, part: Part) -> int:
    """How many triangles the accessors of a primitive that is drawn promise: none is read, so some may be dropped."""
    attributes = part.part("attributes")
    assert attributes is not None
    owner, key = (part, "indices") if part.has("indices") else (attributes, "POSITION")
    count: int = document.item("accessors", owner.integer(key), owner.where).integer("count", low=1)
    return count // 3 if part.integer("mode", 4) == 4 else max(0, count - 2)


def read_primitive(document: Document, part: Part, morph: tuple[float, ...], name: str, material: int) -> Geometry | None:
    """One primitive as a mesh with the morph targets added at weights `morph`; None where it draws no triangles."""
    attributes = drawn_attributes(part)
    if attributes is None:
        return None
    mode = part.integer("mode", 4)
    positions = read(document, attributes.integer("POSITION"), attributes.where, types=("VEC3",))
    rows = len(positions)

    def attribute(key: str, *types: str) -> Array | None:
        if not attributes.has(key):
            return None
        return read(document, attributes.integer(key), attributes.where, types=types, rows=rows)

    arrays: dict[str, Any] = {
        "normals": attribute("NORMAL", "VEC3"),
        "tangents": attribute("TANGENT", "VEC4"),
        "texcoords": attribute("TEXCOORD_0", "VEC2"),
        "texcoords1": attribute("TEXCOORD_1", "VEC2"),
        "colors": _with_alpha(attribute("COLOR_0", "VEC3", "VEC4")),
    }
    joints, weights = attribute("JOINTS_0", "VEC4"), attribute("WEIGHTS_0", "VEC4")
    if arrays["normals"] is None:
        arrays["tangents"] = None  # glTF 2.0, section 3.7.2.1: to be ignored without normals
    positions = _morphed(document, part, positions, arrays, morph)
    triangles = primitive_triangles(document, part, rows, mode)
    extra = {} if joints is None or weights is None else {"joints": joints, "weights": weights}
    if extra and not np.isfinite(positions).all():
        tell(part.where, "has vertices that are not finite, so its skin is ignored")
        extra = {}
    mesh = build_mesh(part.where, positions, triangles, material=material, name=name, **arrays)
    return Geometry(mesh, **extra)


def _with_alpha(colors: Array | None) -> Array | None:
    if colors is None or colors.shape[1] == 4:
        return colors
    return np.concatenate([colors, np.ones((len(colors), 1), colors.dtype)], 1)


def primitive_triangles(document: Document, part: Part, rows: int, mode: int) -> Array:
    """(m, 3) int64 or narrower: of the primitive's indices, or of all vertices in order; strips and fans become lists.

    Raises:
        FileError: The indices are no unsigned integers.
    """
    if part.has("indices"):
        indices = read(document, part.integer("indices"), part.where, types=("SCALAR",))[:, 0]
        if indices.dtype.kind != "u":
            raise FileError(part.where, f"indices: expected unsigned integers, got {indices.dtype}")
        indices = indices.astype(np.int64) if indices.dtype.itemsize == 4 and int(indices.max()) > 2**31 - 1 else indices.astype(np.int32)
    else:
        indices = np.arange(rows, dtype=np.int32)
    if mode == 5:
        return strip(indices)
    if mode == 6:
        return fan(indices)
    if len(indices) % 3:
        tell(
            part.where,
            f"{len(indices)} indices are no whole number of triangles; the last {len(indices) % 3} are dropped",
        )
    return indices[: len(indices) // 3 * 3].reshape(-1, 3)


def _morphed(document: Document, part: Part, positions: Array, arrays: dict[str, Any], weights: tuple[float, ...]) -> Array:
    """Positions plus the weighted sum of the targets' displacements; normals in `arrays` likewise, and unit again."""
    for target, weight in zip(part.parts("targets", "target"), weights, strict=False):
        if weight == 0:
            continue
        for key in ("POSITION", "NORMAL"):
            base = positions if key == "POSITION" else arrays["normals"]
            if base is None or not target.has(key):
                continue
            moved = read(document, target.integer(key), target.where, types=("VEC3",), rows=len(positions))
            total = base + np.float32(weight) * moved.astype(np.float32)
            if key == "POSITION":
                positions = total
            else:
                arrays["normals"] = total
    return positions


def skinned(geometry: Geometry, joint_matrices: Array, where: str) -> Mesh:
    """The mesh in world space, each vertex moved by the weighted sum of its joints' matrices (k, 4, 4)."""
    mesh, joints, weights = geometry.mesh, geometry.joints, geometry.weights
    assert joints is not None
    assert weights is not None
    if int(joints.max(initial=0)) >= len(joint_matrices):
        raise FileError(where, f"joint {int(joints.max())} of a skin of {len(joint_matrices)}")
    total = weights.sum(1, keepdims=True)
    weights = np.where(total > 0, weights / np.where(total > 0, total, 1), (1, 0, 0, 0))
    positions, normals = np.empty_like(mesh.positions), None if mesh.normals is None else np.empty_like(mesh.normals)
    chunk = 1 << 16  # a matrix for each vertex of a chunk
    for start in range(0, len(positions), chunk):
        s = slice(start, start + chunk)
        blend = np.einsum("nj,njab->nab", weights[s], joint_matrices[joints[s].astype(np.int64)])
        positions[s] = np.einsum("nab,nb->na", blend[:, :3, :3], mesh.positions[s]) + blend[:, :3, 3]
        if normals is not None and mesh.normals is not None:
            normals[s] = np.einsum("nab,nb->na", _cofactors(blend[:, :3, :3]), mesh.normals[s])
    if normals is not None:
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        fallback = vertex_normals(positions, mesh.triangles) if (length < 1e-12).any() else normals
        normals = np.where(length < 1e-12, fallback, normals / np.maximum(length, 1e-12))
    return replace(mesh, positions=positions, normals=normals, tangents=None)


def _cofactors(matrix: Array) -> Array:
    """(n, 3, 3): the inverse transpose times the determinant, which carries normals."""
    a, b, c = matrix[..., 0], matrix[..., 1], matrix[..., 2]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], -1)
