"""Rows of transport: what one shooter gives to every element, per unit of its radiosity.

For shooter s and element j the row holds K_j = F V: the form factor from the element's centre to the shooter, and how much of it is seen in
the shooter's hemicube. B_s K_j is the irradiance that j receives. Rows are stored as the upper half of a float32, rounded, which is enough
(0.2 %, without bias) and halves the memory to stream; where they are used, the shooter's own scale puts their sum right.

Visibility is blended from the four pixels about the element. What is drawn in a pixel hides the element only if it is in front of the element's
tangent plane there, in front of the element itself, and if its own plane parts the element from the shooter: so neither a flat surface nor one
bent inwards shadows itself, nor do walls darken the corners between them, whatever the resolution, and there is no bias to tune.

Form factors near a shooter are summed over the nodes of its tree, down to single elements, which up close are parallelograms under Lambert's
formula; see `transfer`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import bits_float, float_bits
from luxel.radiosity.hemicube import FACES, ItemBuffers, delta_form_factors
from luxel.radiosity.occlusion import Occlusion, occluded
from luxel.radiosity.patches import Tree
from luxel.radiosity.transfer import polygon_factor

BLOCK = 256
"""Elements that a thread works on at a time."""

# Rows of `Elements.numbers`.
PX, PY, PZ, NX, NY, NZ, GX, GY, GZ, AREA, UX, UY, UZ, VX, VY, VZ = range(16)

_F, _I = np.float32, np.int32
_PI = _F(np.pi)
_FAR = _F(16.0)  # squared distance over squared radius beyond which a node is taken as a whole
_FLAT = _F(9.0)  # squared distance over area within which an element is a parallelogram
_BIAS = _F(1.0 - 1e-3)  # of a distance: rounding, and pixels' corners snapped
_DEEPEST = 64


class Elements(NamedTuple):
    """What receives light and sends it on, in the order of its tree.

    Attributes:
        numbers: (16, n) float32: position, normal (shading), normal of the surface, area, and the element's sides u and v as vectors, metres.
    """

    numbers: Array


class Occluders(NamedTuple):
    """What is drawn into hemicubes.

    Attributes:
        positions: (3, v) float32.
        triangles: (m, 3) int32.
        planes: (m, 4) float32: unit normal n and offset d of each triangle, in front where n.x > d.
        two_sided: (m,) bool.
        masked: Alpha-masked triangles, which are not drawn but asked ray by ray, as their holes are finer than a hemicube's pixels.
    """

    positions: Array
    triangles: Array
    planes: Array
    two_sided: Array
    masked: Occlusion


class Shooters(NamedTuple):
    """Who shoots.

    Attributes:
        node: (s,) int32, of the tree.
        centers: (s, 3) float32: where its hemicube stands.
        frames: (s, 3, 3) float32: rows right, up, normal.
    """

    node: Array
    centers: Array
    frames: Array


@jit.inlined
def decoded(half):
    """The float32 whose upper half is given."""
    return bits_float(_I(np.uint32(half) << np.uint32(16)))


@jit.inlined
def spread_factor(cos_r, cos_s, cos_n, r2, area, spread):
    """Form factor from a point to a flat surface of mean square extent `spread` along its axes, right to the second order of extent over distance.

    cos_r and cos_s are times r. The integrand f = cos_r cos_s / r^2 has in the surface's plane the Laplacian (8 - 24 cos_s^2 - 8 cos_n cos_s /
    cos_r) f / r^2, of which half times `spread` is the difference of its mean from its value at the centre; straight ahead that is -4 spread / r^2,
    as of a disc.
    """
    base = cos_r * cos_s
    bend = _F(4.0) * spread / r2 * (base - cos_s * cos_s * (_F(3.0) * base / r2 + cos_n))
    mean = base + bend if bend > _F(0.0) else base * base / (base - bend)
    return mean * area / (_PI * r2 * r2)


@jit.part
def _element_factor(j, x, y, z, nx, ny, nz, r2, cos_r, cos_s, corners, source):
    """Form factor from a point to element `j`; cosines times r."""
    area = source[AREA, j]
    if r2 > _FLAT * area:
        cos_n = nx * source[NX, j] + ny * source[NY, j] + nz * source[NZ, j]
        return spread_factor(cos_r, cos_s, cos_n, r2, area, area * _F(1 / 12))
    for k in range(4):
        a = _F(0.5) if k == 1 or k == 2 else _F(-0.5)
        b = _F(0.5) if k >= 2 else _F(-0.5)
        for axis in range(3):
            corners[k, axis] = source[PX + axis, j] + a * source[UX + axis, j] + b * source[VX + axis, j]
    return _F(abs(polygon_factor(x, y, z, nx, ny, nz, corners, 4)))


@jit.part
def node_factor(root, x, y, z, nx, ny, nz, span, child, place, source, stack, corners):
    """Form factor from a point with unit normal n to all elements below node `root`."""
    total, depth = _F(0.0), 1
    stack[0] = root
    while depth > 0:
        depth -= 1
        node = stack[depth]
        dx, dy, dz = place[node, 0] - x, place[node, 1] - y, place[node, 2] - z
        r2, radius, area = dx * dx + dy * dy + dz * dz, place[node, 3], place[node, 7]
        first = child[node]
        if first >= 0 and r2 < _FAR * radius * radius:
            stack[depth], stack[depth + 1] = first, first + 1
            depth += 2
            continue
        cos_r = nx * dx + ny * dy + nz * dz
        cos_s = -(place[node, 4] * dx + place[node, 5] * dy + place[node, 6] * dz)
        if first < 0:
            j = span[node, 0]
            if cos_s > _F(0.0) and (cos_r > _F(0.0) or r2 < _FLAT * area):
                total += _element_factor(j, x, y, z, nx, ny, nz, r2, cos_r, cos_s, corners, source)
        elif cos_r > _F(0.0) and cos_s > _F(0.0):
            cos_n = nx * place[node, 4] + ny * place[node, 5] + nz * place[node, 6]
            total += spread_factor(cos_r, cos_s, cos_n, r2, area, place[node, 8])
    return total


@jit.inlined
def _parted(plane, x, y, z, cx, cy, cz, margin):
    """Whether a triangle's plane has the point and the shooter on either side, the point by more than `margin`."""
    point = plane[0] * x + plane[1] * y + plane[2] * z - plane[3]
    shooter = plane[0] * cx + plane[1] * cy + plane[2] * cz - plane[3]
    return (point < -margin and shooter > _F(0.0)) or (point > margin and shooter < _F(0.0))


@jit.part
def _pixel_sees(at, u, v, nr, nu, na, plane, axis, x, y, z, center, near, depth, ids, planes):
    """Whether a pixel of a hemicube sees the element (1) or something that hides it (0)."""
    d = depth[at]
    facing = -(nr * u + nu * v + na)
    if d * plane * _BIAS <= near * facing or d * axis * _BIAS <= near:
        return _F(1.0)
    return _F(0.0) if _parted(planes[ids[at]], x, y, z, center[0], center[1], center[2], near) else _F(1.0)


@jit.part
def seen_fraction(lx, ly, lz, nr, nu, na, x, y, z, center, resolution, first, near, depth, ids, planes):
    """How much of an element at (x, y, z) is seen, 0..1; l is its place and (nr, nu, na) its surface's normal in the shooter's frame."""
    ax, ay = abs(lx), abs(ly)
    plane = -(nr * lx + nu * ly + na * lz)
    if lz >= ax and lz >= ay:
        face, right, up, axis = 0, lx, ly, lz
        fr, fu, fa = nr, nu, na
    elif ax >= ay:
        face, right, up, axis = (1 if lx > _F(0.0) else 2), ly, lz, ax
        fr, fu, fa = nu, na, (nr if lx > _F(0.0) else -nr)
    else:
        face, right, up, axis = (3 if ly > _F(0.0) else 4), lx, lz, ay
        fr, fu, fa = nr, na, (nu if ly > _F(0.0) else -nu)
    scale = _F(resolution) * _F(0.5)
    tall = resolution if face == 0 else resolution // 2
    px, py = right / axis * scale + scale - _F(0.5), scale - _F(0.5) - up / axis * scale
    ix, iy = min(max(_I(np.floor(px)), 0), resolution - 2), min(max(_I(np.floor(py)), 0), tall - 2)
    wx, wy = min(max(px - _F(ix), _F(0.0)), _F(1.0)), min(max(py - _F(iy), _F(0.0)), _F(1.0))
    at = first + np.uint64((face * resolution + iy) * resolution + ix)
    step = _F(1.0) / scale
    u, v = (_F(ix) + _F(0.5)) * step - _F(1.0), _F(1.0) - (_F(iy) + _F(0.5)) * step
    below = at + np.uint64(resolution)
    one = np.uint64(1)
    s00 = _pixel_sees(at, u, v, fr, fu, fa, plane, axis, x, y, z, center, near, depth, ids, planes)
    s10 = _pixel_sees(at + one, u + step, v, fr, fu, fa, plane, axis, x, y, z, center, near, depth, ids, planes)
    s01 = _pixel_sees(below, u, v - step, fr, fu, fa, plane, axis, x, y, z, center, near, depth, ids, planes)
    s11 = _pixel_sees(below + one, u + step, v - step, fr, fu, fa, plane, axis, x, y, z, center, near, depth, ids, planes)
    return (s00 * (_F(1.0) - wx) + s10 * wx) * (_F(1.0) - wy) + (s01 * (_F(1.0) - wx) + s11 * wx) * wy


# Scratch of `_find`, one row each: place in the shooter's frame; distance to the shooter's centre squared; cosines at the receiver (shading
# normal, surface) and at the shooter, times the distance.
_LX, _LY, _LZ, _R2, _COS_R, _COS_S = range(6)


@jit.part
def _find(first, count, numbers, center, frame, place, c, listed):
    """List those of `count` elements from `first` on that face the shooter and are in front of it; returns how many."""
    r0, r1, r2, u0, u1, u2, n0, n1, n2 = (
        frame[0, 0], frame[0, 1], frame[0, 2], frame[1, 0], frame[1, 1], frame[1, 2], frame[2, 0], frame[2, 1], frame[2, 2],
    )  # fmt: skip
    cx, cy, cz = center[0], center[1], center[2]
    sx, sy, sz, mx, my, mz = place[0], place[1], place[2], place[4], place[5], place[6]
    for i in range(np.uint64(0), np.uint64(count)):
        j = np.uint64(first) + i
        x, y, z = numbers[PX, j] - cx, numbers[PY, j] - cy, numbers[PZ, j] - cz
        c[_LX, i], c[_LY, i], c[_LZ, i] = r0 * x + r1 * y + r2 * z, u0 * x + u1 * y + u2 * z, n0 * x + n1 * y + n2 * z
        surface = numbers[GX, j] * x + numbers[GY, j] * y + numbers[GZ, j] * z
        x, y, z = numbers[PX, j] - sx, numbers[PY, j] - sy, numbers[PZ, j] - sz
        c[_R2, i] = x * x + y * y + z * z
        cosine = -(numbers[NX, j] * x + numbers[NY, j] * y + numbers[NZ, j] * z)
        c[_COS_R, i] = cosine if surface < _F(0.0) else _F(0.0)
        c[_COS_S, i] = mx * x + my * y + mz * z
    n = np.uint64(0)
    for i in range(np.uint64(0), np.uint64(count)):
        listed[n] = i
        n += np.uint64((c[_COS_R, i] > _F(0.0)) & (c[_COS_S, i] > _F(0.0)) & (c[_LZ, i] > _F(0.0)))
    return n


@jit.parallel_kernel
def _fill_rows(queue, numbers, span, child, place, source, nodes, centers, frames, start, resolutions, depth, ids, near,
               planes, masked, slots, rows, sums):  # fmt: skip
    n = numbers.shape[1]
    blocks = (n + BLOCK - 1) // BLOCK
    own_c, own_list = np.empty((6, BLOCK), np.float32), np.empty(BLOCK + 1, np.uint64)
    own_stack, own_corners = np.empty(_DEEPEST, np.int32), np.empty((4, 3))
    c, listed, stack, corners = jit.borrow(own_c), jit.borrow(own_list), jit.borrow(own_stack), jit.borrow(own_corners)
    numbers, span, child, place = jit.borrow(numbers), jit.borrow(span), jit.borrow(child), jit.borrow(place)
    source, depth, ids, planes, rows = jit.borrow(source), jit.borrow(depth), jit.borrow(ids), jit.borrow(planes), jit.borrow(rows)
    centers, frames, masked = jit.borrow(centers), jit.borrow(frames), jit.borrow(masked)
    any_masked = len(masked.link) > 0
    block = jit.take(queue)
    while block < blocks:
        first = block * BLOCK
        count = min(BLOCK, n - first)
        for s in range(len(nodes)):
            node, row = nodes[s], rows[slots[s]]
            for i in range(first, first + count):
                row[i] = 0
            found = _find(first, count, numbers, centers[s], frames[s], place[node], c, listed)
            radius2, area, total = place[node, 3] * place[node, 3], place[node, 7], 0.0
            turn = frames[s]
            for k in range(found):
                i = listed[k]
                j = np.uint64(first) + i
                gx, gy, gz = numbers[GX, j], numbers[GY, j], numbers[GZ, j]
                nr, nu, na = (
                    turn[0, 0] * gx + turn[0, 1] * gy + turn[0, 2] * gz, turn[1, 0] * gx + turn[1, 1] * gy + turn[1, 2] * gz,
                    turn[2, 0] * gx + turn[2, 1] * gy + turn[2, 2] * gz,
                )  # fmt: skip
                v = seen_fraction(
                    c[_LX, i], c[_LY, i], c[_LZ, i], nr, nu, na, numbers[PX, j], numbers[PY, j], numbers[PZ, j], centers[s], resolutions[s],
                    np.uint64(start[s]), near, depth, ids, planes,
                )  # fmt: skip
                if v > _F(0.0) and any_masked and occluded(
                    masked, centers[s, 0], centers[s, 1], centers[s, 2], np.float64(numbers[PX, j]), np.float64(numbers[PY, j]),
                    np.float64(numbers[PZ, j]), -1, -1
                ):  # fmt: skip
                    continue
                if v > _F(0.0):
                    r2 = c[_R2, i]
                    if r2 < _FAR * radius2:
                        f = node_factor(
                            node, numbers[PX, j], numbers[PY, j], numbers[PZ, j], numbers[NX, j], numbers[NY, j], numbers[NZ, j],
                            span, child, place, source, stack, corners,
                        )  # fmt: skip
                    else:
                        cos_n = numbers[NX, j] * place[node, 4] + numbers[NY, j] * place[node, 5] + numbers[NZ, j] * place[node, 6]
                        f = spread_factor(c[_COS_R, i], c[_COS_S, i], cos_n, r2, area, place[node, 8])
                    half = np.uint16((np.uint32(float_bits(f * v)) + np.uint32(0x8000)) >> np.uint32(16))
                    row[j] = half
                    total += np.float64(decoded(half)) * np.float64(numbers[AREA, j])
            sums[s, block] = total
        block = jit.take(queue)
    own_c[0, 0] = own_list[0] + own_stack[0] + own_corners[0, 0]  # they live until here


@jit.parallel_kernel
def _escape(queue, centers, start, resolutions, ids, planes, two_sided, deltas, first_delta, escaped):
    """The share of a shooter's light that meets nothing, and the share that meets the back of something one-sided."""
    s = jit.take(queue)
    while s < len(centers):
        x, y, z = centers[s, 0], centers[s, 1], centers[s, 2]
        size = FACES * resolutions[s] * resolutions[s]
        out = back = 0.0
        for i in range(size):
            t = ids[start[s] + i]
            share = deltas[first_delta[s] + i]
            if t < 0:
                out += share
            elif not two_sided[t] and planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z < planes[t, 3]:
                back += share
        escaped[s, 0], escaped[s, 1] = out, back
        s = jit.take(queue)


@jit.parallel_kernel
def _receive(queue, rows, slots, powers, received):
    """Add to received (3, n) what shooters of radiosity powers (s, 3) give."""
    n = received.shape[1]
    blocks = (n + BLOCK - 1) // BLOCK
    rows, received = jit.borrow(rows), jit.borrow(received)
    block = jit.take(queue)
    while block < blocks:
        first = block * BLOCK
        red, green, blue = received[0, first : first + BLOCK], received[1, first : first + BLOCK], received[2, first : first + BLOCK]
        for s in range(len(slots)):
            row = rows[slots[s], first : first + BLOCK]
            r, g, b = powers[s, 0], powers[s, 1], powers[s, 2]
            for i in range(np.uint64(0), np.uint64(len(row))):
                k = decoded(row[i])
                red[i] += k * r
                green[i] += k * g
                blue[i] += k * b
        block = jit.take(queue)


def fill_rows(elements: Elements, tree: Tree, source: Array, shooters: Shooters, seen: ItemBuffers, occluders: Occluders, slots: Array, rows: Array,
              threads: int) -> tuple[Array, Array]:  # fmt: skip
    """Compute the rows of s shooters.

    Args:
        elements: Of the receivers.
        tree: Of the shooters, whose elements' numbers are `source` (16, k).
        slots: (s,) int64: where each row goes.
        rows: (slots, n) uint16, written.

    Returns:
        (s,) float64: sum over the row of area times K: the area of the shooter if nothing escapes; and (s, 2) float64: the shares of the hemicube
        that meet nothing and the backs of one-sided surfaces.
    """
    count, n = len(shooters.node), elements.numbers.shape[1]
    sums = np.empty((count, -(-n // BLOCK)))
    jit.run(
        _fill_rows, threads, elements.numbers, tree.span, tree.child, tree.place, source, shooters.node, shooters.centers, shooters.frames,
        seen.start, seen.resolution, seen.depth, seen.ids, np.float32(seen.near), occluders.planes, occluders.masked, slots, rows, sums,
    )  # fmt: skip
    sizes = sorted(set(seen.resolution.tolist()))
    deltas = [delta_form_factors(size).ravel() for size in sizes]
    begin = dict(zip(sizes, np.cumsum([0] + [len(d) for d in deltas]).tolist(), strict=False))
    escaped = np.empty((count, 2))
    jit.run(
        _escape, threads, shooters.centers, seen.start, seen.resolution, seen.ids, occluders.planes, occluders.two_sided,
        np.concatenate(deltas),
        np.array([begin[size] for size in seen.resolution.tolist()], np.int64), escaped,
    )  # fmt: skip
    return sums.sum(1), escaped


def receive(rows: Array, slots: Array, powers: Array, received: Array, threads: int) -> None:
    """received (3, n) float32 += the sum over the shooters, in their order, of powers (s, 3) float32 times rows[slots]."""
    jit.run(_receive, threads, rows, slots, powers, received)
