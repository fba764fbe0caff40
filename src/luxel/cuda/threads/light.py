"""Light: transport that is kept, solved for other lights and colours, as `luxel.radiosity.relight`: conjugate gradients over groups of elements,
then light passed on from element to element. One thread an element, a group, or a share of a sum.

Sums over all groups or elements are taken in two steps, in an order that does not depend on when threads run: `PARTS` threads sum what is theirs,
and whoever needs the whole adds the parts up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.jit import part
from luxel.radiosity.gather import mean_light
from luxel.radiosity.transport import BLOCK, decoded

_F = np.float32
PARTS = 256
STRIPS = 32
"""The rows of the groups' exchange are summed in so many strips."""


class Groups(NamedTuple):
    """The groups' equations, (1 - R G R) y = right; see `luxel.radiosity.relight`.

    Attributes:
        starts: (p + 1,) int64: where the elements of each begin.
        exchange: (p, p) float32: G, symmetric.
        area: (p,) float64, m2.
        root: (p, 3) float32: R.
        scale: (p, 3) float64: from radiosity to y; 0 where nothing is reflected.
        first: (p, 3) float64: mean radiosity by the light of lights.
        x, residual, way, image: (p, 3) float32.
        sent: (p, 3) float32: what the exchange is multiplied by; strips: (STRIPS, p, 3) float32: its product, in parts.
        sums: (4, PARTS, 3) float64: parts of the squared residual (two of them, in turns), of way times image, and of the first square.
    """

    starts: Array
    exchange: Array
    area: Array
    root: Array
    scale: Array
    first: Array
    x: Array
    residual: Array
    way: Array
    image: Array
    sent: Array
    strips: Array
    sums: Array


@part
def receive_element(i, still, factor, rows, touched, powers, direct):
    """direct[:, i] = still * factor + what the lights give: powers (s, 3) times rows (s, e), in their order."""
    red, green, blue = still[0, i] * factor, still[1, i] * factor, still[2, i] * factor
    for s in range(len(powers)):
        if touched[s, i // BLOCK]:
            k = decoded(rows[s, i])
            red += k * powers[s, 0]
            green += k * powers[s, 1]
            blue += k * powers[s, 2]
    direct[0, i], direct[1, i], direct[2, i] = red, green, blue


@part
def send_element(i, luxel, albedo, received, light):
    """light[i + 3] = what element `i` sends on of what it has `received` (3, e); `light` (e + 3, 4) as `mean_light` wants it."""
    n = np.int64(luxel[i])
    for c in range(3):
        light[i + 3, c] = albedo[n, c] * received[c, i]
    light[i + 3, 3] = _F(0.0)
    if i < 3:
        for c in range(4):
            light[i, c] = _F(0.0)


@part
def pass_on(i, hits, light, known, received, change):
    """received[:, i] = known + the mean of the light that element `i` sees; change[i] gets by how much it changed, summed over colours."""
    red, green, blue = mean_light(hits, np.uint64(i), light)
    red, green, blue = known[0, i] + red, known[1, i] + green, known[2, i] + blue
    change[i] = abs(red - received[0, i]) + abs(green - received[1, i]) + abs(blue - received[2, i])
    received[0, i], received[1, i], received[2, i] = red, green, blue


@part
def sum_changes(t, received, change, totals):
    """totals[:, t] (2, PARTS) float64: share `t` of the sums of changes and of what is received."""
    changed, whole = 0.0, 0.0
    for i in range(t, len(change), PARTS):
        changed += np.float64(change[i])
        whole += np.float64(received[0, i]) + np.float64(received[1, i]) + np.float64(received[2, i])
    totals[0, t], totals[1, t] = changed, whole


@part
def scatter(i, luxel, front, received, result):
    """The luxel (n, 3) of element `i`, if it is its front, gets what it received."""
    if front[i]:
        n = np.int64(luxel[i])
        result[n, 0], result[n, 1], result[n, 2] = received[0, i], received[1, i], received[2, i]


@part
def begin_group(p, area, luxel, albedo, direct, shining, groups):
    """Set up the equation of group `p`: of the albedo (n, 3), and of the light (3, e) and (e + 3, 4) that its elements send on at first."""
    whole = 0.0
    for e in range(groups.starts[p], groups.starts[p + 1]):
        whole += np.float64(area[e])
    for c in range(3):
        rho, first = 0.0, 0.0
        for e in range(groups.starts[p], groups.starts[p + 1]):
            here, a = albedo[luxel[e], c], area[e]
            rho += np.float64(here * a)
            first += np.float64((direct[c, e] * here + shining[e + 3, c]) * a)
        rho, first = rho / whole, first / whole
        root, scale = _F(math.sqrt(rho / whole)), math.sqrt(whole / rho) if rho > 0.0 else 0.0
        groups.root[p, c], groups.scale[p, c], groups.first[p, c] = root, scale, first
        right = _F(scale * first)
        groups.x[p, c], groups.residual[p, c], groups.way[p, c], groups.sent[p, c] = _F(0.0), right, right, root * right
    groups.area[p] = whole


@part
def square(t, which, groups):
    """Share `t` of the squared residual, into `which` row of the sums."""
    red = green = blue = 0.0
    for p in range(t, len(groups.area), PARTS):
        red += np.float64(groups.residual[p, 0]) ** 2
        green += np.float64(groups.residual[p, 1]) ** 2
        blue += np.float64(groups.residual[p, 2]) ** 2
    groups.sums[which, t, 0], groups.sums[which, t, 1], groups.sums[which, t, 2] = red, green, blue


@part
def total(sums, which, c):
    """All shares of one sum."""
    whole = 0.0
    for t in range(PARTS):
        whole += sums[which, t, c]
    return whole


@part
def exchange_strip(q, strip, groups):
    """Strip `strip` of the product of the exchange's column `q` (its row, as it is symmetric) with what is sent."""
    count = len(groups.area)
    red = green = blue = _F(0.0)
    for p in range(strip * count // STRIPS, (strip + 1) * count // STRIPS):
        g = groups.exchange[p, q]
        red += g * groups.sent[p, 0]
        green += g * groups.sent[p, 1]
        blue += g * groups.sent[p, 2]
    groups.strips[strip, q, 0], groups.strips[strip, q, 1], groups.strips[strip, q, 2] = red, green, blue


@part
def exchanged(p, c, groups):
    """Row `p` of the product, from its strips."""
    whole = _F(0.0)
    for strip in range(STRIPS):
        whole += groups.strips[strip, p, c]
    return whole


@part
def multiply(p, groups):
    """image = way - R G R way, of group `p`."""
    for c in range(3):
        groups.image[p, c] = groups.way[p, c] - groups.root[p, c] * exchanged(p, c, groups)


@part
def measure(t, groups):
    """Share `t` of way times image."""
    for c in range(3):
        along = 0.0
        for p in range(t, len(groups.area), PARTS):
            along += np.float64(groups.way[p, c]) * np.float64(groups.image[p, c])
        groups.sums[2, t, c] = along


@part
def settled(which, enough, groups):
    """Whether the squared residual is no more than `enough` of the first, in every colour."""
    still = False
    for c in range(3):
        still = still or total(groups.sums, which, c) > enough * total(groups.sums, 3, c)
    return not still


@part
def step(t, before, enough, groups):
    """Go along the way, in the groups of share `t`, if it is not settled; and its share of the new squared residual, in the other row."""
    after = 1 - before
    if settled(before, enough, groups):
        for c in range(3):
            groups.sums[after, t, c] = groups.sums[before, t, c]
        return
    for c in range(3):
        along = total(groups.sums, 2, c)
        far = _F(total(groups.sums, before, c) / along) if along > 0.0 else _F(0.0)
        rest = 0.0
        for p in range(t, len(groups.area), PARTS):
            groups.x[p, c] += far * groups.way[p, c]
            groups.residual[p, c] -= far * groups.image[p, c]
            rest += np.float64(groups.residual[p, c]) ** 2
        groups.sums[after, t, c] = rest


@part
def turn(t, before, enough, groups):
    """The next way, conjugate to those before, in the groups of share `t`."""
    if settled(before, enough, groups):
        return
    for c in range(3):
        square_before = total(groups.sums, before, c)
        share = _F(total(groups.sums, 1 - before, c) / square_before) if square_before > 0.0 else _F(0.0)
        for p in range(t, len(groups.area), PARTS):
            way = groups.residual[p, c] + share * groups.way[p, c]
            groups.way[p, c] = way
            groups.sent[p, c] = groups.root[p, c] * way


@part
def send_group(p, groups):
    """What group `p` sends in the end: its radiosity."""
    for c in range(3):
        scale = groups.scale[p, c]
        groups.sent[p, c] = _F(np.float64(groups.x[p, c]) / scale if scale > 0.0 else groups.first[p, c])


@part
def spread_group(p, direct, groups, received):
    """received = direct + what the group gets from the others, for the elements of group `p`."""
    for c in range(3):
        given = _F(np.float64(exchanged(p, c, groups)) / groups.area[p])
        for e in range(groups.starts[p], groups.starts[p + 1]):
            received[c, e] = direct[c, e] + given
