"""Closed scenes whose light is known."""

import numpy as np

from luxel import Material, Mesh, Scene


def matte(albedo=0.5, radiance=0.0, **rest):
    """A diffuse material; numbers or RGB."""
    color, light = np.broadcast_to(albedo, 3), np.broadcast_to(radiance, 3)
    return Material((*map(float, color), 1.0), roughness=1.0, specular=(0, 0, 0), emissive=tuple(map(float, light)), **rest)


def face(axis, side, low, high, inward=True):
    """A side of a box, as a mesh that faces in or out."""
    a, b = (k for k in range(3) if k != axis)
    corners = np.empty((4, 3))
    corners[:, axis] = high[axis] if side else low[axis]
    corners[:, a] = np.array([low[a], high[a], high[a], low[a]])
    corners[:, b] = np.array([low[b], low[b], high[b], high[b]])
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])[axis]
    wanted = (1 - 2 * side) * (1 if inward else -1)
    order = [[0, 1, 2], [0, 2, 3]] if normal * wanted > 0 else [[0, 2, 1], [0, 3, 2]]
    return Mesh(corners.astype(np.float32), np.array(order, np.int32), name=f"{'xyz'[axis]}{side}")


def box(materials, low=(0, 0, 0), high=(1, 1, 1), scene=None, inward=True, skip=()):
    """A box of six sides, x0 x1 y0 y1 z0 z1, each with a material of its own."""
    scene = Scene() if scene is None else scene
    for k in range(6):
        if k not in skip:
            scene.add(face(k // 2, k % 2, low, high, inward), materials[k] if isinstance(materials, (list, tuple)) else materials)
    return scene
