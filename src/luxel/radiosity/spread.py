"""Values grow from the texels that have one into those that have none."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array

# The eight neighbours, and how much each counts: by its distance.
_NEIGHBOURS = [(dy, dx, (dy * dy + dx * dx) ** -0.5) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]


def spread(pages: Array, known: Array, wanted: Array, steps: int | None = None, label: Array | None = None) -> tuple[Array, Array]:
    """Give texels that are wanted and not known the mean of their known neighbours, ring by ring.

    Args:
        pages: (p, h, w, c) float32; not changed.
        known: (p, h, w) bool: texels that have a value.
        wanted: (p, h, w) bool: texels that may get one.
        steps: Rings at most; None goes on until nothing more can be reached.
        label: (p, h, w) int32: values go only between texels of equal label. None: everywhere on the page.

    Returns:
        The pages, a copy, and what is known now.
    """
    p, h, w, c = pages.shape
    width = w + 2
    # A border of one texel that is never known, so that every texel has eight neighbours.
    values = np.zeros((p, h + 2, width, c), np.float32)
    values[:, 1:-1, 1:-1] = pages
    have = np.pad(known, ((0, 0), (1, 1), (1, 1)))
    open_ = np.pad(wanted, ((0, 0), (1, 1), (1, 1))) & ~have
    labels = None if label is None else np.pad(label, ((0, 0), (1, 1), (1, 1)), constant_values=-1).reshape(-1)
    flat, has, todo = values.reshape(-1, c), have.reshape(-1), np.flatnonzero(open_)
    while len(todo) and (steps is None or steps > 0):
        total, weight = np.zeros((len(todo), c), np.float32), np.zeros(len(todo), np.float32)
        for dy, dx, share in _NEIGHBOURS:
            near = todo + (dy * width + dx)
            use = has[near] if labels is None else has[near] & (labels[near] == labels[todo])
            factor = use * np.float32(share)
            total += flat[near] * factor[:, None]
            weight += factor
        reached = weight > 0
        if not reached.any():
            break
        flat[todo[reached]] = total[reached] / weight[reached, None]
        has[todo[reached]] = True
        todo = todo[~reached]
        steps = None if steps is None else steps - 1
    return np.ascontiguousarray(values[:, 1:-1, 1:-1]), np.ascontiguousarray(have[:, 1:-1, 1:-1])
