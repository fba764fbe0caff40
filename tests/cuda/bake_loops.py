"""The grids of `luxel.cuda.bake_kernels` as loops, over the same threads, compiled for the processor."""

import numpy as np
from loops import again, loops

from luxel import jit
from luxel.cuda import bake_kernels

globals().update(loops(bake_kernels.__name__, *bake_kernels.bodies(again)))
_look, _shoot = again("luxel.cuda.threads.look"), again("luxel.cuda.threads.shoot")
_look_along, _sky_light, _closer_light = _look.look, _look.sky_light, _look.closer_light
_draw_triangle, _fill_entry = _shoot.draw_triangle, _shoot.fill_entry
_SCRATCH, _STACK, _CUT, _SPARE = _look.SCRATCH, _look.STACK, _shoot.MOST + 1, 2 * _shoot.MOST
_ROW, _DEEPEST = _shoot.SCRATCH, _shoot.DEEPEST


@jit.kernel
def look(n, m, given):
    c, stack = np.empty(_SCRATCH, np.float32), np.empty(_STACK, np.int32)
    for j in range(m):
        for i in range(n):
            _look_along(i, j, *given, c, stack)


@jit.kernel
def sky_light(n, _, given):
    local, c, stack = np.empty(3), np.empty(_SCRATCH, np.float32), np.empty(_STACK, np.int32)
    for i in range(n):
        _sky_light(i, *given, local, c, stack)


@jit.kernel
def closer_light(n, _, given):
    local, c, stack = np.empty(3, np.float32), np.empty(_SCRATCH, np.float32), np.empty(_STACK, np.int32)
    sums = np.empty((1, 8), np.float32)
    for i in range(n):
        _closer_light(i, *given, local, sums, c, stack)


@jit.kernel
def draw_cubes(n, m, given):
    p, q = np.empty((_CUT, 7)), np.empty((_SPARE, 7))
    for j in range(m):
        for i in range(n):
            _draw_triangle(i, j, *given, p, q)


@jit.kernel
def fill_rows(n, m, given):
    c, stack, corners = np.empty(_ROW, np.float32), np.empty(_DEEPEST, np.int32), np.empty((4, 3))
    for j in range(m):
        for i in range(n):
            _fill_entry(i, j, *given, c, stack, corners)
