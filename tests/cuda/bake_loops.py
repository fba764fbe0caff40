"""The grids of `luxel.cuda.bake_kernels` as loops, over the same threads, compiled for the processor."""

import numpy as np
from loops import again

from luxel import jit
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


@jit.kernel
def look(n, m, eyes, first, first_ray, directions, hits):
    c, stack = np.empty(_SCRATCH, np.float32), np.empty(_STACK, np.int32)
    for j in range(m):
        for i in range(n):
            _look_along(i, j, eyes, first, first_ray, directions, hits, c, stack)


@jit.kernel
def count_away(n, _, numbers, hits, away):
    for i in range(n):
        _count_away(i, numbers, hits, away)


@jit.kernel
def gather_mean(n, _, first, hits, light, result):
    for i in range(n):
        _gather_mean(i, first, hits, light, result)


@jit.kernel
def find_cells(n, _, hits, sky):
    for i in range(n):
        _find_cells(i, hits, sky)


@jit.kernel
def sky_light(n, _, eyes, sky, result):
    local, c, stack = np.empty(3), np.empty(_SCRATCH, np.float32), np.empty(_STACK, np.int32)
    for i in range(n):
        _sky_light(i, eyes, sky, result, local, c, stack)


@jit.kernel
def shine(n, _, scene, numbers, table, at, reach, result):
    for i in range(n):
        _shine(i, scene, numbers, table, at, reach, result)


@jit.kernel
def draw_cubes(n, m, lanes, cubes):
    p, q = np.empty((_CUT, 7)), np.empty((_SPARE, 7))
    for j in range(m):
        for i in range(n):
            _draw_triangle(i, j, lanes, cubes, p, q)


@jit.kernel
def read_cubes(n, m, cubes):
    for j in range(m):
        for i in range(n):
            _read_pixel(i, j, cubes)


@jit.kernel
def find_escapes(n, m, cubes, deltas, escapes):
    for j in range(m):
        for i in range(n):
            _find_escape(i, j, cubes, deltas, escapes)


@jit.kernel
def fill_rows(n, m, receivers, shots, cubes, rows):
    c, stack, corners = np.empty(_ROW, np.float32), np.empty(_DEEPEST, np.int32), np.empty((4, 3))
    for j in range(m):
        for i in range(n):
            _fill_entry(i, j, receivers, shots, cubes, rows, c, stack, corners)


@jit.kernel
def sum_rows(n, m, numbers, slots, rows, sums):
    for j in range(m):
        for i in range(n):
            _sum_block(i, j, numbers, slots, rows, sums)


@jit.kernel
def receive_rows(n, _, slots, rows, touched, powers, gained):
    for i in range(n):
        _receive(i, slots, rows, touched, powers, gained)


@jit.kernel
def send_unshot(n, _, unshot, sent):
    for i in range(n):
        _send(i, unshot, sent)


@jit.kernel
def share_sent(n, _, numbers, away, sent, gained, shares):
    for i in range(n):
        _share_sent(i, numbers, away, sent, gained, shares)


@jit.kernel
def add_up(n, m, first, shares, sums):
    for j in range(m):
        for i in range(n):
            _add_up(i, first + j, shares, sums)


@jit.kernel
def find_scale(n, _, sums, scale):
    for i in range(n):
        _find_scale(i, sums, scale)


@jit.kernel
def take_in(n, _, albedo, scale, keeps, gained, received, unshot, new_received, new_unshot):
    for i in range(n):
        _take_in(i, albedo, scale, keeps, gained, received, unshot, new_received, new_unshot)


@jit.kernel
def note_direct(n, _, gained, direct):
    for i in range(n):
        _note_direct(i, gained, direct)


@jit.kernel
def forget(n, _, chosen, starts, albedo, gained, unshot):
    for i in range(n):
        _forget(i, chosen, starts, albedo, gained, unshot)


@jit.kernel
def take_stock(n, m, numbers, starts, albedo, gained, unshot, power, absorbed):
    for j in range(m):
        for i in range(n):
            _take_stock(i, j, numbers, starts, albedo, gained, unshot, power, absorbed)


@jit.kernel
def share_stock(n, _, power, absorbed, received, unshot, shares):
    for i in range(n):
        _share_stock(i, power, absorbed, received, unshot, shares)
