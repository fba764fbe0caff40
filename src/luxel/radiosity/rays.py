"""Rays: visibility of many segments at once, exact; the one door to Embree, which is there to compare with.

luxel's own hierarchy (`luxel.radiosity.occlusion`) is the default: it can be asked inside kernels, decides shared edges and grazing segments from
the geometry, and knows masks. Embree (extra `bake`) answers batches from Python faster, in single precision and without masks.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.errors import ExtraMissingError, InputError
from luxel.radiosity.occlusion import WRAPS, Masks, Occlusion, prepare, visible_pairs

if TYPE_CHECKING:
    from luxel.radiosity.labour import Labour
    from luxel.raster.geometry import Geometry
    from luxel.scene.material import Material
    from luxel.scene.scene import Scene


class Occluders:
    """Triangles that stand in the way.

    Args:
        positions: (n, 3) float32, metres.
        triangles: (m, 3) int32.
        masks: Which triangles have holes (`scene_masks`).

    Attributes:
        occlusion: The arrays for `luxel.radiosity.occlusion.occluded` in kernels.
    """

    def __init__(self, positions: Array, triangles: Array, masks: Masks | None = None) -> None:
        positions = checked(positions, ("n", 3), np.float32, "positions")
        triangles = checked(triangles, ("m", 3), np.int32, "triangles")
        if triangles.size and not 0 <= int(triangles.min()) <= int(triangles.max()) < len(positions):
            raise InputError(f"triangles: expected vertices 0 .. {len(positions) - 1}, got {triangles.min()} .. {triangles.max()}")
        self.occlusion: Occlusion = prepare(positions, triangles, masks)

    @classmethod
    def of_scene(cls, scene: Scene) -> Occluders:
        """All instances of a scene, with the holes of alpha-masked materials; triangle ids are those of `flatten(scene, "none")`."""
        from luxel.raster.geometry import flatten

        geometry = flatten(scene, cull="none")
        return cls(geometry.positions, geometry.triangles, scene_masks(scene, geometry))

    def visible(self, origins: Array, targets: Array, threads: int | None = None, *, skip: Array | None = None) -> Array:
        """Which targets are seen from their origins.

        Args:
            origins, targets: (n, 3) float64, or one point (3,) for all; metres. Surfaces on which an end lies do not hide it.
            threads: How many; default all cores. The answer does not depend on it.
            skip: (n, 2) int32 triangles that do not count for a segment, -1 for none.

        Returns:
            (n,) bool.
        """
        origins, targets = np.broadcast_arrays(np.atleast_2d(np.asarray(origins, np.float64)), np.asarray(targets, np.float64))
        origins, targets = checked(origins, ("n", 3), np.float64, "origins"), checked(targets, ("n", 3), np.float64, "targets")
        return visible(self.occlusion, origins, targets, jit.checked_threads(threads), skip)


def visible(scene: Occlusion, origins: Array, targets: Array, threads: int, skip: Array | None = None) -> Array:
    """(n,) bool, for (n, 3) origins and targets; as `Occluders.visible`."""
    n = len(origins)
    skip = checked(np.full((n, 2), -1, np.int32) if skip is None else skip, (n, 2), np.int32, "skip")
    result = np.zeros(n, np.bool_)
    writable = [np.require(array, dtype, ["C", "W"]) for array, dtype in ((origins, np.float64), (targets, np.float64), (skip, np.int32))]
    jit.run(visible_pairs, min(threads, n // 1024 + 1), scene, *writable, result)
    return result


def visible_to_all(scene: Occlusion, a: Array, b: Array, labour: Labour) -> Array:
    """(k,) bool: which of the points (k, 3) see each other, each process looking for some."""
    return labour.each(len(a), lambda some: visible(scene, a[some], b[some], labour.threads))


class EmbreeOccluders:
    """The same question put to Embree: segments are shortened by `offset` of their length at both ends. No masks.

    Raises:
        ExtraMissingError: embreex is not installed.
    """

    def __init__(self, positions: Array, triangles: Array) -> None:
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError:
            raise ExtraMissingError("embreex", "bake", "comparing with Embree") from None
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(positions[triangles], np.float32))
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), query="OCCLUDED")  # builds: not while threads ask

    def visible(self, origins: Array, targets: Array, threads: int | None = None, *, offset: float = 1e-4) -> Array:
        """(n,) bool for (n, 3) origins and targets."""
        origins, targets = np.asarray(origins, np.float64), np.asarray(targets, np.float64)
        starts = np.ascontiguousarray(origins + offset * (targets - origins), np.float32)
        ways = np.ascontiguousarray((1 - 2 * offset) * (targets - origins), np.float32)
        count = jit.checked_threads(threads)

        def ask(part: slice) -> Array:
            hit = self._scene.run(starts[part], ways[part], dists=np.ones(len(starts[part]), np.float32), query="OCCLUDED")
            return np.asarray(hit < 0)

        step = max(1, -(-len(starts) // count))
        parts = [slice(k, k + step) for k in range(0, len(starts), step)]
        with ThreadPoolExecutor(count) as pool:
            answers = list(pool.map(ask, parts))
        return np.concatenate(answers) if answers else np.zeros(0, np.bool_)


def obstacles(geometry: Geometry, masks: Masks | None) -> Occlusion:
    """What hides in `flatten(scene, "none")`: all triangles but those that are blended, with the holes of `scene_masks`."""
    from luxel.raster.bin import BLEND

    blended = np.repeat(geometry.parts.alpha_mode == BLEND, np.diff(geometry.part_start))
    return prepare(geometry.positions, np.where(blended[:, None], 0, geometry.triangles), masks)


def scene_masks(scene: Scene, geometry: Geometry) -> Masks | None:
    """The alpha of the masked materials of a scene, for the triangles of `flatten(scene, "none")`; None if none is masked."""
    from luxel.scene.material import Material

    materials = [*scene.materials, Material()]
    masked = sorted({int(m) for m in geometry.part_material if materials[m].alpha_mode == "MASK"})
    if not masked:
        return None
    count = len(geometry.triangles)
    mask, texcoords = np.full(count, -1, np.int32), np.zeros((count, 6), np.float32)
    rows, cutoffs, pictures, start = [], [], [], 0
    for row, m in enumerate(masked):
        picture, wrap, nearest = _alpha_picture(scene, materials[m])
        rows.append([start, picture.shape[1], picture.shape[0], WRAPS[wrap[0]], WRAPS[wrap[1]], nearest, 0, 0])
        cutoffs.append(materials[m].alpha_cutoff)
        pictures.append(picture.ravel())
        start += picture.size
        for part in np.flatnonzero(geometry.part_material == m):
            faces = slice(geometry.part_start[part], geometry.part_start[part + 1])
            mask[faces] = row
            texcoords[faces] = _mask_coordinates(materials[m], geometry, geometry.triangles[faces])
    return Masks(mask, texcoords, np.array(rows, np.int32), np.array(cutoffs, np.float32), np.concatenate(pictures))


def _alpha_picture(scene: Scene, material: Material) -> tuple[Array, tuple[str, str], bool]:
    """A material's alpha (h, w) float32, how it wraps, and whether it is sampled at the nearest texel."""
    factor, ref = np.float32(material.base_color[3]), material.base_color_texture
    if ref is None:
        return np.full((1, 1), factor), ("clamp", "clamp"), True
    texture = scene.textures[ref.texture]
    if texture.image.shape[2] not in (2, 4):
        return np.full((1, 1), factor), ("clamp", "clamp"), True
    alpha = texture.image[..., -1]
    scale = np.float32(1 / 255) if alpha.dtype == np.uint8 else np.float32(1)
    return alpha.astype(np.float32) * scale * factor, texture.wrap, texture.filter == "nearest"


def _mask_coordinates(material: Material, geometry: Geometry, triangles: Array) -> Array:
    """(k, 6) float32: the corners' texture coordinates in the mask's picture."""
    ref = material.base_color_texture
    coordinates = geometry.texcoords1 if ref is not None and ref.texcoord == 1 else geometry.texcoords
    if ref is None or not len(coordinates):
        return np.zeros((len(triangles), 6), np.float32)
    cos, sin = np.cos(ref.rotation), np.sin(ref.rotation)
    turn = np.array([[cos, sin], [-sin, cos]]) * np.asarray(ref.scale)  # KHR_texture_transform: scaled, then turned, then moved
    moved = coordinates[triangles] @ turn.T + np.asarray(ref.offset)
    return moved.reshape(-1, 6).astype(np.float32)
