"""The state of a solve on a GPU: what stands there for `luxel.radiosity.solve.State`."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from luxel.arrays import Array
from luxel.cuda.shooter import Shooter
from luxel.cuda.threads.settle import ABSORBED, GONE, GOT, HERE, PARTS, POWER, SENT, SUMS
from luxel.radiosity.gather import Sight, Spots
from luxel.radiosity.labour import Labour
from luxel.radiosity.patches import patch_starts
from luxel.radiosity.solve import Problem, Rows, State, balance

if TYPE_CHECKING:
    from luxel.cuda.labour import GpuLabour

_F = np.float32
_SHARES, _EACH = 8192, 16  # most threads that share a sum, and how much each has at least


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
        self.labour, self.gpu, self.kernels, n = labour, labour.gpu, labour.kernels, problem.elements.numbers.shape[1]
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
        self._shooter: Shooter | None = None

    @property
    def left(self) -> Array:
        """As of `State`, from the sums of the last step."""
        return self._left

    @property
    def left_here(self) -> float:
        """The same."""
        return self._left_here

    def shoot_brightest(self, problem: Problem, rows: Rows, labour: Labour) -> int:
        """As of `State`. Who shoots is known to the GPU only; the processor hears how many, and what the ledger needs."""
        if self._shooter is None:
            self._shooter = Shooter(self.labour, problem, rows)
        batch, gained = self._shooter.shoot(self.there["power"])
        self.gpu.launch(self.kernels.sum_shots, (3, 1), batch, self._sums)
        sums = self._step(gained, self._one, True, batch.chosen)
        self.whole = False
        self._commit(sums, None)
        self.escaped = self.escaped + sums[GONE : GONE + 3]
        return int(sums[SENT])

    def take_in(self, problem: Problem, gained: Any, threads: int, from_lights: bool = False) -> None:
        """As of `State`; `gained` on the GPU."""
        sums = self._step(gained, self._one, True)
        self._commit(sums, gained if from_lights else None)

    def pass_on(self, problem: Problem, sight: Sight, labour: Labour) -> None:
        """As of `State`."""
        gpu, k, n = self.gpu, self.kernels, len(sight.away)
        gpu.launch(k.send_unshot, (n, 1), self.there["unshot"], self._sent)
        if sight.spots is None:
            gpu.launch(k.gather_mean, (n, 1), 0, sight.hits, self._sent, self._gained)
        else:
            self._pass_on_in_parts(sight, self.labour.there(sight.spots))
        gpu.launch(k.share_sent, (self._shares.shape[1], 1), self._numbers, sight.away, self._sent, self._gained, self._shares)
        gpu.launch(k.add_up, (PARTS, ABSORBED), 0, self._shares, self._sums)
        gpu.launch(k.find_scale, (3, 1), self._sums, self._scale)
        sums = self._step(self._gained, self._scale, False)
        sent, gone, got = (sums[row : row + 3] for row in (SENT, GONE, GOT))
        away = balance(sent, sent - gone, got)[1]
        self.whole = False
        self._commit(sums, None)
        self.escaped = self.escaped + away

    def _pass_on_in_parts(self, sight: Sight, spots: Spots) -> None:
        """The light of spots by rows, and that of all others by rays."""
        gpu, k, n, points = self.gpu, self.kernels, (len(sight.away), 1), (len(spots.element), 1)
        powers = gpu.empty((len(spots.rows), 3), _F)
        gpu.launch(k.find_powers, (len(powers), 1), spots, self._sent, powers)
        gpu.launch(k.hide_spots, points, spots, self._sent)
        gpu.launch(k.gather_mean, n, 0, sight.hits, self._sent, self._gained)
        gpu.launch(k.receive_spots, n, self._gained, _F(1.0), spots.rows, spots.touched, powers, self._gained)
        gpu.launch(k.send_unshot, n, self.there["unshot"], self._sent)  # for the sums

    def _step(self, gained: Any, scale: Any, keeps: bool, chosen: Any = None) -> Array:
        """What the state becomes when `gained` is taken in and the `chosen` patches have shot, into `_next`; returns all sums, (SUMS,)."""
        gpu, k, n, next_ = self.gpu, self.kernels, self._numbers.shape[1], self._next
        gpu.launch(k.take_in, (n, 1), self._albedo, scale, keeps, gained, self.there["received"], self.there["unshot"], next_["received"],
                   next_["unshot"])  # fmt: skip
        if chosen is not None:
            gpu.launch(k.forget, (len(chosen), 1), chosen, self._starts, self._albedo, gained, next_["unshot"])
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
        self.here = {}
