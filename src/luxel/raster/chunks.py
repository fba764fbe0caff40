"""Chunks: which triangles and vertices can touch a part of the screen, found without looking at each of them.

Every 128 triangles that follow each other are a chunk, with a box around it and a list of the blocks of 256 vertices that it uses. What is not in a
chunk whose box touches the part is neither projected nor binned. Boxes are judged by the planes of the part, in float64, with two pixels to spare, so
nothing is lost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.raster.bin import CHUNK_LOG2
from luxel.raster.geometry import Geometry
from luxel.raster.project import BLOCK, View, Window

_SPARE = 2.0  # pixels
_SEARCHED = 16  # the latest blocks of vertices in which a block is looked for; one that comes twice does no harm


class Chunks(NamedTuple):
    """Chunks of a geometry's triangles.

    Attributes:
        boxes: (c, 6) float64, least and largest coordinates.
        start: (c + 1,) int64, where the blocks of each chunk begin.
        blocks: (k,) int32, blocks of vertices.
        vertex_blocks: How many of those there are.
    """

    boxes: Array
    start: Array
    blocks: Array
    vertex_blocks: int


class Reach(NamedTuple):
    """(c,) uint8: chunks of triangles that count; (b,) uint8: blocks of vertices that do. Without rows: all of them."""

    chunks: Array
    blocks: Array


EVERYWHERE = Reach(np.empty(0, np.uint8), np.empty(0, np.uint8))


@jit.kernel
def _chunk(positions, triangles, boxes, start, blocks):
    """Write the boxes, where each chunk's blocks begin, and the blocks if there is room; returns their number."""
    size, k, writing = 1 << CHUNK_LOG2, 0, len(blocks) > 0
    own = np.empty(3 * size, np.int32)
    for c in range(len(boxes)):
        box, found = boxes[c], 0
        for axis in range(3):
            box[axis], box[3 + axis] = np.inf, -np.inf
        for t in range(c * size, min(len(triangles), (c + 1) * size)):
            for corner in range(3):
                v = triangles[t, corner]
                block, known = v // BLOCK, False
                for i in range(max(0, found - _SEARCHED), found):
                    known |= own[i] == block
                if not known:
                    own[found] = block
                    found += 1
                for axis in range(3):
                    x = np.float64(positions[v, axis])
                    box[axis], box[3 + axis] = min(box[axis], x), max(box[3 + axis], x)
        start[c] = k
        if writing:
            blocks[k : k + found] = own[:found]
        k += found
    start[len(boxes)] = k
    return k


def chunks_of(geometry: Geometry) -> Chunks:
    """The chunks of a geometry, for `reach`."""
    count = -(-len(geometry.triangles) // (1 << CHUNK_LOG2))
    boxes, start = np.empty((count, 6)), np.zeros(count + 1, np.int64)
    arrays = geometry.positions, geometry.triangles, boxes, start
    blocks = np.empty(_chunk(*arrays, np.empty(0, np.int32)), np.int32)
    if len(blocks):
        _chunk(*arrays, blocks)
    return Chunks(boxes, start, blocks, -(-len(geometry.positions) // BLOCK))


@jit.kernel
def _reach(boxes, start, blocks, planes, chunks_out, blocks_out):
    for c in range(len(boxes)):
        outside = False
        for k in range(len(planes)):  # the corner that lies farthest inside
            far = planes[k, 3]
            for axis in range(3):
                far += planes[k, axis] * (boxes[c, 3 + axis] if planes[k, axis] > 0.0 else boxes[c, axis])
            if far < 0.0:
                outside = True
                break
        if not outside:
            chunks_out[c] = 1
            for k in range(start[c], start[c + 1]):
                blocks_out[blocks[k]] = 1


def reach(chunks: Chunks, view: View, window: Window, bounds: tuple[int, int, int, int]) -> Reach:
    """What may touch the rectangle `bounds` (left, top, right, bottom in pixels of the window)."""
    out = Reach(np.zeros(len(chunks.boxes), np.uint8), np.zeros(chunks.vertex_blocks, np.uint8))
    x, y, _, w = view.clip_from_world
    left, right = ((window.x + side) / window.full_width * 2 - 1 for side in (bounds[0] - _SPARE, bounds[2] + _SPARE))
    top, bottom = (1 - (window.y + side) / window.full_height * 2 for side in (bounds[1] - _SPARE, bounds[3] + _SPARE))
    planes = np.stack([top * w - y, y - bottom * w, x - left * w, right * w - x, w])  # a point is inside where all are at least 0
    with np.errstate(all="ignore"):
        _reach(chunks.boxes, chunks.start, chunks.blocks, planes, *out)
    return out
