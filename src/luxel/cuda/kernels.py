"""The grids: one thread a vertex, a triangle, a pixel, and its own memory. What the threads do is `luxel.cuda.threads`.

The second axis of a grid counts views. A kernel is given the number of threads that are wanted, and of views, and all else as one tuple. Each is
always given the same types: they are looked at once (`luxel.cuda.device.Gpu.launch`).
"""

from __future__ import annotations

import numpy as np

from luxel.cuda.door import cuda, kernel
from luxel.cuda.primitives import again
from luxel.cuda.threads import draw as draw_source
from luxel.cuda.threads import shade as shade_source
from luxel.cuda.threads import views as views_source

_WARP = 32
_draw, _shade, _views = (again(module.__name__) for module in (draw_source, shade_source, views_source))
_project_vertex, _count_pieces, _write_pieces = _views.project_vertex, _views.count_pieces, _views.write_pieces
_draw_triangle, _draw_piece, _draw_item = _draw.draw_triangle, _draw.draw_piece, _draw.draw_item
_shade_pixel, _resolve_pixel = _shade.shade_pixel, _shade.resolve_pixel
_light_vertex, _write_outputs_of = _shade.light_vertex, _shade.write_outputs_of
_Own, _SIZE, _STORED, _MOST = _shade.Own, _shade.SIZE, _shade.STORED, _shade.MOST
_NO_LAYER = _draw.NO_LAYER


@kernel
def project(n, views_drawn, given):
    """`threads.views.project_vertex`."""
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        _project_vertex(i, v, *given)


@kernel
def count_pieces(n, _, given):
    """`threads.views.count_pieces`."""
    i, _ = cuda.grid(2)
    p, q = cuda.local.array((10, 7), np.float64), cuda.local.array((18, 7), np.float64)
    if i < n:
        _count_pieces(i, *given, p, q)


@kernel
def write_pieces(n, _, given):
    """`threads.views.write_pieces`."""
    i, _ = cuda.grid(2)
    p, q = cuda.local.array((10, 7), np.float64), cuda.local.array((18, 7), np.float64)
    if i < n:
        _write_pieces(i, *given, p, q)


@kernel
def fill_keys(n, views_drawn, given):
    """values[v, i] = value, for (v, n) uint64."""
    values, value = given
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        values[v, i] = value


@kernel
def fill_floats(n, views_drawn, given):
    """values[v, i] = value, for (v, n) float32."""
    values, value = given
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        values[v, i] = value


@kernel
def fill_ints(n, views_drawn, given):
    """values[v, i] = value, for (v, n) int32."""
    values, value = given
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        values[v, i] = value


@kernel
def draw(n, views_drawn, given):
    """`threads.draw.draw_triangle`: opaque triangles."""
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        _draw_triangle(i, v, *given, None, None)


@kernel
def draw_pieces(n, views_drawn, given):
    """`threads.draw.draw_piece`: opaque pieces."""
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        _draw_piece(i, v, *given, None, None)


@kernel
def draw_items(n, _, given):
    """`threads.draw.draw_item`: `n` lanes."""
    i, _ = cuda.grid(2)
    if i < n:
        _draw_item(i // _WARP, i % _WARP, *given, None, None)


@kernel
def mask(n, views_drawn, given):
    """`threads.draw.draw_triangle`: masked triangles."""
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        _draw_triangle(i, v, *given, None)


@kernel
def mask_pieces(n, views_drawn, given):
    """`threads.draw.draw_piece`: masked pieces."""
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        _draw_piece(i, v, *given, None)


@kernel
def mask_items(n, _, given):
    """`threads.draw.draw_item`: masked ones."""
    i, _ = cuda.grid(2)
    if i < n:
        _draw_item(i // _WARP, i % _WARP, *given, None)


@kernel
def peel(n, views_drawn, given):
    """`threads.draw.draw_triangle`: one layer of blended triangles."""
    everything, pattern, raster, queue, keys, nearer_than = given
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        _draw_triangle(i, v, everything, pattern, raster, queue, keys, None, nearer_than)


@kernel
def peel_pieces(n, views_drawn, given):
    """`threads.draw.draw_piece`: one layer of blended pieces."""
    everything, pattern, raster, queue, keys, nearer_than = given
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        _draw_piece(i, v, everything, pattern, raster, queue, keys, None, nearer_than)


@kernel
def peel_items(n, _, given):
    """`threads.draw.draw_item`: blended ones."""
    everything, pattern, raster, queue, keys, nearer_than = given
    i, _ = cuda.grid(2)
    if i < n:
        _draw_item(i // _WARP, i % _WARP, everything, pattern, raster, queue, keys, None, nearer_than)


@kernel
def take_layer(n, views_drawn, given):
    """What a pass found is what the next must be nearer than: (v, n) keys; and `found` gets 1 if there was anything."""
    layer, keys, found = given
    i, v = cuda.grid(2)
    if i < n and v < views_drawn and layer[v, i] != _NO_LAYER:
        keys[v, i] = layer[v, i]
        found[0] = 1


@kernel
def shade(n, views_drawn, given):
    """`threads.shade.shade_pixel`, where no material has a texture or is of the metallic-roughness model."""
    i, v = cuda.grid(2)
    own = _Own(
        cuda.local.array(_SIZE, np.float32), cuda.local.array((1, _STORED), np.float32), cuda.local.array((1, 4), np.int32),
        cuda.local.array(4, np.int32), cuda.local.array(2, np.float32), cuda.local.array(_MOST, np.int32), cuda.local.array(4, np.float32),
    )  # fmt: skip
    if i < n and v < views_drawn:
        _shade_pixel(i, v, *given, own, None)


@kernel
def shade_rich(n, views_drawn, given):
    """`threads.shade.shade_pixel`."""
    i, v = cuda.grid(2)
    own = _Own(
        cuda.local.array(_SIZE, np.float32), cuda.local.array((1, _STORED), np.float32), cuda.local.array((1, 4), np.int32),
        cuda.local.array(4, np.int32), cuda.local.array(2, np.float32), cuda.local.array(_MOST, np.int32), cuda.local.array(4, np.float32),
    )  # fmt: skip
    if i < n and v < views_drawn:
        _shade_pixel(i, v, *given, own, True)


@kernel
def light_vertices(n, views_drawn, given):
    """`threads.shade.light_vertex`."""
    i, v = cuda.grid(2)
    own = _Own(
        cuda.local.array(_SIZE, np.float32), cuda.local.array((1, _STORED), np.float32), cuda.local.array((1, 4), np.int32),
        cuda.local.array(4, np.int32), cuda.local.array(2, np.float32), cuda.local.array(_MOST, np.int32), cuda.local.array(4, np.float32),
    )  # fmt: skip
    if i < n and v < views_drawn:
        _light_vertex(i, v, *given, own)


@kernel
def resolve(n, views_drawn, given):
    """`threads.shade.resolve_pixel`."""
    i, v = cuda.grid(2)
    sums = cuda.local.array(4, np.float32)
    if i < n and v < views_drawn:
        _resolve_pixel(i, v, *given, sums)


@kernel
def write_outputs(n, views_drawn, given):
    """`threads.shade.write_outputs_of`."""
    i, v = cuda.grid(2)
    if i < n and v < views_drawn:
        _write_outputs_of(i, v, *given)
