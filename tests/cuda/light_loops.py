"""The grids of `luxel.cuda.light_kernels` as loops, over the same threads, compiled for the processor."""

from loops import again

from luxel import jit
from luxel.cuda.threads import light as light_source

_light = again(light_source.__name__)
_receive_element = _light.receive_element
_send_element = _light.send_element
_pass_on = _light.pass_on
_sum_changes = _light.sum_changes
_scatter = _light.scatter
_begin_group = _light.begin_group
_square = _light.square
_multiply = _light.multiply
_measure = _light.measure
_step = _light.step
_turn = _light.turn
_send_group = _light.send_group
_spread_group = _light.spread_group
_exchange_strip = _light.exchange_strip


@jit.kernel
def receive(n, _, still, factor, rows, touched, powers, direct):
    for i in range(n):
        _receive_element(i, still, factor, rows, touched, powers, direct)


@jit.kernel
def send(n, _, luxel, albedo, received, light):
    for i in range(n):
        _send_element(i, luxel, albedo, received, light)


@jit.kernel
def pass_on(n, _, hits, light, known, received, change):
    for i in range(n):
        _pass_on(i, hits, light, known, received, change)


@jit.kernel
def sum_changes(n, _, received, change, totals):
    for i in range(n):
        _sum_changes(i, received, change, totals)


@jit.kernel
def scatter(n, _, luxel, front, received, result):
    for i in range(n):
        _scatter(i, luxel, front, received, result)


@jit.kernel
def begin_groups(n, _, area, luxel, albedo, direct, shining, groups):
    for i in range(n):
        _begin_group(i, area, luxel, albedo, direct, shining, groups)


@jit.kernel
def square(n, _, which, groups):
    for i in range(n):
        _square(i, which, groups)


@jit.kernel
def multiply(n, _, groups):
    for i in range(n):
        _multiply(i, groups)


@jit.kernel
def measure(n, _, groups):
    for i in range(n):
        _measure(i, groups)


@jit.kernel
def step(n, _, before, enough, groups):
    for i in range(n):
        _step(i, before, enough, groups)


@jit.kernel
def turn(n, _, before, enough, groups):
    for i in range(n):
        _turn(i, before, enough, groups)


@jit.kernel
def send_groups(n, _, groups):
    for i in range(n):
        _send_group(i, groups)


@jit.kernel
def spread_groups(n, _, direct, groups, received):
    for i in range(n):
        _spread_group(i, direct, groups, received)


@jit.kernel
def exchange(n, strips, groups):
    for strip in range(strips):
        for i in range(n):
            _exchange_strip(i, strip, groups)
