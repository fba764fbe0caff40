"""Draws the pictures of the gallery. Those of real models need the models: LUXEL_MESHES names their folder.

python docs/gallery/draw.py [NAME ...]
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import luxel
from luxel.cli import main as command
from luxel.io.images import read_image
from luxel.scene import builtin
from luxel.scene.transforms import look_at

HERE = Path(__file__).resolve().parent
MESHES = Path(os.environ.get("LUXEL_MESHES", HERE.parents[2] / "shared" / "meshes"))
NIGHT, DAWN = (0.012, 0.015, 0.02), (0.62, 0.7, 0.8)
BEST: dict[str, Any] = {"samples": 16}


def lit(scene: luxel.Scene, sun: Iterable[float], strength: float, sky: Any, ground: Any, color: Any = (1.0, 0.93, 0.82)) -> luxel.Scene:
    """The scene under one sun, seen in the direction `sun`, and a hemisphere."""
    scene.lights = [luxel.Light("directional", color, strength * math.pi, look_at(tuple(sun), (0, 0, 0)))]
    scene.ambient = luxel.Ambient(sky, ground)
    return scene


def model(name: str, material: luxel.Material) -> luxel.Scene:
    mesh = luxel.load(MESHES / name).meshes[0]
    return luxel.Scene.from_mesh(mesh, material)


def pixels(picture: luxel.Picture) -> Any:
    return np.asarray(picture)[..., :3]


def room() -> Any:
    """What `luxel demo` draws."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder, "room.png"))
        assert command(["demo", "-o", path, "--size", "960x540", "--samples", "16", "-q"]) == 0
        return read_image(path)[..., :3]


def dragon() -> Any:
    jade = luxel.Material((0.06, 0.27, 0.15, 1.0), roughness=0.28, shading="pbr", double_sided=True)
    scene = lit(model("dragon_vrip.ply", jade), (-0.5, 0.9, 0.7), 1.6, (0.55, 0.65, 0.8), (0.10, 0.08, 0.06))
    scene.lights.append(luxel.Light("directional", (1.0, 0.75, 0.5), 2.5, look_at((1.0, 0.2, -0.8), (0, 0, 0))))
    camera = luxel.frame(scene, azimuth=math.radians(12), elevation=math.radians(12), size=(640, 440))
    return pixels(luxel.render(scene, camera, (640, 440), background=NIGHT, **BEST))


def bunny() -> Any:
    """Four shading models of one mesh."""
    clay = luxel.Material((0.62, 0.36, 0.24, 1.0), roughness=0.35, double_sided=True)
    scene = lit(model("stanford-bunny.obj", clay), (-0.6, 0.8, 0.9), 0.9, (0.30, 0.34, 0.40), (0.12, 0.10, 0.08))
    camera = luxel.frame(scene, azimuth=math.radians(-10), elevation=math.radians(12), size=(240, 240))
    shadings = ("flat", "gouraud", "phong", "pbr")
    return np.hstack([pixels(luxel.render(scene, camera, (240, 240), shading=s, background=DAWN, **BEST)) for s in shadings])


def arena() -> Any:
    scene = lit(luxel.load(MESHES / "scenes" / "zdm2.glb"), (-0.8, 0.75, -0.25), 0.9, (0.22, 0.32, 0.48), (0.12, 0.10, 0.09), (1.0, 0.78, 0.5))
    camera = luxel.Camera.look_at((46, 40, -46), (2, -3, 4), yfov=math.radians(42), near=0.5)
    return pixels(luxel.render(scene, camera, (640, 400), background=DAWN, **BEST))


def living_room() -> Any:
    scene = lit(luxel.load(MESHES / "scenes" / "living_room.glb"), (0.55, 0.8, 0.75), 0.8, (0.42, 0.47, 0.55), (0.22, 0.20, 0.17))
    camera = luxel.Camera.look_at((3.4, 2.0, 9.9), (-0.8, 0.6, 0.0), yfov=math.radians(54))
    return pixels(luxel.render(scene, camera, (640, 400), background=DAWN, **BEST))


def outputs() -> Any:
    """Depth, normals, triangle ids and object ids of the room, out of one pass."""
    names = ("depth", "normal", "triangle", "object")
    picture = luxel.render(builtin.room(), size=(480, 270), outputs=names)
    near, far = np.percentile(picture.depth[np.isfinite(picture.depth)], (0, 100))
    depth = np.repeat(255 * (1 - np.clip((picture.depth - near) / (far - near), 0, 1))[..., None], 3, 2)
    normal = 127.5 + 127.5 * picture.normal
    tiles = [depth, normal, _colored(picture.triangle), _colored(picture.object)]
    return np.vstack([np.hstack(tiles[:2]), np.hstack(tiles[2:])]).astype(np.uint8)


def _colored(ids: Any) -> Any:
    colors = np.random.default_rng(4).integers(40, 256, (int(ids.max()) + 2, 3))
    colors[-1] = 0  # id -1: nothing
    return colors[ids]


def antialiasing() -> Any:
    """The plant and the vase of the room, four times as large as drawn: 1, 4 and 16 samples, and 16 with a Gaussian filter."""
    scene = luxel.prepare(builtin.room())
    ways: tuple[dict[str, Any], ...] = ({"samples": 1}, {"samples": 4}, {"samples": 16}, {"samples": 16, "filter": "gaussian"})
    parts = [pixels(luxel.render(scene, size=(480, 270), **way))[95:165, 170:230] for way in ways]
    return np.hstack([np.kron(part, np.ones((4, 4, 1), np.uint8)) for part in parts])


def layout() -> Any:
    """The bunny's triangles by place in the order and by misses, as the file has them and laid out."""
    from luxel.layout.pictures import picture

    scene = luxel.load(MESHES / "stanford-bunny.obj", normals=False)
    return picture(scene, luxel.optimize(scene, measures=False)[0], size=(480, 360))


PICTURES: tuple[Callable[[], Any], ...] = (room, dragon, bunny, arena, living_room, outputs, antialiasing, layout)


def main() -> None:
    for draw in PICTURES:
        if sys.argv[1:] and draw.__name__ not in sys.argv[1:]:
            continue
        path = HERE / f"{draw.__name__}.{'png' if draw in (outputs, antialiasing) else 'jpg'}"
        image = Image.fromarray(draw())
        image.save(path, **({"optimize": True} if path.suffix == ".png" else {"quality": 88, "optimize": True}))
        print(f"{path.name}  {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
