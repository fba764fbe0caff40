"""Light: radiance towards the eye from a batch of evaluated fragments. Flat loops over fragments that the compiler vectorises.

With E the irradiance of a light on the surface, n, l, v the normal and the directions to light and eye, h between l and v:

- Lambert: colour E / pi.
- Blinn-Phong: Lambert + E Ks (s + 8) / (8 pi) (n.h)^s: the highlight is normalised, so that with Ks = F0 it is as bright as glTF's.
- pbr: glTF 2.0, Appendix B: E ((1 - F) diffuse / pi + F D V); D of Trowbridge and Reitz (GGX), V of Smith in its height-correlated
  form, F of Schlick, alpha = roughness^2.
- Ambient: a hemisphere of radiance, lerp(ground, sky, (1 + y) / 2) in direction y, also taken for the irradiance / pi on a normal. In
  pbr it is reflected, too: Karis's fit of the environment's BRDF ("Physically based shading on mobile", 2014) times the radiance
  along a ray between mirror and normal; the diffuse part then gets what is left, so a white dielectric under a white sky shows 1.
- Lightmap: diffuse E / pi in place of the diffuse part of lights and ambient; highlights stay. Occlusion dims ambient light only.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.jit import inlined, part
from luxel.raster.arithmetic import exp2, log2
from luxel.raster.channels import (
    CB,
    CG,
    CR,
    EB,
    EG,
    EMB,
    EMG,
    EMR,
    ER,
    LE,
    LMB,
    LMG,
    LMR,
    LX,
    LY,
    LZ,
    MODEL,
    NX,
    NY,
    NZ,
    OB,
    OCCLUSION,
    OG,
    OR,
    PX,
    PY,
    PZ,
    ROUGHNESS,
    SB,
    SG,
    SHININESS,
    SPB,
    SPG,
    SPR,
    SR,
    VX,
    VY,
    VZ,
)
from luxel.raster.materials import EMISSIVE, LIGHTMAPPED, MODEL_LAMBERT, MODEL_MASK, MODEL_PBR, MODEL_PHONG, MODEL_UNLIT, OCCLUDED
from luxel.raster.surface import run_length
from luxel.scene.camera import Camera
from luxel.scene.light import Ambient, Light
from luxel.scene.scene import Scene

# Columns of `LightTable.lights`.
ORIGIN, PUNCTUAL, COLOR, INVERSE_RANGE, AXIS, CONE_SCALE, CONE_OFFSET = 0, 3, 4, 7, 8, 11, 12
LIGHT_COLUMNS = 13

_ZERO, _HALF, _ONE, _TWO, _EIGHT = (np.float32(x) for x in (0, 0.5, 1, 2, 8))
_PI, _INVERSE_PI, _INVERSE_8PI, _TINY = (np.float32(x) for x in (math.pi, 1 / math.pi, 0.125 / math.pi, 1e-30))
# Karis's constants.
_K1, _K2, _K3, _K4, _K5, _K6, _K7 = (np.float32(x) for x in (0.0425, -0.0275, -9.28, -1.04, 1.04, -0.572, -0.04))
_SHARPEST = np.float32(1e-8)  # below roughness^4 of the smoothest surface; keeps a missing normal from dividing by zero
_GRAZING = np.float32(1e-4)  # least cosine to the eye, where interpolated normals turn away at silhouettes


class LightTable(NamedTuple):
    """What lights a scene. Kernels take the whole tuple.

    Attributes:
        lights: (l, LIGHT_COLUMNS) float32: position, or direction to a directional light; 1 if punctual; colour times intensity;
            1 / range; direction the light shines; scale and offset of the cone.
        ambient: (2, 3) float32: radiance of sky and ground, W/(m2 sr).
        punctual: 1 if a light has a place, so that positions are needed; else 0.
    """

    lights: Array
    ambient: Array
    punctual: int


def pack_lights(scene: Scene, camera: Camera) -> LightTable:
    """The lights of `scene`; where it has none at all, a head light at `camera` and a faint ambient."""
    lights, ambient = scene.lights, scene.ambient
    if not lights and ambient is None and not any(material.lightmap_texture for material in scene.materials):
        lights, ambient = [_head_light(camera)], Ambient((0.35, 0.35, 0.35), (0.15, 0.15, 0.15))
    rows = np.array([_pack(light) for light in lights], np.float32).reshape(-1, LIGHT_COLUMNS)
    radiance = ambient or Ambient()
    return LightTable(rows, np.array([radiance.sky, radiance.ground], np.float32), int(rows[:, PUNCTUAL].any()))


def _head_light(camera: Camera) -> Light:
    """A directional light from over the camera's left shoulder."""
    from luxel.scene.transforms import look_at

    assert camera.world_from_camera is not None
    turn = look_at((-0.35, 0.5, 1.0), (0.0, 0.0, 0.0))
    return Light("directional", intensity=0.65 * math.pi, world_from_light=camera.world_from_camera @ turn)


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


@part
def light(g: Array, n: int, table: LightTable, rich: bool | None = True) -> None:
    """Light the first `n` fragments of a batch that `surface` has evaluated.

    Args:
        g: The batch; OR OG OB are written, in place of the base colour: outgoing radiance W/(m2 sr), not premultiplied. OA stays.
        n: Fragments.
        table: From `pack_lights`.
        rich: None if no fragment is of the metallic-roughness model, which is then not even compiled.
    """
    start = 0
    while start < n:
        length = run_length(g[MODEL + start : MODEL + n])
        code = np.int32(g[MODEL + start])
        if code == MODEL_LAMBERT and len(table.lights) == 1 and table.lights[0, PUNCTUAL] == _ZERO:
            light_plainly(g[start:], length, table.ambient, table.lights[0])
        elif code & MODEL_MASK != MODEL_UNLIT:
            begin(g[start:], length, table.ambient, code, rich)
            for k in range(len(table.lights)):
                add(g[start:], length, table.lights[k], code, rich)
            finish(g[start:], length, code)
        start += length


@part
def light_plainly(g: Array, n: int, radiance: Array, row: Array) -> None:
    """`begin`, `directional_diffuse` and `finish` in one, for a diffuse surface under ambient light and one directional light: the sums stay in
    registers. The same operations in the same order."""
    red, green, blue = radiance[1, 0] * _PI, radiance[1, 1] * _PI, radiance[1, 2] * _PI
    more_red, more_green, more_blue = radiance[0, 0] * _PI - red, radiance[0, 1] * _PI - green, radiance[0, 2] * _PI - blue
    x, y, z = row[ORIGIN], row[ORIGIN + 1], row[ORIGIN + 2]
    light_red, light_green, light_blue = row[COLOR], row[COLOR + 1], row[COLOR + 2]
    for i in range(n):
        up = _HALF + _HALF * g[NY + i]
        facing = max(_ZERO, g[NX + i] * x + g[NY + i] * y + g[NZ + i] * z)
        g[OR + i] = g[CR + i] * ((red + more_red * up + facing * light_red) * _INVERSE_PI)
        g[OG + i] = g[CG + i] * ((green + more_green * up + facing * light_green) * _INVERSE_PI)
        g[OB + i] = g[CB + i] * ((blue + more_blue * up + facing * light_blue) * _INVERSE_PI)


@part
def add(g: Array, n: int, row: Array, code: np.int32, rich: bool | None) -> None:
    """Add one light."""
    model = code & MODEL_MASK
    keep = _ZERO if code & LIGHTMAPPED else _ONE
    if row[PUNCTUAL] == _ZERO and model == MODEL_LAMBERT:
        directional_diffuse(g, n, row, keep)
        return
    if row[PUNCTUAL] == _ZERO:
        directional(g, n, row)
    else:
        punctual(g, n, row)
    if model != MODEL_PBR:
        diffuse(g, n, row, keep)
    elif rich is not None:
        microfacets(g, n, row, keep)
    if model == MODEL_PHONG:
        highlight(g, n, row)


@part
def begin(g: Array, n: int, radiance: Array, code: np.int32, rich: bool | None) -> None:
    """Begin the sums of diffuse irradiance and specular radiance: with ambient light and lightmap."""
    red, green, blue = radiance[1, 0] * _PI, radiance[1, 1] * _PI, radiance[1, 2] * _PI
    more_red, more_green, more_blue = radiance[0, 0] * _PI - red, radiance[0, 1] * _PI - green, radiance[0, 2] * _PI - blue
    for i in range(n):
        up = _HALF + _HALF * g[NY + i]
        g[ER + i] = red + more_red * up
        g[EG + i] = green + more_green * up
        g[EB + i] = blue + more_blue * up
    if code & MODEL_MASK == MODEL_PHONG:
        for i in range(n):
            g[SR + i] = _ZERO
            g[SG + i] = _ZERO
            g[SB + i] = _ZERO
    if rich is not None:  # noqa: SIM102 - on its own, it decides what is compiled
        if code & MODEL_MASK == MODEL_PBR:
            reflect_ambient(g, n, radiance)
            if code & OCCLUDED:
                for i in range(n):
                    g[SR + i] *= g[OCCLUSION + i]
                    g[SG + i] *= g[OCCLUSION + i]
                    g[SB + i] *= g[OCCLUSION + i]
    if code & LIGHTMAPPED:
        for i in range(n):
            g[ER + i] = g[LMR + i]
            g[EG + i] = g[LMG + i]
            g[EB + i] = g[LMB + i]
    elif code & OCCLUDED:
        for i in range(n):
            g[ER + i] *= g[OCCLUSION + i]
            g[EG + i] *= g[OCCLUSION + i]
            g[EB + i] *= g[OCCLUSION + i]


@part
def reflect_ambient(g: Array, n: int, radiance: Array) -> None:
    """Begin the sum of specular radiance with the reflection of sky and ground, and take its share from the diffuse sum."""
    red, green, blue = radiance[1, 0], radiance[1, 1], radiance[1, 2]
    more_red, more_green, more_blue = radiance[0, 0] - red, radiance[0, 1] - green, radiance[0, 2] - blue
    for i in range(n):
        nv = g[NX + i] * g[VX + i] + g[NY + i] * g[VY + i] + g[NZ + i] * g[VZ + i]
        rough = g[ROUGHNESS + i]
        mirrored = _TWO * nv * g[NY + i] - g[VY + i]
        up = _HALF + _HALF * (mirrored + (g[NY + i] - mirrored) * rough * rough)
        scale, bias = environment(max(nv, _GRAZING), rough)
        fr, fg, fb = g[SPR + i] * scale + bias, g[SPG + i] * scale + bias, g[SPB + i] * scale + bias
        g[SR + i] = fr * (red + more_red * up)
        g[SG + i] = fg * (green + more_green * up)
        g[SB + i] = fb * (blue + more_blue * up)
        g[ER + i] -= g[ER + i] * fr
        g[EG + i] -= g[EG + i] * fg
        g[EB + i] -= g[EB + i] * fb


@inlined
def environment(nv: np.float32, roughness: np.float32) -> tuple[np.float32, np.float32]:
    """Karis's fit: under white light from all around, F0 * scale + bias is reflected."""
    x = _ONE - roughness
    y = _K1 + _K2 * roughness
    a = min(x * x, exp2(_K3 * nv)) * x + y
    return _K4 * a + _K5 + _K6 * roughness, -_K4 * a + _K7 - _K7 * roughness


@part
def directional(g: Array, n: int, row: Array) -> None:
    """Direction to a directional light, and its irradiance on the surface."""
    x, y, z = row[ORIGIN], row[ORIGIN + 1], row[ORIGIN + 2]
    for i in range(n):
        g[LX + i] = x
        g[LY + i] = y
        g[LZ + i] = z
        g[LE + i] = max(_ZERO, g[NX + i] * x + g[NY + i] * y + g[NZ + i] * z)


@part
def directional_diffuse(g: Array, n: int, row: Array, keep: np.float32) -> None:
    """Add the irradiance of a directional light: `directional` and `diffuse` in one, where the direction is not needed afterwards."""
    x, y, z = row[ORIGIN], row[ORIGIN + 1], row[ORIGIN + 2]
    red, green, blue = row[COLOR] * keep, row[COLOR + 1] * keep, row[COLOR + 2] * keep
    for i in range(n):
        facing = max(_ZERO, g[NX + i] * x + g[NY + i] * y + g[NZ + i] * z)
        g[ER + i] += facing * red
        g[EG + i] += facing * green
        g[EB + i] += facing * blue


@part
def punctual(g: Array, n: int, row: Array) -> None:
    """Direction to a point or spot light, and its irradiance on the surface (KHR_lights_punctual)."""
    ox, oy, oz, inverse_range = row[ORIGIN], row[ORIGIN + 1], row[ORIGIN + 2], row[INVERSE_RANGE]
    ax, ay, az, scale, offset = row[AXIS], row[AXIS + 1], row[AXIS + 2], row[CONE_SCALE], row[CONE_OFFSET]
    for i in range(n):
        x, y, z = ox - g[PX + i], oy - g[PY + i], oz - g[PZ + i]
        square = max(x * x + y * y + z * z, _TINY)
        inverse = _ONE / np.float32(math.sqrt(square))
        x, y, z = x * inverse, y * inverse, z * inverse
        far = square * inverse_range * inverse_range
        window = min(_ONE, max(_ZERO, _ONE - far * far))
        cone = min(_ONE, max(_ZERO, offset - (x * ax + y * ay + z * az) * scale))
        facing = max(_ZERO, g[NX + i] * x + g[NY + i] * y + g[NZ + i] * z)
        g[LX + i] = x
        g[LY + i] = y
        g[LZ + i] = z
        g[LE + i] = facing * cone * cone * window * inverse * inverse


@part
def diffuse(g: Array, n: int, row: Array, keep: np.float32) -> None:
    """Add the irradiance of a light."""
    red, green, blue = row[COLOR] * keep, row[COLOR + 1] * keep, row[COLOR + 2] * keep
    for i in range(n):
        g[ER + i] += g[LE + i] * red
        g[EG + i] += g[LE + i] * green
        g[EB + i] += g[LE + i] * blue


@part
def highlight(g: Array, n: int, row: Array) -> None:
    """Add the Blinn-Phong highlight of a light."""
    red, green, blue = row[COLOR], row[COLOR + 1], row[COLOR + 2]
    for i in range(n):
        hx, hy, hz = g[LX + i] + g[VX + i], g[LY + i] + g[VY + i], g[LZ + i] + g[VZ + i]
        nh = (g[NX + i] * hx + g[NY + i] * hy + g[NZ + i] * hz) / np.float32(math.sqrt(max(hx * hx + hy * hy + hz * hz, _TINY)))
        exponent = g[SHININESS + i]
        power = exp2(exponent * log2(max(nh, _TINY)))
        lobe = g[LE + i] * power * (exponent + _EIGHT) * _INVERSE_8PI
        g[SR + i] += lobe * red * g[SPR + i]
        g[SG + i] += lobe * green * g[SPG + i]
        g[SB + i] += lobe * blue * g[SPB + i]


@part
def microfacets(g: Array, n: int, row: Array, keep: np.float32) -> None:
    """Add the diffuse irradiance and the specular radiance of a light, glTF's model."""
    red, green, blue = row[COLOR], row[COLOR + 1], row[COLOR + 2]
    for i in range(n):
        nx, ny, nz = g[NX + i], g[NY + i], g[NZ + i]
        lx, ly, lz = g[LX + i], g[LY + i], g[LZ + i]
        vx, vy, vz = g[VX + i], g[VY + i], g[VZ + i]
        lobe, fresnel = reflection(nx, ny, nz, lx, ly, lz, vx, vy, vz, g[ROUGHNESS + i])
        fr, fg, fb = g[SPR + i], g[SPG + i], g[SPB + i]
        fr, fg, fb = fr + (_ONE - fr) * fresnel, fg + (_ONE - fg) * fresnel, fb + (_ONE - fb) * fresnel
        er, eg, eb = g[LE + i] * red, g[LE + i] * green, g[LE + i] * blue
        g[SR + i] += er * fr * lobe
        g[SG + i] += eg * fg * lobe
        g[SB + i] += eb * fb * lobe
        g[ER + i] += er * (_ONE - fr) * keep
        g[EG + i] += eg * (_ONE - fg) * keep
        g[EB + i] += eb * (_ONE - fb) * keep


@inlined
def reflection(
    nx: np.float32, ny: np.float32, nz: np.float32, lx: np.float32, ly: np.float32, lz: np.float32,
    vx: np.float32, vy: np.float32, vz: np.float32, roughness: np.float32,
) -> tuple[np.float32, np.float32]:  # fmt: skip
    """D V of GGX for unit vectors n, l, v, and Schlick's (1 - v.h)^5."""
    hx, hy, hz = lx + vx, ly + vy, lz + vz
    inverse = _ONE / np.float32(math.sqrt(max(hx * hx + hy * hy + hz * hz, _TINY)))
    hx, hy, hz = hx * inverse, hy * inverse, hz * inverse
    nl = max(nx * lx + ny * ly + nz * lz, _GRAZING)
    nv = max(nx * vx + ny * vy + nz * vz, _GRAZING)
    nh = nx * hx + ny * hy + nz * hz
    # (n.h)^2 (a - 1) + 1 = a (n.h)^2 + |n x h|^2, which keeps the sharp lobes of smooth surfaces exact in float32.
    cx, cy, cz = ny * hz - nz * hy, nz * hx - nx * hz, nx * hy - ny * hx
    square = roughness * roughness
    square *= square
    spread = max(square * nh * nh + (cx * cx + cy * cy + cz * cz), _SHARPEST)
    rest = _ONE - square
    masking = nl * np.float32(math.sqrt(nv * nv * rest + square)) + nv * np.float32(math.sqrt(nl * nl * rest + square))
    lobe = _HALF * square * _INVERSE_PI / (spread * spread * masking)
    grazing = _ONE - min(_ONE, vx * hx + vy * hy + vz * hz)
    fourth = grazing * grazing * grazing * grazing
    return lobe, fourth * grazing


@part
def finish(g: Array, n: int, code: np.int32) -> None:
    """Outgoing radiance: diffuse, specular, emitted."""
    if code & MODEL_MASK == MODEL_LAMBERT:
        for i in range(n):
            g[OR + i] = g[CR + i] * (g[ER + i] * _INVERSE_PI)
            g[OG + i] = g[CG + i] * (g[EG + i] * _INVERSE_PI)
            g[OB + i] = g[CB + i] * (g[EB + i] * _INVERSE_PI)
    else:
        for i in range(n):
            g[OR + i] = g[CR + i] * (g[ER + i] * _INVERSE_PI) + g[SR + i]
            g[OG + i] = g[CG + i] * (g[EG + i] * _INVERSE_PI) + g[SG + i]
            g[OB + i] = g[CB + i] * (g[EB + i] * _INVERSE_PI) + g[SB + i]
    if code & EMISSIVE:
        for i in range(n):
            g[OR + i] += g[EMR + i]
            g[OG + i] += g[EMG + i]
            g[OB + i] += g[EMB + i]
