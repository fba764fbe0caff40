"""Batches of fragments for the tests of shading."""

import numpy as np

from luxel import jit
from luxel.raster import channels as c
from luxel.raster.lighting import light, pack_lights
from luxel.raster.materials import pack_materials
from luxel.raster.surface import surface
from luxel.scene.camera import Camera
from luxel.scene.light import Ambient
from luxel.scene.scene import Scene


@jit.kernel
def _shade(g, material, n, materials, lights, lit):
    surface(g, material, n, materials)
    if lit:
        light(g, n, lights)


def evaluate_and_light(g, material, n, materials, lights):
    _shade(g, material, n, materials, lights, True)


def evaluate(g, material, n, materials):
    _shade(g, material, n, materials, pack_lights(Scene(), Camera()), False)


def batch(**rows):
    """A batch whose rows are those given (normal, view, position: (n, 3); others by channel name, (n,)) over sensible defaults, and n."""
    n = max((len(value) for value in rows.values()), default=1)
    g = np.full(c.BATCH, np.nan, np.float32)  # what nobody fills must not matter
    defaults = {"normal": [[0, 0, 1]], "view": [[0, 0, 1]], "position": [[0, 0, 0]], "FRONT": [1]}
    for name in ("TX", "TY", "TZ", "TW", "CR", "CG", "CB", "CA"):
        defaults[name] = [name[0] == "C"]
    for name in ("U0", "V0", "U1", "V1"):
        defaults |= {name: [0], name + "X": [0], name + "Y": [0]}
    for name, value in (defaults | rows).items():
        first = {"normal": c.NX, "view": c.VX, "position": c.PX, "face": c.FX, "dx": c.DXX, "dy": c.DYX}.get(name)
        columns = np.broadcast_to(np.asarray(value, np.float32).reshape(len(value), -1), (n, np.size(value) // len(value)))
        for k in range(columns.shape[1]):
            start = (getattr(c, name) if first is None else first) + k * c.PITCH
            g[start : start + n] = columns[:, k]
    return g, n


def row(g, n, channel):
    return g[channel : channel + n]


def rgb(g, n, first=c.OR):
    return np.stack([row(g, n, first + k * c.PITCH) for k in range(3)], 1)


def shade(materials, lights=(), ambient=None, shading=None, textures=(), index=0, **rows):
    """(n, 4): radiance and alpha of a batch."""
    scene = Scene(materials=list(materials), lights=list(lights), ambient=ambient or Ambient(), textures=list(textures))
    g, n = batch(**rows)
    index = np.broadcast_to(np.int32(index), c.FRAGMENTS).copy() if np.ndim(index) == 0 else np.asarray(index, np.int32)
    evaluate_and_light(g, index, n, pack_materials(scene, shading), pack_lights(scene, Camera()))
    return np.concatenate([rgb(g, n), row(g, n, c.OA)[:, None]], 1)


def unit(vectors):
    vectors = np.asarray(vectors, np.float64)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def hemisphere(count, seed=0):
    """Unit vectors with z > 0, uniform in solid angle."""
    rng = np.random.default_rng(seed)
    z, phi = 1 - rng.random(count), 2 * np.pi * rng.random(count)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], 1)
