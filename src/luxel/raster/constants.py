"""Numbers that every stage of the rasteriser shares; those of fixed-point positions are from `luxel.fixed`."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.fixed import GUARD_HIGH, GUARD_LOW, SUBPIXEL
from luxel.fixed import MAX_SIZE as MAX_SIZE
from luxel.fixed import SUBPIXEL_LOG2 as SUBPIXEL_LOG2

SAFE_LOW, SAFE_HIGH = GUARD_LOW + 2 * SUBPIXEL, GUARD_HIGH - 2 * SUBPIXEL
"""Vertices between these need no clipping. They lie within the planes at which triangles are cut (`Window.guard`, a pixel further out), so no
edge between two of them is ever cut, whatever the third corners of the two triangles at it are: neighbours agree."""

UNSAFE = -(1 << 31)
"""Stands for the x of a vertex that has no place on the screen: behind the near plane, at or beyond the guard band's end, or not finite."""

# Why a vertex is unsafe, kept in place of its y: a triangle whose three vertices share a bit lies outside.
OUT_NEAR, OUT_FAR, OUT_LEFT, OUT_RIGHT, OUT_TOP, OUT_BOTTOM, OUT_NAN = (1 << i for i in range(7))

NOTHING = -1
"""The triangle id of a sample that no triangle covers."""

# Standard sample positions in 1/16 pixel (Direct3D 11.3, Vulkan); "grid" is the 2x2 grid of the anti-aliasing paper.
_PATTERNS: dict[tuple[str, int], list[tuple[int, int]]] = {
    ("standard", 1): [(8, 8)],
    ("standard", 2): [(12, 12), (4, 4)],
    ("standard", 4): [(6, 2), (14, 6), (2, 10), (10, 14)],
    ("standard", 8): [(9, 5), (7, 11), (13, 9), (5, 3), (3, 13), (1, 7), (11, 15), (15, 1)],
    ("standard", 16): [
        (9, 9), (7, 5), (5, 10), (12, 7), (3, 6), (10, 13), (13, 11), (11, 3),
        (6, 14), (8, 1), (4, 2), (2, 12), (0, 8), (15, 4), (14, 15), (1, 0),
    ],
    ("grid", 4): [(4, 4), (12, 4), (4, 12), (12, 12)],
}  # fmt: skip

SAMPLE_COUNTS = (1, 2, 4, 8, 16)


def sample_pattern(samples: int, pattern: str = "standard") -> Array:
    """(samples, 2) int32: x and y of each sample in 1/256 pixel from the pixel's top left corner.

    Raises:
        InputError: No such pattern.
    """
    from luxel.errors import InputError

    key = ("standard", 1) if samples == 1 else (pattern, samples)
    if key not in list(_PATTERNS):
        known = ", ".join(f"{name} {count}" for name, count in _PATTERNS)
        raise InputError(f"samples: expected one of {known}; got {pattern} {samples}")
    return np.array(_PATTERNS[key], np.int32) * (SUBPIXEL // 16)
