"""Project: world positions to fixed-point screen positions and reversed depth.

A projected vertex is 16 bytes, so that one cache line gives a whole one: x, y (int32, 8 fraction bits, pixels from the window's top left
corner), depth and weight (float32, kept in the same (n, 4) int32 array through a view). Depth is z / w of `Camera.clip_from_world`: 1 at
the near plane, falling to 0; weight is 1 / w (1 for orthographic cameras), what attributes are divided by to be perspective-correct.

Arithmetic is float64 without contraction, so that the bits are the same on every machine; the matrix is applied to the float32 positions
with no rounding between, which keeps scenes far from the origin steady.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import floor
from luxel.memory import reusable
from luxel.raster.constants import (
    GUARD_HIGH,
    GUARD_LOW,
    OUT_BOTTOM,
    OUT_FAR,
    OUT_LEFT,
    OUT_NAN,
    OUT_NEAR,
    OUT_RIGHT,
    OUT_TOP,
    SAFE_HIGH,
    SAFE_LOW,
    SUBPIXEL_LOG2,
    UNSAFE,
)

_CHUNK = 16384
_ALL = np.empty(0, np.uint8)
BLOCK = 256
"""Vertices that are projected together."""


class Window(NamedTuple):
    """The part of a picture that is drawn: x, y, width, height in pixels of the picture, whose size is full_width x full_height."""

    x: int
    y: int
    width: int
    height: int
    full_width: int
    full_height: int

    def guard(self) -> Array:
        """(4,) float64: normalised device coordinates at which triangles are clipped: left, right, bottom, top; a pixel within the guard band."""
        low, high = (GUARD_LOW >> SUBPIXEL_LOG2) + 1, (GUARD_HIGH >> SUBPIXEL_LOG2) - 1
        x = (np.array([low, high]) + self.x) / self.full_width * 2 - 1
        y = 1 - (np.array([high, low]) + self.y) / self.full_height * 2
        return np.concatenate([x, y])


class View(NamedTuple):
    """What project needs of a camera: clip_from_world (4, 4) float64, and the depth of the far plane (0: none, or orthographic)."""

    clip_from_world: Array
    least_depth: float


@jit.device
def out_code(x, y, z, w, least_depth):
    """Bits of the planes of the view that the clip-space point is outside of."""
    code = 0
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z) and math.isfinite(w)):
        return OUT_NAN
    if z > w:
        code |= OUT_NEAR
    if z < least_depth * w:
        code |= OUT_FAR
    if x < -w:
        code |= OUT_LEFT
    if x > w:
        code |= OUT_RIGHT
    if y > w:
        code |= OUT_TOP
    if y < -w:
        code |= OUT_BOTTOM
    return code


@jit.device
def to_fixed(ndc, offset, size, origin):
    """Normalised device coordinate (as -1..1 over `size` pixels) to fixed point, rounded to nearest, from pixel `origin`; float64."""
    return math.floor((ndc * 0.5 + offset) * size * 256.0 + 0.5) - origin * 256.0


@jit.inlined
def place(m, x, y, z, half_w, half_h, left, top):
    """Of a world position: fixed-point x and y from the window's (left, top), depth and weight; all float64. `m` has the 16 numbers of
    clip_from_world, `half_w` and `half_h` are half the picture's size in fixed point."""
    iw = 1.0 / (m[12] * x + m[13] * y + m[14] * z + m[15])
    return (
        floor((m[0] * x + m[1] * y + m[2] * z + m[3]) * iw * half_w + half_w + 0.5) - left,
        floor(half_h - (m[4] * x + m[5] * y + m[6] * z + m[7]) * iw * half_h + 0.5) - top,
        (m[8] * x + m[9] * y + m[10] * z + m[11]) * iw,
        iw,
    )


@jit.inlined
def is_unsafe(x, y, depth, weight, least_depth):
    """1 if what `place` gave is beyond the near or far plane or the guard band, else 0. Every comparison is false for a NaN, which is unsafe."""
    flag = 0 if weight > 0.0 else 1
    flag |= 0 if depth <= 1.0 else 1
    flag |= 0 if depth >= least_depth else 1
    flag |= 0 if x >= SAFE_LOW else 1
    flag |= 0 if x <= SAFE_HIGH else 1
    flag |= 0 if y >= SAFE_LOW else 1
    flag |= 0 if y <= SAFE_HIGH else 1
    return flag


@jit.inlined
def why_unsafe(m, x, y, z, least_depth):
    """`out_code` of a world position."""
    return out_code(
        m[0] * x + m[1] * y + m[2] * z + m[3], m[4] * x + m[5] * y + m[6] * z + m[7], m[8] * x + m[9] * y + m[10] * z + m[11],
        m[12] * x + m[13] * y + m[14] * z + m[15], least_depth,
    )  # fmt: skip


@jit.parallel_kernel
def _project(queue, positions, m, least_depth, window, wanted, screen, screen_f, unsafe):
    n = len(positions)
    wx, wy = np.float64(window[0]) * 256.0, np.float64(window[1]) * 256.0
    half_w, half_h = np.float64(window[4]) * 128.0, np.float64(window[5]) * 128.0
    rows = (
        m[0, 0], m[0, 1], m[0, 2], m[0, 3], m[1, 0], m[1, 1], m[1, 2], m[1, 3],
        m[2, 0], m[2, 1], m[2, 2], m[2, 3], m[3, 0], m[3, 1], m[3, 2], m[3, 3],
    )  # fmt: skip
    # Blocks of planar arrays and one short loop a step, so that the arithmetic runs in vector registers: five times as fast.
    px, py, pz = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    fx, fy, fd, fw = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    wrong = np.empty(BLOCK, np.int64)
    chunk = jit.take(queue)
    while chunk * _CHUNK < n:
        bad = 0
        for start in range(chunk * _CHUNK, min(n, (chunk + 1) * _CHUNK), BLOCK):
            if len(wanted) > 0 and wanted[start // BLOCK] == 0:
                continue
            count = min(BLOCK, n - start)
            for i in range(count):
                px[i], py[i], pz[i] = positions[start + i, 0], positions[start + i, 1], positions[start + i, 2]
            for i in range(count):
                x, y, z = np.float64(px[i]), np.float64(py[i]), np.float64(pz[i])
                fx[i], fy[i], fd[i], fw[i] = place(rows, x, y, z, half_w, half_h, wx, wy)
            any_wrong = 0
            for i in range(count):
                flag = is_unsafe(fx[i], fy[i], fd[i], fw[i], least_depth)
                wrong[i] = flag
                any_wrong |= flag
            if any_wrong:
                for i in range(count):
                    if wrong[i]:
                        bad += 1
                        x, y, z = np.float64(px[i]), np.float64(py[i]), np.float64(pz[i])
                        fx[i] = UNSAFE
                        fy[i] = why_unsafe(rows, x, y, z, least_depth)
                        fd[i] = fw[i] = 0.0
            for i in range(count):
                screen[start + i, 0] = np.int32(fx[i])
                screen[start + i, 1] = np.int32(fy[i])
                screen_f[start + i, 2] = np.float32(fd[i])
                screen_f[start + i, 3] = np.float32(fw[i])
        unsafe[chunk] = bad
        chunk = jit.take(queue)


def project(positions: Array, view: View, window: Window, threads: int, wanted: Array = _ALL) -> tuple[Array, int]:
    """Project (n, 3) float32 positions; returns (screen (n, 4) int32, how many vertices are unsafe and need clipping).

    `wanted`: (blocks of BLOCK vertices,) uint8, 0 for those that are left out, whose rows are undefined; without rows: all are projected.
    """
    n = len(positions)
    screen = reusable((n, 4), np.int32)
    unsafe = np.zeros(n // _CHUNK + 1, np.int64)
    jit.run(
        _project, min(threads, len(unsafe)), positions, view.clip_from_world, view.least_depth,
        np.array(window, np.int64), wanted, screen, screen.view(np.float32), unsafe,
    )  # fmt: skip
    return screen, int(unsafe.sum())
