"""Fixed-point interpolators, clock by clock: what walks spans, what spreads as a wave, and what copies a template.

In a step every interpolator makes at most one addition and writes at most one pixel. Registers are two's complement of `bits` bits and wrap.
All kernels write to the same arrays, in pixels of the triangle's box: `step` (h, w) int32, when a pixel was written, and `unit` (h, w) int32,
by which interpolator; `writes` (h, w) uint8, how often; `value` (channels, h, w) int64, with what.
"""

from __future__ import annotations

import numpy as np

from luxel import jit

ONE_WAY, COUNTER, INTERLEAVED, CORRECTED = range(4)
"""Ways to walk a span: from the left; from both ends; every n-th pixel each; from the left with the slope's remainder carried (EC-DDA)."""

MOST_LANES = 16


@jit.inlined
def held(value, bits):
    """What a register of so many bits holds of a sum."""
    return (value << (64 - bits)) >> (64 - bits)


@jit.inlined
def put(y, x, clock, number, values, slot, step, unit, writes, value):
    """Interpolator `number`, whose registers are column `slot` of `values`, writes a pixel."""
    step[y, x], unit[y, x] = clock, number
    writes[y, x] += 1
    for channel in range(value.shape[0]):
        value[channel, y, x] = values[channel, slot]


@jit.part
def load_row(way, lanes, k, rows, start, end, slope, stride, bits, x, dx, v, dv, rest):
    """Put the span into the registers of its interpolators; returns the steps that takes beyond reading the span's ends.

    Interleaved, the n-th interpolator begins n slopes from the end: 1, 2, 4, 8 of them know their place after 0, 1, 2, 3 additions of shifted slopes.
    """
    channels, took = v.shape[0], 0
    for u in range(lanes):
        backward = way == COUNTER and u == 1
        x[u] = rows[k, 2] if backward else rows[k, 1] + (u if way == INTERLEAVED else 0)
        dx[u] = -1 if backward else (lanes if way == INTERLEAVED else 1)
        for c in range(channels):
            v[c, u] = end[k, c] if backward else start[k, c]
            dv[c, u] = -slope[k, c] if backward else stride[k, c]
    known, needed = 1, min(lanes, rows[k, 2] - rows[k, 1] + 1)
    while way == INTERLEAVED and known < needed:
        for u in range(known, min(2 * known, lanes)):
            for c in range(channels):
                v[c, u] = held(v[c, u - known] + known * slope[k, c], bits)
        known, took = 2 * known, took + 1
    last = max(1, rows[k, 2] - rows[k, 1])
    for c in range(channels if way == CORRECTED else 0):
        change = held(end[k, c] - start[k, c], bits)
        dv[c, 0], rest[c, 0] = change // last, change % last
        rest[c, 1], rest[c, 2] = (last - 1) >> 1, last  # begins at half, so that it rounds to nearest
    return took


@jit.part
def walk_row(way, lanes, y, right, bits, clock, x, dx, v, dv, rest, step, unit, writes, value):
    """Step the interpolators that are loaded until the span is full; returns the clock after it."""
    while True:
        first, second, busy = x[0], x[1], 0
        for u in range(lanes):
            if way == COUNTER:  # they stop where they meet
                active = first <= second if u == 0 else second > first
            else:
                active = x[u] <= right
            if not active:
                continue
            busy += 1
            put(y, x[u], clock, u, v, u, step, unit, writes, value)
            x[u] += dx[u]
            for c in range(v.shape[0]):
                v[c, u] = held(v[c, u] + dv[c, u], bits)
                if way == CORRECTED:
                    rest[c, 1] += rest[c, 0]
                    if rest[c, 1] >= rest[c, 2]:
                        rest[c, 1] -= rest[c, 2]
                        v[c, u] = held(v[c, u] + 1, bits)
        if busy == 0:
            return clock
        clock += 1


@jit.kernel
def run_rows(way, lanes, rows, first, start, end, slope, stride, bits, row_setup, overlapped, begun, step, unit, writes, value, steps):
    """Fill the spans of triangles.

    Args:
        way, lanes: How, and with how many interpolators.
        rows: (r, 3) int64, row, first and last pixel.
        first: (t + 1,) int64, where each triangle's rows begin.
        start, end, slope, stride: (r, channels) int64, values at both ends, change from pixel to pixel, and over `lanes` pixels.
        row_setup: Steps of the edge interpolators and of what divides, before a row.
        overlapped: Rows are set up while those before are filled.
        begun: The clock at which each triangle begins.
        steps: (t,) int64, written: the clock at its end.
    """
    x, dx = np.zeros(MOST_LANES, np.int64), np.zeros(MOST_LANES, np.int64)
    shape = start.shape[1], MOST_LANES
    v, dv, rest = np.zeros(shape, np.int64), np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    for t in range(len(steps)):
        clock = ready = np.int64(begun)
        for k in range(first[t], first[t + 1]):
            if not overlapped:
                ready = clock
            clock = max(clock, ready + row_setup)
            ready = clock
            clock += load_row(way, lanes, k, rows, start, end, slope, stride, bits, x, dx, v, dv, rest)
            clock = walk_row(way, lanes, rows[k, 0], rows[k, 2], bits, clock, x, dx, v, dv, rest, step, unit, writes, value)
        steps[t] = clock


@jit.kernel
def run_border(rows, inner, start, end, across, bits, row_setup, begun, step, unit, writes, value):
    """Two edge interpolators draw the pixels of the spans that `inner` (h, w) bool does not have, each from its end; returns the clock after both.

    `start`, `end`: (r, channels) int64, values at both ends; `across`: (channels,) int64, the plane's slope.
    """
    v = np.zeros((start.shape[1], 2), np.int64)
    clocks = np.full(2, begun, np.int64)
    for k in range(len(rows)):
        y, left, right = rows[k, 0], rows[k, 1], rows[k, 2]
        x0, x1 = left, right
        for c in range(len(v)):
            v[c, 0], v[c, 1] = start[k, c], end[k, c]
        clocks += row_setup
        goes0 = goes1 = True
        while goes0 or goes1:
            goes0, goes1 = goes0 and x0 <= x1 and not inner[y, x0], goes1 and x1 > x0 and not inner[y, x1]
            if goes0:
                put(y, x0, clocks[0], 0, v, 0, step, unit, writes, value)
                x0, clocks[0] = x0 + 1, clocks[0] + 1
            if goes1:
                put(y, x1, clocks[1], 1, v, 1, step, unit, writes, value)
                x1, clocks[1] = x1 - 1, clocks[1] + 1
            for c in range(len(v)):
                v[c, 0], v[c, 1] = held(v[c, 0] + across[c], bits), held(v[c, 1] - across[c], bits)
    return clocks.max()


@jit.kernel
def run_wave(todo, again, units, seed, rows, start, across, down, bits, row_setup, begun, step, unit, writes, value, told):
    """A wave over the pixels of `todo` (h, w) uint8, cleared as they are filled, from a seed.

    Every pixel that is written activates those of its four neighbours that are to be filled and not active. When none is left and `again` is set, the
    spans are gone through for what the wave could not reach, and it starts anew in the middle of the first run that is found.

    Args:
        units: How many pixels may be written in a step; 0, all that are active.
        seed: (2,) int64, x and y; if that is not to be filled, spans are gone through at once.
        rows, start: The spans (r, 3), and values at their left ends (r, channels).
        across, down: (channels,) int64, the plane's slopes.
        told: (3,) int64, written: seeds, most pixels in a step, and the clock at the end.
    """
    height, width = todo.shape
    size = int(todo.sum()) + 1
    queue, v = np.empty((size, 2), np.int64), np.zeros((len(across), 1), np.int64)
    clock, head, tail, k, seeds, most = np.int64(begun), 0, 0, 0, 0, 0
    if 0 <= seed[1] < height and 0 <= seed[0] < width and todo[seed[1], seed[0]]:
        own = np.searchsorted(rows[:, 0], seed[1])
        plant(seed[0], own, rows, start, across, bits, todo, value, queue, tail)
        tail, seeds = 1, 1
    while True:
        while head < tail:
            many = tail - head if units == 0 else min(units, tail - head)
            most = max(most, many)
            tail = spread(queue, head, many, tail, clock, across, down, bits, v, todo, step, unit, writes, value)
            head, clock = head + many, clock + 1
        if seeds and not again:
            break
        x = np.int64(-1)
        while k < len(rows) and x < 0:
            x = middle_of_first_run(todo, rows[k, 0], rows[k, 1], rows[k, 2])
            clock += row_setup
            k += x < 0
        if x < 0:
            break
        plant(x, k, rows, start, across, bits, todo, value, queue, tail)
        tail, seeds = tail + 1, seeds + 1
    told[0], told[1], told[2] = seeds, most, clock


@jit.part
def spread(queue, head, many, tail, clock, across, down, bits, v, todo, step, unit, writes, value):
    """One step: `many` active pixels of the queue are written and activate their neighbours; returns the queue's new end."""
    height, width = todo.shape
    for i in range(many):
        x, y = queue[head + i, 0], queue[head + i, 1]
        for c in range(len(v)):
            v[c, 0] = value[c, y, x]
        put(y, x, clock, i, v, 0, step, unit, writes, value)
        for way in range(4):
            dx, dy = (way == 0) - (way == 1), (way == 2) - (way == 3)
            nx, ny = x + dx, y + dy
            if 0 <= nx < width and 0 <= ny < height and todo[ny, nx]:
                todo[ny, nx] = 0
                for c in range(len(v)):
                    value[c, ny, nx] = held(v[c, 0] + dx * across[c] + dy * down[c], bits)
                queue[tail, 0], queue[tail, 1] = nx, ny
                tail += 1
    return tail


@jit.part
def plant(x, k, rows, start, across, bits, todo, value, queue, tail):
    """Activate a seed in row k of the spans: its value is the left end's and as many slopes as it is away from there."""
    y = rows[k, 0]
    todo[y, x] = 0
    queue[tail, 0], queue[tail, 1] = x, y
    for c in range(len(across)):
        value[c, y, x] = held(start[k, c] + (x - rows[k, 1]) * across[c], bits)


@jit.part
def middle_of_first_run(todo, y, left, right):
    """The middle of a row's first run of pixels to be filled, or -1."""
    x = left
    while x <= right and not todo[y, x]:
        x += 1
    if x > right:
        return np.int64(-1)
    end = x
    while end < right and todo[y, end + 1]:
        end += 1
    return (x + end) >> 1


@jit.kernel
def run_copies(xs, ys, clocks, units, values, offset, turned, constant, lanes, bits, todo, step, unit, writes, value):
    """Write a template's pixels, in the order of their steps, and in the same steps their copies; returns how many of both found nothing to do.

    Args:
        xs, ys, clocks, units: (n,) int64; values: (channels, n) int64.
        offset: (4, 2) int64, what is added to x and y; turned: (4,) whether they are subtracted from it, and the value from the constant.
        constant: (4, channels) int64.
        lanes: Interpolators of the template.
        todo: (h, w) uint8, cleared as pixels are filled.
    """
    height, width = todo.shape
    v = np.zeros((len(values), 1), np.int64)
    idle = 0
    for i in range(len(xs)):
        for copy in range(4):
            sign = -1 if turned[copy] else 1
            x, y = offset[copy, 0] + sign * xs[i], offset[copy, 1] + sign * ys[i]
            if not (0 <= x < width and 0 <= y < height and todo[y, x]):
                idle += 1
                continue
            todo[y, x] = 0
            for c in range(len(v)):
                v[c, 0] = held(constant[copy, c] + sign * values[c, i], bits)
            put(y, x, clocks[i], copy * lanes + units[i], v, 0, step, unit, writes, value)
    return idle
