"""Light: radiance towards the eye from a batch of evaluated fragments. Flat loops over fragments that the compiler vectorises."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.jit import device, inlined
from luxel.raster.channels import (
    CA, CB, CG, CR, EB, EG, EMB, EMG, EMR, ER, LE, LX, LY, LZ, LMB, LMG, LMR, MODEL, NX, NY, NZ, OA, OB, OG, OR, PX, PY, PZ,
)  # fmt: skip
from luxel.raster.materials import EMISSIVE, LIGHTMAPPED, MODEL_LAMBERT, MODEL_MASK
from luxel.raster.surface import run_end
from luxel.scene.camera import Camera
from luxel.scene.light import Ambient, Light
from luxel.scene.scene import Scene

# Columns of `LightTable.lights`.
ORIGIN, PUNCTUAL, COLOR, INVERSE_RANGE, AXIS, CONE_SCALE, CONE_OFFSET = 0, 3, 4, 7, 8, 11, 12
LIGHT_COLUMNS = 13

_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_PI, _INVERSE_PI, _TINY = np.float32(np.pi), np.float32(1 / np.pi), np.float32(1e-30)


class LightTable(NamedTuple):
    """What lights a scene. Kernels take the whole tuple.

    Attributes:
        lights: (l, LIGHT_COLUMNS) float32: position, or direction to a directional light; 1 if punctual; colour times intensity;
            1 / range; direction the light shines; scale and offset of the cone.
        ambient: (2, 3) float32: radiance of sky and ground, W/(m2 sr).
    """

    lights: Array
    ambient: Array


def pack_lights(scene: Scene, camera: Camera) -> LightTable:
    """The lights of `scene`; where it has none at all, a head light at `camera` and a faint ambient."""
    lights, ambient = scene.lights, scene.ambient
    if not lights and ambient is None and not any(material.lightmap_texture for material in scene.materials):
        lights, ambient = [_head_light(camera)], Ambient((0.45, 0.45, 0.45), (0.2, 0.2, 0.2))
    rows = [_pack(light) for light in lights]
    radiance = ambient or Ambient()
    return LightTable(
        np.array(rows, np.float32).reshape(-1, LIGHT_COLUMNS), np.array([radiance.sky, radiance.ground], np.float32)
    )


def _head_light(camera: Camera) -> Light:
    """A directional light from over the camera's left shoulder."""
    from luxel.scene.transforms import look_at

    assert camera.world_from_camera is not None
    turn = look_at((-0.35, 0.5, 1.0), (0.0, 0.0, 0.0))
    return Light("directional", intensity=0.75 * math.pi, world_from_light=camera.world_from_camera @ turn)


def _pack(light: Light) -> list[float]:
    assert light.world_from_light is not None
    matrix = light.world_from_light
    axis = -matrix[:3, 2] / max(float(np.linalg.norm(matrix[:3, 2])), 1e-30)
    punctual = light.kind != "directional"
    scale, offset = 0.0, 1.0
    if light.kind == "spot":
        inner, outer = math.cos(light.inner_cone), math.cos(light.outer_cone)
        scale = 1 / max(0.001, inner - outer)
        offset = -outer * scale
    origin = matrix[:3, 3] if punctual else -axis
    return [*origin, float(punctual), *(light.intensity * channel for channel in light.color), 1 / light.range, *axis, scale, offset]


@device
def light(g: Array, n: int, table: LightTable) -> None:
    """Light the first `n` fragments of a batch that `surface` has evaluated.

    Args:
        g: The batch; OR OG OB OA are written: outgoing radiance W/(m2 sr), not premultiplied, and alpha.
        n: Fragments.
        table: From `pack_lights`.
    """
    start = 0
    while start < n:
        end = start + run_end(g[MODEL + start : MODEL + n], 0, n - start)
        illuminate(g[start:], end - start, int(g[MODEL + start]), table)
        start = end


@inlined
def illuminate(g: Array, n: int, code: int, table: LightTable) -> None:
    """Light fragments start .. end, which are of one model."""
    model = code & MODEL_MASK
    if model == 0:
        for i in range(n):
            g[OR + i] = g[CR + i]
            g[OG + i] = g[CG + i]
            g[OB + i] = g[CB + i]
            g[OA + i] = g[CA + i]
        return
    ambient(g, n, table.ambient)
    for k in range(len(table.lights)):
        row = table.lights[k]
        if row[PUNCTUAL] == _ZERO:
            directional(g, n, row)
        diffuse(g, n, row)
    for i in range(n):
        g[OR + i] = g[CR + i] * g[ER + i] * _INVERSE_PI
        g[OG + i] = g[CG + i] * g[EG + i] * _INVERSE_PI
        g[OB + i] = g[CB + i] * g[EB + i] * _INVERSE_PI
        g[OA + i] = g[CA + i]


@inlined
def ambient(g: Array, n: int, radiance: Array) -> None:
    """Begin the sum of diffuse irradiance with that from sky and ground."""
    red, green, blue = radiance[1, 0] * _PI, radiance[1, 1] * _PI, radiance[1, 2] * _PI
    more_red, more_green, more_blue = radiance[0, 0] * _PI - red, radiance[0, 1] * _PI - green, radiance[0, 2] * _PI - blue
    for i in range(n):
        up = _HALF + _HALF * g[NY + i]
        g[ER + i] = red + more_red * up
        g[EG + i] = green + more_green * up
        g[EB + i] = blue + more_blue * up


@inlined
def directional(g: Array, n: int, row: Array) -> None:
    """Direction to a directional light, and its irradiance on the surface."""
    x, y, z = row[ORIGIN], row[ORIGIN + 1], row[ORIGIN + 2]
    for i in range(n):
        g[LX + i] = x
        g[LY + i] = y
        g[LZ + i] = z
        g[LE + i] = max(_ZERO, g[NX + i] * x + g[NY + i] * y + g[NZ + i] * z)


@inlined
def diffuse(g: Array, n: int, row: Array) -> None:
    """Add the irradiance of a light."""
    red, green, blue = row[COLOR], row[COLOR + 1], row[COLOR + 2]
    for i in range(n):
        g[ER + i] += g[LE + i] * red
        g[EG + i] += g[LE + i] * green
        g[EB + i] += g[LE + i] * blue
