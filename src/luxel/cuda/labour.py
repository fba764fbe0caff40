"""Baking on a GPU: what stands for `luxel.radiosity.labour.Labour` there.

What a bake asks of many items is done by kernels (`luxel.cuda.bake_kernels`) on arrays that are copied to the GPU once and stay there: what hides,
the elements, what their rays meet, rows, light received and to shoot. The order of steps, when to stop, the ledger and checkpoints are the
processor's own (`luxel.radiosity.bake`, `solve`), which hears of a pass nothing but its sums.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from luxel.arrays import Array
from luxel.cuda import memory
from luxel.cuda.device import find
from luxel.cuda.threads.look import TOGETHER, Closer, Eyes, Sky
from luxel.cuda.threads.shoot import Cubes, Receivers, Shots
from luxel.errors import DeviceError, LuxelWarning
from luxel.radiosity.direct import QUARTERS
from luxel.radiosity.directions import cosine_directions
from luxel.radiosity.gather import Sight, View, padded
from luxel.radiosity.hemicube import FACES, GUARD, delta_form_factors
from luxel.radiosity.labour import Drawn, Labour
from luxel.radiosity.patches import Tree
from luxel.radiosity.sky import Even, cells
from luxel.radiosity.solve import Problem, State
from luxel.radiosity.transport import Elements, Occluders, Shooters, Visibility

if TYPE_CHECKING:
    from luxel.radiosity.effort import Rays

_F = np.float32
_MOST_ROWS = 1 << 15  # of a grid; a card takes no more than twice as many
_WHOLE = float(1 << 48)  # whole numbers have one sum in whatever order threads add them
_FEW_TRIANGLES = 1 << 14  # up to so many are drawn by a warp each, more by a thread each


@cache
def _shares(resolution: int) -> Array:
    """(5 r r,) uint64: the share of a hemicube's light that goes through each pixel, in parts of `_WHOLE`."""
    return np.rint(delta_form_factors(resolution).reshape(-1) * _WHOLE).astype(np.uint64)


def labour_on(device: str, threads: int) -> Labour:
    """Who bakes on `device`.

    Raises:
        InputError: No such device.
        ExtraMissingError, DeviceError: "cuda", and it cannot be used.
    """
    gpu = find(device, "baking", 5)
    return Labour(threads) if gpu is None else GpuLabour(gpu, threads, fallback=device == "auto")


class GpuLabour(Labour):
    """Work on all items by a GPU.

    Args:
        gpu: A `luxel.cuda.device.Gpu`.
        threads: Of the processor, for what it does.
        fallback: The processor bakes what does not fit.
        kernels: What it launches: `luxel.cuda.bake_kernels`.
    """

    def __init__(self, gpu: Any, threads: int, fallback: bool = False, kernels: Any = None) -> None:
        super().__init__(threads)
        if kernels is None:
            from luxel.cuda import bake_kernels as kernels
        self.gpu, self.kernels, self.fallback = gpu, kernels, fallback
        self._sent: dict[Any, tuple[Array, Any]] = {}
        self._eyes: tuple[View, Eyes] | None = None

    def fitting(self, problem: Problem, view: View, rays: Rays, rows: tuple[int, int, int]) -> Labour:
        """This, if a bake fits in the GPU's memory; else a DeviceError, or the processor."""
        n = view.numbers.shape[1]
        try:
            self.gpu.expect(memory.needed(problem, view, rays, rows), f"a bake of {n} elements", "fewer luxels or a lower quality")
        except DeviceError as error:
            if not self.fallback:
                raise
            warnings.warn(f"device auto: baking on the processor: {error}", LuxelWarning, stacklevel=4)
            return Labour(self.threads)
        return self

    def there(self, host: Any) -> Any:
        """An array, or a named tuple of arrays, on the GPU: copied when it is first asked for. It must not change afterwards."""
        if isinstance(host, tuple):
            copies = map(self.there, host)
            return type(host)(*copies) if hasattr(host, "_fields") else tuple(copies)
        if not isinstance(host, np.ndarray):
            return host
        key = host.ctypes.data, host.shape, host.strides, host.dtype
        if key not in self._sent:
            self._sent[key] = host, self.gpu.array(host)  # the host's is held, lest another come to lie in its place
        return self._sent[key][1]

    def state(self, problem: Problem, state: State) -> State:
        """The state on the GPU."""
        from luxel.cuda.state import GpuState

        return GpuState(self, problem, state)

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """An array on the GPU."""
        return self.gpu.empty(shape, dtype)

    def fetch(self, kept: Any) -> Array:
        """A copy of one."""
        return np.ascontiguousarray(self.gpu.host(kept))

    def cubes(self, occluders: Occluders, resolution: int, near: float, centers: Any, frames: Any, wanted: Any) -> Cubes:
        """Hemicubes to be drawn, of shooters whose centres and frames are on the GPU."""
        gpu, s, pixels, o = self.gpu, len(centers), FACES * resolution**2, self.there(occluders[:4])
        keys, depth, ids = gpu.empty((s, pixels), np.uint64), gpu.empty((s * pixels,), _F), gpu.empty((s * pixels,), np.int32)
        return Cubes(o[0], o[1], o[2], o[3], centers, frames, self.there(_GUARD), resolution, _F(near), wanted, keys, depth, ids)

    def draw(self, cubes: Cubes, escapes: Any) -> None:
        """Draw hemicubes, and add to `escapes` (s, 2) uint64 how much light of theirs meets nothing, or a back, in parts of `_WHOLE`."""
        launch, k, (s, pixels), triangles = self.gpu.launch, self.kernels, cubes.keys.shape, len(cubes.triangles)
        lanes = 32 if triangles <= _FEW_TRIANGLES else 1
        launch(k.clear_cubes, (pixels, s), cubes)
        launch(k.draw_cubes, (triangles * lanes, s), lanes, cubes)
        launch(k.read_cubes, (pixels, s), cubes)
        launch(k.find_escapes, (pixels, s), cubes, self.there(_shares(cubes.resolution)), escapes)

    def see(self, occluders: Occluders, who: Shooters, resolution: int, near: float) -> Drawn:
        """What shooters see, as `Cubes`."""
        gpu, s = self.gpu, len(who.node)
        cubes = self.cubes(occluders, resolution, near, gpu.array(who.centers), gpu.array(who.frames), gpu.array(np.ones(s, np.bool_)))
        escapes = gpu.array(np.zeros((s, 2), np.uint64))
        self.draw(cubes, escapes)
        return Drawn(cubes, gpu.host(escapes) / _WHOLE)  # type: ignore[arg-type]

    def fill(self, elements: Elements, occluders: Occluders, rays: Visibility, shots: Shots, cubes: Cubes, rows: Any, sums: Any) -> None:
        """Fill rows of transport from what shooters see, and `sums` (s, blocks) with their sums."""
        gpu, k, (s, blocks), n = self.gpu, self.kernels, sums.shape, elements.numbers.shape[1]
        numbers, bounds, scene, masked = self.there((elements.numbers, elements.bounds, rays.scene, occluders.masked))
        gpu.launch(k.fill_rows, (n, s), Receivers(numbers, bounds, scene, masked, rays.number, rays.always), shots, cubes, rows)
        gpu.launch(k.sum_rows, (blocks, s), numbers, cubes.wanted, shots.slots, rows, sums)

    def fill_rows(self, elements: Elements, tree: Tree, source: Array, who: Shooters, seen: Any, occluders: Occluders, rays: Visibility,
                  slots: Array, rows: Any) -> Array:  # fmt: skip
        """(s, blocks) float64: the sums of the rows that are filled."""
        span, child, place = self.there((tree.span, tree.child, tree.place))
        shots = Shots(span, child, place, self.there(source), self.gpu.array(who.node), self.gpu.array(slots))
        sums = self.gpu.empty((len(slots), len(elements.bounds)), np.float64)
        self.fill(elements, occluders, rays, shots, seen, rows, sums)
        return self.gpu.host(sums)

    def receive(self, rows: Any, touched: Array, slots: Array, powers: Array) -> Any:
        """(3, n) float32 on the GPU."""
        gained = self.gpu.empty((3, rows.shape[1]), _F)
        self.gpu.launch(self.kernels.receive_rows, (rows.shape[1], 1), self.gpu.array(slots), rows, self.gpu.array(touched),
                        self.gpu.array(powers), gained)  # fmt: skip
        return gained

    def eyes(self, view: View) -> Eyes:
        """The elements of a view on the GPU."""
        if self._eyes is None or self._eyes[0] is not view:
            numbers, frames = self.there(view.numbers), self.gpu.array(view.frames())
            self._eyes = view, Eyes(self.there(view.scene), numbers, frames, self.there(view.lookup), _F(view.reach))
        return self._eyes[1]

    def shine(self, view: View, table: Array) -> Array:
        """(3, n) float32."""
        gpu, n, eyes = self.gpu, view.numbers.shape[1], self.eyes(view)
        received = gpu.array(np.zeros((3, n), _F))
        step = max(1, memory.RAYS_AT_ONCE // (QUARTERS * n))
        for first in range(0, len(table), step):
            some = gpu.array(table[first : first + step])
            gpu.launch(self.kernels.shine, (n, 1), eyes.scene, eyes.numbers, some, float(view.reach), received)
            gpu.wait()
        return gpu.host(received)

    def sky(self, view: View, sight: Sight, sky: Even) -> Array:
        """(3, n) float32."""
        n = view.numbers.shape[1]
        result = self.gpu.empty((3, n), _F)
        self._see_sky(self.eyes(view), 0, n, sight.hits, self._cells_of(sky, *sight.hits.shape), result)
        return self.gpu.host(result)

    def _cells_of(self, sky: Even, elements: int, rays: int) -> Sky:
        """Room for what so many elements see of a sky by so many rays."""
        gpu, groups, (cell, wide, high) = self.gpu, -(-elements // TOGETHER), cells(rays)
        seen, kind = (gpu.empty((groups, wide, high), np.int32) for _ in range(2))
        return Sky(gpu.array(cell), gpu.array(sky.coarse), gpu.array(sky.fine), seen, kind, gpu.empty((groups,), np.bool_))

    def _see_sky(self, eyes: Eyes, first: int, count: int, hits: Any, sky: Sky, result: Any) -> None:
        """result[:, first : first + count]: the light of the sky on so many elements, which see `hits`."""
        self.gpu.launch(self.kernels.find_cells, (-(-count // TOGETHER), 1), count, hits, sky)
        self.gpu.launch(self.kernels.sky_light, (count, 1), first, eyes, sky, result)

    def look(self, view: View, rays: int, told: Callable[[float], None]) -> Sight:
        """What elements see, kept on the GPU."""
        gpu, eyes, n = self.gpu, self.eyes(view), view.numbers.shape[1]
        hits, away, directions = gpu.columns((n, rays), np.int32), gpu.empty((n,), np.float64), self._directions(rays)
        step = max(1, min(rays, memory.RAYS_AT_ONCE // n, _MOST_ROWS))
        for ray in range(0, rays, step):
            last = min(rays, ray + step)
            gpu.launch(self.kernels.look, (n, last - ray), eyes, 0, ray, directions, hits)
            gpu.wait()
            told(last / rays)
        blind = gpu.empty((n,), np.bool_)
        gpu.launch(self.kernels.count_away, (n, 1), eyes.numbers, hits, away, blind)
        return Sight(hits, away, gpu.host(blind))

    def bounce(self, sight: Sight, light: Array) -> Array:
        """(3, n) float32: what elements receive of `light` (n, 3). In a solve `GpuState.pass_on` does it."""
        gpu, n = self.gpu, len(light)

        def gathered(light: Array) -> Array:
            result = gpu.empty((3, n), _F)
            gpu.launch(self.kernels.gather_mean, (n, 1), 0, sight.hits, gpu.array(padded(light)), result)
            return np.asarray(gpu.host(result))

        return self.shared(sight.spots, light, gathered)

    def brightness_around(self, sight: Sight, own: Elements, elements: Elements, irradiance: Array) -> Array:
        """(n,) float64 W/m2."""
        gpu, n = self.gpu, len(irradiance)
        result = gpu.empty((n,), np.float64)
        root = gpu.array(np.sqrt(irradiance).astype(_F))
        gpu.launch(self.kernels.find_brightness, (n, 1), sight.hits, self.there(elements.numbers), root, result)
        return np.asarray(gpu.host(result))

    def look_closer(self, view: View, sight: Sight, light: Array, unlike: float, told: Callable[[float], None]) -> Array:
        """(3, n) float32: the mean of `light` (n, 3) over what elements have met, and more rays where it is unlike."""
        gpu, k, eyes, n = self.gpu, self.kernels, self.eyes(view), view.numbers.shape[1]
        cell, wide, high = cells(sight.hits.shape[1])
        groups = -(-n // TOGETHER)
        least, most = (gpu.empty((groups, wide, high), _F) for _ in range(2))
        closer = Closer(gpu.array(cell), gpu.array(padded(light)), _F(unlike), least, most, gpu.empty((groups, wide, high), np.bool_))
        result = gpu.empty((3, n), _F)
        gpu.launch(k.find_again, (groups, 1), sight.hits, closer)
        step = max(1, memory.RAYS_AT_ONCE // sight.hits.shape[1])
        for first in range(0, n, step):
            gpu.launch(k.closer_light, (min(step, n - first), 1), first, eyes, sight.hits, closer, result)
            gpu.wait()
            told(min(n, first + step) / n)
        return gpu.host(result)

    def gather(self, view: View, light: Array, rays: int, sky: Even | None, told: Callable[[float], None]) -> tuple[Array, Array | None]:
        """(3, n) float32 each."""
        gpu, eyes, n = self.gpu, self.eyes(view), view.numbers.shape[1]
        step = memory.at_once(n, rays)
        hits, there, result = gpu.columns((step, rays), np.int32), gpu.array(padded(light)), gpu.empty((3, n), _F)
        directions, seen = self._directions(rays), gpu.empty((3, n), _F) if sky is not None else None
        above = None if sky is None else self._cells_of(sky, step, rays)
        for first in range(0, n, step):
            count = min(step, n - first)
            for ray in range(0, rays, _MOST_ROWS):
                gpu.launch(self.kernels.look, (count, min(_MOST_ROWS, rays - ray)), eyes, first, ray, directions, hits)
            gpu.launch(self.kernels.gather_mean, (count, 1), first, hits, there, result)
            if above is not None:
                self._see_sky(eyes, first, count, hits, above, seen)
            gpu.wait()
            told((first + count) / n)
        return gpu.host(result), None if seen is None else gpu.host(seen)

    def _directions(self, rays: int) -> Any:
        return self.gpu.array(cosine_directions(rays).astype(_F))


_GUARD = np.array([-GUARD, GUARD, -GUARD, GUARD])
