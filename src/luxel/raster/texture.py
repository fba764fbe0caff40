"""Texture sampling: nearest, bilinear, trilinear over mipmaps, with a few probes where the footprint is long.

Conventions: texel (x, y) has its centre at ((x + 0.5) / width, (y + 0.5) / height); v grows downwards; level l is
max(1, width >> l) wide. Level of detail: log2 of the longer axis of the pixel's footprint in texels of level 0 (after the reach of the
probes, below), 0 when it magnifies. Anisotropy: where the longer axis is r times the shorter one, min(4, ceil(r)) trilinear probes
are spread evenly along it, each as wide as its share. 8-bit texels are decoded by table before they are weighted, so filtering is in linear light.
"""

from __future__ import annotations

import math

import numpy as np

from luxel.arrays import Array
from luxel.jit import inlined, part
from luxel.raster.arithmetic import log2
from luxel.raster.channels import PITCH, TEXA, TEXB, TEXG, TEXR
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
)  # fmt: skip

PROBES = 4

_ZERO, _HALF, _ONE, _TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
_HUGE, _TINY, _PROBES = np.float32(1e9), np.float32(1e-12), np.float32(PROBES)
_NONE, _NEXT = np.int32(0), np.int32(1)
_BYTE, _GREEN, _BLUE, _ALPHA = np.uint32(255), np.uint32(8), np.uint32(16), np.uint32(24)


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
    a, b, c, d, e, f = transform[0], transform[1], transform[2], transform[3], transform[4], transform[5]
    for i in range(n):
        u, v = g[uv + i], g[uv + PITCH + i]
        ux, vx = g[uv + 2 * PITCH + i], g[uv + 3 * PITCH + i]
        uy, vy = g[uv + 4 * PITCH + i], g[uv + 5 * PITCH + i]
        red, green, blue, alpha = sample(
            info, levels, texels, radiance, a * u + b * v + c, d * u + e * v + f, a * ux + b * vx, d * ux + e * vx, a * uy + b * vy, d * uy + e * vy
        )
        g[TEXR + i] = red
        g[TEXG + i] = green
        g[TEXB + i] = blue
        g[TEXA + i] = alpha


@inlined
def sample(
    info: Array, levels: Array, texels: Array, radiance: Array, u: np.float32, v: np.float32,
    ux: np.float32, vx: np.float32, uy: np.float32, vy: np.float32,
) -> tuple[np.float32, np.float32, np.float32, np.float32]:  # fmt: skip
    """Linear RGBA of a texture at (u, v), with the derivatives of (u, v) per pixel along x and y."""
    kind, last = info[FILTER], info[LEVELS] - 1
    width, height = np.float32(info[WIDTH]), np.float32(info[HEIGHT])
    red, green, blue, alpha = _ZERO, _ZERO, _ZERO, _ZERO
    probes, low, blend = np.int32(1), np.int32(0), _ZERO
    if kind == TRILINEAR:
        along_x = ux * ux * width * width + vx * vx * height * height
        along_y = uy * uy * width * width + vy * vy * height * height
        if along_y > along_x:
            ux, vx, along_x, along_y = uy, vy, along_y, along_x
        probes, detail = footprint(along_x, along_y)
        detail = min(detail, np.float32(last))
        low = np.int32(detail)
        blend = detail - np.float32(low)
    share = _ONE / np.float32(probes)
    for probe in range(probes):
        reach = (np.float32(np.int32(probe)) + _HALF) * share - _HALF
        level, weight = low, share * (_ONE - blend)
        while weight > _ZERO:
            r, g, b, a = filtered(info, levels, texels, radiance, level, u + reach * ux, v + reach * vx)
            red, green, blue, alpha = red + weight * r, green + weight * g, blue + weight * b, alpha + weight * a
            weight = share * blend if level == low else _ZERO
            level = np.int32(level + _NEXT)
    return red, green, blue, alpha


@inlined
def footprint(major: np.float32, minor: np.float32) -> tuple[np.int32, np.float32]:
    """Number of probes and level of detail, from the squared lengths of the footprint's axes in texels."""
    if not major > _ONE:  # magnified, or not a number
        return np.int32(1), _ZERO
    major = min(major, _HUGE * _HUGE)
    ratio = max(_ONE, min(_PROBES, np.float32(math.sqrt(major / max(minor, _TINY * major)))))
    probes = np.int32(ratio)
    if np.float32(probes) < ratio:
        probes = np.int32(probes + 1)
    level = _HALF * log2(major / np.float32(probes * probes))
    return probes, max(_ZERO, level)


@inlined
def filtered(
    info: Array, levels: Array, texels: Array, radiance: Array, level: int, u: np.float32, v: np.float32
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Linear RGBA of one mipmap level: of the nearest texel, or between the nearest four."""
    width = max(_NEXT, np.int32(info[WIDTH] >> level))
    height = max(_NEXT, np.int32(info[HEIGHT] >> level))
    x = unwrap(u, info[WRAP_U]) * np.float32(width)
    y = unwrap(v, info[WRAP_V]) * np.float32(height)
    if info[FILTER] == NEAREST:
        top = levels[level] + np.int64(min(np.int32(y), height - _NEXT)) * width
        return texel(info, texels, radiance, top + min(np.int32(x), width - _NEXT))
    left, right, fx = neighbours(x - _HALF, width, info[WRAP_U])
    upper, lower, fy = neighbours(y - _HALF, height, info[WRAP_V])
    top = levels[level] + np.int64(upper) * width
    bottom = levels[level] + np.int64(lower) * width
    r0, g0, b0, a0 = texel(info, texels, radiance, top + left)
    r1, g1, b1, a1 = texel(info, texels, radiance, top + right)
    r2, g2, b2, a2 = texel(info, texels, radiance, bottom + left)
    r3, g3, b3, a3 = texel(info, texels, radiance, bottom + right)
    w0, w1, w2, w3 = (_ONE - fx) * (_ONE - fy), fx * (_ONE - fy), (_ONE - fx) * fy, fx * fy
    return (
        w0 * r0 + w1 * r1 + w2 * r2 + w3 * r3,
        w0 * g0 + w1 * g1 + w2 * g2 + w3 * g3,
        w0 * b0 + w1 * b1 + w2 * b2 + w3 * b3,
        w0 * a0 + w1 * a1 + w2 * a2 + w3 * a3,
    )


@inlined
def unwrap(u: np.float32, wrap: int) -> np.float32:
    """A coordinate brought to 0 .. 1; what is not a number, or huge, gives 0."""
    if not abs(u) < _HUGE:
        return _ZERO
    if wrap == CLAMP:
        return min(_ONE, max(_ZERO, u))
    if wrap == REPEAT:
        return u - whole(u)
    u = u - _TWO * whole(_HALF * u)
    return _TWO - u if u > _ONE else u


@inlined
def whole(x: np.float32) -> np.float32:
    """The largest whole number that is not above x, for |x| < 2^31; math.floor would be a call of the C library."""
    cut = np.float32(np.int32(x))
    return cut - _ONE if x < cut else cut


@inlined
def neighbours(x: np.float32, size: int, wrap: int) -> tuple[int, int, np.float32]:
    """The two texels between whose centres x lies (-0.5 .. size - 0.5, counted from the first centre), and how far along."""
    first = np.int32(x) if x >= _ZERO else np.int32(-1)
    second = np.int32(first + _NEXT)
    along = x - np.float32(first)
    if wrap == REPEAT:
        return (first if first >= _NONE else np.int32(size - _NEXT)), (second if second < size else _NONE), along
    return max(first, _NONE), min(second, np.int32(size - _NEXT)), along


@inlined
def texel(info: Array, texels: Array, radiance: Array, index: int) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Linear RGBA of one stored texel."""
    at = np.uint64(index)
    if info[WIDE]:
        return radiance[at, 0], radiance[at, 1], radiance[at, 2], radiance[at, 3]
    packed = texels[at]
    page = np.uint32(info[SRGB] << 8)
    return (
        LUT[page + (packed & _BYTE)],
        LUT[page + ((packed >> _GREEN) & _BYTE)],
        LUT[page + ((packed >> _BLUE) & _BYTE)],
        LUT[packed >> _ALPHA],
    )
