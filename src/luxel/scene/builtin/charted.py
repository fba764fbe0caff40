"""Rectangles, and meshes of them that carry their own lightmap coordinates: each rectangle is one chart, aligned with the texels.

A chart of W x H texels that starts on a texel's corner has exactly W * H luxels, so a scene of such rectangles has as many as it is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.scene.material import Material
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

PAGE = 1024
"""Texels along the sides of the page that the charts are laid out for; `bake`'s own default."""

_GAP = 2  # texels between charts
_BLOCK = 4  # texels: the charts of a mesh start on such a row, clear of those of the mesh before
_NARROW = 4  # cells
_HALVINGS = 50


class Rectangle(NamedTuple):
    """A flat rectangle, metres: from its lower left corner, seen from the front, its sides to the right and up; and its material's name."""

    corner: Array
    right: Array
    up: Array
    material: str


def add_charted(scene: Scene, rectangles: list[Rectangle], materials: Mapping[str, Material], faces: int, luxels: int) -> None:
    """Add rectangles to a scene, a mesh a material, cut into `faces` quadrilaterals with four vertices each, on charts of `luxels` texels in all."""
    sides = np.array([[np.linalg.norm(r.right), np.linalg.norm(r.up)] for r in rectangles])
    cells, texels = even_cuts(sides, faces), even_cuts(sides, luxels)
    width = int(np.sqrt(1.2 * ((texels + _GAP).prod(1)).sum())) + int(texels[:, 0].max())
    top = 0
    for name, material in materials.items():
        chosen = [i for i, r in enumerate(rectangles) if r.material == name]
        places, top = _shelves(texels[chosen], width, top)
        parts = [_quads(rectangles[i], cells[i], place, texels[i]) for i, place in zip(chosen, places, strict=True)]
        positions, normals, texcoords, texcoords1 = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        first = np.arange(0, len(positions), 4)[:, None, None]
        triangles = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
        scene.add(Mesh(positions, triangles, normals, texcoords, texcoords1 / PAGE, name=name), material)
    if max(width, top) > PAGE:
        raise InputError(f"{luxels} luxels on {len(rectangles)} charts: expected what fits on {PAGE} x {PAGE} texels, got {width} x {top}")


def even_cuts(sides: Array, total: int) -> Array:
    """(n, 2) int64: into how many steps of about the same length to cut the sides of n rectangles, so that they get `total` cells in all, exactly.

    A side gets its length over the step, rounded, so equal sides are cut alike, and the cells of walls meet along their common edges. The step is
    found by halving; the few cells that are then missing go to narrow rectangles, a row of cells each, the longest first.

    Args:
        sides: (n, 2) float64, metres.
        total: At least n.

    Raises:
        InputError: It cannot be done.
    """
    sides = np.round(sides, 6)
    low, high = 1e-9, 3.0 * float(sides.max())  # too many cells, and one a rectangle
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _cells(sides, middle).prod(1).sum() > total else (low, middle)
    cells = _cells(sides, high)
    rest = total - int(cells.prod(1).sum())
    narrow, across = np.nonzero(cells <= _NARROW)
    longest = np.argsort(-cells[narrow, 1 - across], kind="stable")
    while rest > 0:
        before = rest
        for i, side in zip(narrow[longest], across[longest], strict=True):
            if cells[i, side] <= min(rest, _NARROW):
                rest -= int(cells[i, side])
                cells[i, 1 - side] += 1
        if rest == before:
            break
    if rest:
        raise InputError(f"expected a number of cells that {len(sides)} rectangles can be cut into, got {total}")
    return cells


def _cells(sides: Array, step: float) -> Array:
    return np.maximum(np.floor(sides / step + 0.5), 1).astype(np.int64)


def _shelves(sizes: Array, width: int, top: int) -> tuple[Array, int]:
    """Where charts of these sizes lie, (n, 2) columns and rows: the tallest first, in rows; and the first block of rows that is free after them."""
    places = np.empty_like(sizes)
    column, row, tall = 0, top, 0
    for i in np.argsort(-sizes[:, 1], kind="stable"):
        w, h = sizes[i]
        if column + w > width:
            column, row, tall = 0, row + tall + _GAP, 0
        places[i] = column, row
        column, tall = column + w + _GAP, max(tall, int(h))
    return places, -(-(row + tall + _GAP) // _BLOCK) * _BLOCK


def _quads(rectangle: Rectangle, cells: Array, place: Array, texels: Array) -> tuple[Array, Array, Array, Array]:
    """Positions, normals, texture coordinates, and lightmap coordinates in texels, of four vertices a cell: (4 k, ...) each."""
    u, v = np.meshgrid(*(np.arange(n) for n in cells))
    around = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    uv = (np.stack([u.ravel(), v.ravel()], 1)[:, None] + around).reshape(-1, 2) / cells
    positions = rectangle.corner + uv[:, :1] * rectangle.right + uv[:, 1:] * rectangle.up
    facing = np.cross(rectangle.right, rectangle.up)
    normals = np.broadcast_to(facing / np.linalg.norm(facing), positions.shape)
    downward = np.stack([uv[:, 0], 1 - uv[:, 1]], 1)  # row 0 of a picture is at its top
    return positions, normals, downward, place + downward * texels
