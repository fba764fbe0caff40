"""Mesh: arrays of vertices and triangles, with one material."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError

_VERTEX_ARRAYS = {"normals": 3, "texcoords": 2, "texcoords1": 2, "colors": 4, "tangents": 4}


@dataclass(eq=False)
class Mesh:
    """Triangles that share one material.

    Attributes:
        positions: (n, 3) float32, metres.
        triangles: (m, 3) int32, indices into `positions`, counter-clockwise seen from the front.
        normals: (n, 3) float32, unit length, or None: the renderer then makes them (see `luxel.scene.normals`).
        texcoords: (n, 2) float32, TEXCOORD_0; (0, 0) is the top left corner of the picture, as in glTF. Or None.
        texcoords1: (n, 2) float32, TEXCOORD_1, the lightmap's. Or None.
        colors: (n, 4) float32, linear RGBA that multiplies the base colour. Or None.
        tangents: (n, 4) float32, glTF's xyz and handedness. Or None.
        material: Index into the scene's materials, or -1 for the default material.
        name: As in the file; may be empty.

    Raises:
        InputError: A shape or dtype is wrong, or a triangle names a vertex that does not exist.
    """

    positions: Array
    triangles: Array
    normals: Array | None = None
    texcoords: Array | None = None
    texcoords1: Array | None = None
    colors: Array | None = None
    tangents: Array | None = None
    material: int = -1
    name: str = ""

    def __post_init__(self) -> None:
        self.positions = checked(self.positions, ("n", 3), np.float32, "positions")
        self.triangles = checked(self.triangles, ("m", 3), np.int32, "triangles")
        n = len(self.positions)
        if self.triangles.size:
            low, high = int(self.triangles.min()), int(self.triangles.max())
            if low < 0 or high >= n:
                raise InputError(f"triangles: vertex {low if low < 0 else high} of a mesh with {n} vertices")
        for name, width in _VERTEX_ARRAYS.items():
            value = getattr(self, name)
            if value is not None:
                setattr(self, name, checked(value, (n, width), np.float32, name))

    def bounds(self) -> Array:
        """(2, 3) float64: the least and the largest coordinate of the vertices, metres; zeros for a mesh with none."""
        if not len(self.positions):
            return np.zeros((2, 3))
        return np.stack([self.positions.min(0), self.positions.max(0)]).astype(np.float64)
