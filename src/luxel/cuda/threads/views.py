"""What is drawn, from where: the arrays of a batch of views, and what one view sees of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.jit import part
from luxel.raster.bin import Clipped
from luxel.raster.clip import cut, write_piece
from luxel.raster.constants import UNSAFE
from luxel.raster.fragments import Drawn, Eye
from luxel.raster.geometry import Geometry
from luxel.raster.lighting import LightTable
from luxel.raster.project import is_unsafe, place, why_unsafe

# Columns of `Views.numbers`.
LEAST_DEPTH, NEAR, FAR, PARALLEL, NUMBERS = 0, 1, 2, 3, 4


class Views(NamedTuple):
    """Cameras and what depends on them; the first axis counts views.

    Attributes:
        matrix: (v, 4, 4) float64, clip_from_world.
        numbers: (v, NUMBERS) float64: depth of the far plane, `near`, `far`, 1 if orthographic.
        eye: (v, 2, 3) float32: place of the eye; unit direction towards it.
        lights: (v, l, LIGHT_COLUMNS) float32.
        ambient: (v, 2, 3) float32.
        previous: (v, 4, 4) float64, clip_from_world of the camera that motion is measured from.
    """

    matrix: Array
    numbers: Array
    eye: Array
    lights: Array
    ambient: Array
    previous: Array


class Everything(NamedTuple):
    """What all views draw.

    Attributes:
        geometry: Of the scene; the same for all views.
        screen: (v, n, 4) int32, projected vertices; screen_f: the same bits, float32.
        clipped: Pieces of all views, one view after the other; clipped_f: `clipped.screen` as float32.
        first_piece: (v + 1,) int32: the pieces of view v are first_piece[v] .. first_piece[v + 1] - 1.
        lit: (v, n, 4) float32, vertex colours by view in place of the geometry's, for Gouraud shading; or (0, 0, 4).
    """

    geometry: Geometry
    screen: Array
    screen_f: Array
    clipped: Clipped
    clipped_f: Array
    first_piece: Array
    lit: Array


@part
def seen_by(v, everything):
    """What view `v` draws."""
    g, first, last = everything.geometry, everything.first_piece[v], everything.first_piece[v + 1]
    colors = everything.lit[v] if len(everything.lit) > 0 else g.colors
    geometry = Geometry(
        g.positions, g.triangles, g.normals, g.texcoords, g.texcoords1, colors, g.tangents, g.part_start, g.part_material, g.part_object, g.parts
    )
    c = everything.clipped
    clipped = Clipped(c.source[first:last], c.screen[first:last], c.corners[first:last])
    return Drawn(geometry, everything.screen[v], everything.screen_f[v], clipped, everything.clipped_f[first:last])


@part
def eye_of(v, views):
    """Where view `v` looks from."""
    return Eye(views.eye[v, 0], views.eye[v, 1], views.numbers[v, PARALLEL] != 0.0)


@part
def lights_of(v, views):
    """What lights the scene in view `v`."""
    return LightTable(views.lights[v], views.ambient[v], 1)


@part
def project_vertex(i, v, positions, views, window, screen, screen_f):
    """Project vertex `i` into view `v`, as `luxel.raster.project`."""
    m, least_depth = views.matrix[v], views.numbers[v, LEAST_DEPTH]
    rows = (
        m[0, 0], m[0, 1], m[0, 2], m[0, 3], m[1, 0], m[1, 1], m[1, 2], m[1, 3],
        m[2, 0], m[2, 1], m[2, 2], m[2, 3], m[3, 0], m[3, 1], m[3, 2], m[3, 3],
    )  # fmt: skip
    x, y, z = np.float64(positions[i, 0]), np.float64(positions[i, 1]), np.float64(positions[i, 2])
    half_w, half_h = np.float64(window.full_width) * 128.0, np.float64(window.full_height) * 128.0
    fx, fy, depth, weight = place(rows, x, y, z, half_w, half_h, np.float64(window.x) * 256.0, np.float64(window.y) * 256.0)
    if is_unsafe(fx, fy, depth, weight, least_depth):
        fx, fy, depth, weight = np.float64(UNSAFE), np.float64(why_unsafe(rows, x, y, z, least_depth)), 0.0, 0.0
    screen[v, i, 0] = np.int32(fx)
    screen[v, i, 1] = np.int32(fy)
    screen_f[v, i, 2] = np.float32(depth)
    screen_f[v, i, 3] = np.float32(weight)


@part
def count_pieces(c, candidates, geometry, views, guard, pieces, p, q):
    """How many pieces clipping makes of candidate `c`: candidates (c, 2) int32 are view and triangle. p (10, 7), q (18, 7) float64 are scratch."""
    v = candidates[c, 0]
    n = cut(p, q, candidates[c, 1], geometry.positions, geometry.triangles, views.matrix[v], views.numbers[v, LEAST_DEPTH], guard)
    pieces[c] = max(n - 2, 0)


@part
def write_pieces(c, candidates, geometry, views, guard, window, start, clipped,
                 clipped_f, p, q):  # fmt: skip
    """Write the pieces of candidate `c` from row start[c] on."""
    v = candidates[c, 0]
    n = cut(p, q, candidates[c, 1], geometry.positions, geometry.triangles, views.matrix[v], views.numbers[v, LEAST_DEPTH], guard)
    half_w, half_h = np.float64(window.full_width) * 128.0, np.float64(window.full_height) * 128.0
    left, top = np.float64(window.x) * 256.0, np.float64(window.y) * 256.0
    for piece in range(n - 2):
        clipped.source[start[c] + piece] = candidates[c, 1]
        write_piece(p, piece, start[c] + piece, half_w, half_h, left, top, clipped.screen, clipped_f, clipped.corners)
