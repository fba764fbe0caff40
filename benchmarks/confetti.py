"""A room full of confetti: loose, tiny, two-sided triangles that face all ways, each a chart of its own, about a lamp. Its mean light is known.

- What the lamp gives falls with the distance d as exp(-d a / 2) / d^2, a being the area of the confetti in a cubic metre (Beer and Lambert): a
  triangle that faces anywhere hides half its area, and a side of it receives, on the mean, a quarter of what it would if it faced the lamp.
- The room is closed: all that the lamp gives is absorbed. The lightmap has the light of fronts; that of backs is the same, on the mean.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

import luxel
from luxel.radiosity.bake import bake
from luxel.radiosity.diagnosis import diagnose
from luxel.radiosity.effort import effort
from luxel.radiosity.quality import QUALITIES
from luxel.radiosity.unwrap import unwrap
from luxel.scene.builtin import box

EDGE, ROOM, DENSITY = 0.02, (4.0, 3.0, 5.0), 30.0  # metres, and luxels a metre: a triangle is smaller than a luxel
POWER = 10.0  # of the lamp, W/sr
NEAR, FAR = 0.4, 1.4  # metres from the lamp, between which its light is compared: many triangles, and walls are farther


def confetti(count: int, seed: int = 1) -> luxel.Scene:
    """A room with a point light in its middle and so many triangles anywhere in it."""
    rng, scene, shell = np.random.default_rng(seed), luxel.Scene(), box(ROOM)
    inward = replace(shell, triangles=np.ascontiguousarray(shell.triangles[:, ::-1]), normals=-shell.normals)
    scene.add(inward, luxel.Material((0.7, 0.7, 0.7, 1.0), name="walls"))
    a, b = rng.normal(size=(2, count, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b -= (a * b).sum(1, keepdims=True) * a
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    middle = rng.uniform(-0.5, 0.5, (count, 3)) * (np.array(ROOM) - 2 * EDGE)
    angle = 2 * np.pi / 3 * np.arange(3)[:, None]
    corners = middle[:, None] + EDGE / np.sqrt(3) * (np.cos(angle) * a[:, None] + np.sin(angle) * b[:, None])
    loose = luxel.Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), normals=np.repeat(np.cross(a, b), 3, 0))
    scene.add(loose, luxel.Material((0.5, 0.4, 0.2, 1.0), double_sided=True, name="confetti"))
    scene.lights.append(luxel.Light("point", intensity=POWER))
    return scene


def measured(count: int) -> dict[str, Any]:
    """What a draft of so many triangles takes, what was said before it, and how its light is beside what is known."""
    warnings.simplefilter("ignore", luxel.LuxelWarning)
    assert bake(confetti(100), quality="draft", density=5.0).pages.any()  # kernels are compiled
    scene, start = confetti(count), time.perf_counter()
    atlas = unwrap(scene, DENSITY)
    laid = time.perf_counter() - start
    said = diagnose(atlas, None, *effort(QUALITIES["draft"], False, False), laid)
    charts, pages = said.charts, said.pages
    del atlas
    start, worked = time.perf_counter(), time.process_time()
    baked = bake(scene, quality="draft", density=DENSITY)
    whole, worked = time.perf_counter() - start, time.process_time() - worked
    finite = bool(np.isfinite(baked.pages).all() and baked.irradiance.min() >= 0)
    return {"charts": charts, "luxels": len(baked.luxels.area), "pages": pages, "laid": laid, "whole": whole, "worked": worked, "said": said.seconds,
            "bytes": said.bytes, "finite": finite, "direct": _direct(baked, count), "absorbed": _absorbed(baked)}  # fmt: skip


def _direct(baked: luxel.Baked, count: int) -> float:
    """What confetti some way from the lamp has of it, by what it should have."""
    distance = np.linalg.norm(baked.luxels.position, axis=1)
    chosen = baked.luxels.two_sided & (distance > NEAR) & (distance < FAR)
    filled = np.prod(np.array(ROOM) - 2 * EDGE)
    depth = 0.5 * count * np.sqrt(3) / 4 * EDGE**2 / filled * distance[chosen]
    return float((baked.direct[chosen, 0] * distance[chosen] ** 2).sum() / (POWER / 4 * np.exp(-depth)).sum())


def _absorbed(baked: luxel.Baked) -> float:
    """Watts that are absorbed, by those of the lamp."""
    luxels = baked.luxels
    sides = luxels.area.astype(np.float64) * (1 + luxels.two_sided)
    return float((sides[:, None] * (1 - luxels.albedo) * baked.irradiance).sum() / (3 * 4 * np.pi * POWER))
