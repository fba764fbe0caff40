"""Seams: the places where two edges of charts lie together in the world and apart in the lightmap.

Edges that share both corners are found by sorting. Edges that only lie along each other, as where a long wall touches two short ones,
are found through points along them. Two edges make a seam where the surface goes on: where the shading normals agree. Whether something stands
between the two sides is for `luxel.radiosity.seams` to see.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.radiosity.appearance import MOST_LEAN
from luxel.raster.geometry import Geometry, flatten
from luxel.scene.coincidence import mixed

if TYPE_CHECKING:
    from luxel.radiosity.unwrap import Atlas

ANGLE = 5.0  # degrees between the normals of two sides that are one surface
_NEAR = 0.1  # texels: edges that touch are nearer than this
_POINTS = 400_000  # along all edges together
_PARALLEL = 0.999  # cosine between edges that lie along each other
_FORWARD = np.array([0.53, 0.37, 0.76])  # nearly of length 1, and square to few edges of what people build
_LARGEST_GROUP = 12  # edges in one place; more are no seams of surfaces


class Seams(NamedTuple):
    """s pieces of edges that lie together, each as two lines in texture space.

    Attributes:
        page: (s, 2) int32: page of the two sides.
        start, end: (s, 2, 2) float64: texture coordinates (u, v) of both sides where the piece begins and ends.
        place: (s, 2, 3) float64, metres: where it begins and ends in the world.
        normal: (s, 2, 3) float64, unit: the surface's, there.
        inward: (s, 2, 3) float64, unit: from the seam into each side's triangle.
        chart: (s, 2) int32: of the two sides.
    """

    page: Array
    start: Array
    end: Array
    place: Array
    normal: Array
    inward: Array
    chart: Array


class Edges(NamedTuple):
    """e edges of triangles at the borders of charts, with their two corners.

    Attributes:
        place: (e, 2, 3) float64, metres.
        uv: (e, 2, 2) float64.
        normal: (e, 2, 3) float64, unit shading normals.
        page: (e,) int32.
        inward: (e, 3) float64: unit vector in the triangle's plane, away from the edge.
        chart: (e,) int32.
        key: (e,) uint64: equal for edges between the same two places.
    """

    place: Array
    uv: Array
    normal: Array
    page: Array
    inward: Array
    chart: Array
    key: Array

    def take(self, rows: Array) -> Edges:
        """Those of `rows`."""
        return Edges(*(array[rows] for array in self))


def find_seams(atlas: Atlas, angle: float = ANGLE) -> Seams:
    """The seams of a scene's lightmap.

    Args:
        atlas: Scene, pages and their size.
        angle: Degrees that the normals of the two sides may differ.
    """
    edges = _chart_edges(atlas)
    same = np.cos(np.radians(angle))
    exact = _same_corners(edges, same)
    alone = np.ones(len(edges.page), bool)
    alone[[exact[:, 0], exact[:, 1]]] = False
    whole = np.stack([edges.uv[exact[:, 0]], _aligned(edges, exact, edges.uv)], 1)  # (s, side, corner, 2)
    alone &= (edges.uv[:, 0] != edges.uv[:, 1]).any(1)  # a point on the page has one texel for all of itself: nothing there to run along
    along = _along(edges.take(alone), np.array(atlas.size, np.float64), same)
    first = exact[:, 0]
    found = Seams(
        edges.page[exact], whole[:, :, 0], whole[:, :, 1], edges.place[first], edges.normal[first], edges.inward[exact], edges.chart[exact],
    )  # fmt: skip
    return Seams(*(np.concatenate(arrays) for arrays in zip(found, along, strict=True)))


def _chart_edges(atlas: Atlas) -> Edges:
    """The edges that are no neighbour's edge, in place and on the page."""
    scene = atlas.scene
    geometry = flatten(scene, cull="none")
    drawn = [len(scene.meshes[instance.mesh].triangles) > 0 for instance in scene.instances]
    page = np.repeat(atlas.instance_page[drawn], np.diff(geometry.part_start)).astype(np.int32)
    page = np.repeat(page, 3)
    corners = geometry.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    place, spot = _numbers(geometry, atlas)
    on_page = mixed([np.sort(spot[corners], 1)[:, 0], np.sort(spot[corners], 1)[:, 1], page.astype(np.uint64)])
    _, back, count = np.unique(on_page, return_inverse=True, return_counts=True)
    ends = np.sort(place[corners], 1)
    rows = np.flatnonzero((count[back] == 1) & (ends[:, 0] != ends[:, 1]))
    third = geometry.triangles[:, [2, 0, 1]].reshape(-1)[rows]
    key = mixed(list(ends[rows].T))
    return _edges(geometry, corners[rows], third, page[rows], atlas.chart[rows // 3], key)


def _numbers(geometry: Geometry, atlas: Atlas) -> tuple[Array, Array]:
    """(n,) uint64 twice: a vertex's place in the world, and that with its place on the page."""
    largest = float(np.abs(geometry.positions).max(initial=0.0)) or 1.0
    cells = np.round(geometry.positions.astype(np.float64) / (0.9e-6 * largest)).astype(np.int64).view(np.uint64)
    place = mixed(list(cells.T))
    texels = np.round(geometry.texcoords1.astype(np.float64) * np.array(atlas.size) * 64).astype(np.int64).view(np.uint64)
    return place, mixed([place, *texels.T])


def _edges(geometry: Geometry, corners: Array, third: Array, page: Array, chart: Array, key: Array) -> Edges:
    place = geometry.positions[corners].astype(np.float64)
    direction = _unit(place[:, 1] - place[:, 0])
    inward = geometry.positions[third].astype(np.float64) - place[:, 0]
    inward = _unit(inward - (inward * direction).sum(1, keepdims=True) * direction)
    uv = geometry.texcoords1[corners].astype(np.float64)
    normal = _unit(geometry.normals[corners].astype(np.float64))
    face = np.cross(direction, inward)
    triangle = np.concatenate([corners, third[:, None]], 1)
    lean = (_unit(geometry.normals[triangle].astype(np.float64)) * face[:, None]).sum(2).min(1)
    normal = np.where((lean > MOST_LEAN)[:, None, None], normal, face[:, None])  # as luxels have them
    return Edges(place, uv, normal, page, inward, chart, key)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


def _pairs(key: Array) -> Array:
    """(k, 2) int64: all pairs of rows with equal keys, in groups of a reasonable size."""
    order = np.argsort(key, kind="stable")
    ordered, found = key[order], [np.zeros((0, 2), np.int64)]
    for step in range(1, _LARGEST_GROUP):
        equal = np.flatnonzero(ordered[step:] == ordered[:-step])
        if not len(equal):
            break
        found.append(np.stack([order[equal], order[equal + step]], 1))
    return np.concatenate(found)


def _same_corners(edges: Edges, same: float) -> Array:
    """(s, 2) int64: pairs of edges with both corners in one place that are one surface's."""
    pairs = _pairs(edges.key)
    one = ((edges.normal[pairs[:, 0]] * _aligned(edges, pairs, edges.normal)).sum(2) >= same).all(1)
    return pairs[one]


def _aligned(edges: Edges, pairs: Array, corners: Array) -> Array:
    """What the second edges of `pairs` have at their corners (e, 2, d), in the order of the first edges' corners."""
    begin = edges.place[pairs[:, 0], 0]
    apart = [np.abs(begin - edges.place[pairs[:, 1], corner]).max(1) for corner in (0, 1)]
    own = corners[pairs[:, 1]]
    return np.where((apart[0] > apart[1])[:, None, None], own[:, ::-1], own)


def _along(edges: Edges, size: Array, same: float) -> Seams:
    """Seams of edges that lie along each other without sharing both corners."""
    lines, directions = np.zeros((0, 2, 2)), np.zeros((0, 2, 3))
    none = Seams(edges.page[:0, None].repeat(2, 1), lines, lines, directions, directions, directions, edges.chart[:0, None].repeat(2, 1))
    if len(edges.page) < 2:
        return none
    length = np.linalg.norm(edges.place[:, 1] - edges.place[:, 0], axis=1)
    texel = length / np.maximum(np.linalg.norm((edges.uv[:, 1] - edges.uv[:, 0]) * size, axis=1), 1e-6)
    spacing = max(2 * float(np.median(texel)), float(length.sum()) / _POINTS, 1e-12)
    pairs = _near(edges, length, spacing)
    a, b = edges.take(pairs[:, 0]), edges.take(pairs[:, 1])
    near = _NEAR * np.minimum(np.minimum(texel[pairs[:, 0]], texel[pairs[:, 1]]), spacing)
    direction = _unit(a.place[:, 1] - a.place[:, 0])
    reach = length[pairs[:, 0]]
    ends = ((b.place - a.place[:, :1]) * direction[:, None]).sum(2)  # (k, 2): b's corners along a, metres
    low, high = np.maximum(ends.min(1), 0), np.minimum(ends.max(1), reach)
    span = ends[:, 1] - ends[:, 0]
    lies = (high - low > near) & (np.abs(span) > 0.5 * length[pairs[:, 1]])
    a_at = np.stack([low, high], 1) / reach[:, None]  # where the piece begins and ends, 0..1 along each edge
    b_at = (np.stack([low, high], 1) - ends[:, :1]) / np.where(lies, span, 1)[:, None]
    gap = np.linalg.norm(_at(a.place, a_at) - _at(b.place, b_at), axis=2).max(1)
    normals = _unit(_at(a.normal, a_at)), _unit(_at(b.normal, b_at))
    rows = np.flatnonzero(lies & (gap < near) & ((normals[0] * normals[1]).sum(2) >= same).all(1))
    sides, both = np.stack([_at(a.uv, a_at)[rows], _at(b.uv, b_at)[rows]], 1), pairs[rows]
    place = _at(a.place, a_at)[rows]
    return Seams(edges.page[both], sides[:, :, 0], sides[:, :, 1], place, normals[0][rows], edges.inward[both], edges.chart[both])


def _at(corners: Array, t: Array) -> Array:
    """(k, 2, d): between corners (k, 2, d), at t (k, 2) in 0..1."""
    return corners[:, :1] + (corners[:, 1:] - corners[:, :1]) * t[:, :, None]


def _near(edges: Edges, length: Array, spacing: float) -> Array:
    """(k, 2) int64: pairs of edges, the lower first, that may lie along each other.

    Points stand along every edge, `spacing` apart at most and at its corners. Where two edges overlap, a corner of one of them is in the
    overlap, and half the spacing at most from a point of the other. Points are near if their edges' directions are, too: among blades of grass
    there are too many pairs of others.
    """
    from scipy.spatial import cKDTree

    count = np.maximum(np.ceil(length / spacing), 1).astype(np.int64) + 1
    edge = np.repeat(np.arange(len(length)), count)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    t = step / (count[edge] - 1)
    points = edges.place[edge, 0] + (edges.place[edge, 1] - edges.place[edge, 0]) * t[:, None]
    direction = _unit(edges.place[:, 1] - edges.place[:, 0])
    bend, forward = np.sqrt(2 - 2 * _PARALLEL), direction @ _FORWARD
    ways = np.where(forward < 0, -1, 1)[:, None] * direction  # of the two that an edge has, one
    again = np.flatnonzero((np.abs(forward) < bend)[edge])  # but both where the other edge's may be the other
    of = np.concatenate([np.arange(len(edge)), again])
    way = np.concatenate([ways[edge], -ways[edge[again]]])
    tree = cKDTree(np.concatenate([points[of] / (0.6 * spacing), way / bend], 1))
    found = of[tree.query_pairs(1 + 1e-6, np.inf, output_type="ndarray")]
    found = found[((points[found[:, 0]] - points[found[:, 1]]) ** 2).sum(1) <= (0.6 * spacing) ** 2]
    pairs = np.sort(edge[found], 1)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    parallel = np.abs((direction[pairs[:, 0]] * direction[pairs[:, 1]]).sum(1)) > _PARALLEL
    return np.unique(pairs[parallel], axis=0)
