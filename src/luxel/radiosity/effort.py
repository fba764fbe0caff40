"""Effort: what a bake of some quality keeps and does, told before it begins."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from luxel.errors import InputError
from luxel.radiosity.diagnosis import Shooting, check_memory, work_of
from luxel.radiosity.labour import Labour
from luxel.radiosity.lamps import Lamps
from luxel.radiosity.quality import Quality
from luxel.radiosity.solve import Problem
from luxel.radiosity.spots import most_spot_rows
from luxel.radiosity.transport import ROW_BYTES

_MOST_KEPT = 8 << 30
"""A transport may be so large."""

_SEEN = 128
"""Rays by which elements look around for a transport that is kept, where they do not for the bake."""


class Rays(NamedTuple):
    """By how many rays each element looks around: what they meet is kept; and once more for the last bounce, of which nothing is."""

    kept: int
    gathered: int


def rays_of(settings: Quality, sky: bool) -> Rays:
    """Twice as many under a sky, as windows are to be found."""
    times = 2 if sky else 1
    return Rays(times * (settings.seen or _SEEN), times * settings.gathered)


def effort(settings: Quality, sky: bool, glows: bool) -> tuple[int, float, Shooting | None, int]:
    """What `diagnosis.estimate` asks for: rays that are kept, the work of a luxel, what shoots, and points of spots; of a scene with or without a
    sky, and whether any surface glows."""
    looks = settings.seen > 0
    rays = rays_of(settings, sky)
    work = work_of(rays.kept if looks or sky else 0, rays.gathered, looks and settings.unlike < math.inf, sky)
    if looks and not settings.exact:
        return rays.kept, work, None, settings.spot_points
    lights = settings.light_points if glows else 0
    shooting = Shooting(lights, settings.rays, 0.0 if looks else settings.patch, settings.tolerance, ROW_BYTES)
    return rays.kept, work, shooting, settings.spot_points


def memory_check(settings: Quality, lamps: Lamps, density: float | None, labour: Labour) -> Callable[[float, int], None]:
    """Refuses so many luxels, of so many triangles, if they do not fit in memory."""
    rays, ranks = rays_of(settings, lamps.sky is not None).kept, labour.team.size
    return partial(check_memory, rays=rays // ranks, spots=settings.spot_points // ranks, density=density, here=labour.team.here)


def kept_rows(problem: Problem, settings: Quality, rays: int, keep: bool, labour: Labour) -> tuple[int, int, int]:
    """How many rows are kept: of the patches what fits, if they shoot; of the lights all if they must be; of spots, at most."""
    n, patches = problem.elements.numbers.shape[1], len(problem.patches.tree.patches)
    lights = 0 if problem.lights is None else len(problem.lights.tree.patches)
    spots = most_spot_rows(n, settings)
    wanted = 2 * n * (lights + spots) + 4 * n * rays
    if keep and wanted > _MOST_KEPT:
        raise InputError(f"transport: {wanted / 1e9:.1f} GB for {lights} lights and {n} luxels, at most {_MOST_KEPT / 1e9:.0f} GB: bake coarser")
    return 0 if settings.seen else min(patches, labour.team.size * ROW_BYTES // (2 * n)), lights if keep else 0, spots
