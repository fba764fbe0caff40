"""Texture sampling: nearest, bilinear, trilinear over mipmaps, with more probes where the footprint is long.

Texel (x, y) has its centre at ((x + 0.5) / width, (y + 0.5) / height), v grows downwards, and level l is max(1, width >> l) wide.
The footprint's two axes are the derivatives per pixel along x and y, in texels of level 0, but no shorter than one. Where the longer
one is r times the shorter one, min(4, round(r)) probes are spread evenly along it; the level of detail is log2 of the longer axis
over their number.
8-bit texels are decoded before they are weighted, so filtering is in linear light.

A batch takes one texture at a time, in stages: places and addresses in vector registers, texels fetched one by one, then decoding
and weighting in vector registers again. Coordinates that are not finite, or beyond 1e9, read the place 0.
"""

from __future__ import annotations

import math

import numpy as np

from luxel.arrays import Array
from luxel.jit import bits_float, float_bits, inlined, part
from luxel.raster.arithmetic import log2
from luxel.raster.channels import (
    ALONG,
    AXIS_S,
    AXIS_T,
    BLEND,
    DOWN,
    LEVEL,
    PITCH,
    PLACE_S,
    PLACE_T,
    PROBE_S,
    PROBE_T,
    PROBES,
    TEXA,
    TEXB,
    TEXEL0,
    TEXEL1,
    TEXEL2,
    TEXEL3,
    TEXG,
    TEXR,
    WEIGHT,
)
from luxel.raster.mipmap import (
    CLAMP,
    FILTER,
    HEIGHT,
    LEVELS,
    LUT,
    NEAREST,
    REPEAT,
    SRGB,
    TRILINEAR,
    WIDE,
    WIDTH,
    WRAP_U,
    WRAP_V,
)

MOST_PROBES = 4

_ZERO, _HALF, _ONE, _TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
_HUGE = np.float32(1e9)
_NONE, _NEXT = np.int32(0), np.int32(1)
_BYTE, _GREEN, _BLUE, _ALPHA = np.int32(255), np.int32(8), np.int32(16), np.int32(24)


@part
def fetch(g: Array, n: int, info: Array, levels: Array, texels: Array, radiance: Array, uv: int, transform: Array) -> None:
    """Sample one texture for the first `n` fragments of a batch.

    Args:
        g: The batch; TEXR TEXG TEXB TEXA get linear RGBA.
        n: Fragments.
        info, levels: The texture's rows of `TexturePool.textures` and `levels`.
        texels, radiance: The pools.
        uv: U0 or U1, which coordinates and derivatives to take.
        transform: (6,) float32, see `materials`.
    """
    transform_places(g, n, g[uv:], transform)
    trilinear = info[FILTER] == TRILINEAR
    measure(g, n, np.float32(info[WIDTH]), np.float32(info[HEIGHT]), np.float32(info[LEVELS] - 1), MOST_PROBES if trilinear else 1)
    passes, between = np.int32(1), np.int32(0)
    for i in range(n):
        passes = max(passes, np.int32(g[PROBES + i]))
        between = np.int32(between | np.int32(g[BLEND + i] > _ZERO))
        g[TEXR + i] = _ZERO
        g[TEXG + i] = _ZERO
        g[TEXB + i] = _ZERO
        g[TEXA + i] = _ZERO
    for probe in range(passes):
        wrap(g[PROBE_S : PROBE_S + n], g[PLACE_S : PLACE_S + n], g[AXIS_S : AXIS_S + n], g[PROBES : PROBES + n], probe, info[WRAP_U])
        wrap(g[PROBE_T : PROBE_T + n], g[PLACE_T : PLACE_T + n], g[AXIS_T : AXIS_T + n], g[PROBES : PROBES + n], probe, info[WRAP_V])
        for step in range(1 + between):
            weigh(g, n, np.float32(probe), step == 1)
            address(g, n, np.int32(step), info)
            if info[WIDE]:
                add_wide(g, n, np.int32(step), info, levels, radiance)
            else:
                load(g, n, np.int32(step), info, levels, texels)
                decode(g, n, np.int32(info[SRGB] << _GREEN))


@part
def transform_places(g: Array, n: int, uv: Array, transform: Array) -> None:
    """Transform the coordinates, and their derivatives: along x into AXIS_S AXIS_T, along y into PROBE_S PROBE_T."""
    a, b, c, d, e, f = transform[0], transform[1], transform[2], transform[3], transform[4], transform[5]
    for i in range(n):
        u, v, ux, vx, uy, vy = uv[i], uv[PITCH + i], uv[2 * PITCH + i], uv[3 * PITCH + i], uv[4 * PITCH + i], uv[5 * PITCH + i]
        g[PLACE_S + i] = a * u + b * v + c
        g[PLACE_T + i] = d * u + e * v + f
        g[AXIS_S + i] = a * ux + b * vx
        g[AXIS_T + i] = d * ux + e * vx
        g[PROBE_S + i] = a * uy + b * vy
        g[PROBE_T + i] = d * uy + e * vy


@part
def measure(g: Array, n: int, width: np.float32, height: np.float32, last: np.float32, most: int) -> None:
    """Longer axis, number of probes and level of detail of each footprint."""
    limit = np.float32(most)
    for i in range(n):
        sx, tx, sy, ty = g[AXIS_S + i], g[AXIS_T + i], g[PROBE_S + i], g[PROBE_T + i]
        along_x = sx * sx * width * width + tx * tx * height * height
        along_y = sy * sy * width * width + ty * ty * height * height
        turned = along_y > along_x
        g[AXIS_S + i] = sy if turned else sx
        g[AXIS_T + i] = ty if turned else tx
        longer = min(_HUGE * _HUGE, max(_ONE, along_y if turned else along_x))
        shorter = max(_ONE, along_x if turned else along_y)
        ratio = max(_ONE, min(limit, np.float32(math.sqrt(longer / shorter))))
        probes = np.float32(np.int32(ratio + _HALF))
        level = min(last, max(_ZERO, _HALF * log2(longer / (probes * probes))))
        g[PROBES + i] = probes
        g[LEVEL + i] = np.float32(np.int32(level))
        g[BLEND + i] = level - np.float32(np.int32(level))


@part
def wrap(out: Array, place: Array, axis: Array, probes: Array, probe: int, mode: int) -> None:
    """Coordinates of one probe along one direction, brought to 0 .. 1."""
    step = np.float32(probe) + _HALF
    for i in range(len(out)):
        u = place[i] + axis[i] * (step / probes[i] - _HALF) if probes[i] > _ONE else place[i]
        out[i] = u if abs(u) < _HUGE else _ZERO
    if mode == REPEAT:
        for i in range(len(out)):
            out[i] -= whole(out[i])
    elif mode == CLAMP:
        for i in range(len(out)):
            out[i] = min(_ONE, max(_ZERO, out[i]))
    else:
        for i in range(len(out)):
            u = out[i] - _TWO * whole(_HALF * out[i])
            out[i] = min(u, _TWO - u)


@inlined
def whole(x: np.float32) -> np.float32:
    """The largest whole number that is not above x, for |x| < 2^31; math.floor would be a call of the C library."""
    cut = np.float32(np.int32(x))
    return cut - _ONE if x < cut else cut


@part
def weigh(g: Array, n: int, probe: np.float32, upper: bool) -> None:
    """Weight of one probe at one of its two levels; 0 for those who have fewer probes."""
    for i in range(n):
        share = _ONE / g[PROBES + i] if probe < g[PROBES + i] else _ZERO
        g[WEIGHT + i] = share * (g[BLEND + i] if upper else _ONE - g[BLEND + i])


@part
def address(g: Array, n: int, step: np.int32, info: Array) -> None:
    """The four texels around a probe, as numbers within the level (bits of TEXEL0 ..), and where between them it lies."""
    full_width, full_height, last = info[WIDTH], info[HEIGHT], np.int32(info[LEVELS] - _NEXT)
    around, below = np.int32(info[WRAP_U] == REPEAT), np.int32(info[WRAP_V] == REPEAT)
    smooth = _ZERO if info[FILTER] == NEAREST else _ONE
    for i in range(n):
        level = min(last, np.int32(np.int32(g[LEVEL + i]) + step))
        right, bottom = np.int32(max(_NEXT, np.int32(full_width >> level)) - _NEXT), np.int32(max(_NEXT, np.int32(full_height >> level)) - _NEXT)
        x = g[PROBE_S + i] * np.float32(np.int32(right + _NEXT)) - _HALF * smooth
        y = g[PROBE_T + i] * np.float32(np.int32(bottom + _NEXT)) - _HALF * smooth
        x0, y0 = np.int32(np.int32(x + _ONE) - _NEXT), np.int32(np.int32(y + _ONE) - _NEXT)
        g[ALONG + i] = (x - np.float32(x0)) * smooth
        g[DOWN + i] = (y - np.float32(y0)) * smooth
        x1, y1 = np.int32(x0 + _NEXT), np.int32(y0 + _NEXT)
        x1 = np.int32(right - np.int32(right * around)) if x1 > right else x1
        y1 = np.int32(bottom - np.int32(bottom * below)) if y1 > bottom else y1
        x0 = np.int32(right * around) if x0 < _NONE else min(x0, right)
        y0 = np.int32(bottom * below) if y0 < _NONE else min(y0, bottom)
        upper, lower = np.int32(y0 * np.int32(right + _NEXT)), np.int32(y1 * np.int32(right + _NEXT))
        g[TEXEL0 + i] = bits_float(np.int32(upper + x0))
        g[TEXEL1 + i] = bits_float(np.int32(upper + x1))
        g[TEXEL2 + i] = bits_float(np.int32(lower + x0))
        g[TEXEL3 + i] = bits_float(np.int32(lower + x1))


@part
def load(g: Array, n: int, step: np.int32, info: Array, levels: Array, texels: Array) -> None:
    """Put the texels in place of their numbers. Not for vector registers: their gathers are no faster."""
    last = info[LEVELS] - 1
    for i in range(n):
        start = levels[min(last, np.int32(g[LEVEL + i]) + step)]
        for texel in (TEXEL0, TEXEL1, TEXEL2, TEXEL3):
            g[texel + i] = bits_float(np.int32(texels[start + float_bits(g[texel + i])]))


@part
def decode(g: Array, n: int, page: np.int32) -> None:
    """Add the four weighted texels."""
    for i in range(n):
        fx, fy = g[ALONG + i], g[DOWN + i]
        w1, w3 = g[WEIGHT + i] * fx * (_ONE - fy), g[WEIGHT + i] * fx * fy
        w0, w2 = g[WEIGHT + i] * (_ONE - fx) * (_ONE - fy), g[WEIGHT + i] * (_ONE - fx) * fy
        t0, t1, t2, t3 = float_bits(g[TEXEL0 + i]), float_bits(g[TEXEL1 + i]), float_bits(g[TEXEL2 + i]), float_bits(g[TEXEL3 + i])
        g[TEXR + i] += w0 * light(t0, page) + w1 * light(t1, page) + w2 * light(t2, page) + w3 * light(t3, page)
        t0, t1, t2, t3 = np.int32(t0 >> _GREEN), np.int32(t1 >> _GREEN), np.int32(t2 >> _GREEN), np.int32(t3 >> _GREEN)
        g[TEXG + i] += w0 * light(t0, page) + w1 * light(t1, page) + w2 * light(t2, page) + w3 * light(t3, page)
        t0, t1, t2, t3 = np.int32(t0 >> _GREEN), np.int32(t1 >> _GREEN), np.int32(t2 >> _GREEN), np.int32(t3 >> _GREEN)
        g[TEXB + i] += w0 * light(t0, page) + w1 * light(t1, page) + w2 * light(t2, page) + w3 * light(t3, page)
        t0, t1, t2, t3 = np.int32(t0 >> _GREEN), np.int32(t1 >> _GREEN), np.int32(t2 >> _GREEN), np.int32(t3 >> _GREEN)
        g[TEXA + i] += w0 * light(t0, _NONE) + w1 * light(t1, _NONE) + w2 * light(t2, _NONE) + w3 * light(t3, _NONE)


@inlined
def light(bits: np.int32, page: np.int32) -> np.float32:
    """What the lowest byte means, by one of the two pages of the table."""
    return LUT[np.uint32(np.int32(bits & _BYTE) + page)]


@part
def add_wide(g: Array, n: int, step: np.int32, info: Array, levels: Array, radiance: Array) -> None:
    """Add the four weighted texels of a float texture."""
    last = info[LEVELS] - 1
    for i in range(n):
        start = levels[min(last, np.int32(g[LEVEL + i]) + step)]
        fx, fy, weight = g[ALONG + i], g[DOWN + i], g[WEIGHT + i]
        k0, k1 = start + float_bits(g[TEXEL0 + i]), start + float_bits(g[TEXEL1 + i])
        k2, k3 = start + float_bits(g[TEXEL2 + i]), start + float_bits(g[TEXEL3 + i])
        for channel in range(4):
            upper = radiance[k0, channel] * (_ONE - fx) + radiance[k1, channel] * fx
            lower = radiance[k2, channel] * (_ONE - fx) + radiance[k3, channel] * fx
            g[TEXR + channel * PITCH + i] += weight * (upper * (_ONE - fy) + lower * fy)


@part
def alpha_at(info: Array, levels: Array, texels: Array, radiance: Array, u: np.float32, v: np.float32) -> np.float32:
    """Alpha of level 0 at one place: bilinear, or nearest if the texture asks for it."""
    smooth = _ZERO if info[FILTER] == NEAREST else _ONE
    x = unwrap(u, info[WRAP_U]) * np.float32(info[WIDTH]) - _HALF * smooth
    y = unwrap(v, info[WRAP_V]) * np.float32(info[HEIGHT]) - _HALF * smooth
    x0, y0 = np.int32(np.int32(x + _ONE) - _NEXT), np.int32(np.int32(y + _ONE) - _NEXT)
    total = _ZERO
    for j in range(2):
        for i in range(2):
            column = settle(np.int32(x0 + np.int32(i)), info[WIDTH], info[WRAP_U])
            line = settle(np.int32(y0 + np.int32(j)), info[HEIGHT], info[WRAP_V])
            at = levels[0] + np.int64(line) * np.int64(info[WIDTH]) + np.int64(column)
            alpha = radiance[at, 3] if info[WIDE] else LUT[texels[at] >> np.uint32(24)]
            fx, fy = (x - np.float32(x0)) * smooth, (y - np.float32(y0)) * smooth
            total += alpha * (fx if i else _ONE - fx) * (fy if j else _ONE - fy)
    return total


@inlined
def unwrap(u: np.float32, mode: int) -> np.float32:
    """One coordinate brought to 0 .. 1."""
    if not abs(u) < _HUGE:
        return _ZERO
    if mode == CLAMP:
        return min(_ONE, max(_ZERO, u))
    if mode == REPEAT:
        return u - whole(u)
    u = u - _TWO * whole(_HALF * u)
    return min(u, _TWO - u)


@inlined
def settle(k: np.int32, size: np.int32, mode: int) -> np.int32:
    """The texel that stands for texel -1 <= k <= size."""
    if mode == REPEAT:
        return np.int32(k + size) if k < _NONE else np.int32(k - size) if k >= size else k
    return min(max(k, _NONE), np.int32(size - _NEXT))
