"""Pictures made by NumPy: wood, cloth, a rug, a painting, a sky, a leaf; what is meant to repeat has no seam."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array


def noise(size: tuple[int, int], cells: tuple[int, int], seed: int, octaves: int = 4) -> Array:
    """(h, w) in 0..1: smooth random values on a lattice of `cells` (down, across), finer ones added; it repeats."""
    rng = np.random.default_rng(seed)
    total = np.zeros(size)
    for octave in range(octaves):
        down, across = cells[0] << octave, cells[1] << octave
        lattice = rng.random((down, across))
        total += _stretched(_stretched(lattice, size[0]).T, size[1]).T * 0.5**octave
    low, high = total.min(), total.max()
    return (total - low) / (high - low)


def _stretched(lattice: Array, length: int) -> Array:
    """Rows of a lattice that repeats, to `length` rows, eased between (smoothstep)."""
    at = np.arange(length) * len(lattice) / length
    i = at.astype(int)
    t = (at - i)[:, None]
    ease = t * t * (3 - 2 * t)
    return lattice[i] * (1 - ease) + lattice[(i + 1) % len(lattice)] * ease


def ramp(value: Array, *stops: tuple[float, tuple[int, int, int]]) -> Array:
    """(h, w, 3) uint8: a value to sRGB bytes by straight lines between (value, colour) stops."""
    at = [stop for stop, _ in stops]
    channels = [np.interp(value, at, [color[k] for _, color in stops]) for k in range(3)]
    return np.round(np.stack(channels, -1)).astype(np.uint8)


def wood(
    size: int = 256,
    seed: int = 1,
    dark: tuple[int, int, int] = (92, 58, 34),
    light: tuple[int, int, int] = (158, 110, 70),
) -> Array:
    """Grain along u."""
    bent = noise((size, size), (3, 1), seed, 3)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (6 * bent + 3 * np.arange(size)[:, None] / size))
    fibre = noise((size, size), (64, 2), seed + 1, 2)
    return ramp(0.6 * rings + 0.4 * fibre, (0, dark), (1, light))


def planks(size: int = 512, rows: int = 6, seed: int = 3) -> tuple[Array, Array]:
    """A parquet of long boards along u: colour, and height 0..1 with the joints low."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:size, 0:size] / size
    row = np.floor(y * rows).astype(int)
    start = rng.random(rows)[row]
    along = (x + start) % 1 * 2  # two boards a row
    board = row * 2 + along.astype(int)
    tone = rng.uniform(0.25, 0.75, 2 * rows)[board]
    shift = rng.integers(0, size, 2 * rows)[board]
    grain = noise((size, size), (32, 2), seed + 1, 3)
    fibre = noise((size, size), (128, 4), seed + 2, 2)
    column = (np.arange(size)[None, :] + shift) % size
    line = (np.arange(size)[:, None] + shift) % size
    value = tone + 0.45 * (grain[line, column] - 0.5) + 0.2 * (fibre[line, column] - 0.5)
    joint = np.minimum(np.abs(y * rows - np.round(y * rows)) / rows, np.abs(along - np.round(along)) / 2)
    groove = np.clip(joint * size / 1.5, 0, 1)
    color = ramp(value, (0, (98, 58, 32)), (0.5, (158, 104, 60)), (1, (204, 150, 96)))
    return np.round(color * (0.45 + 0.55 * groove[..., None])).astype(np.uint8), groove


def weave(size: int = 128, threads: int = 16) -> Array:
    """(h, w) height 0..1 of a plain weave: warp and weft pass over each other by turns."""
    y, x = np.mgrid[0:size, 0:size] * threads / size
    over = (np.floor(x) + np.floor(y)) % 2 == 0
    warp, weft = np.abs(np.sin(np.pi * x)), np.abs(np.sin(np.pi * y))
    arch_x, arch_y = np.sin(np.pi * (x % 1)), np.sin(np.pi * (y % 1))
    return np.where(over, warp * (0.6 + 0.4 * arch_y), weft * (0.6 + 0.4 * arch_x))


def cloth(height: Array, color: tuple[int, int, int], seed: int = 5) -> Array:
    """(h, w, 3) uint8: a woven cloth of one colour, its threads not all alike."""
    size = (len(height), len(height))
    value = 0.7 + 0.22 * height + 0.12 * (noise(size, (16, 16), seed, 2) - 0.5)
    return np.round(np.clip(value[..., None] * np.array(color), 0, 255)).astype(np.uint8)


def checks(size: int, colors: tuple[tuple[int, int, int], tuple[int, int, int]], cells: int = 6) -> Array:
    """(h, w, 3) uint8: a gingham of `cells` squares a side, mixed where the stripes cross."""
    y, x = np.mgrid[0:size, 0:size] * cells // size
    share = ((x % 2) + (y % 2)) / 2
    return ramp(share, (0, colors[0]), (1, colors[1]))


def stripes(width: int = 32, height: int = 256) -> Array:
    """(h, w, 3) uint8: linen with two bands of colour near the hem (v = 1)."""
    v = ((np.arange(height) + 0.5) / height)[:, None, None]
    picture = np.where((v > 0.86) & (v < 0.93), (186, 104, 74), np.where((v > 0.8) & (v < 0.82), (208, 160, 80), (236, 227, 208)))
    return np.round(picture * (0.93 + 0.07 * noise((height, width), (128, 16), 14, 1)[..., None])).astype(np.uint8)


def normal_map(height: Array, depth: float) -> Array:
    """(h, w, 3) uint8: tangent-space normals of a height field that repeats; `depth` in texels for a height of 1."""
    x = (np.roll(height, 1, 1) - np.roll(height, -1, 1)) * depth / 2
    y = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * depth / 2  # rows run down, the bitangent up
    n = np.stack([x, y, np.ones_like(x)], -1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return np.round(127.5 + 127.5 * n).astype(np.uint8)


def rug(width: int = 384, height: int = 256) -> Array:
    """(h, w, 3) uint8: a bordered rug with a field of diamonds."""
    y, x = np.mgrid[0:height, 0:width]
    inset = np.minimum(np.minimum(x, width - 1 - x), np.minimum(y, height - 1 - y)) / 16.0
    cream, ink, rust, sand = (226, 214, 192), (44, 62, 80), (164, 74, 52), (200, 160, 104)
    diamond = np.abs((x / 32 + 0.0) % 2 - 1) + np.abs((y / 32) % 2 - 1)
    picture = np.where(((diamond > 0.86) & (diamond < 1.14))[..., None], ink, cream)
    picture = np.where((diamond < 0.42)[..., None], rust, picture)
    picture = np.where((diamond < 0.2)[..., None], sand, picture)
    triangle = np.abs(((x + y) / 16) % 2 - 1) + np.abs(((x - y) / 16) % 2 - 1)
    border = np.where((triangle < 1.0)[..., None], sand, rust)
    for limit, color in ((3.0, ink), (2.7, border), (0.9, ink), (0.6, cream)):
        picture = np.where((inset < limit)[..., None], color, picture)
    knots = 0.86 + 0.14 * noise((height, width), (64, 96), 9, 1)
    return np.round(picture * knots[..., None]).astype(np.uint8)


def painting(width: int = 288, height: int = 192, seed: int = 11) -> Array:
    """(h, w, 3) uint8: hills behind hills under an evening sky."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width] / height
    sky = ((0, (70, 96, 132)), (0.45, (228, 178, 138)), (0.65, (244, 214, 160)))
    picture = ramp(y + 0.05 * (noise((height, width), (4, 3), seed, 3) - 0.5), *sky).astype(float)
    sun = np.clip(12 * (0.13 - np.hypot(x - 0.98, y - 0.36)), 0, 1)[..., None]
    picture = picture * (1 - sun) + sun * np.array([255, 236, 196])
    near, far = np.array([34, 56, 62]), np.array([196, 150, 132])
    for i, base in enumerate(np.linspace(0.5, 0.86, 5)):
        waves = sum(np.sin(x[0] * f + rng.uniform(0, 6)) / f for f in (2.1, 4.3, 9.7, 21.0))
        hill = np.clip((y - base + 0.11 * waves[None, :]) * height, 0, 1)[..., None]
        picture = picture * (1 - hill) + hill * (far + (near - far) * i / 4)
    brush = 0.92 + 0.08 * noise((height, width), (96, 24), seed + 1, 1)
    return np.round(np.clip(picture * brush[..., None], 0, 255)).astype(np.uint8)


def sky(width: int = 128, height: int = 128, seed: int = 21) -> Array:
    """(h, w, 3) uint8: a bright day with thin clouds over far trees."""
    y = np.mgrid[0:height, 0:width][0] / height
    clouds = np.clip(2.2 * noise((height, width), (4, 3), seed, 4) - 1.0, 0, 1)[..., None]
    picture = ramp(y, (0, (150, 190, 236)), (0.7, (222, 236, 248))).astype(float)
    picture += clouds * (250 - picture) * 0.8
    edge = 0.8 + 0.1 * (noise((1, width), (1, 8), seed + 1, 3) - 0.5)
    trees = np.clip((y - edge) * height / 2, 0, 1)[..., None]
    leaves = ramp(noise((height, width), (16, 16), seed + 2, 3), (0, (98, 128, 92)), (1, (170, 190, 140)))
    return np.round(picture * (1 - trees) + trees * leaves).astype(np.uint8)


def leaf(size: int = 96) -> Array:
    """(h, w, 4) uint8: a pointed leaf from the bottom (its stalk) to the top, with alpha."""
    y, x = np.mgrid[0:size, 0:size] / (size - 1)
    t, s = 1 - y, np.abs(x - 0.5) * 2
    outline = np.sin(np.pi * np.clip(t, 0, 1) ** 0.75) * 0.95
    alpha = np.clip((outline - s) * size / 3, 0, 1)
    vein = np.exp(-((s * 16) ** 2)) + 0.5 * np.exp(-(((((t * 9 - s * 3) % 1) - 0.5) * 9) ** 2))
    color = ramp(np.clip(0.35 + 0.35 * t + 0.3 * vein, 0, 1), (0, (30, 66, 34)), (0.6, (66, 122, 56)), (1, (150, 184, 104)))
    return np.concatenate([color, np.round(255 * alpha[..., None]).astype(np.uint8)], -1)


def corners(size: int = 64, reach: float = 0.14, floor: float = 0.55) -> Array:
    """(h, w) uint8 occlusion of one face of a room: darker towards its four edges."""
    t = (np.arange(size) + 0.5) / size
    edge = np.minimum(t, 1 - t)
    shade = 1 - (1 - floor) * np.exp(-edge / reach)
    return np.round(255 * shade[:, None] * shade[None, :] / shade.max() ** 2).astype(np.uint8)


def contact(size: tuple[int, int], extent: tuple[float, float], footprints: list[tuple[float, float, float, float, float]]) -> Array:
    """(h, w) uint8 occlusion of a floor under furniture.

    Args:
        size: Rows and columns.
        extent: Metres of the floor along x and z; row 0 is at the least z.
        footprints: x, z, width, depth and clearance of each piece, metres: the higher it stands, the fainter.
    """
    rows, columns = size
    z, x = np.mgrid[0:rows, 0:columns]
    x = ((x + 0.5) / columns - 0.5) * extent[0]
    z = ((z + 0.5) / rows - 0.5) * extent[1]
    light = np.ones(size)
    for cx, cz, width, depth, clearance in footprints:
        outside = np.hypot(np.maximum(np.abs(x - cx) - width / 2, 0), np.maximum(np.abs(z - cz) - depth / 2, 0))
        dark = 0.75 / (1 + 1.5 * clearance)
        light *= 1 - dark * np.exp(-((outside / (0.12 + 0.5 * clearance)) ** 1.2))
    return np.round(255 * light).astype(np.uint8)
