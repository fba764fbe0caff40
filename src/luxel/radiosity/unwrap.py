"""Unwrap: lightmap coordinates (TEXCOORD_1) for a whole scene, every instance in a place of its own."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError, LuxelWarning
from luxel.jit import checked_threads
from luxel.radiosity.charts import Charted, chart_surfaces, linear_density
from luxel.radiosity.pieces import Surface, areas
from luxel.radiosity.reuse import make_room, own_coordinates
from luxel.raster.geometry import made_normals
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Instance, Scene

LUXELS = 250_000
"""About how many luxels a scene gets if no density is given."""

_DENSEST = 1e9  # texels per metre

_SHRUNK = 0.98  # of the density wanted: a chart that has less was too large for its page

_VERTEX_ARRAYS = ("positions", "normals", "texcoords", "texcoords1", "colors", "tangents")


class Atlas(NamedTuple):
    """A scene laid out on lightmap pages.

    Attributes:
        scene: As given, but every instance has a mesh of its own, with `texcoords1` in 0..1 of its page. A mesh whose charts fall on several
            pages is split.
        instance_page: (instances,) int32.
        pages: Number of pages.
        size: Width and height of every page, texels.
        chart: (triangles,) int32: chart of each triangle of `flatten(scene, "none")`, numbered over all pages; -1 if it has none.
        reused: The file's own TEXCOORD_1 served.
    """

    scene: Scene
    instance_page: Array
    pages: int
    size: tuple[int, int]
    chart: Array
    reused: bool


def unwrap(scene: Scene, density: float | Mapping[str, float] | None = None, page: int | tuple[int, int] = 1024, gutter: int = 2,
           reuse: bool = True, threads: int | None = None, progress: Callable[[float], None] | None = None) -> Atlas:  # fmt: skip
    """Give every instance lightmap coordinates.

    A scene's own TEXCOORD_1 is taken if it serves: inside 0..1, without overlap, with charts of a texel at least. Meshes whose coordinates overlap
    those of others get pages of their own. Else new coordinates are made by xatlas, with the density that is asked for: exact on what can be laid
    flat, the mean elsewhere. Charts narrower than a texel are made a texel wide, and charts too large for a page are made smaller, which is said.

    Args:
        scene: Not changed.
        density: Texels per metre in the world; by name of material for some, with "" for all others. None: about `LUXELS` luxels in all, or for
            the scene's own coordinates what `page` gives.
        page: Width and height of a page, texels; or both. A scene that needs one page only gets one as large as it needs.
        gutter: Texels that stay free between new charts, at least.
        reuse: Take the scene's own coordinates if they serve.
        threads: None: all that the process may use. The result does not depend on it.
        progress: Called with the share that is probably done while xatlas works on a large scene; it takes some 0.1 s for 1,000 curved triangles.

    Raises:
        InputError: An argument is out of range, or the scene cannot be drawn.
        ExtraMissingError: xatlas is not installed.
        LuxelError: xatlas failed.
    """
    width, height = (_whole(side, "page", 16, 1 << 14) for side in (page if isinstance(page, tuple) else (page, page)))
    gutter, threads = _whole(gutter, "gutter", 0, 64), checked_threads(threads)
    scene.check()
    drawn, meshes, surfaces = _drawn(scene)
    each = densities(scene, meshes, surfaces, density)
    if reuse:
        atlas = own_coordinates(scene, drawn, meshes, surfaces, None if density is None else each, (width, height), threads)
        if atlas is not None:
            return atlas
    scene = make_room(scene)
    meshes = [scene.meshes[i.mesh] for i in drawn]
    meshes = [mesh if mesh.normals is not None else replace(mesh, normals=made_normals(mesh)) for mesh in meshes]  # cuts change no shading
    scaled = [Surface((s.positions * d).astype(np.float32), s.triangles, s.normals) for s, d in zip(surfaces, each, strict=True)]
    side = min(width, height)  # xatlas packs squares
    charted, pages = chart_surfaces(scaled, side, gutter, progress)
    if density is not None:
        _tell_of_shrunk(scaled, charted, each, side)
    return _assembled(scene, drawn, meshes, charted, pages, _page_size(charted, pages, side))


def _tell_of_shrunk(scaled: list[Surface], charted: list[Charted], each: list[float], page: int) -> None:
    """Warn of charts that were made smaller to fit on a page."""
    count, got, asked = 0, np.inf, 0.0
    for surface, flat, density in zip(scaled, charted, each, strict=True):
        names, number = np.unique(np.append(flat.chart, -1), return_inverse=True)  # 0: none
        chart, positions = number[:-1].astype(np.int64) - 1, surface.positions[flat.source].astype(np.float64)
        share = linear_density(positions, flat.triangles, flat.texcoords, chart, len(names) - 1).max(1)
        shrunk = share[(share > 0) & (share < _SHRUNK)]  # 0: a point
        if len(shrunk):
            count += len(shrunk)
            got, asked = min((got, asked), (float(shrunk.min()) * density, density))
    if count:
        charts = "1 chart does not fit on a page of" if count == 1 else f"{count:,} charts do not fit on pages of"
        text = f"density: {charts} {page} texels: down to {got:.4g} texels per metre where {asked:.4g} were asked for"
        warnings.warn(f"{text}; a larger page would do", LuxelWarning, stacklevel=3)


def expected_luxels(scene: Scene, density: float | Mapping[str, float] | None) -> float:
    """About how many luxels a scene will have at a density: its area in texels. Nothing is laid out for it."""
    _, meshes, surfaces = _drawn(scene)
    each = densities(scene, meshes, surfaces, density)
    return sum(float(areas(s.positions, s.triangles).sum()) * d * d for s, d in zip(surfaces, each, strict=True))


def _drawn(scene: Scene) -> tuple[list[Instance], list[Mesh], list[Surface]]:
    """The instances that have a surface, with their meshes and what those are in the world."""
    drawn = [i for i in scene.instances if len(scene.meshes[i.mesh].triangles)]
    meshes = [scene.meshes[i.mesh] for i in drawn]
    return drawn, meshes, [_in_world(mesh, instance) for mesh, instance in zip(meshes, drawn, strict=True)]


def densities(scene: Scene, meshes: list[Mesh], surfaces: list[Surface], density: object) -> list[float]:
    """Texels per metre of each instance."""
    if density is None:
        area = sum(float(areas(surface.positions, surface.triangles).sum()) for surface in surfaces)
        density = float(np.sqrt(LUXELS / area)) if area > 0 else 1.0
    by_name: dict[str, Any] = dict(density) if isinstance(density, Mapping) else {"": density}
    for name, value in by_name.items():
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not 0 < value < _DENSEST:
            of = f" of {name!r}" if name else ""
            raise InputError(f"density{of}: expected texels per metre above 0 and below {_DENSEST:g}, got {value!r}")
    names = [scene.materials[mesh.material].name if mesh.material >= 0 else "" for mesh in meshes]
    unknown = set(by_name) - {m.name for m in scene.materials} - {""}
    missing = set(names) - set(by_name) if "" not in by_name else set()
    if unknown:
        raise InputError(f"density: no material is called {min(unknown)!r}")
    if missing:
        raise InputError(f"density: none for material {min(missing)!r}")
    return [float(by_name.get(name, by_name.get("", 0.0))) for name in names]


def _whole(value: object, name: str, low: int, high: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not low <= value <= high:
        raise InputError(f"{name}: expected a whole number of texels in {low} .. {high}, got {value!r}")
    return int(value)


def _in_world(mesh: Mesh, instance: Instance) -> Surface:
    matrix = np.asarray(instance.world_from_mesh)
    with np.errstate(all="ignore"):
        positions = mesh.positions @ matrix[:3, :3].T + matrix[:3, 3]
    normals = (made_normals(mesh) if mesh.normals is None else mesh.normals) @ np.linalg.pinv(matrix[:3, :3])
    length = np.sqrt((normals**2).sum(1, keepdims=True))
    return Surface(positions.astype(np.float32), mesh.triangles, np.where(length > 0, normals / np.maximum(length, 1e-30), 0).astype(np.float32))


def _page_size(charted: list[Charted], pages: int, page: int) -> tuple[int, int]:
    """A single page is no larger than what is on it, in blocks of four texels."""
    if pages > 1:
        return page, page
    used = [int(np.ceil(max((flat.texcoords[:, k].max(initial=0.0) for flat in charted), default=0.0) - 1e-3)) for k in (0, 1)]
    return min(page, max(4, -(-used[0] // 4) * 4)), min(page, max(4, -(-used[1] // 4) * 4))


def _assembled(scene: Scene, drawn: list[Instance], meshes: list[Mesh], charted: list[Charted], pages: int, size: tuple[int, int]) -> Atlas:
    """The scene whose instances have meshes of their own, one for each page that they are on."""
    made, instances, page, chart = [], [], [], []
    for instance, mesh, flat in zip(drawn, meshes, charted, strict=True):
        for number in np.unique(flat.page):
            chosen = flat.page == number
            made.append(_piece(mesh, flat, chosen, size))
            instances.append(replace(instance, mesh=len(made) - 1))
            page.append(number)
            chart.append(flat.chart[chosen])
    charts = np.concatenate([np.zeros(0, np.int32), *chart])
    return Atlas(replace(scene, meshes=made, instances=instances), np.array(page, np.int32), pages, size, charts, False)


def _piece(mesh: Mesh, flat: Charted, chosen: Array, size: tuple[int, int]) -> Mesh:
    """The chosen triangles of a mesh, with lightmap coordinates."""
    used, triangles = np.unique(flat.triangles[chosen], return_inverse=True)
    source = flat.source[used]
    arrays = {name: value[source] for name in _VERTEX_ARRAYS if (value := getattr(mesh, name)) is not None}
    arrays["texcoords1"] = (flat.texcoords[used] / size).astype(np.float32)
    return replace(mesh, triangles=triangles.reshape(-1, 3).astype(np.int32), **arrays)
