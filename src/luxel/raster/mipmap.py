"""Textures as pools of texels with their mipmaps.

Level l + 1 is made from level l by a box filter that is exact for every size: along an odd length of 2 k + 1 texels, each of the k new
texels covers 2 + 1 / k old ones, taken in three taps whose weights change along the row (polyphase), so that every old texel counts
the same and means are kept. Averages are of linear light, and of colours weighted by alpha where a material uses the alpha; each
level is rounded to 8 bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.jit import inlined, kernel
from luxel.raster.encode import srgb_code, srgb_to_linear, unit_code
from luxel.scene.material import Texture
from luxel.scene.scene import Scene

# Columns of `TexturePool.textures`.
WIDTH, HEIGHT, LEVELS, WRAP_U, WRAP_V, FILTER, SRGB, WIDE = range(8)
REPEAT, CLAMP, MIRROR = range(3)
NEAREST, BILINEAR, TRILINEAR = range(3)
_WRAPS = {"repeat": REPEAT, "clamp": CLAMP, "mirror": MIRROR}
_FILTERS = {"nearest": NEAREST, "bilinear": BILINEAR, "trilinear": TRILINEAR}
MAX_LEVELS = 32

_CODES = np.arange(256) / 255.0
LUT = np.concatenate([_CODES, srgb_to_linear(_CODES)]).astype(np.float32)  # what a byte means: of data, then of sRGB

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_UNSEEN = np.float32(1e-6)  # what a fully transparent texel's colour counts, so that it is kept where all are transparent
_BYTE, _GREEN, _BLUE, _ALPHA = np.uint32(255), np.uint32(8), np.uint32(16), np.uint32(24)


class TexturePool(NamedTuple):
    """All textures of a scene.

    Attributes:
        textures: (t, 8) int32: width, height, levels, wrap along u and v, filter, sRGB or not, in which pool.
        levels: (t, MAX_LEVELS) int64: the first texel of each level in its pool.
        texels: (p,) uint32: R, G, B, A from the lowest byte up.
        radiance: (q, 4) float32: linear RGBA of float textures.
    """

    textures: Array
    levels: Array
    texels: Array
    radiance: Array


def pack_textures(scene: Scene) -> TexturePool:
    """Gather the textures that the scene's materials name, and make the mipmaps of those that are sampled trilinearly."""
    used, weighted = _uses(scene)
    textures = np.zeros((len(scene.textures), 8), np.int32)
    levels = np.zeros((len(scene.textures), MAX_LEVELS), np.int64)
    sizes = [0, 0]
    for i in sorted(used):
        texture = scene.textures[i]
        height, width, channels = texture.image.shape
        count = max(width, height).bit_length() if texture.filter == "trilinear" else 1
        wide = int(texture.image.dtype != np.uint8)
        wraps = [_WRAPS[wrap] for wrap in texture.wrap]
        textures[i] = width, height, count, *wraps, _FILTERS[texture.filter], texture.srgb and channels != 2, wide
        for level in range(count):
            levels[i, level] = sizes[wide]
            sizes[wide] += max(1, width >> level) * max(1, height >> level)
    pool = TexturePool(textures, levels, np.empty(sizes[0], np.uint32), np.empty((sizes[1], 4), np.float32))
    for i in used:
        _fill(pool, i, scene.textures[i], i in weighted)
    return pool


def _uses(scene: Scene) -> tuple[set[int], set[int]]:
    """The textures that materials name, and those whose alpha is opacity."""
    used, weighted = set(), set()
    for material in scene.materials:
        for name, ref in vars(material).items():
            if name.endswith("_texture") and ref is not None:
                used.add(ref.texture)
        if material.alpha_mode != "OPAQUE" and material.base_color_texture is not None:
            weighted.add(material.base_color_texture.texture)
    return used, weighted


def _fill(pool: TexturePool, i: int, texture: Texture, weighted: bool) -> None:
    if pool.textures[i, WIDE]:
        _fill_wide(pool, i, texture.image, weighted)
        return
    height, width, channels = texture.image.shape
    starts = pool.levels[i]
    store(texture.image.reshape(-1), channels, pool.texels[starts[0] : starts[0] + width * height])
    for k in range(1, pool.textures[i, LEVELS]):
        shrink(pool.texels, starts[k - 1], starts[k], width, _taps(width), _taps(height), int(pool.textures[i, SRGB]), weighted)
        width, height = max(1, width // 2), max(1, height // 2)


def _fill_wide(pool: TexturePool, i: int, image: Array, weighted: bool) -> None:
    level = expand(image)
    for k in range(pool.textures[i, LEVELS]):
        level = halve(level, weighted) if k else level
        height, width = level.shape[:2]
        pool.radiance[pool.levels[i, k] : pool.levels[i, k] + height * width] = level.reshape(-1, 4)


def expand(image: Array) -> Array:
    """(h, w, 4) float32 from (h, w, 1..4): grey is spread to RGB, missing alpha is 1."""
    height, width, channels = image.shape
    result = np.ones((height, width, 4), np.float32)
    result[..., :3] = image[..., :1] if channels < 3 else image[..., :3]
    if channels in (2, 4):
        result[..., 3] = image[..., -1]
    return result


def halve(level: Array, weighted: bool = False) -> Array:
    """The next mipmap level (h', w', 4) of linear RGBA (h, w, 4); `weighted`: colours count as much as their alpha."""
    if weighted:
        weight = level[..., 3:] + _UNSEEN
        mean = halve(np.concatenate([level[..., :3] * weight, weight], 2))
        return np.concatenate([mean[..., :3] / mean[..., 3:], mean[..., 3:] - _UNSEEN], 2)
    for axis in (0, 1):
        lines = np.moveaxis(level, axis, 0)
        weights = _taps(len(lines))
        halved = weights[:, 0, None, None] * lines[::2][: len(weights)]
        for tap in range(1, weights.shape[1]):
            halved += weights[:, tap, None, None] * lines[tap::2][: len(weights)]
        level = np.moveaxis(halved, 0, axis)
    return np.ascontiguousarray(level, np.float32)


def _taps(n: int) -> Array:
    """(k, 1..3) float32: the weights that texel i of the next level, of k, gives to the texels from 2 i on of a row of n."""
    if n == 1:
        return np.ones((1, 1), np.float32)
    k = n // 2
    i = np.arange(k)
    weights = np.stack([k - i, np.full(k, k), i + 1], 1) / n if n % 2 else np.full((k, 2), 0.5)
    return weights.astype(np.float32)


@kernel
def store(image: Array, channels: int, texels: Array) -> None:
    """Pack an 8-bit picture, (texels * channels,) uint8."""
    for i in range(len(texels)):
        at = i * channels
        red, alpha = np.uint32(image[at]), _BYTE
        green, blue = red, red
        if channels > 2:
            green, blue = np.uint32(image[at + 1]), np.uint32(image[at + 2])
        if channels == 2 or channels == 4:
            alpha = np.uint32(image[at + channels - 1])
        texels[i] = red | (green << _GREEN) | (blue << _BLUE) | (alpha << _ALPHA)


@kernel
def shrink(texels: Array, source: int, target: int, width: int, across: Array, down: Array, srgb: int, weighted: bool) -> None:
    """Make the level at `target` from the level at `source`, whose rows are `width` long, with the weights of `_taps`."""
    page = np.uint32(srgb * 256)
    for y in range(len(down)):
        for x in range(len(across)):
            red, green, blue, alpha, whole = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
            for j in range(down.shape[1]):
                for i in range(across.shape[1]):
                    packed = texels[source + (2 * y + j) * width + 2 * x + i]
                    share = down[y, j] * across[x, i]
                    opacity = LUT[packed >> _ALPHA]
                    alpha += share * opacity
                    share *= opacity + _UNSEEN if weighted else _ONE
                    whole += share
                    red += share * LUT[page + (packed & _BYTE)]
                    green += share * LUT[page + ((packed >> _GREEN) & _BYTE)]
                    blue += share * LUT[page + ((packed >> _BLUE) & _BYTE)]
            scale = _ONE / whole
            texels[target + y * len(across) + x] = pack(red * scale, green * scale, blue * scale, alpha, srgb)


@inlined
def pack(red: np.float32, green: np.float32, blue: np.float32, alpha: np.float32, srgb: int) -> np.uint32:
    """8-bit texel of linear RGBA."""
    if srgb:
        r, g, b = srgb_code(red), srgb_code(green), srgb_code(blue)
    else:
        r, g, b = unit_code(red), unit_code(green), unit_code(blue)
    return np.uint32(r) | (np.uint32(g) << _GREEN) | (np.uint32(b) << _BLUE) | (np.uint32(unit_code(alpha)) << _ALPHA)
