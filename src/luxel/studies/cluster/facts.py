"""Facts of a frame: which triangle each pixel shows, and which tile each triangle lies in. All that the model knows of a scene it has from here."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

import luxel
from luxel.arrays import Array
from luxel.raster.constants import NOTHING
from luxel.raster.frame import see
from luxel.raster.render import prepare
from luxel.scene.builtin import bumpy_sphere
from luxel.scene.framing import frame

TILE = 64


class Facts(NamedTuple):
    """A frame.

    Attributes:
        size: Width and height, pixels.
        triangles: Of the scene.
        tiles: Of the screen.
        slot, place: (n,) int64: of each covered pixel its tile, and its number within the tile; in their order.
        owner: (n,) float64: of each covered pixel, how far along the scene's triangles that one stands which it shows, 0 to 1.
        tile_triangles: (tiles,) int64: triangles whose middle lies there, also those that face away.
        tile_pixels: (tiles,) int64: covered pixels.
        tile_visible: (tiles,) int64: triangles that are seen there.
        weight: Each triangle stands for so many: 1, unless the frame is scaled up.
        memo: What has been counted on it.
    """

    size: tuple[int, int]
    triangles: int
    tiles: int
    slot: Array
    place: Array
    owner: Array
    tile_triangles: Array
    tile_pixels: Array
    tile_visible: Array
    weight: float
    memo: dict[Any, Any]

    @property
    def seen(self) -> Array:
        """(tiles,) float64: triangles that are seen in each tile; of more triangles than pixels no more than these."""
        return np.minimum(self.tile_visible * self.weight, np.maximum(self.tile_pixels, self.tile_visible))

    @property
    def all_triangles(self) -> float:
        """Triangles, each with what it stands for."""
        return self.triangles * self.weight


def scene_of(kind: str, n: int, size: tuple[int, int]) -> tuple[luxel.Scene, luxel.Camera]:
    """4 n^2 triangles that fill the screen ("even"), or its lower right corner ("corner"); with the camera that frames the former."""
    mesh = bumpy_sphere(n)
    whole = luxel.Scene.from_mesh(mesh)
    camera = frame(whole, size=size)
    if kind == "corner":
        turn = np.asarray(camera.world_from_camera)
        place = mesh.positions * 0.35 + (turn[:3, 0] * 1.3 - turn[:3, 1] * 0.65).astype(np.float32)
        whole = luxel.Scene.from_mesh(luxel.Mesh(place, mesh.triangles, mesh.normals))
    return whole, camera


def facts_of(kind: str, n: int, size: tuple[int, int], weight: float = 1.0) -> Facts:
    """Draw a frame and look at it."""
    scene, camera = scene_of(kind, n, size)
    prepared = prepare(scene)
    picture = luxel.render(prepared, camera, size, samples=1, outputs=("triangle",))
    ids: Array = np.asarray(picture.outputs()["triangle"])
    wide, high = size
    across, down = -(-wide // TILE), -(-high // TILE)
    y, x = np.nonzero(ids != NOTHING)
    slot, place = y // TILE * across + x // TILE, y % TILE * TILE + x % TILE
    order = np.lexsort((place, slot))
    slot, place, owner = slot[order], place[order], ids[y, x][order] / scene.triangle_count
    geometry = prepared.geometry
    clip = np.asarray(see(prepared, camera, size, None, 1).view.clip_from_world, np.float64)
    middle = geometry.positions[geometry.triangles].astype(np.float64).mean(1)
    at = middle @ clip[:, :3].T + clip[:, 3]
    px, py = (at[:, 0] / at[:, 3] * 0.5 + 0.5) * wide, (0.5 - at[:, 1] / at[:, 3] * 0.5) * high
    seen = (px >= 0) & (px < wide) & (py >= 0) & (py < high)
    counts = np.bincount(py[seen].astype(np.int64) // TILE * across + px[seen].astype(np.int64) // TILE, minlength=across * down)
    visible = np.unique(slot * scene.triangle_count + ids[y, x][order]) // scene.triangle_count
    pixels_of, seen_of = (np.bincount(each, minlength=across * down) for each in (slot, visible))
    return Facts(size, scene.triangle_count, across * down, slot, place, owner, counts, pixels_of, seen_of, weight, {})
