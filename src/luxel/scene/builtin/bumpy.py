"""The bumpy sphere: the mesh that the speed of rasterisers is measured with, at any number of triangles."""

from __future__ import annotations

import numpy as np

from luxel.errors import InputError
from luxel.scene.builtin.grid import normalized
from luxel.scene.camera import Camera
from luxel.scene.light import Ambient, Light
from luxel.scene.material import Material
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene
from luxel.scene.transforms import look_at


def bumpy_sphere(n: int = 160) -> Mesh:
    """4 n^2 triangles: r = 1 + 0.1 sin(9 theta) sin(9 phi) over n x 2n cells of polar angle and azimuth.

    The triangles at the poles have no area, and are kept: a benchmark counts them.

    Args:
        n: Steps from pole to pole, at least 2.

    Returns:
        (n + 1)(2 n + 1) vertices with exact normals and texture coordinates.
    """
    if n < 2:
        raise InputError(f"bumpy_sphere: expected n >= 2, got {n}")
    polar = np.linspace(0, np.pi, n + 1)[:, None]
    azimuth = np.linspace(0, 2 * np.pi, 2 * n + 1)[None, :]
    st, ct, sp, cp = np.sin(polar), np.cos(polar), np.sin(azimuth), np.cos(azimuth)
    sp[:, -1], cp[:, -1], st[-1] = sp[:, 0], cp[:, 0], 0.0  # the seam and the pole close to the bit
    radius = 1 + 0.1 * np.sin(9 * polar) * np.sin(9 * azimuth)
    shape = (*radius.shape, 3)
    outward = np.stack(np.broadcast_arrays(st * cp, ct, st * sp), -1)
    south = np.stack(np.broadcast_arrays(ct * cp, -st, ct * sp), -1)
    east = np.stack(np.broadcast_arrays(-sp, 0.0, cp), -1)
    by_polar = 0.9 * np.cos(9 * polar) * np.sin(9 * azimuth)
    ratio = np.full_like(st, 9.0)  # sin(9 theta) / sin(theta), and its limit at the poles
    np.divide(np.sin(9 * polar), st, out=ratio, where=st > 0)
    by_azimuth = 0.9 * ratio * np.cos(9 * azimuth)
    normals = normalized(radius[..., None] * outward - by_polar[..., None] * south - by_azimuth[..., None] * east)

    a = (np.arange(n)[:, None] * (2 * n + 1) + np.arange(2 * n)).ravel()
    b, c, d = a + 1, a + 2 * n + 1, a + 2 * n + 2
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    u, v = np.broadcast_arrays(1 - azimuth / (2 * np.pi), polar / np.pi)
    return Mesh(
        (radius[..., None] * outward).reshape(-1, 3),
        triangles,
        normals.reshape(shape).reshape(-1, 3),
        np.stack([u, v], -1).reshape(-1, 2),
        name="bumpy sphere",
    )


def bumpy_sphere_scene(n: int = 160) -> Scene:
    """The bumpy sphere under one light along (1, 1, 1), seen from 2.6 metres."""
    scene = Scene(name="bumpy-sphere", ambient=Ambient((0.1, 0.1, 0.1), (0.1, 0.1, 0.1)))
    scene.add(bumpy_sphere(n), Material(base_color=(0.8, 0.55, 0.35, 1.0), roughness=0.45, name="clay"))
    scene.lights.append(Light("directional", intensity=3.0, world_from_light=look_at((1, 1, 1), (0, 0, 0)), name="sun"))
    scene.cameras.append(Camera.look_at((0, 0, 2.6), (0, 0, 0), near=0.1, far=10.0, name="front"))
    return scene
