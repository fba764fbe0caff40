"""The grids of `luxel.cuda.threads.light`: one thread an element, a group, or a share of a sum; strips along the second axis."""

from __future__ import annotations

from luxel.cuda.door import cuda, kernel
from luxel.cuda.primitives import again
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


@kernel
def receive(n, _, still, factor, rows, touched, powers, direct):
    """`threads.light.receive_element`."""
    i, _ = cuda.grid(2)
    if i < n:
        _receive_element(i, still, factor, rows, touched, powers, direct)


@kernel
def send(n, _, luxel, albedo, received, light):
    """`threads.light.send_element`."""
    i, _ = cuda.grid(2)
    if i < n:
        _send_element(i, luxel, albedo, received, light)


@kernel
def pass_on(n, _, hits, light, known, received, change):
    """`threads.light.pass_on`."""
    i, _ = cuda.grid(2)
    if i < n:
        _pass_on(i, hits, light, known, received, change)


@kernel
def sum_changes(n, _, received, change, totals):
    """`threads.light.sum_changes`."""
    i, _ = cuda.grid(2)
    if i < n:
        _sum_changes(i, received, change, totals)


@kernel
def scatter(n, _, luxel, front, received, result):
    """`threads.light.scatter`."""
    i, _ = cuda.grid(2)
    if i < n:
        _scatter(i, luxel, front, received, result)


@kernel
def begin_groups(n, _, area, luxel, albedo, direct, shining, groups):
    """`threads.light.begin_group`."""
    i, _ = cuda.grid(2)
    if i < n:
        _begin_group(i, area, luxel, albedo, direct, shining, groups)


@kernel
def square(n, _, which, groups):
    """`threads.light.square`."""
    i, _ = cuda.grid(2)
    if i < n:
        _square(i, which, groups)


@kernel
def multiply(n, _, groups):
    """`threads.light.multiply`."""
    i, _ = cuda.grid(2)
    if i < n:
        _multiply(i, groups)


@kernel
def measure(n, _, groups):
    """`threads.light.measure`."""
    i, _ = cuda.grid(2)
    if i < n:
        _measure(i, groups)


@kernel
def step(n, _, before, enough, groups):
    """`threads.light.step`."""
    i, _ = cuda.grid(2)
    if i < n:
        _step(i, before, enough, groups)


@kernel
def turn(n, _, before, enough, groups):
    """`threads.light.turn`."""
    i, _ = cuda.grid(2)
    if i < n:
        _turn(i, before, enough, groups)


@kernel
def send_groups(n, _, groups):
    """`threads.light.send_group`."""
    i, _ = cuda.grid(2)
    if i < n:
        _send_group(i, groups)


@kernel
def spread_groups(n, _, direct, groups, received):
    """`threads.light.spread_group`."""
    i, _ = cuda.grid(2)
    if i < n:
        _spread_group(i, direct, groups, received)


@kernel
def exchange(n, strips, groups):
    """`threads.light.exchange_strip`."""
    i, strip = cuda.grid(2)
    if i < n and strip < strips:
        _exchange_strip(i, strip, groups)
