"""The last step of every reader: arrays as they stood in the file become a sound Mesh, and what was unsound is said."""

from __future__ import annotations

from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.io.files import tell
from luxel.scene.mesh import Mesh
from luxel.scene.normals import vertex_normals


def build_mesh(where: object, positions: Array, triangles: Array, *, material: int = -1, name: str = "", **attributes: Array | None) -> Mesh:
    """A Mesh of `positions` (n, 3) and `triangles` (m, 3), of any numeric dtype, without what is unsound.

    Triangles with an index out of range, or with a vertex that is NaN or infinite (in float32), are dropped, such vertices too; the
    other attributes are mended. Each says so once. Arrays that are sound and of the right dtype are not copied.
    """
    positions = _float32(positions)
    triangles = _in_range(where, triangles, len(positions))
    arrays: dict[str, Any] = {key: _float32(value) for key, value in attributes.items() if value is not None}
    finite = _finite_rows(positions)
    if finite is not None:
        keep = finite[triangles].all(1)
        tell(
            where,
            f"{np.count_nonzero(~finite)} vertices are not finite; {np.count_nonzero(~keep)} triangles that use them are dropped",
        )
        triangles = (np.cumsum(finite, dtype=np.int32) - 1).astype(np.int32)[triangles[keep]]
        positions = positions[finite]
        arrays = {key: value[finite] for key, value in arrays.items()}
    for key, value in arrays.items():
        bad = _finite_rows(value)
        if bad is not None and key != "normals":
            tell(where, f"{np.count_nonzero(~bad)} {key} are not finite and become 0")
            arrays[key] = np.nan_to_num(value, nan=0.0, posinf=0.0, neginf=0.0)
    if "normals" in arrays:
        arrays["normals"] = _sound_normals(where, arrays["normals"], positions, triangles)
    return Mesh(positions, triangles, material=material, name=name, **arrays)


def finite_mesh(where: object, mesh: Mesh) -> Mesh:
    """The mesh as it is, or without the vertices that are NaN or infinite and the triangles that use them, which is said as of a file's."""
    if _finite_rows(mesh.positions) is None:
        return mesh
    return build_mesh(where, **vars(mesh))


def turned(texcoords: Array) -> Array:
    """Texture coordinates (n, 2) with v counted from the other end: PLY, OBJ, OFF from the bottom, glTF and luxel from the top."""
    return np.stack([texcoords[:, 0], 1 - texcoords[:, 1]], 1)


def _float32(value: Array) -> Array:
    """C-contiguous, aligned and writable float32, copied only if it was not."""
    return np.require(value, np.float32, ["C", "A", "W"])


def _in_range(where: object, triangles: Array, n: int) -> Array:
    """(k, 3) int32: those of `triangles` whose vertices are in 0..n-1."""
    if len(triangles) and (int(triangles.min()) < 0 or int(triangles.max()) >= n):
        good = np.asarray(((triangles >= 0) & (triangles < n)).all(1))
        tell(
            where,
            f"{np.count_nonzero(~good)} of {len(good)} triangles name a vertex outside 0..{n - 1} and are dropped",
        )
        triangles = triangles[good]
    return np.require(triangles, np.int32, ["C", "A", "W"])


def _finite_rows(value: Array) -> Array | None:
    """(n,) bool: rows without NaN or infinity; None where all are."""
    chunk = 1 << 20
    if all(np.isfinite(value[start : start + chunk]).all() for start in range(0, len(value), chunk)):
        return None
    return np.asarray(np.isfinite(value).all(1))


def _sound_normals(where: object, normals: Array, positions: Array, triangles: Array) -> Array:
    """`normals` at unit length; those without a direction are made anew."""
    square = np.einsum("ij,ij->i", normals, normals)
    if (np.abs(square - 1) < 1e-3).all():
        return normals
    bad = ~((square > 1e-12) & np.isfinite(square))
    normals = normals / np.sqrt(np.where(bad, 1, square))[:, None]
    if bad.any():
        used = np.zeros(len(normals), bool)
        used[triangles] = True
        if (bad & used).any():
            tell(where, f"{np.count_nonzero(bad & used)} normals have no direction and are made anew")
        normals[bad] = vertex_normals(positions, triangles)[bad]
    return normals.astype(np.float32, copy=False)
