"""Proof that two meshes are the same: as multisets of triangles, with everything at their corners, in their winding.

Exact: vertices and triangles are compared byte by byte (`clean.weld`), nothing is only hashed or rounded. Independent of how the second mesh
was made from the first.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.layout.clean import canonical, degenerate, vertex_rows, weld
from luxel.scene.scene import Scene


class Soup(NamedTuple):
    """Triangles with all they carry.

    Attributes:
        triangles: (m, 3) int32, rows of `rows`.
        rows: (n, words) uint32, from `clean.vertex_rows`: everything of a vertex.
        positions: (n, 3), to know degenerate triangles by; or None.
        faces: (m, words) uint32: everything of a triangle that is not its corners'; or None.
    """

    triangles: Array
    rows: Array
    positions: Array | None = None
    faces: Array | None = None


def difference(before: Mapping[str, Soup], after: Mapping[str, Soup], dropped_degenerate: bool = False,
               dropped_duplicates: bool = False) -> str | None:  # fmt: skip
    """What differs between two files or scenes, part by part; None if nothing does.

    Args:
        before, after: The parts by name: what may not mix.
        dropped_degenerate: Degenerate triangles of `before` may be missing.
        dropped_duplicates: Of equal triangles of `before` one is enough.
    """
    for name in [*before, *(name for name in after if name not in before)]:
        either = before.get(name) or after[name]
        nothing = either._replace(triangles=either.triangles[:0], faces=None if either.faces is None else either.faces[:0])
        found = _compared(before.get(name, nothing), after.get(name, nothing), dropped_degenerate, dropped_duplicates)
        if found:
            return f"{name}: {found}" if name else found
    return None


def _compared(a: Soup, b: Soup, dropped_degenerate: bool, dropped_duplicates: bool) -> str | None:
    if a.rows.shape[1] != b.rows.shape[1] and len(a.triangles):
        return "vertices have other attributes"
    if dropped_degenerate:
        a, b = _proper(a), _proper(b)
    if not (len(a.triangles) and len(b.triangles)):
        return None if len(a.triangles) == len(b.triangles) else f"{len(a.triangles)} triangles became {len(b.triangles)}"
    names = weld(np.concatenate([a.rows, b.rows]))[0]  # equal vertices of both have one name
    keys = [canonical(names[a.triangles]), canonical(names[b.triangles + np.int32(len(a.rows))])]
    if a.faces is not None and b.faces is not None:
        keys = [np.concatenate([key, faces.view(np.int32)], 1) for key, faces in zip(keys, (a.faces, b.faces), strict=True)]
    kinds, first = weld(vertex_rows([np.concatenate(keys)]))
    have, got = (np.bincount(part, minlength=len(first)) for part in np.split(kinds, [len(keys[0])]))
    wrong = (have == 0) != (got == 0) if dropped_duplicates else have != got
    wrong |= got > have
    if not wrong.any():
        return None
    return f"{np.count_nonzero(wrong & (got < have))} kinds of triangle are missing, {np.count_nonzero(wrong & (got > have))} are new"


def _proper(soup: Soup) -> Soup:
    """Without triangles of which two corners are equal, or in one place."""
    if not len(soup.triangles):
        return soup
    names, first = weld(soup.rows)
    keep = ~degenerate(names[soup.triangles], soup.positions if soup.positions is None else soup.positions[first])
    return soup._replace(triangles=soup.triangles[keep], faces=None if soup.faces is None else soup.faces[keep])


def soups_of(scene: Scene) -> dict[str, Soup]:
    """The meshes of a scene, each a part."""
    names = ("positions", "normals", "texcoords", "texcoords1", "colors", "tangents")
    soups = {}
    for i, mesh in enumerate(scene.meshes):
        arrays = [getattr(mesh, name) for name in names if getattr(mesh, name) is not None]
        soups[f"mesh {i}"] = Soup(mesh.triangles, vertex_rows(arrays), mesh.positions)
    return soups
