"""GPUs that transform vertices in batches (Kerbl et al. 2018, "Revisiting The Vertex Cache"), as meshoptimizer models them.

A batch ends, and the cache with it, before a triangle whose new vertices no longer fit into the warp, and after `group` triangles.
Within a batch vertices are kept as in a FIFO of `cache`. The models are gross: they rank orders, they do not predict milliseconds. State
the model with every figure.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.layout.cache import used_vertices
from luxel.layout.checks import MOST_INDICES, checked_triangles, whole


class Model(NamedTuple):
    """A GPU's vertex reuse.

    Attributes:
        cache: Vertices the FIFO holds.
        warp: New vertices of a batch, or 0 for no limit.
        group: Triangles of a batch, or 0 for no limit.
    """

    cache: int
    warp: int = 0
    group: int = 0


MODELS = {"nvidia": Model(32, 32, 32), "amd": Model(14, 64, 128), "intel": Model(128), "mobile": Model(16)}
"""nvidia, amd and intel are those that meshoptimizer measures by. mobile is a plain FIFO of 16: tilers keep a small post-transform cache,
whose size makers do not publish; 16 is what their guides and exporters assume."""


class Reuse(NamedTuple):
    """What a model says of an order.

    Attributes:
        transformed: Vertices transformed, counted as often as it happens.
        batches: Warps started; 0 or 1 if the model has no batches.
        acmr: transformed / triangles; best 0.5 on a large closed mesh, worst 3.
        atvr: transformed / vertices used; best 1, worst about 6.
    """

    transformed: int
    batches: int
    acmr: float
    atvr: float


@jit.kernel
def _batches(triangles, cache, warp, group, stamp, missed):
    """Misses of each triangle and how many batches there were; `stamp` (n,) int64 holds 0."""
    now = np.int64(cache)
    batches, in_warp, in_group = 0, 0, 0
    for t in range(len(triangles)):
        new = 0
        for corner in range(3):
            new += now - stamp[triangles[t, corner]] >= cache
        if (group and in_group == group) or (warp and in_warp + new > warp):
            batches += in_warp > 0
            in_warp = in_group = 0
            now += cache
        misses = 0
        for corner in range(3):
            v = triangles[t, corner]
            if now - stamp[v] >= cache:
                now += 1
                stamp[v] = now
                misses += 1
        missed[t] = misses
        in_warp += misses
        in_group += 1
    return batches + (in_warp > 0)


def model_of(model: str | Model) -> Model:
    """The model of that name, or the model given, checked.

    Raises:
        InputError: There is no model of that name, or its cache or warp holds fewer than 3 vertices.
    """
    if isinstance(model, str):
        if model not in MODELS:
            raise InputError(f"profile: expected one of {', '.join(MODELS)}, got {model!r}")
        return MODELS[model]
    cache, warp, group = model
    whole(cache, "cache", 3)
    whole(group, "group", 0)
    if whole(warp, "warp", 0) in (1, 2):
        raise InputError(f"warp: expected 0 (no limit) or at least 3, got {warp}")
    return model


def misses(triangles: object, model: str | Model, vertex_count: int | None = None) -> Array:
    """(m,) uint8 vertices each triangle makes the GPU transform.

    Raises:
        InputError: An index is out of range, or `model_of` refuses the model.
    """
    faces, n = checked_triangles(triangles, vertex_count)
    return _simulate(faces, n, model_of(model))[0]


def reuse(triangles: object, model: str | Model, vertex_count: int | None = None) -> Reuse:
    """What `model` says of drawing `triangles`, (m, 3) int32, in this order.

    Raises:
        InputError: An index is out of range, there are no triangles, or `model_of` refuses the model.
    """
    faces, n = checked_triangles(triangles, vertex_count, empty=False)
    missed, batches = _simulate(faces, n, model_of(model))
    transformed = int(missed.sum(dtype=np.int64))
    return Reuse(transformed, batches, transformed / len(faces), transformed / used_vertices(faces, n))


def _simulate(faces: Array, n: int, model: Model) -> tuple[Array, int]:
    missed = np.empty(len(faces), np.uint8)
    cache = min(model.cache, MOST_INDICES)
    return missed, int(_batches(faces, cache, model.warp, model.group, np.zeros(n, np.int64), missed))
