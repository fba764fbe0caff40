"""Look: what the elements of a bake see, by rays, and the light that comes along them, as `luxel.radiosity.gather`, `sky` and `direct`.

One thread a ray. The threads of a warp are neighbouring elements that look the same way, so they walk the hierarchy together. A packet of one ray is
a handful of registers; what a processor's packet of sixteen decides together (which child to enter first) a thread decides for its own.

What rays meet lies ray by ray, `hits` (n, rays) in columns: neighbouring threads write, and later read, neighbouring words.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.jit import part
from luxel.radiosity.closer import find_unlike, look_closer
from luxel.radiosity.direct import shine_on
from luxel.radiosity.element import AREA, FREE, free_sample
from luxel.radiosity.gather import Lookup, away_and_blind, mean_light, met_by, sample_of, start_ray
from luxel.radiosity.occlusion import Occlusion
from luxel.radiosity.packet import SCRATCH, STACK, meet_all
from luxel.radiosity.sky import TOGETHER, classify, light_of

__all__ = [
    "SCRATCH", "STACK", "TOGETHER", "Closer", "Eyes", "Sky", "closer_light", "count_away", "find_again", "find_cells", "gather_mean", "look", "shine",
    "sky_light",
]  # fmt: skip

_FIRST = np.uint64(0)


class Eyes(NamedTuple):
    """Who looks, and at what; see `luxel.radiosity.gather.View`.

    Attributes:
        scene: All that hides.
        numbers: (17, n) float32, of `Elements`.
        frames: (n, 3, 3) float32: of each element, rows right, up, normal.
        lookup: Which element lies where.
        reach: float32, metres.
    """

    scene: Occlusion
    numbers: Array
    frames: Array
    lookup: Lookup
    reach: np.float32


class Sky(NamedTuple):
    """An even sky, and what groups of `TOGETHER` elements see of it; see `luxel.radiosity.sky`.

    Attributes:
        cell: (rays, 2) int32: of each ray.
        coarse, fine: (h, w, 3) float32 W/(m2 sr): for whole cells and for parts of them.
        seen, kind: (groups, wide, high) int32: how many of a group see the sky in a cell, and what it is to them.
        some: (groups,) bool: any cell is not dark.
    """

    cell: Array
    coarse: Array
    fine: Array
    seen: Array
    kind: Array
    some: Array


class Closer(NamedTuple):
    """What groups of `TOGETHER` elements look closer at; see `luxel.radiosity.closer`.

    Attributes:
        cell: (rays, 2) int32: of each ray.
        light: (3 + n, 4) float32: of what is met.
        unlike: float32.
        least, most: (groups, wide, high) float32: scratch.
        again: (groups, wide, high) bool: whether they do at a cell.
    """

    cell: Array
    light: Array
    unlike: np.float32
    least: Array
    most: Array
    again: Array


@part
def look(k, r, eyes, first, first_ray, directions, hits, c, stack):
    """hits[k, first_ray + r]: what element first + k meets along these of `directions` (rays, 3) of its frame.

    `c` (SCRATCH,) float32 and `stack` (STACK,) int32 are scratch.
    """
    i, number = first + k, first_ray + r
    sample = free_sample(np.int64(eyes.numbers[FREE, i]), sample_of(number))
    start_ray(eyes.numbers, eyes.frames[i], directions[number], i, sample, eyes.reach, _FIRST, c)
    meet_all(eyes.scene, c, stack)
    hits[k, number] = met_by(_FIRST, i, eyes.scene, eyes.numbers, eyes.lookup, c)


@part
def count_away(i, numbers, hits, away, blind):
    """away[i] float64 m2, and blind[i]: `luxel.radiosity.gather.Sight`."""
    away[i], blind[i] = away_and_blind(hits, i, numbers[AREA, i])


@part
def gather_mean(k, first, hits, light, result):
    """result[:, first + k]: the mean of `light` (3 + n, 4) over what the rays of an element meet."""
    result[0, first + k], result[1, first + k], result[2, first + k] = mean_light(hits, np.uint64(k), light)


@part
def find_cells(g, count, hits, sky):
    """What the cells of the sky are to group `g` of so many elements."""
    wide, high = sky.kind.shape[1], sky.kind.shape[2]
    first, last = g * TOGETHER, min(count, (g + 1) * TOGETHER)
    sky.some[g] = classify(hits, sky.cell, first, last, wide, high, sky.seen[g], sky.kind[g])


@part
def sky_light(k, first, eyes, sky, result, local, c, stack):
    """result[:, i]: the light of the sky on element i = first + k, W/m2. `local` (3,) float64 is scratch."""
    i, g, s = first + k, k // TOGETHER, eyes.scene
    red, green, blue = light_of(i, sky.some[g], sky.kind[g], s, eyes.numbers, eyes.frames[i], eyes.reach, sky.coarse, sky.fine, local, c, stack)
    result[0, i], result[1, i], result[2, i] = np.float32(red), np.float32(green), np.float32(blue)


@part
def find_again(g, hits, closer):
    """The cells that group `g` looks closer at."""
    first, last = g * TOGETHER, min(len(hits), (g + 1) * TOGETHER)
    find_unlike(hits, closer.light, closer.cell, first, last, closer.unlike, closer.least[g], closer.most[g], closer.again[g])


@part
def closer_light(k, first, eyes, hits, closer, result, local, sums, c, stack):
    """result[:, i]: the light of other surfaces on element i = first + k, W/m2. `local` (3,) and `sums` (1, 8) float32 are scratch."""
    i = first + k
    again, numbers, frames = closer.again[i // TOGETHER], eyes.numbers, eyes.frames
    look_closer(i, i + 1, hits, closer.cell, again, eyes.scene, numbers, frames, eyes.reach, eyes.lookup, closer.light, local, sums, c, stack, result)


@part
def shine(i, scene, numbers, table, reach, result):
    """result[:, i] += what the lights of a table give to element `i`, W/m2."""
    shine_on(i, scene, numbers, table, reach, result)
