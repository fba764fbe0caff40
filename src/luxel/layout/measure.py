"""Every measure of a layout at once, for reports: what the caches, the rasteriser and the memory say of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.layout import batch
from luxel.layout.cache import misses, used_vertices
from luxel.layout.fetch import edge_span, fetched
from luxel.layout.overdraw import Overdraw, overdraw

CACHES = (12, 16, 24, 32)


class Draw(NamedTuple):
    """What one draw call reads.

    Attributes:
        triangles: (m, 3) int32.
        vertices: How many its vertex buffer has.
        stride: Bytes of a vertex.
    """

    triangles: Array
    vertices: int
    stride: int


@dataclass(frozen=True)
class Measures:
    """A layout in numbers; each draw call begins with empty caches.

    Attributes:
        triangles, vertices: Counts; `vertices` are those that triangles use.
        acmr: Misses per triangle of a FIFO of 12, 16, 24 and 32. Best: vertices / triangles, about 0.5; worst 3.
        atvr: Vertices transformed per vertex, by GPU model (`batch.MODELS`). Best 1, worst about 6.
        overdraw: Shaded over covered pixels, mean over 32 views, back faces as the materials have them. Best 1. None if there is nothing to see.
        worst_overdraw: Of the worst view.
        overfetch: Bytes of vertices read over their size, through 128 KiB of cache. Best about 1. None if it was not measured.
        edge_span: How far the two ends of an edge are apart in the vertex buffer, geometric mean. Best just above 1. None likewise.
    """

    triangles: int
    vertices: int
    acmr: dict[int, float] = field(default_factory=dict)
    atvr: dict[str, float] = field(default_factory=dict)
    overdraw: float | None = None
    worst_overdraw: float | None = None
    overfetch: float | None = 1.0
    edge_span: float | None = 1.0

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        return asdict(self)


def measure(draws: Sequence[Draw], seen: tuple[Array, Array, Array] | None = None, threads: int | None = None) -> Measures:
    """Measure draw calls.

    Args:
        draws: In their order.
        seen: Positions (n, 3), triangles (m, 3) and (m,) bool "its back face is not drawn", in world space and drawing order; None leaves
            overdraw out.
        threads: For overdraw.
    """
    draws = [draw for draw in draws if len(draw.triangles)]
    triangles = sum(len(draw.triangles) for draw in draws)
    vertices = [used_vertices(draw.triangles, draw.vertices) for draw in draws]
    if not draws:
        return Measures(0, 0)
    acmr = {k: sum(_total(misses(d.triangles, k, "fifo", d.vertices)) for d in draws) / triangles for k in CACHES}
    atvr = {model: sum(_total(batch.misses(d.triangles, model, d.vertices)) for d in draws) / sum(vertices) for model in batch.MODELS}
    read = sum(fetched(d.triangles, d.vertices, d.stride).bytes for d in draws)
    size = sum(count * d.stride for count, d in zip(vertices, draws, strict=True))
    view = _overdraw(seen, threads)
    return Measures(triangles, sum(vertices), acmr, atvr, view and view.mean, view and view.worst, read / size, _edge_span(draws))


def _edge_span(draws: Sequence[Draw]) -> float:
    """Over all draw calls, each with the weight of its triangles; those that have no edge are left out."""
    spans = []
    for draw in draws:
        a, b, c = draw.triangles.T
        if ((a != b) | (b != c)).any():
            spans.append((len(draw.triangles), np.log(edge_span(draw.triangles, draw.vertices))))
    return float(np.exp(sum(m * span for m, span in spans) / sum(m for m, _ in spans))) if spans else 1.0


def _total(missed: Array) -> int:
    return int(missed.sum(dtype=np.int64))


def _overdraw(seen: tuple[Array, Array, Array] | None, threads: int | None) -> Overdraw | None:
    if seen is None:
        return None
    positions, triangles, cull = seen
    used = np.zeros(len(positions), bool)
    used[triangles] = True
    if not len(triangles) or not np.isfinite(positions[used]).all():
        return None
    found = overdraw(triangles, positions, cull=cull, threads=threads)
    return found if found.covered else None
