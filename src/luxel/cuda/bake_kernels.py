"""The grids of `luxel.cuda.threads.look`, `shoot` and `settle`: one thread a ray, an element, a pixel, an entry of a row, or a share of a sum."""

from __future__ import annotations

import numpy as np

from luxel.cuda.door import cuda, kernel
from luxel.cuda.primitives import again
from luxel.cuda.threads import look as look_source
from luxel.cuda.threads import settle as settle_source
from luxel.cuda.threads import shoot as shoot_source

_look, _settle, _shoot = (again(module.__name__) for module in (look_source, settle_source, shoot_source))
_look_along = _look.look
_count_away = _look.count_away
_gather_mean = _look.gather_mean
_find_cells = _look.find_cells
_sky_light = _look.sky_light
_shine = _look.shine
_draw_triangle = _shoot.draw_triangle
_read_pixel = _shoot.read_pixel
_find_escape = _shoot.find_escape
_fill_entry = _shoot.fill_entry
_sum_block = _shoot.sum_block
_receive = _shoot.receive
_send = _settle.send
_share_sent = _settle.share_sent
_add_up = _settle.add_up
_find_scale = _settle.find_scale
_take_in = _settle.take_in
_note_direct = _settle.note_direct
_forget = _settle.forget
_take_stock = _settle.take_stock
_share_stock = _settle.share_stock
_SCRATCH, _STACK, _CUT, _SPARE = _look.SCRATCH, _look.STACK, _shoot.MOST + 1, 2 * _shoot.MOST
_ROW, _DEEPEST = _shoot.SCRATCH, _shoot.DEEPEST


@kernel
def look(n, m, eyes, first, first_ray, directions, hits):
    """`threads.look.look`."""
    i, j = cuda.grid(2)
    c, stack = cuda.local.array(_SCRATCH, np.float32), cuda.local.array(_STACK, np.int32)
    if i < n and j < m:
        _look_along(i, j, eyes, first, first_ray, directions, hits, c, stack)


@kernel
def count_away(n, _, numbers, hits, away):
    """`threads.look.count_away`."""
    i, _ = cuda.grid(2)
    if i < n:
        _count_away(i, numbers, hits, away)


@kernel
def gather_mean(n, _, first, hits, light, result):
    """`threads.look.gather_mean`."""
    i, _ = cuda.grid(2)
    if i < n:
        _gather_mean(i, first, hits, light, result)


@kernel
def find_cells(n, _, hits, sky):
    """`threads.look.find_cells`."""
    i, _ = cuda.grid(2)
    if i < n:
        _find_cells(i, hits, sky)


@kernel
def sky_light(n, _, eyes, sky, result):
    """`threads.look.sky_light`."""
    i, _ = cuda.grid(2)
    local, c, stack = cuda.local.array(3, np.float64), cuda.local.array(_SCRATCH, np.float32), cuda.local.array(_STACK, np.int32)
    if i < n:
        _sky_light(i, eyes, sky, result, local, c, stack)


@kernel
def shine(n, _, scene, numbers, table, at, reach, result):
    """`threads.look.shine`."""
    i, _ = cuda.grid(2)
    if i < n:
        _shine(i, scene, numbers, table, at, reach, result)


@kernel
def draw_cubes(n, m, lanes, cubes):
    """`threads.shoot.draw_triangle`."""
    i, j = cuda.grid(2)
    p, q = cuda.local.array((_CUT, 7), np.float64), cuda.local.array((_SPARE, 7), np.float64)
    if i < n and j < m:
        _draw_triangle(i, j, lanes, cubes, p, q)


@kernel
def read_cubes(n, m, cubes):
    """`threads.shoot.read_pixel`."""
    i, j = cuda.grid(2)
    if i < n and j < m:
        _read_pixel(i, j, cubes)


@kernel
def find_escapes(n, m, cubes, deltas, escapes):
    """`threads.shoot.find_escape`."""
    i, j = cuda.grid(2)
    if i < n and j < m:
        _find_escape(i, j, cubes, deltas, escapes)


@kernel
def fill_rows(n, m, receivers, shots, cubes, rows):
    """`threads.shoot.fill_entry`."""
    i, j = cuda.grid(2)
    c, stack, corners = cuda.local.array(_ROW, np.float32), cuda.local.array(_DEEPEST, np.int32), cuda.local.array((4, 3), np.float64)
    if i < n and j < m:
        _fill_entry(i, j, receivers, shots, cubes, rows, c, stack, corners)


@kernel
def sum_rows(n, m, numbers, slots, rows, sums):
    """`threads.shoot.sum_block`."""
    i, j = cuda.grid(2)
    if i < n and j < m:
        _sum_block(i, j, numbers, slots, rows, sums)


@kernel
def receive_rows(n, _, slots, rows, touched, powers, gained):
    """`threads.shoot.receive`."""
    i, _ = cuda.grid(2)
    if i < n:
        _receive(i, slots, rows, touched, powers, gained)


@kernel
def send_unshot(n, _, unshot, sent):
    """`threads.settle.send`."""
    i, _ = cuda.grid(2)
    if i < n:
        _send(i, unshot, sent)


@kernel
def share_sent(n, _, numbers, away, sent, gained, shares):
    """`threads.settle.share_sent`."""
    i, _ = cuda.grid(2)
    if i < n:
        _share_sent(i, numbers, away, sent, gained, shares)


@kernel
def add_up(n, m, first, shares, sums):
    """`threads.settle.add_up`."""
    i, j = cuda.grid(2)
    if i < n and j < m:
        _add_up(i, first + j, shares, sums)


@kernel
def find_scale(n, _, sums, scale):
    """`threads.settle.find_scale`."""
    i, _ = cuda.grid(2)
    if i < n:
        _find_scale(i, sums, scale)


@kernel
def take_in(n, _, albedo, scale, keeps, gained, received, unshot, new_received, new_unshot):
    """`threads.settle.take_in`."""
    i, _ = cuda.grid(2)
    if i < n:
        _take_in(i, albedo, scale, keeps, gained, received, unshot, new_received, new_unshot)


@kernel
def note_direct(n, _, gained, direct):
    """`threads.settle.note_direct`."""
    i, _ = cuda.grid(2)
    if i < n:
        _note_direct(i, gained, direct)


@kernel
def forget(n, _, chosen, starts, albedo, gained, unshot):
    """`threads.settle.forget`."""
    i, _ = cuda.grid(2)
    if i < n:
        _forget(i, chosen, starts, albedo, gained, unshot)


@kernel
def take_stock(n, m, numbers, starts, albedo, gained, unshot, power, absorbed):
    """`threads.settle.take_stock`."""
    i, j = cuda.grid(2)
    if i < n and j < m:
        _take_stock(i, j, numbers, starts, albedo, gained, unshot, power, absorbed)


@kernel
def share_stock(n, _, power, absorbed, received, unshot, shares):
    """`threads.settle.share_stock`."""
    i, _ = cuda.grid(2)
    if i < n:
        _share_stock(i, power, absorbed, received, unshot, shares)
