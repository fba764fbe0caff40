"""Facets: what a luxel that glows is made of, where its triangles do not face alike.

A lamp smaller than a luxel has one or a few, each with the plane of one triangle, though its light leaves all around. So what falls to such a luxel,
whole triangles or what the texel cuts of them, is put together by facing, and each facet shines for itself: light points come from the geometry,
whatever the lightmap's density. A luxel on a flat surface has none and shines as it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.cuttings import Cuttings, cuttings_of
from luxel.radiosity.element import AREA, FREE, GX, GZ, NX, NZ, PX, PZ, SAMPLES, UX, VX, VZ
from luxel.radiosity.glow import emission_of, means
from luxel.radiosity.luxels import Luxels
from luxel.raster.geometry import Geometry
from luxel.raster.materials import MaterialTable

_ALIKE = math.cos(math.radians(5.0))
"""A luxel none of whose triangles leans farther from it is flat."""

_CLOSE = math.cos(math.radians(10.0))
"""So far from its first triangle the others of a facet may lean, if there may be as many facets as that takes."""

_THINNEST = 0.01  # of a facet's side

_FEWEST, _MOST = 6, 64  # facets of a luxel, at most: a box has six; sixty-four are 18 degrees apart on a ball
_POINTS = 4  # times the points of all lights: so many facets all luxels may have together, if that is more than the fewest of each


class Facets(NamedTuple):
    """Facets of luxels.

    Attributes:
        bent: (k,) bool: luxels that have facets.
        numbers: (17, f) float32, as of elements: those of a luxel one after the other; their areas sum to its area.
        luxel: (f,) int64: which of the k luxels each is of.
        share: (f, 3) float32: exitance, of the luxel's.
    """

    bent: Array
    numbers: Array
    luxel: Array
    share: Array


def facets_of(luxels: Luxels, chosen: Array, geometry: Geometry, charts: Array, table: MaterialTable | None, points: int, threads: int) -> Facets:
    """Facets of those of the chosen luxels that are bent.

    Args:
        chosen: (k,) int32, ascending.
        charts: (m,) int32, of each triangle.
        table: Of `glowing_table`.
        points: About so many light points there are to be.
    """
    none = Facets(np.zeros(len(chosen), np.bool_), np.zeros((17, 0), np.float32), np.zeros(0, np.int64), np.ones((0, 3), np.float32))
    triangles = geometry.positions.astype(np.float64)[geometry.triangles]
    normal = _normals(triangles)
    candidates = _in_bent_charts(luxels, chosen, charts, normal)
    if not len(candidates):
        return none
    pieces = cuttings_of(luxels, chosen, geometry, charts, candidates, threads)
    bent = np.zeros(len(chosen), np.bool_)
    bent[pieces.luxel[(normal[pieces.triangle] * luxels.face_normal[chosen[pieces.luxel]]).sum(1) < _ALIKE]] = True
    if not bent.any():
        return none
    pieces = pieces.only(bent[pieces.luxel])
    emission = np.ones((len(pieces.luxel), 3), np.float32)
    if table is not None:
        emission, area = emission_of(pieces, luxels, chosen, geometry, table, threads)
        emission, pieces = emission[area > 0], pieces._replace(area=area).only(area > 0)
        bent = np.bincount(pieces.luxel, minlength=len(chosen)) > 0
        if not bent.any():
            return none
    most = int(np.clip(_POINTS * points // np.count_nonzero(bent), _FEWEST, _MOST))
    count = np.bincount(pieces.luxel, minlength=len(chosen))
    facet, found = np.empty(len(pieces.luxel), np.int64), np.empty(len(chosen), np.int64)
    _by_facing(np.append(0, np.cumsum(count)), normal[pieces.triangle], pieces.area, most, facet, found)
    luxel = np.repeat(np.arange(len(chosen)), found)
    numbers, whole = _numbers(pieces, facet, triangles[pieces.triangle], normal[pieces.triangle])
    whole *= (luxels.area[chosen] / np.maximum(np.bincount(luxel, whole, len(chosen)), 1e-300))[luxel]
    return Facets(bent, _scaled(numbers, whole), luxel, _shares(emission, pieces, facet, luxel))


def _shares(emission: Array, pieces: Cuttings, facet: Array, luxel: Array) -> Array:
    """(f, 3) float32: of the emission (p, 3) of pieces, that of facets relative to their luxels'."""
    whole = means(emission, pieces.area, pieces.luxel, int(luxel.max(initial=-1)) + 1)[luxel]
    return np.divide(means(emission, pieces.area, facet, len(luxel)), whole, out=np.ones_like(whole), where=whole > 0)


def without(facets: Facets, hidden: Array) -> Facets:
    """The same without those `hidden`, numbers (h,); a luxel that has no others has none, and shines as it is."""
    kept = np.delete(np.arange(len(facets.luxel)), hidden)
    luxel = facets.luxel[kept]
    return Facets(np.bincount(luxel, minlength=len(facets.bent)) > 0, facets.numbers[:, kept], luxel, facets.share[kept])


def _normals(triangles: Array) -> Array:
    """(m, 3) float64, unit, 0 where there is none: of triangles (m, 3, 3)."""
    with np.errstate(all="ignore"):
        across = np.nan_to_num(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), posinf=0.0, neginf=0.0)
    return across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]


def _in_bent_charts(luxels: Luxels, chosen: Array, charts: Array, normal: Array) -> Array:
    """(c,) int64: triangles of charts with chosen luxels that do not all face alike."""
    count = int(charts.max(initial=-1)) + 1
    first = np.full(count + 1, -1, np.int64)  # the last is of triangles without a chart
    first[luxels.chart[chosen]] = chosen
    own = np.flatnonzero((first[charts] >= 0) & (charts >= 0) & normal.any(1))
    leans = (normal[own] * luxels.face_normal[first[charts[own]]]).sum(1) < _ALIKE
    bent = np.zeros(count, np.bool_)
    bent[charts[own[leans]]] = True
    return own[bent[charts[own]]]


@jit.kernel
def _by_facing(start, normal, area, most, facet, found):
    """The facet of each piece, numbered over all luxels, and how many each luxel has: the largest piece is the first of a facet, and then that whose
    area times its lean from the nearest is largest, as long as any leans too far."""
    nearest = np.empty(len(normal))
    total = 0
    for luxel in range(len(found)):
        first, last, count = start[luxel], start[luxel + 1], 0
        chosen = -1
        for i in range(first, last):
            nearest[i] = -2.0
            if chosen < 0 or area[i] > area[chosen]:
                chosen = i
        while chosen >= 0:
            following, widest = -1, 0.0
            for i in range(first, last):
                lean = normal[i, 0] * normal[chosen, 0] + normal[i, 1] * normal[chosen, 1] + normal[i, 2] * normal[chosen, 2]
                if lean > nearest[i]:
                    nearest[i], facet[i] = lean, total + count
                if nearest[i] < _CLOSE and area[i] * (1.0 - nearest[i]) > widest:
                    following, widest = i, area[i] * (1.0 - nearest[i])
            count += 1
            chosen = following if count < most else -1
        found[luxel] = count
        total += count


def _numbers(pieces: Cuttings, facet: Array, corners: Array, normal: Array) -> tuple[Array, Array]:
    """(17, f) float64 of facets, and their areas (f,); corners (p, 3, 3) and normals (p, 3) of the pieces' triangles.

    A facet is taken for a rectangle about the point of its triangles that is nearest to its centroid, with one side along an edge of its largest
    piece and the spread of its area along both. So what is a rectangle stays it.
    """
    count = int(facet.max()) + 1
    area, weight = np.bincount(facet, pieces.area, count), pieces.area[:, None]
    (a, b, c), (s1, s2) = corners.transpose(1, 0, 2), pieces.place.T[..., None]
    own_middle = a + s1 * (b - a) + s2 * (c - a)

    def sums(values: Array) -> Array:
        return np.stack([np.bincount(facet, column, count) for column in values.T], 1)

    middle, facing = sums(weight * own_middle) / area[:, None], sums(weight * normal)
    facing /= np.maximum(np.linalg.norm(facing, axis=1), 1e-300)[:, None]
    point = _on_triangles(middle[facet], corners, normal)
    nearest = _first_of(facet, ((point - middle[facet]) ** 2).sum(1))
    along = _edges(corners[_first_of(facet, -pieces.area)], facing)
    across = np.cross(facing, along)
    from_middle, from_own = own_middle - middle[facet], corners - corners.mean(1, keepdims=True)
    whole = np.linalg.norm(np.cross(from_own[:, 1] - from_own[:, 0], from_own[:, 2] - from_own[:, 0]), axis=1) / 2
    numbers = np.zeros((17, count))
    for row, axis in ((UX, along), (VX, across)):
        own = np.einsum("pki,pi->pk", from_own, axis[facet])
        square = (from_middle * axis[facet]).sum(1) ** 2 + (own**2).sum(1) / 12 * (pieces.area / whole)  # of what is cut, as if it had the same shape
        spread = np.sqrt(np.bincount(facet, pieces.area * square, count) / area)
        numbers[row : row + 3] = axis.T * np.maximum(spread, _THINNEST * np.sqrt(area))
    numbers[PX : PZ + 1], numbers[NX : NZ + 1], numbers[GX : GZ + 1], numbers[FREE] = point[nearest].T, facing.T, facing.T, (1 << SAMPLES) - 1
    return numbers, area


def _scaled(numbers: Array, area: Array) -> Array:
    """(17, f) float32: facets as large as `area` (f,)."""
    u, v = (np.linalg.norm(numbers[row : row + 3], axis=0) for row in (UX, VX))
    scaled = numbers.astype(np.float64)
    scaled[UX : VZ + 1] *= np.sqrt(area / np.maximum(u * v, 1e-300))
    scaled[AREA] = area
    return scaled.astype(np.float32)


def _first_of(group: Array, key: Array) -> Array:
    """Of each group, which are numbered, the first with the least key."""
    order = np.lexsort((key, group))
    return order[np.searchsorted(group[order], np.arange(int(group.max()) + 1))]


def _on_triangles(place: Array, corners: Array, normal: Array) -> Array:
    """(p, 3): a point of each triangle, with unit normals (p, 3), that is near a place (p, 3); its foot, if that is in the triangle."""
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    whole = np.maximum((np.cross(u, v) * normal).sum(1), 1e-300)
    s1 = ((np.cross(place - a, v) * normal).sum(1) / whole).clip(0, None)
    s2 = ((np.cross(u, place - a) * normal).sum(1) / whole).clip(0, None)
    over = np.maximum(s1 + s2, 1.0)
    return a + (s1 / over)[:, None] * u + (s2 / over)[:, None] * v


def _edges(corners: Array, facing: Array) -> Array:
    """(f, 3): unit vectors along the second longest edge of triangles (f, 3, 3), square to unit normals (f, 3): a leg of what halves a rectangle."""
    edges = np.roll(corners, -1, 1) - corners
    edges -= (edges * facing[:, None]).sum(2, keepdims=True) * facing[:, None]
    length = np.linalg.norm(edges, axis=2)
    second = np.argsort(length, axis=1, kind="stable")[:, 1]
    row = np.arange(len(corners))
    return edges[row, second] / np.maximum(length[row, second], 1e-300)[:, None]
