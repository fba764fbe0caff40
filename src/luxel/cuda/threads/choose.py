"""Choose: who shoots next, and what becomes of it, as `luxel.radiosity.solve.State.shoot_brightest`; nothing of it is known to the processor.

The brightest patches are found in rounds: of each `GROUP` candidates as many go on as can shoot at once, until one group is left. A candidate is the
number of a patch, -1 where there is none. Equally bright ones rank by their numbers, so who wins does not depend on when threads run.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.cuda.threads.settle import GONE, PARTS, SENT
from luxel.jit import part
from luxel.radiosity.solve import SCALE_RANGE

__all__ = ["GROUP", "PARTS", "Batch", "Kept", "aim_shooter", "clear_winner", "find_bright", "line_up", "pick", "place_rows", "settle_row",
           "share_row", "sum_shots"]  # fmt: skip

GROUP = 512
_F = np.float32


class Batch(NamedTuple):
    """Who shoots, b at most, by patch in ascending order.

    Attributes:
        chosen: (b,) int32 patches, -1 at the end where there are fewer.
        slots: (b,) int64: where their rows are kept, -1 for none.
        powers: (b, 3) float32: radiosity times the scale of the row; 0 for none.
        away: (b, 3) float64: watts that reach nothing.
    """

    chosen: Array
    slots: Array
    powers: Array
    away: Array


class Kept(NamedTuple):
    """Rows of patches, as `luxel.radiosity.solve.Rows`: `slot` (p,) int64, `touched` (rows, blocks) bool, `scale` and `lost` (rows,) float64, and
    `used` (1,) int64 of the first `most` rows; the others are not kept.
    """

    slot: Array
    touched: Array
    scale: Array
    lost: Array
    used: Array
    most: int


@part
def find_bright(p, power, bright, candidates):
    """bright[p] float64: watts of patch `p`; candidates[p] int32: itself, if it has any."""
    bright[p] = power[p, 0] + power[p, 1] + power[p, 2]
    candidates[p] = p if bright[p] > 0.0 else -1


@part
def clear_winner(i, winners):
    """There is none."""
    winners[i] = -1


@part
def pick(i, bright, candidates, most, winners):
    """Candidate `i` is among the `most` that win in its group if it is one of the brightest: winners (groups most,), -1 before."""
    me, group = candidates[i], i // GROUP
    if me < 0:
        return
    rank, mine = 0, bright[me]
    for k in range(group * GROUP, min((group + 1) * GROUP, len(candidates))):
        other = candidates[k]
        if other >= 0:
            theirs = bright[other]
            if theirs > mine or (theirs == mine and other < me):
                rank += 1
    if rank < most:
        winners[group * most + rank] = me


@part
def line_up(i, winners, batch):
    """Those of the last round, by number."""
    me, rank, there = winners[i], 0, 0
    for k in range(len(winners)):
        if winners[k] >= 0:
            there += 1
            if winners[k] < me:
                rank += 1
    if me >= 0:
        batch.chosen[rank] = me
    if i >= there:
        batch.chosen[i] = -1


@part
def place_rows(_, batch, kept, wanted):
    """Where the rows of a batch are, as `Rows.place`; wanted (b,) bool: which are still to be filled. By one thread."""
    spare = kept.most
    for s in range(len(batch.chosen)):
        p = batch.chosen[s]
        slot = kept.slot[p] if p >= 0 else -1
        wanted[s] = p >= 0 and slot < 0
        if wanted[s] and kept.used[0] < kept.most:
            slot = kept.used[0]
            kept.slot[p] = slot
            kept.used[0] = slot + 1
        elif wanted[s]:
            slot = spare
            spare += 1
        batch.slots[s] = slot


@part
def aim_shooter(s, batch, shooters, node, cubes, escapes):
    """The shooter's node, centre and frame, of those of all patches; and nothing is known to escape."""
    p = batch.chosen[s]
    escapes[s, 0] = escapes[s, 1] = np.uint64(0)
    if p < 0:
        return
    nodes, centers, frames = shooters
    node[s] = nodes[p]
    for row in range(3):
        cubes.centers[s, row] = centers[p, row]
        for column in range(3):
            cubes.frames[s, row, column] = frames[p, row, column]


@part
def share_row(t, s, batch, cubes, sums, kept, shares):
    """shares[s, t]: every `PARTS`-th of the sums over blocks of a row that was filled, sums (s, blocks); and which of these are not all zero."""
    if not cubes.wanted[s]:
        return
    total = 0.0
    for b in range(t, sums.shape[1], PARTS):
        total += sums[s, b]
        kept.touched[batch.slots[s], b] = sums[s, b] > 0.0
    shares[s, t] = total


@part
def settle_row(s, batch, cubes, node, place, power, shares, escapes, kept):
    """The scale and loss of a row that was filled, as `luxel.radiosity.solve.fill`; and what shooter `s` sends out through its row, or 0."""
    p, slot = batch.chosen[s], batch.slots[s]
    if p < 0:
        for c in range(3):
            batch.powers[s, c], batch.away[s, c] = _F(0.0), 0.0
        return
    area = np.float64(place[node[s], 7])
    if cubes.wanted[s]:
        total = 0.0
        for t in range(PARTS):
            total += shares[s, t]
        scale = area / total if total > 0.0 else 1.0
        if escapes[s, 0] > 0 or escapes[s, 1] > 0:
            scale = min(scale, 1.0)
        scale = min(max(scale, SCALE_RANGE[0]), SCALE_RANGE[1])
        kept.scale[slot], kept.lost[slot] = scale, 1.0 - scale * total / area
    for c in range(3):
        radiosity = power[p, c] / area
        batch.powers[s, c] = _F(radiosity * kept.scale[slot])
        batch.away[s, c] = radiosity * area * kept.lost[slot]


@part
def sum_shots(c, batch, sums):
    """The watts of channel `c` that reach nothing, into row GONE + c of the sums, as its first part; and how many shoot, into row SENT + c."""
    gone, shots = 0.0, 0.0
    for s in range(len(batch.chosen)):
        gone += batch.away[s, c]
        shots += 1.0 if batch.chosen[s] >= 0 else 0.0
    for t in range(PARTS):
        sums[GONE + c, t], sums[SENT + c, t] = 0.0, 0.0
    sums[GONE + c, 0], sums[SENT + c, 0] = gone, shots
