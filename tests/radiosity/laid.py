"""Scenes that are laid out by hand: triangles in the world whose lightmap coordinates are written down."""

import numpy as np

from luxel import Mesh, Scene
from luxel.radiosity.unwrap import Atlas


def laid_out(parts, size, materials=(), textures=()):
    """An atlas of one page: each part is (positions (n, 3), triangles, texels (n, 2), chart of each triangle or a number, keywords of the mesh)."""
    scene, charts = Scene(textures=list(textures)), []
    scene.materials += materials
    for positions, triangles, texels, chart, *rest in parts:
        coordinates = (np.asarray(texels, np.float64) / size).astype(np.float32)
        mesh = Mesh(np.asarray(positions, np.float32), np.asarray(triangles, np.int32), texcoords1=coordinates, **(rest[0] if rest else {}))
        scene.add(mesh)
        charts.append(np.broadcast_to(np.asarray(chart, np.int32), len(mesh.triangles)))
    return Atlas(scene, np.zeros(len(parts), np.int32), 1, tuple(size), np.concatenate(charts), True)


def rectangle(x, y, width, height, metres=0.5, z=0.0, chart=0, **rest):
    """A part for `laid_out`: a rectangle of `width` x `height` texels at texel (x, y), each `metres` wide, that faces +z; row 0 is its top."""
    corners = np.array([[x, y], [x, y + height], [x + width, y + height], [x + width, y]], float)
    positions = np.c_[corners[:, 0] * metres, -corners[:, 1] * metres, np.full(4, z)]
    rest.setdefault("texcoords", (corners - [x, y]) / [width, height])
    return positions, [[0, 1, 2], [0, 2, 3]], corners, chart, rest
