"""Claims: after composition, who shades what, and the way back of the colours.

A rank that has the final visibility of its tiles tells the owner of each triangle which samples it has there, as runs (tile, first sample, length).
The owner shades what it has been told of, with what it has drawn itself, and returns the colours in the order of tiles, pixels and samples; so no
places travel back. What one triangle has of a pixel is one fragment, whose colour travels once, with the samples that have it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.jit import count_bits
from luxel.raster.constants import NOTHING
from luxel.raster.shade import write_tile

_F = np.float32


class Grid(NamedTuple):
    """Tiles `first` .. of a window, row by row, whose samples are rows of arrays: see `shade.Tiles`.

    Attributes:
        across: Tiles in a row of the window.
        side: Of a tile, in pixels.
        width, height: Of the window.
        left, top: Where the window lies in the picture.
        samples: Of each pixel.
    """

    first: int
    across: int
    side: int
    width: int
    height: int
    left: int
    top: int
    samples: int


@jit.kernel
def _to_global(slots, grid, drawn_here, ids, source, m, numbers, offset, out):
    pixels, side = grid.side * grid.side, grid.side
    for slot in slots:
        number = grid.first + slot
        wide, high = grid.width - number % grid.across * side, grid.height - number // grid.across * side
        if drawn_here[slot] == 0:
            out[slot, : pixels * grid.samples] = NOTHING
            continue
        for s in range(grid.samples):
            for p in range(pixels):
                t, i = ids[slot, s * pixels + p], s * pixels + p
                if t < 0 or p % side >= wide or p // side >= high:
                    out[slot, i] = NOTHING
                else:
                    t = t if t < m else source[t - m]
                    out[slot, i] = offset + (numbers[t] if len(numbers) > 0 else t)


def to_global(slots: Array, grid: Grid, drawn_here: Array, ids: Array, source: Array, m: int, numbers: Array, offset: int, out: Array) -> None:
    """Write the ids that all ranks know to rows `slots` of `out`: of what is drawn in the window, and nothing elsewhere.

    Args:
        drawn_here: (tiles,) uint8: whether the rank has drawn to a tile; else its ids are not read.
        ids: (tiles, ...) int32, from `cover`: triangles of this rank, and pieces made by clipping from `m` on.
        source: (k,) int32, the triangle that each piece was cut from.
        numbers: (m,) int32, what the rank calls its triangles; without rows: 0, 1, ...
        offset: Of this rank's first triangle among all.
    """
    _to_global(slots, grid, drawn_here, ids, source, m, numbers, offset, out)


@jit.kernel
def _owner(offsets, t):
    """The rank whose triangles offsets[rank] .. offsets[rank + 1] - 1 hold t."""
    return np.searchsorted(offsets, t, side="right") - 1


@jit.kernel
def _claim(slots, samples, ids, offsets, place, out):
    """Count the words of each owner's claims in `place`; or write them from `place` on, if `out` has room."""
    writing = len(out) > 0
    for slot in slots:
        i = 0
        while i < samples:
            t = ids[slot, i]
            if t < 0:
                i += 1
                continue
            start, owner = i, _owner(offsets, t)
            low, high = offsets[owner], offsets[owner + 1]
            while i < samples and low <= ids[slot, i] < high:
                i += 1
            if writing:
                at = place[owner]
                out[at], out[at + 1], out[at + 2] = slot, start, i - start
            place[owner] += 3


def claims(slots: Array, samples: int, ids: Array, offsets: Array) -> list[Array]:
    """For each owner (3 n,) int32: tile, first sample and length of the runs that it has in rows `slots` of `ids` (tiles, ...) int32."""
    place = np.zeros(len(offsets) - 1, np.int64)
    _claim(slots, samples, ids, offsets, place, np.empty(0, np.int32))
    ends = np.cumsum(place)
    out = np.empty(int(ends[-1]), np.int32)
    if len(out):
        _claim(slots, samples, ids, offsets, ends - place, out)
    return np.split(out, ends[:-1])


@jit.kernel
def _keep(runs, ids, kept):
    for at in range(0, len(runs), 3):
        slot, start, end = runs[at], runs[at + 1], runs[at + 1] + runs[at + 2]
        for i in range(start, end):
            kept[slot, i] = ids[slot, i]


def keep(claimed: list[Array], ids: Array, kept: Array) -> None:
    """Copy what is claimed from `ids` to `kept`, (tiles, ...) int32."""
    for runs in claimed:
        _keep(runs, ids, kept)


def first_samples(runs: Array, grid: Grid) -> tuple[Array, Array]:
    """y and x in the picture, (n,) int64 each, of the pixels whose first sample is in the runs, in their order."""
    slot, start, length = runs.reshape(-1, 3).astype(np.int64).T
    pixels = grid.side**2
    length = np.clip(pixels - start, 0, length)
    ends = np.cumsum(length)
    inside = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - length, length)
    p, number = np.repeat(start, length) + inside, np.repeat(slot, length) + grid.first
    return grid.top + number // grid.across * grid.side + p // grid.side, grid.left + number % grid.across * grid.side + p % grid.side


@jit.kernel
def _fragments(slots, grid, every, kept, colors, masks, out):
    """Count the fragments of the rows; or write them, if `out` has room."""
    pixels, samples = grid.side * grid.side, grid.samples
    plane, n, writing = samples * pixels, 0, len(out) > 0
    for slot in slots:
        for p in range(pixels):
            done = 0
            for s in range(samples):
                t = kept[slot, s * pixels + p]
                if t < 0 or done >> s & 1:
                    continue
                mask = 1 << s
                if not every:
                    for other in range(s + 1, samples):
                        if kept[slot, other * pixels + p] == t:
                            mask |= 1 << other
                done |= mask
                if writing:
                    masks[n] = mask
                    for k in range(3):
                        out[n, k] = colors[slot, k * plane + s * pixels + p]
                n += 1
    return n


def fragments(runs: Array, grid: Grid, every: bool, kept: Array, colors: Array) -> tuple[Array, Array]:
    """The fragments in the tiles of `runs`: (n,) uint16 samples that each has, and (n, 3) float32 colours.

    Args:
        every: Each sample is a fragment of its own (supersampling).
        kept: From `keep`.
        colors: (tiles, 4 * samples * side^2) float32, from `shade`.
    """
    slots, nothing = np.unique(runs[::3]), np.empty(0, np.uint16)
    n = _fragments(slots, grid, every, kept, colors, nothing, np.empty((0, 3), np.float32))
    masks, out = np.empty(n, np.uint16), np.empty((n, 3), np.float32)
    if n:
        _fragments(slots, grid, every, kept, colors, masks, out)
    return masks, out


@jit.kernel
def _place(slots, grid, ids, offsets, place, masks, found, exposure, background, color, linear, colors):
    side, samples, pixels = grid.side, grid.samples, grid.side * grid.side
    plane, to_samples, joint, sums = samples * pixels, len(colors) > 0, len(masks) > 0, np.zeros(4 * pixels, np.float32)
    for slot in slots:
        sums[:] = _F(0.0)
        for p in range(pixels):
            done = np.int64(0)
            for s in range(samples):
                t = ids[slot, s * pixels + p]
                if t < 0 or done >> s & 1:
                    continue
                owner = _owner(offsets, t)
                n = place[owner]
                place[owner] += 1
                mask = np.int64(masks[n]) if joint else np.int64(1) << s
                done |= mask
                if to_samples:
                    for other in range(s, samples):
                        if mask >> other & 1:
                            for k in range(3):
                                colors[slot, k * plane + other * pixels + p] = found[n, k]
                            colors[slot, 3 * plane + other * pixels + p] = _F(1.0)
                    continue
                share = _F(count_bits(np.uint64(mask))) * (_F(1.0) / _F(samples))
                for k in range(3):
                    sums[k * pixels + p] += found[n, k] * share
                sums[3 * pixels + p] += share
        if not to_samples:
            number = grid.first + slot
            px, py = number % grid.across * side, number // grid.across * side
            write_tile(sums, False, side, grid.left + px, grid.top + py, min(side, grid.width - px), min(side, grid.height - py), exposure,
                       background, color, linear)  # fmt: skip


def place(slots: Array, grid: Grid, ids: Array, offsets: Array, masks: list[Array], found: list[Array], exposure: float, background: Array,
          color: Array, linear: Array, colors: Array) -> None:  # fmt: skip
    """Put the fragments that owners have returned where they belong: into the picture, as `shade` does it, or into `colors`, for `resolve`.

    Args:
        slots: Rows of `ids` (tiles, ...) int32, the final ones.
        masks, found: Of each owner, from `returned`.
        exposure, background, color, linear: As of `Look` and `Target`.
        colors: (tiles, 4 * samples * side^2) float32, cleared in `slots`; or without rows.
    """
    counts = np.array([len(part) for part in found], np.int64)
    _place(slots, grid, ids, offsets, np.cumsum(counts) - counts, np.concatenate(masks), np.concatenate(found), _F(exposure), background, color,
           linear, colors)  # fmt: skip


def returned(claimed: list[Array], grid: Grid, every: bool, kept: Array, colors: Array, comm: Comm) -> tuple[list[Array], list[Array]]:
    """Send the colours of what ranks have claimed of this one back to them; returns the masks and colours that come from each owner.

    Masks are sent where they are not known: where a fragment may have several samples.
    """
    made = [fragments(runs, grid, every, kept, colors) for runs in claimed]
    found = comm.exchange([colors for _, colors in made])
    if every or grid.samples == 1:
        return [np.empty(0, np.uint16)] * comm.size, found
    return comm.exchange([masks for masks, _ in made]), found
