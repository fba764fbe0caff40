"""Pictures of a layout, as in the greedy mesh layout paper (2016): triangles by their place in the order, and by what they miss; before and after."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from luxel.arrays import Array
from luxel.layout import batch
from luxel.layout.cache import misses
from luxel.layout.optimize import seen_of
from luxel.raster.render import render
from luxel.scene.camera import Camera
from luxel.scene.colour import linear_from_srgb
from luxel.scene.framing import frame
from luxel.scene.material import Material
from luxel.scene.mesh import Mesh
from luxel.scene.normals import vertex_normals
from luxel.scene.scene import Scene

_RAMP = np.array([(48, 18, 59), (70, 107, 227), (40, 187, 236), (49, 242, 153), (162, 252, 60), (237, 208, 58), (251, 128, 34), (210, 49, 5),
                  (122, 4, 3)], np.float64)  # fmt: skip
_MISSED = np.array([(47, 158, 68), (192, 215, 90), (245, 159, 0), (201, 42, 42)], np.float64)  # by no, one, two, three misses
_GROUND = (0.86, 0.87, 0.89)  # linear
_BAR = 30  # pixels: the height of a caption


def place_colors(count: int) -> Array:
    """(count, 3) float64 sRGB, 0..255: from dark blue, drawn first, over green to red, drawn last."""
    at = np.linspace(0, len(_RAMP) - 1, max(count, 1))[:count]
    low = np.minimum(at.astype(int), len(_RAMP) - 2)
    part = (at - low)[:, None]
    return _RAMP[low] * (1 - part) + _RAMP[low + 1] * part


def missed_of(scene: Scene, cache: int = 12, policy: str = "fifo", profile: str | batch.Model | None = None) -> Array:
    """(m,) uint8: the misses of each triangle of all instances, each drawn from an empty cache."""
    each = []
    for instance in scene.instances:
        mesh = scene.meshes[instance.mesh]
        n = len(mesh.positions)
        each.append(batch.misses(mesh.triangles, profile, n) if profile is not None else misses(mesh.triangles, cache, policy, n))
    return np.concatenate([np.zeros(0, np.uint8), *each])


def colored(scene: Scene, colors: Array) -> Scene:
    """All instances of a scene as one mesh whose triangles have `colors`, (m, 3) sRGB in 0..255, in drawing order."""
    seen = seen_of(scene)
    positions, triangles = (np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)) if seen is None else seen[:2]
    rgba = np.ones((3 * len(triangles), 4), np.float32)
    rgba[:, :3] = np.repeat(linear_from_srgb(colors / 255), 3, 0)
    corners = np.ascontiguousarray(triangles.reshape(-1))
    normals = vertex_normals(positions, triangles)[corners] if len(corners) else None
    mesh = Mesh(positions[corners], np.arange(len(corners), dtype=np.int32).reshape(-1, 3), normals, colors=rgba)
    return Scene.from_mesh(mesh, Material(base_color=(1, 1, 1, 1), roughness=1.0, metallic=0.0, double_sided=True, shading="phong"))


def picture(before: Scene, after: Scene, cache: int = 12, policy: str = "fifo", profile: str | batch.Model | None = None,
            size: tuple[int, int] = (640, 480), camera: Camera | None = None, threads: int | None = None,
            progress: Callable[[float], None] | None = None) -> Array:  # fmt: skip
    """Four views with captions: before on the left, after on the right; by place in the order above, by misses below.

    Args:
        before, after: The scenes.
        cache, policy, profile: The cache whose misses are shown.
        size: Of each of the four, pixels.
        camera: None takes the file's, or frames it.
        threads: For drawing.
        progress: To be told the fraction that is done.

    Returns:
        (h, w, 3) uint8.
    """
    target = f"{policy.upper()} {cache}" if profile is None else str(profile)
    view = camera or frame(before, size=size)
    rows: list[list[Array]] = [[], []]
    for k, (name, scene) in enumerate((("before", before), ("after", after))):
        missed = missed_of(scene, cache, policy, profile)
        rate = f"{missed.mean():.3f}" if len(missed) else "-"
        captions = (f"{name}: place in the order, blue to red", f"{name}: {rate} misses a triangle, {target}; green 0, red 3")
        for i, colors in enumerate((place_colors(len(missed)), _MISSED[missed])):
            shown = replace(colored(scene, colors), cameras=[view])
            drawn = render(shown, view, size, samples=4, background=_GROUND, threads=threads).color
            assert drawn is not None
            rows[i].append(np.concatenate([_caption(captions[i], size[0]), drawn[..., :3]]))
            if progress:
                progress((2 * k + i + 1) / 4)
    return np.concatenate([np.concatenate(row, 1) for row in rows])


def _caption(text: str, width: int) -> Array:
    """(_BAR, width, 3) uint8: a line of text on white."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.new("RGB", (width, _BAR), (255, 255, 255))
    ImageDraw.Draw(image).text((10, 6), text, (20, 22, 26), font=ImageFont.load_default(15))
    return np.asarray(image)
