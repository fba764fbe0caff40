"""Settle: light on its way from element to element, and the ledger's sums, as `luxel.radiosity.solve`.

Sums over elements or patches are taken in two steps and in an order that does not depend on when threads run: of s threads each adds up every s-th
number, and of `PARTS` each every PARTS-th of these `shares`. What is left is added up, in order, by whoever needs it.

Arrays of n elements are (3, n) float32, as in `luxel.radiosity.solve.State`: `received` and `direct` irradiance, `unshot` radiosity, and `gained`,
the irradiance that a step brings.
"""

from __future__ import annotations

import numpy as np

from luxel.jit import part
from luxel.radiosity.element import AREA
from luxel.radiosity.solve import SCALES

_F = np.float32
PARTS = 64

# Rows of the sums: by channel, watts sent, watts of these that go away, and watts that arrive; then watts absorbed and watts to shoot; and last, over
# all elements, what is to shoot as a share of what was received.
SENT, GONE, GOT, ABSORBED, POWER, HERE, SUMS = 0, 3, 6, 9, 12, 15, 16


@part
def send(i, unshot, sent):
    """All that element `i` has to shoot, into `sent` (3 + n, 4), as `luxel.radiosity.gather.mean_light` wants it."""
    for c in range(3):
        sent[i + 3, c] = unshot[c, i]


@part
def share_sent(t, numbers, away, sent, gained, shares):
    """Share `t` of what is sent, of what of it goes away, by the `away` (n,) float64 of `Sight`, and of what arrives."""
    for c in range(3):
        whole = gone = got = 0.0
        for i in range(t, len(away), shares.shape[1]):
            radiosity, area = np.float64(sent[i + 3, c]), np.float64(numbers[AREA, i])
            whole += radiosity * area
            gone += radiosity * away[i]
            got += np.float64(gained[c, i]) * area
        shares[SENT + c, t], shares[GONE + c, t], shares[GOT + c, t] = whole, gone, got


@part
def add_up(t, j, first, shares, sums):
    """Part `t` of the sum in row first + j: shares (SUMS, s), sums (SUMS, PARTS) float64."""
    total, row = 0.0, first + j
    for k in range(t, shares.shape[1], PARTS):
        total += shares[row, k]
    sums[row, t] = total


@part
def total(sums, row):
    """All parts of the sum in a row."""
    whole = 0.0
    for t in range(PARTS):
        whole += sums[row, t]
    return whole


@part
def find_scale(c, sums, scale):
    """scale[c] float32: what puts the sum of what arrives right, in channel `c`; see `luxel.radiosity.solve.pass_on`."""
    wanted, got = total(sums, SENT + c) - total(sums, GONE + c), total(sums, GOT + c)
    scale[c] = _F(min(max(wanted / got if got > 0.0 else 1.0, SCALES[0]), SCALES[1]))


@part
def take_in(i, albedo, scale, keeps, gained, received, unshot, new_received, new_unshot):
    """Element `i` takes in what it gained, times `scale` (3,) float32; it `keeps` what it had to shoot, or has shot it."""
    for c in range(3):
        new = gained[c, i] * scale[c]
        gained[c, i] = new
        new_received[c, i] = received[c, i] + new
        new_unshot[c, i] = (unshot[c, i] if keeps else _F(0.0)) + albedo[c, i] * new


@part
def note_direct(i, gained, direct):
    """What element `i` gained came from a light."""
    for c in range(3):
        direct[c, i] += gained[c, i]


@part
def forget(k, chosen, starts, albedo, gained, unshot):
    """The elements of patch chosen[k], if it is not -1, have shot what they had: they will shoot what they send on of what they gained."""
    if chosen[k] < 0:
        return
    for c in range(3):
        for i in range(starts[chosen[k]], starts[chosen[k] + 1]):
            unshot[c, i] = albedo[c, i] * gained[c, i]


@part
def take_stock(p, c, numbers, starts, albedo, gained, unshot, power, absorbed):
    """What patch `p` has to shoot now, and what it has kept of what it gained, in channel `c`: (patches, 3) float64 watts."""
    shot = kept = 0.0
    for i in range(starts[p], starts[p + 1]):
        new, area = gained[c, i], np.float64(numbers[AREA, i])
        shot += area * np.float64(unshot[c, i])
        kept += area * (np.float64(new) - np.float64(albedo[c, i] * new))
    power[p, c], absorbed[p, c] = shot, kept


@part
def share_stock(t, power, absorbed, received, unshot, shares):
    """Share `t` of what is absorbed and to shoot, and of what elements have still to shoot as shares of what they have received."""
    for c in range(3):
        kept = shot = 0.0
        for p in range(t, len(power), shares.shape[1]):
            kept += absorbed[p, c]
            shot += power[p, c]
        shares[ABSORBED + c, t], shares[POWER + c, t] = kept, shot
    here = 0.0
    for i in range(t, received.shape[1], shares.shape[1]):
        there = received[0, i] + received[1, i] + received[2, i]
        if there > _F(0.0):
            here += np.float64((unshot[0, i] + unshot[1, i] + unshot[2, i]) / there)
    shares[HERE, t] = here
