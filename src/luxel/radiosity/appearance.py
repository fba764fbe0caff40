"""Appearance: where luxels lie on their triangles, which way they look, and what they reflect and emit.

Colours come from the renderer's own `surface`, so that a lightmap is baked with the same textures, filtered over the texel's footprint, that it is
shown with.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.channels import BATCH, CR, EMR, FRAGMENTS, FRONT, MODEL, NX, NY, NZ, PITCH, U0, U0X, U0Y, U1, U1X, U1Y
from luxel.raster.fragments import find_part
from luxel.raster.geometry import Geometry
from luxel.raster.materials import ALPHA_MASK, CUTOFF, EMISSIVE, NEEDS_COLOR, NEEDS_UV0, NEEDS_UV1, MaterialTable
from luxel.raster.surface import mask_alpha, surface

_F = np.float32
_SIDE = 4
LEAST_SHARE = 0.5 / _SIDE**2
"""A luxel is a hole if its share is less: if none of the places where its mask is looked up is solid."""


MOST_LEAN = 0.766
"""Cosine of 40 degrees: normals of a triangle's corners that lean farther from its own are smooth over edges that are none of a curved surface, as of
a cube whose faces share their corners, and would take light from where the surface does not face."""


class Appearance(NamedTuple):
    """Of n luxels: position, normal, face_normal, albedo, emission (n, 3) float32, and share (n,) float32: what alpha masks leave of it."""

    position: Array
    normal: Array
    face_normal: Array
    albedo: Array
    emission: Array
    share: Array


@jit.inlined
def mixed(values, k, a, b, c, s1, s2):
    """Column `k` of a vertex attribute, interpolated."""
    origin = values[a, k]
    return origin + s1 * (values[b, k] - origin) + s2 * (values[c, k] - origin)


@jit.part
def texture_place(g, i, row, x_row, y_row, texcoords, a, b, c, s1, s2, gradient):
    """Texture coordinates, and what they change by a texel to the right and by one down, into the batch."""
    for k in range(2):
        u1, u2 = texcoords[b, k] - texcoords[a, k], texcoords[c, k] - texcoords[a, k]
        g[row + k * PITCH + i] = texcoords[a, k] + s1 * u1 + s2 * u2
        g[x_row + k * PITCH + i] = gradient[0] * u1 + gradient[1] * u2
        g[y_row + k * PITCH + i] = gradient[2] * u1 + gradient[3] * u2


@jit.part
def _leans(normals, v, fx, fy, fz):
    """Whether the normal of vertex `v` leans too far from the unit normal f of one of its triangles."""
    nx, ny, nz = np.float64(normals[v, 0]), np.float64(normals[v, 1]), np.float64(normals[v, 2])
    return not nx * fx + ny * fy + nz * fz > MOST_LEAN * math.sqrt(nx * nx + ny * ny + nz * nz)


@jit.part
def lay(luxel, a, b, c, s1, s2, positions, normals, position, normal, face):
    """Position and normals of one luxel."""
    u = (np.float64(positions[b, 0]) - positions[a, 0], np.float64(positions[b, 1]) - positions[a, 1], np.float64(positions[b, 2]) - positions[a, 2])
    v = (np.float64(positions[c, 0]) - positions[a, 0], np.float64(positions[c, 1]) - positions[a, 1], np.float64(positions[c, 2]) - positions[a, 2])
    fx, fy, fz = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    f = 1.0 / math.sqrt(max(fx * fx + fy * fy + fz * fz, 1e-300))
    fx, fy, fz = fx * f, fy * f, fz * f
    nx, ny, nz = mixed(normals, 0, a, b, c, s1, s2), mixed(normals, 1, a, b, c, s1, s2), mixed(normals, 2, a, b, c, s1, s2)
    size = math.sqrt(np.float64(nx) * nx + np.float64(ny) * ny + np.float64(nz) * nz)
    leans = _leans(normals, a, fx, fy, fz) or _leans(normals, b, fx, fy, fz) or _leans(normals, c, fx, fy, fz)
    for k in range(3):
        position[luxel, k] = _F(positions[a, k] + s1 * u[k] + s2 * v[k])
    face[luxel, 0], face[luxel, 1], face[luxel, 2] = _F(fx), _F(fy), _F(fz)
    if size > 0.0 and not leans:
        normal[luxel, 0], normal[luxel, 1], normal[luxel, 2] = _F(nx / size), _F(ny / size), _F(nz / size)
    else:
        normal[luxel, 0], normal[luxel, 1], normal[luxel, 2] = _F(fx), _F(fy), _F(fz)


@jit.part
def solid_share(row, table, geometry, a, b, c, s1, s2, gradient, whole):
    """How much of a luxel its alpha mask leaves, looked up at 16 places of the texel: all if it is `whole`, else those in the triangle."""
    seen, solid = 0, 0
    texcoords, texcoords1, colors = geometry.texcoords, geometry.texcoords1, geometry.colors
    u0 = v0 = u1 = v1 = _F(0.0)
    for place in range(_SIDE * _SIDE + 1):
        x, y = _F((place % _SIDE + 0.5) / _SIDE - 0.5), _F((place // _SIDE + 0.5) / _SIDE - 0.5)
        if place == _SIDE * _SIDE:
            x = y = _F(0.0)
        t1, t2 = s1 + x * gradient[0] + y * gradient[2], s2 + x * gradient[1] + y * gradient[3]
        if seen == 0 if place == _SIDE * _SIDE else whole or min(t1, min(t2, _F(1.0) - t1 - t2)) >= _F(-1e-6):
            if len(texcoords) > 0:
                u0, v0 = mixed(texcoords, 0, a, b, c, t1, t2), mixed(texcoords, 1, a, b, c, t1, t2)
            if len(texcoords1) > 0:
                u1, v1 = mixed(texcoords1, 0, a, b, c, t1, t2), mixed(texcoords1, 1, a, b, c, t1, t2)
            alpha = mask_alpha(table, row, u0, v0, u1, v1)
            if table.flags[row] & NEEDS_COLOR and len(colors) > 0:
                alpha *= mixed(colors, 3, a, b, c, t1, t2)
            seen += 1
            solid += 1 if alpha >= table.floats[row, CUTOFF] else 0
    return _F(solid) / _F(max(seen, 1))


@jit.parallel_kernel
def _appear(queue, geometry, table, rich, triangle, corner1, corner2, coverage, gradients, position, normal, face, albedo, emission, share):
    g, material = np.zeros(BATCH, np.float32), np.zeros(FRAGMENTS + 1, np.int32)
    starts, triangles = geometry.part_start, geometry.triangles
    batch = jit.take(queue)
    while batch * FRAGMENTS < len(triangle):
        first = batch * FRAGMENTS
        n = min(FRAGMENTS, len(triangle) - first)
        for i in range(n):
            t, s1, s2 = triangle[first + i], corner1[first + i], corner2[first + i]
            a, b, c, gradient = triangles[t, 0], triangles[t, 1], triangles[t, 2], gradients[first + i]
            row = geometry.part_material[find_part(starts, t)]
            material[i], flags = row, table.flags[row]
            lay(first + i, a, b, c, s1, s2, geometry.positions, geometry.normals, position, normal, face)
            g[FRONT + i], g[NX + i], g[NY + i], g[NZ + i] = _F(1.0), normal[first + i, 0], normal[first + i, 1], normal[first + i, 2]
            if flags & NEEDS_COLOR:
                for k in range(4):
                    g[CR + k * PITCH + i] = mixed(geometry.colors, k, a, b, c, s1, s2)
            if flags & NEEDS_UV0 and len(geometry.texcoords) > 0:
                texture_place(g, i, U0, U0X, U0Y, geometry.texcoords, a, b, c, s1, s2, gradient)
            if flags & NEEDS_UV1:
                texture_place(g, i, U1, U1X, U1Y, geometry.texcoords1, a, b, c, s1, s2, gradient)
            share[first + i] = _F(1.0)
            if flags & ALPHA_MASK:
                share[first + i] = solid_share(row, table, geometry, a, b, c, s1, s2, gradient, coverage[first + i] > _F(0.999))
        surface(g, material, n, table, rich)
        for i in range(n):
            glows = np.int32(g[MODEL + i]) & EMISSIVE != 0
            for k in range(3):
                albedo[first + i, k] = g[CR + k * PITCH + i]
                emission[first + i, k] = _F(math.pi) * g[EMR + k * PITCH + i] if glows else _F(0.0)
        batch = jit.take(queue)


def appearance(geometry: Geometry, table: MaterialTable, triangle: Array, corners: tuple[Array, Array], coverage: Array, gradients: Array,
               threads: int) -> Appearance:  # fmt: skip
    """Evaluate n places of triangles, each for what is around it.

    Args:
        geometry, table: The scene.
        triangle: (n,) int32.
        corners: (n,) float32 each: barycentric coordinates in the triangle, of its corners 1 and 2.
        coverage: (n,) float32: how much of what is around each is surface, 0 to 1.
        gradients: (n, 4) float32: what these barycentric coordinates gain along one side of what is around, and along the other.
    """
    n = len(triangle)
    made = Appearance(*(np.empty((n, 3) if name != "share" else n, np.float32) for name in Appearance._fields))
    jit.run(_appear, threads, geometry, table, True if table.rich else None, triangle, *corners, coverage, gradients, *made)
    return made
