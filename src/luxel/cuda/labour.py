"""Baking on a GPU: what stands for `luxel.radiosity.labour.Labour` there, and for the state of a solve.

What a bake asks of many items is done by kernels (`luxel.cuda.bake_kernels`) on arrays that are copied to the GPU once and stay there: what hides,
the elements, what their rays meet, rows, light received and to shoot. The order of steps, when to stop, the ledger and checkpoints are the
processor's own (`luxel.radiosity.bake`, `solve`), which hears of a pass nothing but its sums.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cuda.device import find
from luxel.cuda.threads.draw import EMPTY
from luxel.cuda.threads.look import TOGETHER, Eyes, Sky
from luxel.cuda.threads.settle import ABSORBED, GONE, GOT, HERE, PARTS, POWER, SENT, SUMS
from luxel.cuda.threads.shoot import Cubes, Receivers, Shots
from luxel.errors import DeviceError, LuxelWarning
from luxel.radiosity.direct import AT
from luxel.radiosity.directions import cosine_directions
from luxel.radiosity.element import NX, NZ
from luxel.radiosity.gather import Sight, View, padded
from luxel.radiosity.hemicube import FACES, GUARD, delta_form_factors, frames_of
from luxel.radiosity.labour import Drawn, Labour
from luxel.radiosity.patches import Tree
from luxel.radiosity.sky import COARSE, FINE, cells, shrunk
from luxel.radiosity.solve import BATCH, Problem, State, balance, patch_starts
from luxel.radiosity.transport import BLOCK, Elements, Occluders, Shooters, Visibility

_F = np.float32
_RAYS_AT_ONCE = 1 << 26  # of one launch: after each, progress is told, and Ctrl-C heard
_FEW_TRIANGLES = 1 << 14  # up to so many are drawn by a warp each, more by a thread each
_SHARES, _EACH = 8192, 16  # most threads that share a sum, and how much each has at least
_ELEMENT_BYTES = 320  # beside what its rays meet and its entries in rows


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

    def fitting(self, problem: Problem, rays: int) -> Labour:
        """This, if a solve fits in the GPU's memory; else a DeviceError, or the processor."""
        n, size = problem.elements.numbers.shape[1], max(source.resolution for source in (problem.lights, problem.patches) if source)
        scene = sum(array.nbytes for array in (*problem.rays.scene, *problem.occluders[:4]))
        needed = n * (4 * rays + 2 * BATCH + _ELEMENT_BYTES) + scene + 16 * BATCH * FACES * size**2
        try:
            self.gpu.expect(needed, f"a bake of {n} elements", "fewer luxels or a lower quality")
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
        return GpuState(self, problem, state)

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """An array on the GPU."""
        return self.gpu.empty(shape, dtype)

    def fetch(self, kept: Any) -> Array:
        """A copy of one."""
        return np.ascontiguousarray(self.gpu.host(kept))

    def see(self, occluders: Occluders, who: Shooters, resolution: int, near: float) -> Drawn:
        """What shooters see, as `Cubes`."""
        gpu, k, s, pixels, o = self.gpu, self.kernels, len(who.node), FACES * resolution**2, self.there(occluders[:4])
        guard, deltas = self.there(_GUARD), self.there(delta_form_factors(resolution).reshape(-1))
        keys, depth, ids = gpu.empty((s, pixels), np.uint64), gpu.empty((s * pixels,), _F), gpu.empty((s * pixels,), np.int32)
        cubes = Cubes(o[0], o[1], o[2], o[3], gpu.array(who.centers), gpu.array(who.frames), guard, resolution, _F(near), keys, depth, ids)
        lanes = 32 if len(occluders.triangles) <= _FEW_TRIANGLES else 1
        gpu.launch(gpu.kernels.fill_keys, (pixels, s), cubes.keys, EMPTY)
        gpu.launch(k.draw_cubes, (len(occluders.triangles) * lanes, s), lanes, cubes)
        gpu.launch(k.read_cubes, (pixels, s), cubes)
        escapes = gpu.array(np.zeros((s, 2)))
        gpu.launch(k.find_escapes, (pixels, s), cubes, deltas, escapes)
        return Drawn(cubes, gpu.host(escapes))  # type: ignore[arg-type]

    def fill_rows(self, elements: Elements, tree: Tree, source: Array, who: Shooters, seen: Any, occluders: Occluders, rays: Visibility,
                  slots: Array, rows: Any) -> Array:  # fmt: skip
        """(s, blocks) float64: the sums of the rows that are filled."""
        gpu, k, n = self.gpu, self.kernels, elements.numbers.shape[1]
        numbers, bounds, scene, masked = self.there((elements.numbers, elements.bounds, rays.scene, occluders.masked))
        receivers = Receivers(numbers, bounds, scene, masked, rays.number, rays.always)
        span, child, place = self.there((tree.span, tree.child, tree.place))
        shots = Shots(span, child, place, self.there(source), gpu.array(who.node), gpu.array(slots))
        sums = gpu.empty((len(slots), -(-n // BLOCK)), np.float64)
        gpu.launch(k.fill_rows, (n, len(slots)), receivers, shots, seen, rows)
        gpu.launch(k.sum_rows, (sums.shape[1], len(slots)), receivers.numbers, shots.slots, rows, sums)
        return gpu.host(sums)

    def receive(self, rows: Any, touched: Array, slots: Array, powers: Array) -> Any:
        """(3, n) float32 on the GPU."""
        gained = self.gpu.empty((3, rows.shape[1]), _F)
        self.gpu.launch(self.kernels.receive_rows, (rows.shape[1], 1), self.gpu.array(slots), rows, self.gpu.array(touched),
                        self.gpu.array(powers), gained)  # fmt: skip
        return gained

    def eyes(self, view: View) -> Eyes:
        """The elements of a view on the GPU."""
        if self._eyes is None or self._eyes[0] is not view:
            numbers, frames = self.there(view.numbers), self.gpu.array(frames_of(view.numbers[NX : NZ + 1].T))
            self._eyes = view, Eyes(self.there(view.scene), numbers, frames, self.there(view.lookup), _F(view.reach))
        return self._eyes[1]

    def shine(self, view: View, table: Array) -> Array:
        """(3, n) float32."""
        gpu, n, eyes = self.gpu, view.numbers.shape[1], self.eyes(view)
        received, at = gpu.array(np.zeros((3, n), _F)), gpu.array(np.array(AT))
        step = max(1, _RAYS_AT_ONCE // (len(AT) * n))
        for first in range(0, len(table), step):
            some = gpu.array(table[first : first + step])
            gpu.launch(self.kernels.shine, (n, 1), eyes.scene, eyes.numbers, some, at, float(view.reach), received)
            gpu.wait()
        return gpu.host(received)

    def sky(self, view: View, sight: Sight, even: Array) -> Array:
        """(3, n) float32."""
        gpu, k, eyes, n = self.gpu, self.kernels, self.eyes(view), view.numbers.shape[1]
        cell, wide, high = cells(sight.hits.shape[1])
        groups = -(-n // TOGETHER)
        seen, kind = (gpu.empty((groups, wide, high), np.int32) for _ in range(2))
        sky = Sky(gpu.array(cell), gpu.array(shrunk(even, COARSE)), gpu.array(shrunk(even, FINE)), seen, kind, gpu.empty((groups,), np.bool_))
        result = gpu.empty((3, n), _F)
        gpu.launch(k.find_cells, (groups, 1), sight.hits, sky)
        gpu.launch(k.sky_light, (n, 1), eyes, sky, result)
        return gpu.host(result)

    def look(self, view: View, rays: int, told: Callable[[float], None]) -> Sight:
        """What elements see, kept on the GPU."""
        gpu, eyes, n = self.gpu, self.eyes(view), view.numbers.shape[1]
        hits, away, directions = gpu.columns((n, rays), np.int32), gpu.empty((n,), np.float64), self._directions(rays)
        step = max(1, min(rays, _RAYS_AT_ONCE // n))
        for ray in range(0, rays, step):
            last = min(rays, ray + step)
            gpu.launch(self.kernels.look, (n, last - ray), eyes, 0, ray, directions, hits)
            gpu.wait()
            told(last / rays)
        gpu.launch(self.kernels.count_away, (n, 1), eyes.numbers, hits, away)
        return Sight(hits, away)

    def gather(self, view: View, light: Array, rays: int, told: Callable[[float], None]) -> Array:
        """(3, n) float32: the mean of `light` (n, 3) over what `rays` of each element meet, of which nothing is kept."""
        gpu, eyes, n = self.gpu, self.eyes(view), view.numbers.shape[1]
        step = max(1, min(n, _RAYS_AT_ONCE // rays))
        hits, there, result = gpu.columns((step, rays), np.int32), gpu.array(padded(light)), gpu.empty((3, n), _F)
        directions = self._directions(rays)
        for first in range(0, n, step):
            count = min(step, n - first)
            gpu.launch(self.kernels.look, (count, rays), eyes, first, 0, directions, hits)
            gpu.launch(self.kernels.gather_mean, (count, 1), first, hits, there, result)
            gpu.wait()
            told((first + count) / n)
        return gpu.host(result)

    def _directions(self, rays: int) -> Any:
        return self.gpu.array(cosine_directions(rays).astype(_F))


_GUARD = np.array([-GUARD, GUARD, -GUARD, GUARD])


def _kept(name: str) -> Any:
    """An attribute that is an array on the GPU, and copied to the processor when it is asked for."""

    def get(self: GpuState) -> Array:
        if name not in self.here:
            self.here[name] = self.gpu.host(self.there[name])
            self.here[name].flags.writeable = False
        return self.here[name]

    def set(self: GpuState, value: Array) -> None:
        self.there[name] = self.gpu.array(value)
        self.here.pop(name, None)

    return property(get, set)


class GpuState(State):
    """The state of a solve on a GPU. A step is worked out beside the state and takes its place once its sums are known, so whoever is interrupted
    keeps the state before it.

    Attributes:
        there: Arrays on the GPU, by name; here: copies that were asked for since they last changed.
    """

    received, direct, unshot, power = map(_kept, ("received", "direct", "unshot", "power"))

    def __init__(self, labour: GpuLabour, problem: Problem, state: State) -> None:
        self.gpu, self.kernels, n = labour.gpu, labour.kernels, problem.elements.numbers.shape[1]
        self.there: dict[str, Any] = {}
        self.here: dict[str, Array] = {}
        self._left, self._left_here = state.left, state.left_here
        super().__init__(**{item.name: getattr(state, item.name) for item in fields(State)})
        gpu = self.gpu
        self._numbers, self._albedo = labour.there(problem.elements.numbers), labour.there(problem.albedo)
        self._starts = gpu.array(patch_starts(problem.patches.tree))
        self._sent = gpu.array(np.zeros((n + 3, 4), _F))
        self._gained, self._absorbed = gpu.empty((3, n), _F), gpu.empty(state.power.shape, np.float64)
        self._next = {name: gpu.empty(getattr(state, name).shape, kind) for name, kind in (("received", _F), ("unshot", _F), ("power", np.float64))}
        self._shares, self._sums = gpu.array(np.zeros((SUMS, max(PARTS, min(_SHARES, n // _EACH))))), gpu.array(np.zeros((SUMS, PARTS)))
        self._one, self._scale = gpu.array(np.ones(3, _F)), gpu.empty((3,), _F)
        self._chosen: Any = None

    @property
    def left(self) -> Array:
        """As of `State`, from the sums of the last step."""
        return self._left

    @property
    def left_here(self) -> float:
        """The same."""
        return self._left_here

    def forget(self, problem: Problem, chosen: Array) -> None:
        """As of `State`, with the next step."""
        self._chosen = self.gpu.array(chosen.astype(np.int64))

    def take_in(self, problem: Problem, gained: Any, threads: int, from_lights: bool = False) -> None:
        """As of `State`; `gained` on the GPU."""
        sums = self._step(gained, self._one, True)
        self._commit(sums, gained if from_lights else None)

    def pass_on(self, problem: Problem, sight: Sight, labour: Labour) -> None:
        """As of `State`."""
        gpu, k, n = self.gpu, self.kernels, len(sight.away)
        gpu.launch(k.send_unshot, (n, 1), self.there["unshot"], self._sent)
        gpu.launch(k.gather_mean, (n, 1), 0, sight.hits, self._sent, self._gained)
        gpu.launch(k.share_sent, (self._shares.shape[1], 1), self._numbers, sight.away, self._sent, self._gained, self._shares)
        gpu.launch(k.add_up, (PARTS, ABSORBED), 0, self._shares, self._sums)
        gpu.launch(k.find_scale, (3, 1), self._sums, self._scale)
        sums = self._step(self._gained, self._scale, False)
        sent, gone, got = (sums[row : row + 3] for row in (SENT, GONE, GOT))
        away = balance(sent, sent - gone, got)[1]
        self.whole = False
        self._commit(sums, None)
        self.escaped = self.escaped + away

    def _step(self, gained: Any, scale: Any, keeps: bool) -> Array:
        """What the state becomes when `gained` is taken in, into `_next`; returns all sums, (SUMS,)."""
        gpu, k, n, next_ = self.gpu, self.kernels, self._numbers.shape[1], self._next
        gpu.launch(k.take_in, (n, 1), self._albedo, scale, keeps, gained, self.there["received"], self.there["unshot"], next_["received"],
                   next_["unshot"])  # fmt: skip
        if self._chosen is not None:
            gpu.launch(k.forget, (len(self._chosen), 1), self._chosen, self._starts, self._albedo, gained, next_["unshot"])
        gpu.launch(k.take_stock, (len(self._absorbed), 3), self._numbers, self._starts, self._albedo, gained, next_["unshot"], next_["power"],
                   self._absorbed)  # fmt: skip
        gpu.launch(k.share_stock, (self._shares.shape[1], 1), next_["power"], self._absorbed, next_["received"], next_["unshot"], self._shares)
        gpu.launch(k.add_up, (PARTS, SUMS - ABSORBED), ABSORBED, self._shares, self._sums)
        return np.asarray(gpu.host(self._sums).sum(1))

    def _commit(self, sums: Array, from_lights: Any) -> None:
        """The step is done."""
        if from_lights is not None:
            self.gpu.launch(self.kernels.note_direct, (from_lights.shape[1], 1), from_lights, self.there["direct"])
        self.absorbed = self.absorbed + sums[ABSORBED : ABSORBED + 3]
        self._left, self._left_here = sums[POWER : POWER + 3], float(sums[HERE]) / self._numbers.shape[1]
        for name, new in self._next.items():
            self._next[name], self.there[name] = self.there[name], new
        self.here, self._chosen = {}, None
