"""Lights: those of KHR_lights_punctual, and a hemispherical ambient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError


@dataclass(eq=False)
class Light:
    """A point, spot or directional light.

    Attributes:
        kind: "point", "spot" or "directional".
        color: Linear RGB.
        intensity: Radiant intensity in W/sr for point and spot, irradiance in W/m2 for directional (glTF's cd and lux, taken as they
            are). A white surface that faces a directional light of intensity pi shows 1.
        world_from_light: (4, 4) float64; the light shines along its -z, from its origin.
        range: Metres beyond which a point or spot light gives nothing; inf for none.
        inner_cone, outer_cone: Radians from the axis, of a spot.
        name: As in the file; may be empty.

    Raises:
        InputError: No such kind, or the matrix is not (4, 4).
    """

    kind: Literal["point", "spot", "directional"] = "directional"
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    intensity: float = float(np.pi)
    world_from_light: Array | None = None
    range: float = float("inf")
    inner_cone: float = 0.0
    outer_cone: float = float(np.pi / 4)
    name: str = ""

    def __post_init__(self) -> None:
        if self.kind not in ("point", "spot", "directional"):
            raise InputError(f"light kind: expected point, spot or directional, got {self.kind!r}")
        matrix = np.eye(4) if self.world_from_light is None else self.world_from_light
        self.world_from_light = checked(matrix, (4, 4), np.float64, "world_from_light")


@dataclass(eq=False)
class Ambient:
    """Light from all around, interpolated by the normal's y between ground and sky.

    Attributes:
        sky, ground: Linear RGB radiance, W/(m2 sr); a white surface under sky = (1, 1, 1) alone shows 1.
    """

    sky: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ground: tuple[float, float, float] = (0.0, 0.0, 0.0)
