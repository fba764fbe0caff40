"""How much of a GPU's memory a bake takes, at most: known before it begins."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from luxel.radiosity.gather import View
from luxel.radiosity.hemicube import FACES, RESOLUTIONS
from luxel.radiosity.sky import TOGETHER
from luxel.radiosity.solve import BATCH, Problem
from luxel.radiosity.solve import at_once as shoot_at_once
from luxel.radiosity.transport import BLOCK

if TYPE_CHECKING:
    from luxel.radiosity.effort import Rays

RAYS_AT_ONCE = 1 << 26
"""Of one launch: after each, progress is told, and Ctrl-C heard."""

OWN = 1 << 29
"""Bytes for what threads have of their own, which the driver takes for as many as can run at once: 1.6 kB each in the largest of the kernels."""

# Bytes of an element: its frame and what goes away from it; light received, direct and to shoot, and all but the second for the next step; what is
# gained in a step and by it; what is sent; sums of rows of a batch. Of the state of a patch, and of choosing it.
_LOOKS, _STATE, _STEP, _GATHERS = 36 + 8, 36 + 24, 12 + 12 + 16, 16 + 12
_PATCH, _CHOSEN = 24 + 24 + 24 + 8, 8 + 4 + 4


def at_once(elements: int, rays: int) -> int:
    """How many of so many elements look anew by so many rays in one go: whole groups of neighbours, which tell each other what they see."""
    return min(elements, max(1, RAYS_AT_ONCE // (TOGETHER * rays)) * TOGETHER)


def needed(problem: Problem, view: View, rays: Rays, rows: tuple[int, int, int]) -> int:
    """Bytes that a bake takes of a GPU's memory, at most.

    Args:
        rays: Of each element.
        rows: Of patches, of lights and of spots, that are kept.
    """
    n, patches = view.numbers.shape[1], len(problem.patches.tree.patches)
    blocks, shooting = -(-n // BLOCK), rows[0] > 0
    hits = 4 * n * rays.kept
    cells = 8 * rays.kept * -(-n // TOGETHER)  # of the sky, before there is a state
    closer = 9 * rays.kept * -(-n // TOGETHER)  # of the last bounce, beside it
    if rays.gathered:
        looks = at_once(n, rays.gathered)
        closer = 12 * n + rays.gathered * (4 * looks + 8 * -(-looks // TOGETHER))  # of the last bounce, and of the sky that is seen with it
    slots = rows[1] + BATCH + rows[2] + (rows[0] + BATCH if shooting else 0)
    batches = [(min(BATCH, len(problem.lights.tree.patches)), problem.lights.resolution)] if problem.lights else []
    batches += [(shoot_at_once(patches), problem.patches.resolution)] if shooting else []
    batches += [(min(BATCH, rows[2]), RESOLUTIONS[-1])]
    cubes = sum((16 * shooters + 8) * FACES * size**2 + 8 * shooters * blocks for shooters, size in batches)
    kept = slots * (2 * n + blocks + 16)
    state = (_STATE + _STEP + _GATHERS) * n + (_PATCH + _CHOSEN) * patches
    return OWN + _constant(problem, view) + hits + _LOOKS * n + max(cells, state + closer) + kept + cubes


def _constant(problem: Problem, view: View) -> int:
    """Bytes of what is copied there once."""
    sources = [source for source in (problem.patches, problem.lights) if source]
    trees = [(source.tree.span, source.tree.child, source.tree.place, source.numbers, source.shooters) for source in sources]
    everything = view.scene, view.lookup, view.numbers, problem.elements, problem.albedo, problem.rays.scene, problem.occluders, trees
    return sum({array.ctypes.data: array.nbytes for array in _arrays(everything)}.values())


def _arrays(item: Any) -> Iterator[Any]:
    if isinstance(item, np.ndarray):
        yield item
    elif isinstance(item, (tuple, list)):
        for part in item:
            yield from _arrays(part)
