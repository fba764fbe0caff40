"""Ambient occlusion: how much of a white sky, not farther away than some distance, each luxel sees."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.radiosity.direct import shine, sky_table
from luxel.radiosity.element import find_free
from luxel.radiosity.elements import frames_of_texels
from luxel.radiosity.labour import Labour
from luxel.radiosity.rays import Occluders
from luxel.raster.geometry import flatten

if TYPE_CHECKING:
    from luxel.radiosity.luxels import Luxels
    from luxel.radiosity.unwrap import Atlas


def ambient_occlusion(atlas: Atlas, luxels: Luxels, distance: float, directions: int = 512, threads: int | None = None,
                      labour: Labour | None = None) -> Array:  # fmt: skip
    """The share of a uniform sky's irradiance that reaches each luxel (Zhukov, Iones and Kronin 1998, "An ambient light illumination model").

    Args:
        atlas, luxels: Of a bake.
        distance: Metres beyond which nothing hides the sky.
        directions: Over the whole sphere, the same for all luxels.
        threads: None: all cores this process may use. The result does not depend on it.
        labour: Who does the work, in place of so many threads.

    Returns:
        (n,) float32, 0 (dark) to 1.

    Raises:
        InputError: The distance is not above 0.
    """
    if not 0 < distance < np.inf:
        raise InputError(f"distance of ambient occlusion: expected metres above 0, got {distance!r}")
    u, v = frames_of_texels(atlas, flatten(atlas.scene, "none"), luxels)
    columns = (luxels.position, luxels.normal, luxels.face_normal, luxels.area[:, None], u, v, np.zeros((len(u), 1)))
    numbers = np.concatenate(columns, 1, dtype=np.float32).T
    rays = Occluders.of_scene(atlas.scene).occlusion
    sky = sky_table(np.ones(3), directions)
    labour = labour or Labour(jit.checked_threads(threads))

    def seen(some: Any) -> Array:
        own = np.ascontiguousarray(numbers[:, some])
        find_free(rays, atlas.chart, luxels.chart[some], own, labour.threads)
        return shine(rays, own, sky, distance, labour.threads)[0]

    return np.clip(labour.each(len(luxels.area), seen) / np.float32(np.pi), 0, 1)
