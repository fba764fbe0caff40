"""Pairs: form factors between surfaces, as `luxel.radiosity.form_factors`, one thread a pair of polygons.

What nothing stands between is soon done by any thread. The other pairs take a hundred times as long, and more memory than a thread has of its own:
they go to a queue, and fewer threads, with room for each, take them from it.
"""

from __future__ import annotations

from typing import NamedTuple

from luxel.arrays import Array
from luxel.cuda.machine import add
from luxel.jit import part
from luxel.radiosity.obstructed import CELLS, LEVELS, PARTS, PLANES, RAYS
from luxel.radiosity.pairs import PIECE_CORNERS, PIECES, Scratch, exchange
from luxel.radiosity.shaft import BLOCKERS, CORNERS

__all__ = ["BLOCKERS", "CELLS", "CORNERS", "LEVELS", "PARTS", "PIECES", "PIECE_CORNERS", "PLANES", "RAYS", "Found", "Room", "Scratch", "add_pairs",
           "exchange_hidden", "exchange_plain"]  # fmt: skip

WAITING, TAKEN, COUNTS = 0, 1, 2
"""Places in `Found.counts`."""


class Found(NamedTuple):
    """The exchanges of some polygons, from `first` on, with all p.

    Attributes:
        first: The first of them.
        values, errors: (k, p) float64, square metres; where the second polygon is after the first.
        queue: (k p,) int32: pairs that something stands between, as places in `values`.
        counts: (COUNTS,) int64: pairs in the queue, and how many of them have been taken.
    """

    first: int
    values: Array
    errors: Array
    queue: Array
    counts: Array


class Room(NamedTuple):
    """The larger arrays of the `Scratch` of t threads."""

    blockers: Array
    pieces: Array
    counts: Array
    points: Array


@part
def exchange_plain(q, k, world, wanted, found, scratch):
    """The exchange of the polygons first + k and `q`, if nothing stands between them; else they go to the queue."""
    p = found.first + k
    if q <= p:
        return
    value, error = exchange(world, p, q, wanted, scratch, True)
    if error < 0.0:
        found.queue[add(found.counts, WAITING, 1)] = k * found.values.shape[1] + q
    else:
        found.values[k, q], found.errors[k, q] = value, error


@part
def exchange_hidden(last, world, wanted, found, scratch):
    """Exchanges of pairs of the queue, before row `last` of it, as long as there are any."""
    item = add(found.counts, TAKEN, 1)
    while item < last:
        k, q = found.queue[item] // found.values.shape[1], found.queue[item] % found.values.shape[1]
        found.values[k, q], found.errors[k, q] = exchange(world, found.first + k, q, wanted, scratch)
        item = add(found.counts, TAKEN, 1)


@part
def add_pairs(j, row, first, starts, found, block, errors):
    """Add what is found to row `row` of `block` and `errors` (rows, n), of surface first + row: its exchange with surface `j`, in the order in which
    the processor adds."""
    i, count = first + row, len(found.values)
    for p in range(max(starts[i], found.first), min(starts[i + 1], found.first + count)):
        for q in range(max(starts[j], p + 1), starts[j + 1]):
            times = 2.0 if i == j else 1.0
            block[row, j] += times * found.values[p - found.first, q]
            errors[row, j] += times * found.errors[p - found.first, q]
