"""The grids of `luxel.cuda.threads.look`, `shoot`, `settle`, `choose` and `spots`: one thread a ray, an element, a pixel,
an entry of a row, or a share of a sum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from luxel.cuda.door import cuda, kernel
from luxel.cuda.grids import kernels
from luxel.cuda.primitives import again
from luxel.cuda.threads import choose as choose_source
from luxel.cuda.threads import light as light_source
from luxel.cuda.threads import look as look_source
from luxel.cuda.threads import settle as settle_source
from luxel.cuda.threads import shoot as shoot_source
from luxel.cuda.threads import spots as spots_source


def bodies(again: Callable[[str], Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a thread does in kernels that need no memory of their own: lines and grids, as `luxel.cuda.grids.kernels` has them."""
    sources = look_source, settle_source, shoot_source, choose_source, light_source, spots_source
    look, settle, shoot, choose, light, spots = (again(module.__name__) for module in sources)
    lines = {
        "count_away": look.count_away, "gather_mean": look.gather_mean, "find_cells": look.find_cells, "shine": look.shine,
        "find_again": look.find_again,
        "receive_rows": shoot.receive, "send_unshot": settle.send, "share_sent": settle.share_sent, "find_scale": settle.find_scale,
        "find_powers": spots.power_of, "hide_spots": spots.hide, "receive_spots": light.receive_element,
        "find_brightness": spots.brightness,
        "take_in": settle.take_in, "note_direct": settle.note_direct, "forget": settle.forget, "share_stock": settle.share_stock,
        "find_bright": choose.find_bright, "clear_winners": choose.clear_winner, "pick": choose.pick, "line_up": choose.line_up,
        "place_rows": choose.place_rows, "aim_shooters": choose.aim_shooter, "settle_rows": choose.settle_row, "sum_shots": choose.sum_shots,
    }  # fmt: skip
    grids = {
        "clear_cubes": shoot.clear_pixel, "read_cubes": shoot.read_pixel, "find_escapes": shoot.find_escape, "sum_rows": shoot.sum_block,
        "add_up": settle.add_up, "take_stock": settle.take_stock, "share_rows": choose.share_row,
    }  # fmt: skip
    return lines, grids


globals().update(kernels(__name__, *bodies(again)))  # each is an attribute of this module
_look, _shoot = again(look_source.__name__), again(shoot_source.__name__)
_look_along, _sky_light, _closer_light = _look.look, _look.sky_light, _look.closer_light
_draw_triangle, _fill_entry = _shoot.draw_triangle, _shoot.fill_entry
_SCRATCH, _STACK, _CUT, _SPARE = _look.SCRATCH, _look.STACK, _shoot.MOST + 1, 2 * _shoot.MOST
_ROW, _DEEPEST = _shoot.SCRATCH, _shoot.DEEPEST


@kernel
def look(n, m, given):
    """`threads.look.look`."""
    i, j = cuda.grid(2)
    c, stack = cuda.local.array(_SCRATCH, np.float32), cuda.local.array(_STACK, np.int32)
    if i < n and j < m:
        _look_along(i, j, *given, c, stack)


@kernel
def sky_light(n, _, given):
    """`threads.look.sky_light`."""
    i, _ = cuda.grid(2)
    local, c, stack = cuda.local.array(3, np.float64), cuda.local.array(_SCRATCH, np.float32), cuda.local.array(_STACK, np.int32)
    if i < n:
        _sky_light(i, *given, local, c, stack)


@kernel
def closer_light(n, _, given):
    """`threads.look.closer_light`."""
    i, _ = cuda.grid(2)
    local, c, stack = cuda.local.array(3, np.float32), cuda.local.array(_SCRATCH, np.float32), cuda.local.array(_STACK, np.int32)
    sums = cuda.local.array((1, 8), np.float32)
    if i < n:
        _closer_light(i, *given, local, sums, c, stack)


@kernel
def draw_cubes(n, m, given):
    """`threads.shoot.draw_triangle`."""
    i, j = cuda.grid(2)
    p, q = cuda.local.array((_CUT, 7), np.float64), cuda.local.array((_SPARE, 7), np.float64)
    if i < n and j < m:
        _draw_triangle(i, j, *given, p, q)


@kernel
def fill_rows(n, m, given):
    """`threads.shoot.fill_entry`."""
    i, j = cuda.grid(2)
    c, stack, corners = cuda.local.array(_ROW, np.float32), cuda.local.array(_DEEPEST, np.int32), cuda.local.array((4, 3), np.float64)
    if i < n and j < m:
        _fill_entry(i, j, *given, c, stack, corners)
