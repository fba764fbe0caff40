"""Quality: how finely a bake cuts light, by name or in full."""

from __future__ import annotations

import math
from typing import NamedTuple

from luxel.errors import InputError
from luxel.radiosity.hemicube import RESOLUTIONS


class Quality(NamedTuple):
    """How finely the light is cut.

    Attributes:
        light_points: About so many points for all emitting surfaces, each of which shoots.
        spot_points: The same for surfaces so bright in the light of these that they shoot as they do (`spots`); 0: none does.
        light_resolution: Pixels along a face of a light's hemicube.
        rays: Samples of elements near a light at which each part of it is looked at, by rays; 0: none.
        seen: Rays by which each element looks around, and through which light is then passed on; 0: patches shoot it, as the lights do.
        gathered: Rays by which each element looks around once more for the last bounce; 0: it does not.
        unlike: If not, it looks closer for the last bounce where what it sees differs by more than so many times the mean (`closer`).
        tolerance: The unshot share of the light at which to stop.
        patch: Luxels along the side of a patch, where the surface is flat.
        resolution: Pixels along a face of a patch's hemicube.
        exact: Rays for all pairs of shooter and element: slow.
    """

    light_points: int
    light_resolution: int
    rays: int
    seen: int
    gathered: int
    unlike: float = math.inf
    tolerance: float = 1e-3
    patch: float = 12
    resolution: int = 64
    exact: bool = False
    spot_points: int = 0


QUALITIES = {
    "draft": Quality(64, 64, 4, 64, 0, unlike=4.0, spot_points=128),
    "normal": Quality(256, 128, 4, 128, 0, unlike=4.0, spot_points=256),
    "final": Quality(1024, 128, 16, 128, 1024, spot_points=512),
    "reference": Quality(256, 16, 64, 256, 4096, exact=True),
    "progressive": Quality(256, 128, 4, 0, 0, patch=6),
}


def checked_quality(quality: str | Quality, tolerance: float | None = None) -> Quality:
    """A quality, by its name or as it is, with another tolerance if one is given.

    Raises:
        InputError: There is none of this name, or a bake cannot work with one of its values.
    """
    if not isinstance(quality, Quality):
        if quality not in QUALITIES:
            raise InputError(f"quality: expected {', '.join(QUALITIES)}; got {quality!r}")
        quality = QUALITIES[quality]
    if tolerance is not None:
        if not 0 < tolerance <= 1:
            raise InputError(f"tolerance: expected a share between 0 and 1, got {tolerance!r}")
        quality = quality._replace(tolerance=float(tolerance))
    for name in ("light_resolution", "resolution"):
        if not 2 <= getattr(quality, name) <= RESOLUTIONS[-1] or getattr(quality, name) % 2:
            raise InputError(f"quality: expected an even {name} from 2 to {RESOLUTIONS[-1]}, got {getattr(quality, name)!r}")
    if quality.seen < 0 or quality.seen & (quality.seen - 1):
        raise InputError(f"quality: expected a power of two as the number of rays that elements see by, or 0, got {quality.seen!r}")
    return quality
