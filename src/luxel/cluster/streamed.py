"""Streamed: a share of a file that is drawn piece by piece and never held whole, so that a rank's memory does not grow with the mesh.

Each piece is read, projected, binned and covered, and what is nearest stays, as code: eight times the triangle, plus which of its clipped pieces.
Then the triangles that are seen anywhere are read again, with their vertices, and take the place of the geometry that is composited and shaded.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cluster.codes import CODE, take_nearer, to_drawn
from luxel.cluster.ply_share import Stream
from luxel.cluster.sort_last import ObjectBand
from luxel.memory import reusable
from luxel.raster.bin import NO_CLIPPED, OPAQUE, Parts, bin_triangles
from luxel.raster.clip import clip
from luxel.raster.constants import NOTHING
from luxel.raster.cover import BEHIND, cover
from luxel.raster.fragments import drawn
from luxel.raster.frame import see
from luxel.raster.lanes import LANES
from luxel.raster.project import project
from luxel.raster.render import prepare


class StreamedBand(ObjectBand):
    """A window of which a rank draws what a file has, piece by piece."""

    def __init__(self, stream: Stream, looks: tuple[str | None, str], *rest: Any) -> None:
        self.stream, self.looks = stream, looks
        super().__init__(*rest)

    def _tile_bytes(self) -> int:  # smaller bands than elsewhere, since memory is what this is for; the file is read once for each
        return 2 * super()._tile_bytes()

    def _visible(self, first: int, last: int) -> tuple[Array, Array]:
        shape = last - first, self.pixels + LANES
        codes, nearest = reusable(shape, np.int32), reusable(shape, np.float32)
        codes.fill(NOTHING)
        nearest.fill(BEHIND)
        touched = np.zeros(last - first, bool)
        for start, positions, triangles in self.stream.pieces():
            touched |= self._draw_piece(first, last, start, positions, triangles, codes, nearest)
        self.occupied[first:last] = touched
        slots = np.flatnonzero(touched)
        found = [np.unique(codes[slot][codes[slot] >= 0] >> CODE) for slot in slots]
        self.numbers = np.unique(np.concatenate([np.zeros(0, np.int32), *found])).astype(np.int32)
        self._look_again()
        begin = np.searchsorted(self.clipped.source, np.arange(len(self.numbers)))
        to_drawn(slots, self.pixels, codes, self.numbers, len(self.numbers), begin)
        return codes, nearest

    def _draw_piece(self, first: int, last: int, start: int, positions: Array, triangles: Array, codes: Array, nearest: Array) -> Array:
        """Merge a piece into `codes` and `nearest`; returns (tiles,) bool, where it has drawn."""
        o, w, threads = self.options, self.window, self.options.threads or 1
        screen, unsafe = project(positions, self.seen.view, w, threads)
        clipped = clip(positions, triangles, screen, self.seen.view, w, threads) if unsafe else NO_CLIPPED
        parts = Parts(np.array([0, len(triangles)], np.int32), np.zeros(1, np.int32), self.cull)
        bins = bin_triangles(triangles, screen, clipped, parts, OPAQUE, o.positions, w, o.tile, threads, self._bounds())
        ids, depths = reusable(codes.shape, np.int32), reusable(codes.shape, np.float32)
        cover(bins, triangles, screen, clipped, o.positions, w.width, w.height, first, last, ids, depths, threads)
        touched = np.diff(bins.start)[first:last] > 0
        piece = (np.arange(len(clipped.source)) - np.searchsorted(clipped.source, clipped.source) + 1).astype(np.int32)
        take_nearer(np.flatnonzero(touched), self.pixels, ids, depths, start, len(triangles), clipped.source, piece, codes, nearest)
        return touched

    def _bin(self) -> None:
        self.cull = self.seen.geometry.parts.cull_back[:1]
        super()._bin()

    def _look_again(self) -> None:
        """The triangles `numbers` alone, as what is drawn."""
        seen, threads = self.seen, self.options.threads or 1
        prepared = prepare(self.stream.scene(self.numbers), *self.looks)
        size = self.window.full_width, self.window.full_height
        self.seen = see(prepared, seen.camera, size, None, threads)._replace(previous=seen.previous)
        geometry = self.seen.geometry
        self.screen, unsafe = project(geometry.positions, seen.view, self.window, threads)
        self.clipped = clip(geometry.positions, geometry.triangles, self.screen, seen.view, self.window, threads) if unsafe else NO_CLIPPED
        self.drawn = drawn(geometry, self.screen, self.clipped)
