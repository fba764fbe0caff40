"""Form factors on a GPU: what stands for the processor's loop over pairs in `luxel.radiosity.form_factors`."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cuda.device import find
from luxel.cuda.threads.pairs import BLOCKERS, COUNTS, LEVELS, PIECE_CORNERS, PIECES, RAYS, WAITING, Found, Room
from luxel.errors import DeviceError, LuxelWarning
from luxel.radiosity.pairs import Wanted, World

_PAIRS = 1 << 23  # of polygons, in one launch
_HIDDEN = 1 << 18  # pairs in one launch that something stands between: after each, Ctrl-C is heard
_ROWS = 32768  # of a grid
_THREADS = 1 << 15  # that such pairs are shared out to
_ROOM = 8 * (LEVELS * BLOCKERS + (PIECES + 2) * PIECE_CORNERS * 3 + PIECES + 2 * RAYS * 4)  # bytes a thread


def pairs_on(device: str, world: World, starts: Array, wanted: Wanted) -> GpuPairs | None:
    """Who finds the exchanges of a world's surfaces on `device`; None for the processor.

    Raises:
        InputError: No such device.
        ExtraMissingError, DeviceError: "cuda", and it cannot be used, or has too little memory.
    """
    gpu = find(device, "form factors", 5)
    if gpu is None:
        return None
    try:
        return GpuPairs(gpu, world, starts, wanted)
    except DeviceError as error:
        if device == "cuda":
            raise
        warnings.warn(f"device auto: form factors on the processor: {error}", LuxelWarning, stacklevel=4)
        return None


class GpuPairs:
    """Exchanges of all pairs of polygons, by a GPU.

    Args:
        gpu: A `luxel.cuda.device.Gpu`.
        world: What there is; starts: (n + 1,) int64: where each surface's polygons begin.
        wanted: How good.
        kernels: What is launched: `luxel.cuda.pair_kernels`.
    """

    def __init__(self, gpu: Any, world: World, starts: Array, wanted: Wanted, kernels: Any = None) -> None:
        if kernels is None:
            from luxel.cuda import pair_kernels as kernels
        self.gpu, self.kernels, self.wanted, self.host_starts = gpu, kernels, wanted, starts
        polygons = len(world.polygons.area)
        self.rows = max(1, min(_PAIRS // max(polygons, 1), polygons, _ROWS))
        self.threads = max(128, min(_THREADS, gpu.free_memory() // (4 * _ROOM)))
        needed = 20 * self.rows * polygons + self.threads * _ROOM + sum(a.nbytes for a in (*world.polygons, *world.obstacles, *world.occlusion))
        gpu.expect(needed, f"form factors of {polygons} polygons", "fewer")
        self.world, self.starts = gpu.copied(world), gpu.array(starts)
        shape, t = (self.rows, polygons), self.threads
        self.values, self.errors = gpu.empty(shape, np.float64), gpu.empty(shape, np.float64)
        self.queue, self.counts = gpu.empty((self.rows * polygons,), np.int32), gpu.empty((COUNTS,), np.int64)
        self.room = Room(
            gpu.empty((t, LEVELS, BLOCKERS), np.int64), gpu.empty((t, PIECES + 2, PIECE_CORNERS, 3), np.float64), gpu.empty((t, PIECES), np.int64),
            gpu.empty((t, 2, RAYS, 4), np.float64),
        )  # fmt: skip

    def fill(self, first: int, block: Array, errors: Array) -> None:
        """Exchanges of the surfaces first, first + 1, ... with those not before them, into `block` and `errors`, (k, n) float64 zeros."""
        gpu, there, wrong = self.gpu, self.gpu.array(block), self.gpu.array(errors)
        start, end = self.host_starts[first], self.host_starts[first + len(block)]
        for polygon in range(start, end, self.rows):
            found = self._found(polygon, min(self.rows, end - polygon))
            gpu.launch(self.kernels.add_pairs, (block.shape[1], len(block)), first, self.starts, found, there, wrong)
        block[:], errors[:] = gpu.host(there), gpu.host(wrong)

    def _found(self, first: int, count: int) -> Found:
        """The exchanges of `count` polygons with those after them."""
        gpu, k, polygons = self.gpu, self.kernels, self.values.shape[1]
        gpu.send(np.zeros(COUNTS, np.int64), self.counts)
        found = Found(first, self.values, self.errors, self.queue, self.counts)
        gpu.launch(k.exchange_plain, (polygons, count), self.world, self.wanted, found)
        waiting = int(gpu.host(self.counts)[WAITING])
        for row in range(0, waiting, _HIDDEN):
            last = min(waiting, row + _HIDDEN)
            gpu.send(np.array([waiting, row]), self.counts)
            gpu.launch(k.exchange_hidden, (min(self.threads, last - row), 1), last, self.world, self.wanted, found, self.room)
            gpu.wait()
        return found
