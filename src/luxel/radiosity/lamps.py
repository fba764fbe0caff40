"""Lamps: every light of a bake that has no surface, and whether anything shines at all."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import DarkError, InputError
from luxel.radiosity.direct import irradiances, light_table, sky_table
from luxel.radiosity.sky import Even, split
from luxel.scene.scene import Scene

_SUN_DIRECTIONS = 2048  # all around: what is much brighter than the rest of the sky is put into these


class Lamps(NamedTuple):
    """A `light_table`, its first `own` rows the scene's lights and the others the sun; and an even sky, or None."""

    table: Array
    own: int
    sky: Even | None

    @property
    def radiance(self) -> float:
        """Of the sky, which there must be, and the sun in it: the mean over all directions and channels, W/(m2 sr)."""
        assert self.sky is not None
        return self.sky.mean + irradiances(self.table[self.own :]) / (4 * np.pi)


def lamps_of(scene: Scene, sky: Any) -> Lamps:
    """The lights of a scene and a sky.

    Args:
        sky: Radiance, W/(m2 sr): a number, (3,), or an equirectangular (h, w, 3) picture; None: no sky.

    Raises:
        DarkError: Neither lamps, materials nor the sky shine.
        InputError: The sky is nothing of these, or a lamp or a material takes light away.
    """
    radiance = _radiance(sky)
    _check_lamps(scene)
    table = light_table(scene.lights)
    if not radiance.any():
        if not len(table) and not any(max(scene.materials[mesh.material].emissive) > 0 for mesh in scene.meshes if mesh.material >= 0):
            raise DarkError("bake: nothing shines: expected an emissive material, a light or a sky")
        return Lamps(table, len(table), None)
    even, sun = split(radiance)
    suns = sky_table(sun, _SUN_DIRECTIONS) if (sun > 0).any() else table[:0]
    return Lamps(np.concatenate([table, suns]), len(table), even)


def _check_lamps(scene: Scene) -> None:
    """Refuse lamps and materials that would take light away, and lamps that shine nowhere."""
    for number in sorted({mesh.material for mesh in scene.meshes if mesh.material >= 0}):
        material = scene.materials[number]
        if min(material.emissive) < 0:
            raise InputError(f"bake: {_named('material', number, material.name)}: expected emissive of at least 0, got {tuple(material.emissive)}")
    for number, light in enumerate(scene.lights):
        if min(channel * light.intensity for channel in light.color) < 0:
            what = f"intensity {light.intensity:g}, color {tuple(light.color)}"
            raise InputError(f"bake: {_named('light', number, light.name)}: expected an intensity and a color of at least 0, got {what}")
        if light.kind != "point" and light.world_from_light is not None and not np.linalg.norm(light.world_from_light[:3, 2]) > 0:
            raise InputError(f"bake: {_named('light', number, light.name)}: expected a direction, its transform has none")


def _named(kind: str, number: int, name: str) -> str:
    return f"{kind} {number} ({name!r})" if name else f"{kind} {number}"


def _radiance(sky: Any) -> Array:
    """(3,) or (h, w, 3)."""
    if sky is None:
        return np.zeros(3)
    wanted = "a number of W/(m2 sr), (3,), or a picture (h, w, 3)"
    try:
        radiance = np.asarray(sky)
    except ValueError as error:  # rows of unlike length
        raise InputError(f"sky: expected {wanted}, got {sky!r}") from error
    if radiance.dtype.kind not in "fiu":
        raise InputError(f"sky: expected {wanted}, got {sky!r}")
    if radiance.ndim == 0:
        radiance = np.full(3, float(radiance))
    if not radiance.size:
        raise InputError(f"sky: expected {wanted}, got {radiance.shape}")
    if not (np.isfinite(radiance).all() and np.min(radiance) >= 0):
        raise InputError("sky: expected finite radiance of at least 0")
    if radiance.shape != (3,) and (radiance.ndim != 3 or radiance.shape[2] != 3):
        raise InputError(f"sky: expected {wanted}, got {radiance.shape}")
    return radiance
