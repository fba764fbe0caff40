"""Frame: a batch of views of a scene, stage by stage, each stage one launch for all views.

project -> draw (small triangles at once, large ones by way of a queue) -> shade -> resolve. The processor reads a few counts between the stages,
and sorts what needs clipping; else everything stays on the device.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.clock import Clock
from luxel.cuda.resident import Resident
from luxel.cuda.threads.draw import CANDIDATES, COUNTS, EMPTY, ITEMS, NO_LAYER, Queue, Raster
from luxel.cuda.threads.shade import Picture as Target
from luxel.cuda.threads.shade import Shading
from luxel.cuda.threads.views import Everything, Views
from luxel.raster.bin import BLEND, MASK, OPAQUE, Clipped
from luxel.raster.constants import MAX_SIZE
from luxel.raster.frame import Seen, see
from luxel.raster.outputs import SHAPES, Outputs
from luxel.raster.picture import Picture
from luxel.raster.project import Window
from luxel.raster.render import Options
from luxel.raster.resolve import filter_taps
from luxel.raster.runs import mean_places
from luxel.scene.camera import Camera

_WINDOW = MAX_SIZE // 2
_BATCH_BYTES = 4 << 30
_MOST_VIEWS = 65535  # of a grid
_WARP = 32
_F = np.float32


def draw_views(scene: Resident, cameras: Sequence[Camera | None], size: tuple[int, int], options: Options, previous: Sequence[Camera | None],
               keep: bool = False, progress: Callable[[float], None] | None = None) -> list[Picture]:  # fmt: skip
    """Draw a scene from several cameras.

    Args:
        previous: A camera, or None, for each: where motion is measured from.
        keep: Leave the pictures' arrays on the device.
        progress: Called with the fraction that is done.

    Raises:
        InputError: What `render` refuses.
        DeviceError: Too little memory.
    """
    plain = scene.prepared._replace(vertex_materials=None)  # vertices are lit on the device
    seen = [see(plain, camera, size, before, 1) for camera, before in zip(cameras, previous, strict=True)]
    pictures: list[Picture] = []
    with scene.lock:
        most = _views_at_once(scene, size, options)
        for first in range(0, len(seen), most):
            pictures += _Batch(scene, seen[first : first + most], size, options, keep).draw()
            if progress:
                progress(len(pictures) / len(seen))
    return pictures


def _views_at_once(scene: Resident, size: tuple[int, int], options: Options) -> int:
    """How many views fit; raises a DeviceError if not one does."""
    width, height = (min(side, _WINDOW + 2 * options.tile) for side in size)
    samples, modes = len(options.positions), set(scene.prepared.geometry.parts.alpha_mode.tolist())
    tiles = -(-width // options.tile) * -(-height // options.tile)
    one = 16 * len(scene.prepared.geometry.positions) + 8 * samples * width * height * (2 if BLEND in modes else 1)
    one += 16 * samples * tiles * options.tile**2 if _per_sample(scene, options) else 0
    one += 16 * len(scene.prepared.geometry.positions) if scene.vertex_materials is not None else 0
    bytes_of = {name: 4 * int(np.prod(shape)) for name, (shape, _, _) in SHAPES.items()} | {"color": 4, "linear": 16}
    one += size[0] * size[1] * sum(bytes_of[name] for name in options.outputs)
    items, candidates = scene.room(0, 0)
    held, queue = scene.held(), 16 * items + 8 * candidates
    if one + queue > held:
        scene.gpu.expect(one + queue - held, f"a picture of {size[0]}x{size[1]} with {samples} samples")
    return max(1, min(_MOST_VIEWS, min(_BATCH_BYTES, (scene.gpu.free_memory() + held - queue) * 3 // 4) // one))


def _per_sample(scene: Resident, options: Options) -> bool:
    """Whether colours of samples are kept until they are resolved."""
    colored = bool({"color", "linear"} & set(options.outputs))
    return colored and (options.filter != "box" or BLEND in scene.prepared.geometry.parts.alpha_mode)


class _Batch:
    """Views that are drawn together."""

    def __init__(self, scene: Resident, seen: Sequence[Seen], size: tuple[int, int], options: Options, keep: bool) -> None:
        self.scene, self.gpu, self.kernels = scene, scene.gpu, scene.gpu.kernels
        self.seen, self.size, self.options, self.keep = seen, size, options, keep
        self.clock, self.count = Clock(), len(seen)
        self.views, self.features = self._views(), int(np.bitwise_or.reduce([one.features for one in seen]))
        self.lit = self._lit()
        self.pattern, self.fill = scene.sent("pattern", options.positions), scene.sent("fill", options.fill)
        self.mean = scene.sent("mean", mean_places(options.positions))
        names = set(options.outputs)
        self.color = self._result("color", "color" in names, (), np.uint32)
        self.linear = self._result("linear", "linear" in names, (4,), _F)
        self.motion = any(one.previous is not None for one in seen) and "motion" in names
        self.outputs = Outputs(*(self._result(name, name in names, shape, dtype, nothing) for name, (shape, dtype, nothing) in SHAPES.items()))
        self.per_sample = _per_sample(scene, options)

    def _views(self) -> Views:
        cameras = [(one, one.camera) for one in self.seen]
        numbers = [(one.view.least_depth, camera.near, camera.far, camera.yfov is None) for one, camera in cameras]
        previous = [np.eye(4) if one.previous is None else one.previous for one in self.seen]
        views = Views(
            np.stack([one.view.clip_from_world for one in self.seen]).astype(np.float64), np.array(numbers, np.float64),
            np.stack([np.stack([one.eye.place, one.eye.direction]) for one in self.seen]).astype(_F),
            np.stack([one.lights.lights for one in self.seen]), np.stack([one.lights.ambient for one in self.seen]),
            np.stack(previous).astype(np.float64),
        )  # fmt: skip
        return Views(*(self.scene.sent(f"views {name}", array) for name, array in views._asdict().items()))

    def _lit(self) -> Any:
        scene, n = self.scene, len(self.scene.prepared.geometry.positions)
        if scene.vertex_materials is None:
            return scene.buffer("unlit", (0, 0, 4), _F)
        lit = scene.buffer("lit", (self.count, n, 4), _F)
        self.gpu.launch(self.kernels.light_vertices, (n, self.count), scene.geometry, scene.vertex_material, scene.chosen, self.views,
                        scene.vertex_materials, lit)  # fmt: skip
        return lit

    def _result(self, name: str, wanted: bool, shape: tuple[int, ...], dtype: Any, nothing: float | None = None) -> Any:
        """An output of all views, filled with `nothing`; without rows if it is not wanted."""
        width, height = self.size if wanted else (0, 0)
        full = (self.count, height, width, *shape)
        array = self.gpu.empty(full, dtype) if self.keep and wanted else self.scene.buffer(name, full, dtype)
        if wanted and nothing is not None:
            self._fill(array, np.dtype(dtype).type(nothing))
        return array

    def _fill(self, array: Any, value: Any) -> None:
        each = array.size // self.count
        kernel = {"u": self.kernels.fill_keys, "f": self.kernels.fill_floats, "i": self.kernels.fill_ints}[array.dtype.kind]
        self.gpu.launch(kernel, (each, self.count), array.reshape(self.count, each), value)

    def draw(self) -> list[Picture]:
        """Draw all windows, and fetch the pictures."""
        (width, height), margin = self.size, 0 if self.options.filter == "box" else self.options.tile
        self.clock.lap("prepare")
        for y in range(0, height, _WINDOW):
            for x in range(0, width, _WINDOW):
                left, top = max(0, x - margin), max(0, y - margin)
                right, bottom = min(width, x + _WINDOW + margin), min(height, y + _WINDOW + margin)
                window = Window(left, top, right - left, bottom - top, width, height)
                kept = x - left, y - top, min(width, x + _WINDOW) - left, min(height, y + _WINDOW) - top
                _Pass(self, window, kept).run()
        return self._pictures()

    def _pictures(self) -> list[Picture]:
        arrays = {name: array for name, array in self.outputs._asdict().items() if name in self.options.outputs}
        if "color" in self.options.outputs:
            arrays["color"] = self.gpu.view(self.color.reshape(*self.color.shape, 1), np.uint8)
        if "linear" in self.options.outputs:
            arrays["linear"] = self.linear
        if self.keep:
            self.gpu.wait()
        rows = {name: self.gpu.shared(array) if self.keep else self.gpu.host(array) for name, array in arrays.items()}
        self.clock.lap("fetch")
        seconds = {name: value / self.count for name, value in self.clock.seconds.items()}
        return [Picture(**{name: array[v] for name, array in rows.items()}, seconds=dict(seconds)) for v in range(self.count)]


class _Pass:
    """One window of all views of a batch."""

    def __init__(self, batch: _Batch, window: Window, kept: tuple[int, int, int, int]) -> None:
        self.batch, self.scene, self.gpu, self.kernels, self.clock = batch, batch.scene, batch.gpu, batch.kernels, batch.clock
        self.window, self.kept, self.options, self.count = window, kept, batch.options, batch.count
        self.samples, self.tile = len(self.options.positions), self.options.tile
        self.pixels = window.width * window.height
        self.keys = self._keys("keys", EMPTY)
        self.pieces = 0  # the most of any view

    def _keys(self, name: str, value: Any) -> Any:
        """(v, s, h, w) keys, all `value`."""
        keys = self.scene.buffer(name, (self.count, self.samples, self.window.height, self.window.width), np.uint64)
        self.batch._fill(keys, value)
        return keys

    def run(self) -> None:
        """Draw it."""
        batch, modes = self.batch, set(self.scene.prepared.geometry.parts.alpha_mode.tolist())
        self.everything = self._project()
        self._lap("project")
        k = self.kernels
        self._draw(OPAQUE, (k.draw, k.draw_pieces, k.draw_items))
        if MASK in modes:
            self._draw(MASK, (k.mask, k.mask_pieces, k.mask_items), self.scene.materials)
        self._lap("cover")
        if any(array.size for array in batch.outputs):
            self.gpu.launch(k.write_outputs, (self.pixels, self.count), self.window, self.everything, batch.views, batch.pattern, self.keys,
                            self.window.x, self.window.y, batch.outputs, batch.motion)  # fmt: skip
            self._lap("outputs")
        if not (batch.color.size or batch.linear.size):
            return
        samples = self._samples()
        self._shade(self.keys, EMPTY, samples)
        self._lap("shade")
        if BLEND in modes:
            self._blend(samples)
            self._lap("blend")
        if batch.per_sample:
            self._resolve(samples)
            self._lap("resolve")

    def _lap(self, stage: str) -> None:
        """Launches return at once: what a stage takes is known only if somebody waits for it, which only a measurement does."""
        if self.scene.measured:
            self.gpu.wait()
        self.clock.lap(stage)

    def _project(self) -> Everything:
        scene, n = self.scene, len(self.scene.prepared.geometry.positions)
        screen = scene.buffer("screen", (self.count, n, 4), np.int32)
        screen_f = self.gpu.view(screen, _F)
        self.gpu.launch(self.kernels.project, (n, self.count), scene.geometry.positions, self.batch.views, self.window, screen, screen_f)
        none = scene.sent("no pieces", np.zeros(self.count + 1, np.int32))
        return Everything(scene.geometry, screen, screen_f, scene.no_clipped, scene.no_clipped_f, none, self.batch.lit)

    def _draw(self, mode: int, kernels: tuple[Any, Any, Any], *more: Any, keys: Any = None) -> None:
        """Draw the triangles of one alpha mode: `kernels` are for triangles, for pieces, and for what both leave in the queue."""
        batch, scene, m = self.batch, self.scene, len(self.scene.prepared.geometry.triangles)
        low, high = int(self.options.positions.min()), int(self.options.positions.max())
        raster = Raster(self.window.width, self.window.height, low, high, mode, scene.split, scene.side)
        triangles, pieces, items = kernels
        keys, clipped, wanted = self.keys if keys is None else keys, mode != OPAQUE, (0, 0)
        while True:
            queue = self._queue(*wanted)
            arguments = batch.pattern, raster, queue, keys, *more
            self.gpu.launch(triangles, (m, self.count), self.everything, *arguments)
            counts = self.gpu.host(queue.counts)
            if not clipped and 0 < counts[CANDIDATES] <= len(queue.candidates):
                self._clip(self.gpu.host(queue.candidates)[: counts[CANDIDATES]])
                clipped = True
            if self.pieces:
                self.gpu.launch(pieces, (self.pieces, self.count), self.everything, *arguments)
                counts = self.gpu.host(queue.counts)
            if counts[ITEMS] <= len(queue.items) and counts[CANDIDATES] <= len(queue.candidates):
                break
            wanted = int(counts[ITEMS]), int(counts[CANDIDATES])  # drawing again what is drawn changes nothing
        self.gpu.launch(items, (int(counts[ITEMS]) * _WARP, 1), self.everything, *arguments)

    def _queue(self, items: int, candidates: int) -> Queue:
        """An empty queue with room for so many at least."""
        room = self.scene.room(items, candidates)
        counts = self.scene.buffer("counts", (COUNTS,), np.int64)
        self.gpu.send(np.zeros(COUNTS, np.int64), counts)
        return Queue(counts, self.scene.buffer("items", (room[0], 4), np.int32), self.scene.buffer("candidates", (room[1], 2), np.int32))

    def _clip(self, candidates: Array) -> None:
        """Cut the triangles (view, triangle) that have unsafe vertices, into pieces in ascending order of view and triangle."""
        candidates = candidates[np.lexsort((candidates[:, 1], candidates[:, 0]))]
        there, guard = self.gpu.array(candidates), self.gpu.array(self.window.guard())
        count = self.gpu.array(np.zeros(len(candidates), np.int64))
        fixed = there, self.scene.geometry, self.batch.views, guard
        self.gpu.launch(self.kernels.count_pieces, (len(candidates), 1), *fixed, count)
        pieces = self.gpu.host(count)
        total, start = int(pieces.sum()), np.cumsum(pieces) - pieces
        screen = self.gpu.empty((total, 3, 4), np.int32)
        clipped = Clipped(self.gpu.empty((total,), np.int32), screen, self.gpu.empty((total, 3, 3), _F))
        clipped_f = self.gpu.view(screen, _F)
        self.gpu.launch(self.kernels.write_pieces, (len(candidates), 1), *fixed, self.window, self.gpu.array(start), clipped, clipped_f)
        by_view = np.bincount(candidates[:, 0], pieces, self.count).astype(np.int32)
        first = np.concatenate([[0], np.cumsum(by_view)]).astype(np.int32)
        self.pieces = int(by_view.max(initial=0))
        self.everything = self.everything._replace(clipped=clipped, clipped_f=clipped_f, first_piece=self.gpu.array(first))

    def _samples(self) -> Any:
        """Colours of samples, premultiplied, all 0; without rows if pixels are written at once."""
        tiles = -(-self.window.width // self.tile) * -(-self.window.height // self.tile) if self.batch.per_sample else 0
        samples = self.scene.buffer("samples", (self.count, tiles, 4 * self.samples * self.tile**2), _F)
        if tiles:
            self.batch._fill(samples, _F(0))
        return samples

    def _target(self, samples: Any) -> Target:
        left, top = self.window.x, self.window.y
        return Target(self.batch.color, self.batch.linear, samples, left, top, *self.kept)

    def _shade(self, keys: Any, nothing: Any, samples: Any) -> None:
        batch, o = self.batch, self.options
        footprint = _F(1 / np.sqrt(self.samples) if o.ssaa > 1 else 1)
        shading = Shading(batch.features, bool(o.ssaa > 1), _F(2.0**o.exposure), footprint, batch.fill, batch.pattern, batch.mean, self.tile)
        kernel = self.kernels.shade_rich if self.scene.prepared.materials.rich else self.kernels.shade
        self.gpu.launch(kernel, (self.pixels, self.count), self.window, self.everything, batch.views, self.scene.materials, shading, keys, nothing,
                        self._target(samples))  # fmt: skip

    def _blend(self, samples: Any) -> None:
        """Peel layers from the farthest on, and lay each over what its samples hold."""
        k, each = self.kernels, self.samples * self.pixels
        while True:
            layer = self._keys("layer", NO_LAYER)
            self._draw(BLEND, (k.peel, k.peel_pieces, k.peel_items), self.keys, keys=layer)
            flat = layer.reshape(self.count, each), self.keys.reshape(self.count, each)
            found = self.scene.buffer("found", (1,), np.int32)
            self.gpu.send(np.zeros(1, np.int32), found)
            self.gpu.launch(k.take_layer, (each, self.count), *flat, found)
            if not self.gpu.host(found)[0]:
                return
            self._shade(layer, NO_LAYER, samples)

    def _resolve(self, samples: Any) -> None:
        o, (left, top, right, bottom) = self.options, self.kept
        taps, weights = (self.scene.sent(name, array) for name, array in zip(("taps", "weights"), filter_taps(o.filter, o.positions), strict=True))
        self.gpu.launch(self.kernels.resolve, ((right - left) * (bottom - top), self.count), self.window, self.samples, self.tile, taps, weights,
                        _F(2.0**o.exposure), self.batch.fill, self._target(samples))  # fmt: skip
