"""What composition sends: the rounds of `luxel.cluster.composite`, run for any number of ranks on the pixels of one real frame.

A pixel is held by the rank that has drawn it, and moves, round by round, to the rank that has its tile in the end. Of what a rank gives another in a
round, the runs of pixels are counted, as they are packed. Pixels that several ranks have drawn count once: what is hidden is left out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.cluster.composite import radices
from luxel.studies.cluster.facts import Facts


class Round(NamedTuple):
    """What the ranks do at one time.

    Attributes:
        partners: To whom each of them sends.
        sent: (ranks,) int64 bytes that each sends.
        got: (ranks,) int64 bytes that each gets.
    """

    partners: int
    sent: Array
    got: Array


def parts(slots: Array, steps: list[int]) -> Array:
    """(n, rounds) int64: in which part of what its rank still has each of n tiles lies, round by round, as `np.array_split` cuts them."""
    position, count = np.arange(len(slots)), np.full(len(slots), len(slots))
    out = np.empty((len(slots), len(steps)), np.int64)
    for i, k in enumerate(steps):
        small, larger = count // k, count % k
        head = larger * (small + 1)
        part = np.where(position < head, position // (small + 1), larger + (position - head) // np.maximum(small, 1))
        out[:, i] = part
        position = np.where(position < head, position % (small + 1), (position - head) % np.maximum(small, 1))
        count = small + (part < larger)
    return out


def owners(facts: Facts, ranks: int) -> Array:
    """(n,) int64: the rank that has the triangle of each covered pixel."""
    return np.minimum((facts.owner * ranks).astype(np.int64), ranks - 1)


def rounds(facts: Facts, ranks: int, composition: str, groups: int = 1) -> list[Round]:
    """The rounds of composition of one group of `ranks`; of several groups, that share the screen's tiles evenly, the one with the most pixels."""
    key = "rounds", ranks, composition, groups
    if key not in facts.memo:
        facts.memo[key] = _rounds(_busiest(facts, groups), ranks, composition)
    found: list[Round] = facts.memo[key]
    return found


def _rounds(facts: Facts, ranks: int, composition: str) -> list[Round]:
    slots, tile = np.unique(facts.slot, return_inverse=True)
    steps = radices(ranks, composition)
    whole = math.prod(steps)
    holder, out = owners(facts, ranks), []
    if ranks > whole:  # the ranks beyond the power of two hand over what they have
        out.append(_moved(facts, holder, holder % whole, ranks, 1))
        holder = holder % whole
    digits, stride = parts(slots, steps), 1
    for i, k in enumerate(steps):
        own = holder // stride % k
        after = holder + (digits[tile, i] - own) * stride
        out.append(_moved(facts, holder, after, ranks, k - 1))
        holder, stride = after, stride * k
    return out


def _busiest(facts: Facts, groups: int) -> Facts:
    if groups == 1:
        return facts
    group = np.searchsorted(np.cumsum(facts.tile_pixels), np.arange(1, groups + 1) * facts.tile_pixels.sum() / groups - 0.5)
    low = 0 if groups < 2 else int(group[len(group) // 2 - 1]) + 1
    high = max(low + 1, int(group[len(group) // 2]) + 1)
    keep = (facts.slot >= low) & (facts.slot < high)
    return facts._replace(slot=facts.slot[keep], place=facts.place[keep], owner=facts.owner[keep])


def _moved(facts: Facts, before: Array, after: Array, ranks: int, partners: int) -> Round:
    moves = np.flatnonzero(before != after)
    if not len(moves):
        return Round(partners, np.zeros(ranks, np.int64), np.zeros(ranks, np.int64))
    slot, place, give, take = facts.slot[moves], facts.place[moves], before[moves], after[moves]
    fresh = np.r_[True, (np.diff(slot) != 0) | (np.diff(place) != 1) | (np.diff(give) != 0) | (np.diff(take) != 0)]
    heads = np.unique(give[fresh] * facts.tiles + slot[fresh], return_index=True)[1]  # each rank tells a tile's number, and of how many runs
    words = [2 * (np.bincount(at, minlength=ranks) + np.bincount(at[fresh], minlength=ranks) + np.bincount(at[fresh][heads], minlength=ranks))
             for at in (give, take)]  # fmt: skip
    return Round(partners, 4 * words[0], 4 * words[1])


def claims(facts: Facts, ranks: int, groups: int = 1) -> tuple[int, int]:
    """Bytes that one rank gets, at most: of claims, as an owner, three words a run; and of colours, for its tiles, three a pixel."""
    key = "claims", ranks, groups
    if key not in facts.memo:
        facts.memo[key] = _claims(_busiest(facts, groups), ranks)
    asked, colours = facts.memo[key]
    return asked, colours


def _claims(facts: Facts, ranks: int) -> tuple[int, int]:
    owner = owners(facts, ranks)
    fresh = np.r_[True, (np.diff(facts.slot) != 0) | (np.diff(facts.place) != 1) | (np.diff(owner) != 0)][: len(owner)]
    asked = 12 * int(np.bincount(owner[fresh]).max(initial=0))
    return asked, 12 * math.ceil(len(owner) / ranks)
