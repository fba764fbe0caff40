"""The grids of `luxel.cuda.kernels` as loops, over the same threads, compiled for the processor."""

from types import SimpleNamespace

import needs_numba_cuda  # noqa: F401 - before what it may skip
import numpy as np

from luxel import jit
from luxel.cuda.again import Again
from luxel.cuda.grids import named
from luxel.cuda.threads import draw as draw_source
from luxel.cuda.threads import shade as shade_source
from luxel.cuda.threads import views as views_source

_BITS = ("float_bits", "bits_float", "lowest_bit", "count_bits", "prefetch", "floor", "floor32")


def _nothing(kernel):
    return None


_JIT = SimpleNamespace(
    DISABLED=True, device=jit.part, part=jit.part, inlined=jit.part, kernel=_nothing, parallel_kernel=_nothing,
    **{name: getattr(jit, name) for name in _BITS},
)  # fmt: skip
again = Again("loops", {"luxel.jit": _JIT}, jit.part).load
_draw, _shade, _views = (again(module.__name__) for module in (draw_source, shade_source, views_source))
_project_vertex, _count_pieces, _write_pieces = _views.project_vertex, _views.count_pieces, _views.write_pieces
_draw_triangle, _draw_piece, _draw_item = _draw.draw_triangle, _draw.draw_piece, _draw.draw_item
_shade_pixel, _resolve_pixel = _shade.shade_pixel, _shade.resolve_pixel
_light_vertex, _write_outputs_of = _shade.light_vertex, _shade.write_outputs_of
_Own, _SIZE, _STORED, _MOST = _shade.Own, _shade.SIZE, _shade.STORED, _shade.MOST


def _line(n, _, given):
    for i in range(n):
        body(i, *given)  # noqa: F821 - see `luxel.cuda.grids.named`


def _grid(n, m, given):
    for j in range(m):
        for i in range(n):
            body(i, j, *given)  # noqa: F821


def loops(module, lines, grids):
    """As `luxel.cuda.grids.kernels`."""
    return {name: jit.kernel(named(text, name, module, body)) for text, bodies in ((_line, lines), (_grid, grids)) for name, body in bodies.items()}


@jit.kernel
def project(n, count, given):
    for v in range(count):
        for i in range(n):
            _project_vertex(i, v, *given)


@jit.kernel
def count_pieces(n, _, given):
    p, q = np.empty((10, 7)), np.empty((18, 7))
    for i in range(n):
        _count_pieces(i, *given, p, q)


@jit.kernel
def write_pieces(n, _, given):
    p, q = np.empty((10, 7)), np.empty((18, 7))
    for i in range(n):
        _write_pieces(i, *given, p, q)


@jit.kernel
def draw(n, count, given):
    for v in range(count):
        for i in range(n):
            _draw_triangle(i, v, *given, None, None)


@jit.kernel
def draw_pieces(n, count, given):
    for v in range(count):
        for i in range(n):
            _draw_piece(i, v, *given, None, None)


@jit.kernel
def draw_items(n, _, given):
    for i in range(n):
        _draw_item(i // 32, i % 32, *given, None, None)


@jit.kernel
def mask(n, count, given):
    for v in range(count):
        for i in range(n):
            _draw_triangle(i, v, *given, None)


@jit.kernel
def mask_pieces(n, count, given):
    for v in range(count):
        for i in range(n):
            _draw_piece(i, v, *given, None)


@jit.kernel
def mask_items(n, _, given):
    for i in range(n):
        _draw_item(i // 32, i % 32, *given, None)


@jit.kernel
def peel(n, count, given):
    everything, pattern, raster, queue, keys, nearer_than = given
    for v in range(count):
        for i in range(n):
            _draw_triangle(i, v, everything, pattern, raster, queue, keys, None, nearer_than)


@jit.kernel
def peel_pieces(n, count, given):
    everything, pattern, raster, queue, keys, nearer_than = given
    for v in range(count):
        for i in range(n):
            _draw_piece(i, v, everything, pattern, raster, queue, keys, None, nearer_than)


@jit.kernel
def peel_items(n, _, given):
    everything, pattern, raster, queue, keys, nearer_than = given
    for i in range(n):
        _draw_item(i // 32, i % 32, everything, pattern, raster, queue, keys, None, nearer_than)


def take_layer(n, count, given):
    layer, keys, found = given
    there = layer != 0
    keys[there] = layer[there]
    found[0] = there.any()


def fill_keys(n, count, given):
    values, value = given
    values[:] = value


fill_floats = fill_ints = fill_keys


@jit.kernel
def shade(n, count, given):
    own = _Own(
        np.empty(_SIZE, np.float32), np.empty((1, _STORED), np.float32), np.empty((1, 4), np.int32), np.empty(4, np.int32),
        np.empty(2, np.float32), np.empty(_MOST, np.int32), np.empty(4, np.float32),
    )  # fmt: skip
    for v in range(count):
        for i in range(n):
            _shade_pixel(i, v, *given, own, None)


@jit.kernel
def shade_rich(n, count, given):
    own = _Own(
        np.empty(_SIZE, np.float32), np.empty((1, _STORED), np.float32), np.empty((1, 4), np.int32), np.empty(4, np.int32),
        np.empty(2, np.float32), np.empty(_MOST, np.int32), np.empty(4, np.float32),
    )  # fmt: skip
    for v in range(count):
        for i in range(n):
            _shade_pixel(i, v, *given, own, True)


@jit.kernel
def light_vertices(n, count, given):
    own = _Own(
        np.empty(_SIZE, np.float32), np.empty((1, _STORED), np.float32), np.empty((1, 4), np.int32), np.empty(4, np.int32),
        np.empty(2, np.float32), np.empty(_MOST, np.int32), np.empty(4, np.float32),
    )  # fmt: skip
    for v in range(count):
        for i in range(n):
            _light_vertex(i, v, *given, own)


@jit.kernel
def resolve(n, count, given):
    sums = np.empty(4, np.float32)
    for v in range(count):
        for i in range(n):
            _resolve_pixel(i, v, *given, sums)


@jit.kernel
def write_outputs(n, count, given):
    for v in range(count):
        for i in range(n):
            _write_outputs_of(i, v, *given)
