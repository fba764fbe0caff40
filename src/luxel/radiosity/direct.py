"""Direct light of what has no surface: point, spot and directional lights (KHR_lights_punctual), and the sky, by rays.

Every element asks from each of its quarters, so that shadows' edges are as soft as the lightmap is coarse, and what bends does not shadow
itself. The sky is a set of directions, each standing for an equal part of the sphere; an element turns none of them, so neighbours agree and there
is no noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.radiosity.directions import sphere_directions
from luxel.radiosity.element import FREE, GX, GY, GZ, LIFT, NX, NY, NZ, quarter_of
from luxel.radiosity.occlusion import Occlusion, occluded
from luxel.scene.light import Light

_CHUNK = 256
_PIXELS_PER_DIRECTION = 64
# Columns of a table of lights: position; direction it shines in; intensity by channel; 1 if it is far away; range; cosines of the cones.
_X, _Y, _Z, _DX, _DY, _DZ, _RED, _GREEN, _BLUE, _FAR, _RANGE, _INNER, _OUTER = range(13)
QUARTERS = 4
"""Of an element, from each of which a ray goes to every light."""


def light_table(lights: Sequence[Light]) -> Array:
    """(l, 13) float64."""
    table = np.zeros((len(lights), 13))
    for row, light in zip(table, lights, strict=True):
        matrix = light.world_from_light
        assert matrix is not None
        row[_X : _Z + 1], row[_DX : _DZ + 1] = matrix[:3, 3], -matrix[:3, 2] / (np.linalg.norm(matrix[:3, 2]) or 1.0)
        row[_RED : _BLUE + 1] = np.multiply(light.color, light.intensity)
        row[_FAR], row[_RANGE] = light.kind == "directional", light.range
        spot = light.kind == "spot"
        row[_INNER], row[_OUTER] = (math.cos(light.inner_cone), math.cos(light.outer_cone)) if spot else (-2.0, -3.0)
    return table


def irradiances(table: Array) -> float:
    """The sum over directional lights, W/m2: the mean over channels."""
    return float(table[:, _RED : _BLUE + 1].mean(1).sum())


@jit.part
def _strength(light, dx, dy, dz, r2):
    """What of a light's intensity goes along the unit vector d towards it, and its 1 / r^2: as the renderer has it."""
    if light[_FAR] != 0.0:
        return 1.0
    along = -(dx * light[_DX] + dy * light[_DY] + dz * light[_DZ])
    cone = min(max((along - light[_OUTER]) / max(light[_INNER] - light[_OUTER], 1e-9), 0.0), 1.0)
    fade = 1.0
    if light[_RANGE] < np.inf:
        q = r2 / (light[_RANGE] * light[_RANGE])
        fade = min(max(1.0 - q * q, 0.0), 1.0)
    return cone * cone * fade / r2


@jit.part
def shine_on(j, scene, numbers, table, reach, received):
    """Add to received (3, n) what the lights of a `light_table` give to element `j`, by a ray to each from every quarter."""
    nx, ny, nz = np.float64(numbers[NX, j]), np.float64(numbers[NY, j]), np.float64(numbers[NZ, j])
    gx, gy, gz, free = np.float64(numbers[GX, j]), np.float64(numbers[GY, j]), np.float64(numbers[GZ, j]), np.int64(numbers[FREE, j])
    for k in range(len(table)):
        light, sum_ = table[k], 0.0
        for p in range(QUARTERS):
            a, b, c = quarter_of(numbers, j, p, free, LIFT)
            x, y, z = np.float64(a), np.float64(b), np.float64(c)
            if light[_FAR] != 0.0:
                dx, dy, dz, length = -light[_DX], -light[_DY], -light[_DZ], reach
            else:
                dx, dy, dz = light[_X] - x, light[_Y] - y, light[_Z] - z
                length = math.sqrt(dx * dx + dy * dy + dz * dz)
                if length == 0.0:
                    continue
                dx, dy, dz = dx / length, dy / length, dz / length
            cosine = nx * dx + ny * dy + nz * dz
            if cosine > 0.0 and gx * dx + gy * dy + gz * dz > 0.0:
                strength = cosine * _strength(light, dx, dy, dz, length * length)
                if strength > 0.0 and not occluded(scene, x, y, z, x + dx * length, y + dy * length, z + dz * length, -1, -1):
                    sum_ += strength
        if sum_ > 0.0:
            for channel in range(3):
                received[channel, j] += np.float32(sum_ / QUARTERS * light[_RED + channel])


@jit.parallel_kernel
def _shine(queue, scene, numbers, table, reach, received):
    scene, numbers, table, received = jit.borrow(scene), jit.borrow(numbers), jit.borrow(table), jit.borrow(received)
    n = numbers.shape[1]
    chunk = jit.take(queue)
    while chunk * _CHUNK < n:
        for j in range(chunk * _CHUNK, min(n, (chunk + 1) * _CHUNK)):
            shine_on(j, scene, numbers, table, reach, received)
        chunk = jit.take(queue)


def shine(scene: Occlusion, numbers: Array, table: Array, reach: float, threads: int) -> Array:
    """(3, n) float32: the irradiance, W/m2, that lights of a `light_table` give to elements, of `Elements.numbers` (17, n).

    Args:
        reach: Metres from any element to beyond the scene.
    """
    received = np.zeros((3, numbers.shape[1]), np.float32)
    if len(table):
        jit.run(_shine, threads, scene, numbers, table, reach, received)
    return received


def sky_table(sky: object, count: int) -> Array:
    """(l, 13) float64: a sky as directional lights.

    Args:
        sky: (3,) radiance, W/(m2 sr); or (h, w, 3) radiance, equirectangular: +y up, the middle column looks along -z.
        count: Directions over the whole sphere; dark ones are left out.
    """
    directions = sphere_directions(count)
    values = np.asarray(sky, np.float64)
    if values.ndim == 1:
        radiance = np.tile(checked(values, (3,), np.float64, "sky"), (count, 1))
    else:
        radiance, directions = _averaged(values, directions)
    table = np.zeros((count, 13))
    table[:, _DX : _DZ + 1], table[:, _RED : _BLUE + 1], table[:, _FAR] = -directions, radiance * (4 * np.pi / count), 1
    return table[radiance.sum(1) > 0]


def _averaged(picture: Array, directions: Array) -> tuple[Array, Array]:
    """(n, 3) the mean radiance of what lies nearest to each of n directions, and (n, 3) where its light comes from on the average; the whole
    picture is spent, each pixel by its solid angle."""
    from scipy.spatial import KDTree

    picture = checked(picture, ("h", "w", 3), np.float64, "sky")
    finer = int(np.ceil(np.sqrt(_PIXELS_PER_DIRECTION * len(directions) / (picture.shape[0] * picture.shape[1]))))
    if finer > 1:  # a pixel larger than what a direction stands for must reach all that lie in it
        picture = np.repeat(np.repeat(picture, finer, 0), finer, 1)
    rows, columns = picture.shape[:2]
    polar, azimuth = (np.arange(rows) + 0.5) / rows * np.pi, ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * np.pi
    ring = np.sin(polar)[:, None]
    pixels = np.stack([ring * np.sin(azimuth), np.repeat(np.cos(polar)[:, None], columns, 1), -ring * np.cos(azimuth)], -1)
    _, nearest = KDTree(directions).query(pixels.reshape(-1, 3))
    solid = np.repeat(ring, columns, 1).ravel()
    solid *= 4 * np.pi / solid.sum()
    sums = np.stack([np.bincount(nearest, solid * picture[..., c].ravel(), len(directions)) for c in range(3)], 1)
    light = solid * picture.sum(2).ravel()
    middle = np.stack([np.bincount(nearest, light * pixels[..., axis].ravel(), len(directions)) for axis in range(3)], 1)
    length = np.linalg.norm(middle, axis=1)[:, None]
    return sums * (len(directions) / (4 * np.pi)), np.divide(middle, length, out=directions.copy(), where=length > 0)
