"""Occlusion: whether triangles stand between two points, callable pair by pair in any kernel.

A triangle hides if the segment crosses its plane, with both ends farther than `epsilon` from it, inside the triangle or on its border. So a
surface never hides points that lie on it, however grazing the segment: `epsilon` is what the rounding of positions and normals can amount to
in this scene, and nothing needs an offset along normals. A segment through an edge or corner that triangles share is hidden by at
least one of them: they project its ends alike, and decide on which side of it the segment passes from the same products.

Alpha-masked triangles hide where their texture's alpha, bilinear or nearest as it asks, is at least the cut-off.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import floor
from luxel.radiosity.bvh import build

_REPEAT, _CLAMP, _MIRROR = range(3)
WRAPS = {"repeat": _REPEAT, "clamp": _CLAMP, "mirror": _MIRROR}


class Occlusion(NamedTuple):
    """What `occluded` needs of a scene, m triangles in the order of the leaves.

    Attributes:
        box, link: Of `luxel.radiosity.bvh.Boxes`.
        corners: (m, 12) float32: three corners and the unit normal, metres.
        triangle: (m,) int32: the triangle's row in the mesh.
        mask: (m,) int32: the triangle's row in `masks`, -1 if it is opaque.
        texcoords: (m, 6) float32, or (0, 6) if no triangle is masked.
        masks: (k, 8) int32: first element in `alpha`, width, height, wrap along u and v, nearest, and two unused.
        cutoffs: (k,) float32, of `alpha`.
        alpha: (a,) float32: the masks' alpha, row by row.
        epsilon: (1,) float64, metres.
    """

    box: Array
    link: Array
    corners: Array
    triangle: Array
    mask: Array
    texcoords: Array
    masks: Array
    cutoffs: Array
    alpha: Array
    epsilon: Array


class Masks(NamedTuple):
    """Alpha-masked triangles: `mask` (m,) int32 and `texcoords` (m, 6) float32 by triangle; the others as in `Occlusion`."""

    mask: Array
    texcoords: Array
    masks: Array
    cutoffs: Array
    alpha: Array


def prepare(positions: Array, triangles: Array, masks: Masks | None = None) -> Occlusion:
    """The triangles of a mesh as obstacles: positions (n, 3) float32, triangles (m, 3) int32. Those without area or not finite hide nothing."""
    corners = positions[triangles].astype(np.float32, copy=False)
    with np.errstate(all="ignore"):
        wide = corners.astype(np.float64)
        normal = np.cross(wide[:, 1] - wide[:, 0], wide[:, 2] - wide[:, 0])
        length = np.sqrt((normal * normal).sum(1))
        kept = np.flatnonzero((length > 0) & np.isfinite(length))
    corners, normal = corners[kept], normal[kept] / length[kept, None]
    boxes = build(corners.min(1), corners.max(1))
    order = boxes.order
    rows = np.concatenate([corners.reshape(-1, 9)[order], normal[order].astype(np.float32)], 1)
    epsilon = np.array([float(np.abs(corners).max(initial=0.0)) * 2.0**-20])
    triangle = kept[order].astype(np.int32)
    mask, texcoords, table, cutoffs, alpha = _no_masks(len(triangles)) if masks is None else masks
    texcoords = texcoords[triangle] if len(texcoords) else texcoords
    return Occlusion(boxes.box, boxes.link, rows, triangle, mask[triangle], texcoords, table, cutoffs, alpha, epsilon)


def _no_masks(m: int) -> Masks:
    empty = np.zeros(0, np.float32)
    return Masks(np.full(m, -1, np.int32), np.zeros((0, 6), np.float32), np.zeros((0, 8), np.int32), empty, empty)


@jit.part
def _wrapped(i, size, wrap):
    """A texel's number within the picture."""
    if wrap == _CLAMP:
        return min(max(i, 0), size - 1)
    if wrap == _MIRROR:
        i = i % (2 * size)
        return i if i < size else 2 * size - 1 - i
    return i % size


@jit.part
def _alpha(scene, row, u, v):
    """Alpha of a mask at texture coordinates."""
    start, width, height = scene.masks[row, 0], scene.masks[row, 1], scene.masks[row, 2]
    wrap_u, wrap_v = scene.masks[row, 3], scene.masks[row, 4]
    if scene.masks[row, 5]:
        x, y = np.int64(floor(u * width)), np.int64(floor(v * height))
        return np.float64(scene.alpha[start + _wrapped(y, height, wrap_v) * width + _wrapped(x, width, wrap_u)])
    u, v = u * width - 0.5, v * height - 0.5
    x, y = np.int64(floor(u)), np.int64(floor(v))
    s, t = u - x, v - y
    top, bottom = start + _wrapped(y, height, wrap_v) * width, start + _wrapped(y + 1, height, wrap_v) * width
    left, right = _wrapped(x, width, wrap_u), _wrapped(x + 1, width, wrap_u)
    upper = scene.alpha[top + left] * (1 - s) + scene.alpha[top + right] * s
    lower = scene.alpha[bottom + left] * (1 - s) + scene.alpha[bottom + right] * s
    return upper * (1 - t) + lower * t


@jit.part
def _opaque_at(scene, item, w0, w1, w2):
    """Whether a masked triangle hides where its corners have these weights, of any sum."""
    total = w0 + w1 + w2
    if total == 0.0:
        return True
    w0, w1, w2 = w0 / total, w1 / total, w2 / total
    uv = scene.texcoords
    u = w0 * uv[item, 0] + w1 * uv[item, 2] + w2 * uv[item, 4]
    v = w0 * uv[item, 1] + w1 * uv[item, 3] + w2 * uv[item, 5]
    row = scene.mask[item]
    return _alpha(scene, row, u, v) >= scene.cutoffs[row]


@jit.part
def mask_is_opaque(scene, item, x, y, z):
    """Whether a masked triangle hides at a point of its plane; `item` in the order of the leaves."""
    c = scene.corners[item]
    ux, uy, uz, vx, vy, vz = c[3] - c[0], c[4] - c[1], c[5] - c[2], c[6] - c[0], c[7] - c[1], c[8] - c[2]
    px, py, pz = x - c[0], y - c[1], z - c[2]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    pu, pv = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
    whole, w1, w2 = uu * vv - uv * uv, pu * vv - pv * uv, pv * uu - pu * uv
    return _opaque_at(scene, item, np.float64(whole - w1 - w2), np.float64(w1), np.float64(w2))


@jit.part
def _hides(scene, item, kx, ky, kz, ox, oy, oz, dx, dy, dz, epsilon):
    """Whether triangle `item` (in the order of the leaves) crosses the segment from o by d, whose coordinates are permuted: kz is the longest of d.

    Sheared along d, the corners lie in a plane and d in its origin (Woop, Benthin, Wald, "Watertight ray/triangle intersection", 2013).
    """
    c = scene.corners
    i = np.uint64(item)
    az = c[i, kz] - oz
    ax, ay = c[i, kx] - ox, c[i, ky] - oy
    nx, ny, nz = np.float64(c[i, 9 + kx]), np.float64(c[i, 9 + ky]), np.float64(c[i, 9 + kz])
    here = -(nx * ax + ny * ay + nz * az)
    there = here + nx * dx + ny * dy + nz * dz
    if not ((here > epsilon and there < -epsilon) or (here < -epsilon and there > epsilon)):
        return False
    sx, sy = dx / dz, dy / dz
    ax, ay = ax - sx * az, ay - sy * az
    bz, gz = c[i, 3 + kz] - oz, c[i, 6 + kz] - oz
    bx, by = c[i, 3 + kx] - ox - sx * bz, c[i, 3 + ky] - oy - sy * bz
    gx, gy = c[i, 6 + kx] - ox - sx * gz, c[i, 6 + ky] - oy - sy * gz
    w0, w1, w2 = bx * gy - by * gx, gx * ay - gy * ax, ax * by - ay * bx
    if not ((w0 >= 0.0 and w1 >= 0.0 and w2 >= 0.0) or (w0 <= 0.0 and w1 <= 0.0 and w2 <= 0.0)):
        return False
    return scene.mask[i] < 0 or _opaque_at(scene, item, w0, w1, w2)


@jit.part
def _longest(dx, dy, dz):
    """The axis along which d is longest."""
    if abs(dx) > abs(dy):
        return np.uint64(0) if abs(dx) > abs(dz) else np.uint64(2)
    return np.uint64(1) if abs(dy) > abs(dz) else np.uint64(2)


@jit.part
def _leaf_hides(scene, leaf, axis, ox, oy, oz, dx, dy, dz, skip_a, skip_b, epsilon):
    """Whether a triangle of a leaf crosses the segment."""
    if axis == 0:
        kx, ky, ox, oy, oz, dx, dy, dz = np.uint64(1), np.uint64(2), oy, oz, ox, dy, dz, dx
    elif axis == 1:
        kx, ky, ox, oy, oz, dx, dy, dz = np.uint64(2), np.uint64(0), oz, ox, oy, dz, dx, dy
    else:
        kx, ky = np.uint64(0), np.uint64(1)
    for item in range(leaf >> 3, (leaf >> 3) + (leaf & 7)):
        triangle = scene.triangle[item]
        if triangle != skip_a and triangle != skip_b and _hides(scene, item, kx, ky, axis, ox, oy, oz, dx, dy, dz, epsilon):
            return True
    return False


@jit.part
def _inverse(d):
    """1 / d, finite: a segment along a box's side then still lies inside or outside."""
    return 1.0 / d if abs(d) > 1e-30 else 1e30


@jit.device
def occluded(scene, ox, oy, oz, tx, ty, tz, skip_a, skip_b):
    """Whether a triangle of `scene` (an `Occlusion`) stands between o and t; triangles skip_a and skip_b (-1: none) do not count.

    Coordinates are float64 (or float32, widened), metres. The same answer with o and t exchanged, but for roundings at borders.
    """
    ox, oy, oz = np.float64(ox), np.float64(oy), np.float64(oz)
    dx, dy, dz = tx - ox, ty - oy, tz - oz
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    axis = _longest(dx, dy, dz)
    box, link, epsilon = scene.box, scene.link, scene.epsilon[0]
    node, nodes = np.uint64(0), np.uint64(len(link))
    while node < nodes:
        x0, x1 = (box[node, 0] - ox) * ix, (box[node, 3] - ox) * ix
        y0, y1 = (box[node, 1] - oy) * iy, (box[node, 4] - oy) * iy
        z0, z1 = (box[node, 2] - oz) * iz, (box[node, 5] - oz) * iz
        near = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), 0.0))
        far = min(min(max(x0, x1), max(y0, y1)), min(max(z0, z1), 1.0))
        if near > far:
            node = np.uint64(link[node, 0])
            continue
        leaf = link[node, 1]
        if leaf and _leaf_hides(scene, leaf, axis, ox, oy, oz, dx, dy, dz, skip_a, skip_b, epsilon):
            return True
        node += np.uint64(1)
    return False


@jit.parallel_kernel
def visible_pairs(queue, scene, origins, targets, skip, result):
    """Whether each target is seen from its origin, in chunks of 1024: (n, 3) float64 each; skip (n, 2) int32; result (n,) bool."""
    scene = jit.borrow(scene)
    count = len(origins)
    chunk = jit.take(queue)
    while chunk * 1024 < count:
        for i in range(chunk * 1024, min(count, chunk * 1024 + 1024)):
            o, t = origins[i], targets[i]
            result[i] = not occluded(scene, o[0], o[1], o[2], t[0], t[1], t[2], skip[i, 0], skip[i, 1])
        chunk = jit.take(queue)
