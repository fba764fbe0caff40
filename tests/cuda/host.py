"""A stand-in for the GPU: the same threads, compiled for the processor and run one after the other. What it leaves out are the grids themselves
(`luxel.cuda.kernels`), which the simulator runs, and the compiler for the GPU."""

from types import SimpleNamespace

import numba
import numpy as np

from luxel import jit
from luxel.cuda.again import Again

_BITS = ("float_bits", "bits_float", "lowest_bit", "count_bits", "prefetch")


def _function(python):
    return numba.njit(error_model="numpy")(python)


def _nothing(kernel):
    return None


_JIT = SimpleNamespace(
    DISABLED=True, device=_function, part=_function, inlined=_function, kernel=_nothing, parallel_kernel=_nothing,
    **{name: getattr(jit, name) for name in _BITS},
)  # fmt: skip
again = Again({"luxel.jit": _JIT}, _function).load
_views, _draw, _shade = (again(f"luxel.cuda.threads.{name}") for name in ("views", "draw", "shade"))

_CLIP = "p, q = np.empty((10, 7)), np.empty((18, 7))"
_OWN = (
    "own = Own(np.empty(SIZE, np.float32), np.empty((1, STORED), np.float32), np.empty((1, 4), np.int32), np.empty(4, np.int32),"
    " np.empty(2, np.float32), np.empty(MOST, np.int32), np.empty(4, np.float32))"
)
_DRAW = "everything, pattern, raster, queue, keys"
_SHADE = "window, everything, views, materials, shading, keys, nothing, picture"


def _grid(given, call, scratch="pass"):
    """What a kernel is: `call` for each thread i of each view v."""
    names = {**vars(_views), **vars(_draw), **vars(_shade), "np": np}
    source = f"def run(n, views_drawn, {given}):\n {scratch}\n for v in range(views_drawn):\n  for i in range(n):\n   {call}\n"
    exec(source, names)
    return _function(names["run"])


def _drawing(call, more):
    given, tail = (_DRAW, "") if not more else (f"{_DRAW}, {more}", "")
    extra = {"": "None, None", "materials": "materials, None", "nearer_than": "None, nearer_than"}[more]
    return _grid(given, f"{call}, {_DRAW}, {extra}){tail}")


def _take_layer(n, views_drawn, layer, keys, found):
    there = layer != 0
    keys[there] = layer[there]
    found[0] = there.any()


def _fill(n, views_drawn, values, value):
    values[:] = value


KERNELS = SimpleNamespace(
    project=_grid("positions, views, window, screen, screen_f", "project_vertex(i, v, positions, views, window, screen, screen_f)"),
    count_pieces=_grid("candidates, geometry, views, guard, pieces", "count_pieces(i, candidates, geometry, views, guard, pieces, p, q)", _CLIP),
    write_pieces=_grid("candidates, geometry, views, guard, window, start, clipped, clipped_f",
                       "write_pieces(i, candidates, geometry, views, guard, window, start, clipped, clipped_f, p, q)", _CLIP),
    fill=_fill, take_layer=_take_layer,
    **{name + what: _drawing(call, more) for name, more in (("draw", ""), ("mask", "materials"), ("peel", "nearer_than"))
       for what, call in (("", "draw_triangle(i, v"), ("_pieces", "draw_piece(i, v"), ("_items", "draw_item(i // 32, i % 32"))},
    shade=_grid(_SHADE, f"shade_pixel(i, v, {_SHADE}, own, None)", _OWN), shade_rich=_grid(_SHADE, f"shade_pixel(i, v, {_SHADE}, own, True)", _OWN),
    light_vertices=_grid("geometry, vertex_material, chosen, views, materials, lit",
                         "light_vertex(i, v, geometry, vertex_material, chosen, views, materials, lit, own)", _OWN),
    resolve=_grid("window, samples, tile, taps, weights, exposure, background, picture",
                  "resolve_pixel(i, v, window, samples, tile, taps, weights, exposure, background, picture, sums)", "sums = np.empty(4, np.float32)"),
    write_outputs=_grid("window, everything, views, pattern, keys, left, top, outputs, motion_from",
                        "write_outputs_of(i, v, window, everything, views, pattern, keys, left, top, outputs, motion_from)"),
)  # fmt: skip


class Host:
    """The methods of `luxel.cuda.device.Gpu`."""

    name, kernels = "host", KERNELS

    def __init__(self, memory=1 << 32):
        self.memory = memory

    def free_memory(self):
        return self.memory

    def expect(self, size, what):
        from luxel.errors import DeviceError

        if size > self.memory:
            raise DeviceError(f"{what} needs {size}")

    def array(self, host):
        return np.ascontiguousarray(host).copy()

    def copied(self, arrays):
        if isinstance(arrays, np.ndarray):
            return self.array(arrays)
        return type(arrays)(*map(self.copied, arrays)) if isinstance(arrays, tuple) else arrays

    def empty(self, shape, dtype):
        array = np.empty(shape, dtype)
        array.reshape(-1).view(np.uint8)[:] = 0xAB  # what is read before it is written shows
        return array

    def host(self, array):
        return array.copy()

    def view(self, array, dtype):
        return array.view(dtype)

    def shared(self, array):
        return array

    def wait(self):
        pass

    def launch(self, kernel, shape, *arguments):
        if 0 not in shape:
            kernel(*shape, *arguments)
