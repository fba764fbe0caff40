"""Packets: the first triangles that 16 rays meet, all at once, for gathering: rays that start near each other and go a like way.

Each node of the hierarchy is fetched once for all of them, and what is done with it is plain loops over the rays, which the compiler turns into
vector instructions (Wald, Slusallek, Benthin, Wagner, "Interactive rendering with coherent ray tracing", 2001). Single precision: a ray lost
or gained in a crack is no harm in a mean of many.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.jit import bits_float
from luxel.radiosity.batch import RAYS
from luxel.radiosity.occlusion import mask_is_opaque

WIDTH = RAYS
"""Rays of a packet."""

_F, _I = np.float32, np.int32
_CRACK = _F(1e-5)  # of a triangle: by so much it reaches beyond its sides
_DEEPEST = 192

# Rows of a packet's scratch, WIDTH numbers each: where rays start, their unit directions, how far they go, then what they met: how far away, the
# row of `Occlusion.corners` (int32) or -1, and the product of direction and normal; last, what the walk needs.
OX, OY, OZ, DX, DY, DZ, AT, FOUND, SLOPE, _IX, _IY, _IZ, _SX, _SY, _SZ, _NEW = (np.uint64(WIDTH * row) for row in range(16))
SCRATCH = 16 * WIDTH
STACK = _DEEPEST + 8


@jit.inlined
def _touched(box, node, c):
    """How many rays of a packet touch the box of a node before what they have met."""
    x0, y0, z0, x1, y1, z1 = box[node, 0], box[node, 1], box[node, 2], box[node, 3], box[node, 4], box[node, 5]
    count = _I(0)
    for r in range(np.uint64(WIDTH)):
        ax, bx = x0 * c[_IX + r] - c[_SX + r], x1 * c[_IX + r] - c[_SX + r]
        ay, by = y0 * c[_IY + r] - c[_SY + r], y1 * c[_IY + r] - c[_SY + r]
        az, bz = z0 * c[_IZ + r] - c[_SZ + r], z1 * c[_IZ + r] - c[_SZ + r]
        near = max(max(min(ax, bx), min(ay, by)), max(min(az, bz), _F(0.0)))
        far = min(min(max(ax, bx), max(ay, by)), min(max(az, bz), c[AT + r]))
        count = _I(count + (_I(1) if near <= far else _I(0)))
    return count


@jit.inlined
def _meet(corners, item, epsilon, c):
    """Let the rays meet a triangle: _NEW is how far along it is, 0 if it is not; returns how many do."""
    x0, y0, z0 = corners[item, 0], corners[item, 1], corners[item, 2]
    ux, uy, uz = corners[item, 3] - x0, corners[item, 4] - y0, corners[item, 5] - z0
    vx, vy, vz = corners[item, 6] - x0, corners[item, 7] - y0, corners[item, 8] - z0
    nx, ny, nz = corners[item, 9], corners[item, 10], corners[item, 11]
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    whole = uu * vv - uv * uv
    edge = -_CRACK * whole
    count = _I(0)
    for r in range(np.uint64(WIDTH)):
        ax, ay, az = x0 - c[OX + r], y0 - c[OY + r], z0 - c[OZ + r]
        dx, dy, dz = c[DX + r], c[DY + r], c[DZ + r]
        height, slope = nx * ax + ny * ay + nz * az, nx * dx + ny * dy + nz * dz
        at = height / slope
        px, py, pz = dx * at - ax, dy * at - ay, dz * at - az
        pu, pv = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
        s, t = pu * vv - pv * uv, pv * uu - pu * uv
        meets = (abs(height) > epsilon) & (at > _F(0.0)) & (at < c[AT + r]) & (s >= edge) & (t >= edge) & (s + t <= whole - edge)
        c[_NEW + r] = at if meets else _F(0.0)
        count = _I(count + (_I(1) if meets else _I(0)))
    return count


@jit.part
def _keep(scene, item, c):
    """What was met is what is nearest so far; where a mask has a hole, it is not."""
    masked = scene.mask[item] >= 0
    for r in range(np.uint64(WIDTH)):
        at = c[_NEW + r]
        if at > _F(0.0):
            x, y, z = c[OX + r] + c[DX + r] * at, c[OY + r] + c[DY + r] * at, c[OZ + r] + c[DZ + r] * at
            if masked and not mask_is_opaque(scene, item, x, y, z):
                continue
            corners = scene.corners
            c[AT + r], c[FOUND + r] = at, bits_float(_I(item))
            c[SLOPE + r] = corners[item, 9] * c[DX + r] + corners[item, 10] * c[DY + r] + corners[item, 11] * c[DZ + r]


@jit.inlined
def _inverse(d):
    return _F(1.0) / d if abs(d) > _F(1e-18) else _F(1e18)


@jit.part
def meet_all(scene, c, stack):
    """Trace a packet: rows OX .. AT of the scratch `c` (SCRATCH,) float32 are given, AT, FOUND and SLOPE are filled; `stack` (STACK,) int32."""
    mx = my = mz = _F(0.0)
    for r in range(np.uint64(WIDTH)):
        c[FOUND + r], c[SLOPE + r] = bits_float(_I(-1)), _F(0.0)
        ix, iy, iz = _inverse(c[DX + r]), _inverse(c[DY + r]), _inverse(c[DZ + r])
        c[_IX + r], c[_IY + r], c[_IZ + r] = ix, iy, iz
        c[_SX + r], c[_SY + r], c[_SZ + r] = c[OX + r] * ix, c[OY + r] * iy, c[OZ + r] * iz
        mx, my, mz = mx + c[DX + r], my + c[DY + r], mz + c[DZ + r]
    box, link, epsilon = scene.box, scene.link, _F(scene.epsilon[0])
    if len(link) == 0:
        return
    stack[0] = 0
    depth = 1
    while depth > 0:
        depth -= 1
        node = np.uint64(stack[depth])
        if _touched(box, node, c) == 0:
            continue
        leaf = link[node, 1]
        if leaf:
            for item in range(np.uint64(leaf >> 3), np.uint64((leaf >> 3) + (leaf & 7))):
                if _meet(scene.corners, item, epsilon, c) > 0:
                    _keep(scene, item, c)
            continue
        one = node + np.uint64(1)
        other = np.uint64(link[one, 0])
        along = _F(0.0)  # which of the two children lies nearer along the packet's way
        along += (box[other, 0] + box[other, 3] - box[one, 0] - box[one, 3]) * mx
        along += (box[other, 1] + box[other, 4] - box[one, 1] - box[one, 4]) * my
        along += (box[other, 2] + box[other, 5] - box[one, 2] - box[one, 5]) * mz
        stack[depth] = other if along > _F(0.0) else one
        stack[depth + 1] = one if along > _F(0.0) else other
        depth += 2
