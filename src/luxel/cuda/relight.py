"""Transport that is kept on the GPU: a scene's light for other lights and colours, without moving what is kept.

The steps are those of `luxel.radiosity.relight.Transport.spread`, with its tolerances. What differs is the last: light is passed on from element to
element until little changes, without the conjugate residuals of the processor, which cost more there than they save: a pass is one launch.
"""

from __future__ import annotations

import warnings
import weakref
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cuda.device import find, gpu
from luxel.cuda.threads.light import PARTS, STRIPS, Groups
from luxel.errors import DeviceError, LuxelWarning
from luxel.radiosity.gather import Spots
from luxel.radiosity.relight import Transport

_F = np.float32
_ENOUGH = 1e-3  # of the norm of the right-hand side
_MOST_STEPS, _STEPS_UNSEEN = 100, 4
_MOST_PASSES = 1000
# Bytes of what is worked out: of an element its light in five arrays, of a luxel its colour and the result, of a group its unknowns and STRIPS sums.
_ELEMENT, _LUXEL, _GROUP = 3 * 12 + 2 * 16 + 4, 2 * 12, 8 + 8 + 3 * (6 * 4 + 2 * 8) + 12 * STRIPS

_kept: weakref.WeakKeyDictionary[Transport, ResidentTransport] = weakref.WeakKeyDictionary()


def resident(transport: Transport) -> ResidentTransport:
    """The transport on the GPU, where it stays as long as `transport` lives.

    Raises:
        ExtraMissingError, DeviceError: No GPU can be used, or it has too little memory.
    """
    if transport not in _kept:
        _kept[transport] = ResidentTransport(gpu(), transport)
    return _kept[transport]


def solved(transport: Transport, emission: Array, albedo: Array, still: float, tolerance: float, device: str) -> Array | None:
    """`Transport.solve` with checked arguments, on `device`; None if that is "auto" and the processor has to do it, which is said."""
    if find(device) is None:
        return None
    try:
        there = resident(transport)
        light = there.solve(transport.powers(emission), transport.shining(emission), albedo, still, tolerance)
    except DeviceError as error:
        if device == "cuda":
            raise
        warnings.warn(f"device auto: lighting on the processor: {error}", LuxelWarning, stacklevel=3)
        return None
    return there.gpu.host(light)


class ResidentTransport:
    """The arrays of a `Transport` on a GPU, and those in which its equations are solved."""

    def __init__(self, gpu: Any, transport: Transport, kernels: Any = None) -> None:
        t, self.gpu = transport, gpu
        spots = t.spots or ()
        kept = sum(a.nbytes for a in (t.exchange, t.hits, t.rows, t.touched, t.luxel, t.front, t.area, t.still, *spots))
        kept += (12 * len(t.area) + 12 * len(t.spot_rows)) * bool(spots)
        gpu.expect(kept + _ELEMENT * len(t.area) + _LUXEL * len(t.emission) + _GROUP * len(t.starts) + (1 << 20), "the transport", "a coarser bake")
        if kernels is None:
            from luxel.cuda import light_kernels as kernels
        self.kernels, self.elements, self.luxels, groups = kernels, len(t.area), len(t.emission), len(t.starts) - 1
        self.luxel, self.front, self.area, self.rows, self.touched, self.still = (
            gpu.array(array) for array in (t.luxel, t.front, t.area, t.rows, t.touched, t.still)
        )
        self.hits = gpu.columns(t.hits.shape, np.int32)
        gpu.send(t.hits, self.hits)
        triples = [gpu.empty((groups, 3), kind) for kind in (_F, np.float64, np.float64, _F, _F, _F, _F, _F)]
        before = gpu.array(t.starts.astype(np.int64)), gpu.array(t.exchange), gpu.empty((groups,), np.float64)
        self.groups = Groups(*[*before, *triples, gpu.empty((STRIPS, groups, 3), _F), gpu.empty((4, PARTS, 3), np.float64)])
        self.direct, self.received, self.known = (gpu.empty((3, self.elements), _F) for _ in range(3))
        self.light, self.shining = gpu.empty((self.elements + 3, 4), _F), gpu.empty((self.elements + 3, 4), _F)
        self.change, self.totals = gpu.empty((self.elements,), _F), gpu.empty((2, PARTS), np.float64)
        self.powers = gpu.empty((len(t.rows), 3), _F)
        self.spots = Spots(*map(gpu.array, spots)) if spots else None
        if self.spots:
            self.base, self.spot_powers = gpu.empty((3, self.elements), _F), gpu.empty((len(t.spot_rows), 3), _F)
        self.albedo, self.result = gpu.empty((self.luxels, 3), _F), gpu.array(np.zeros((self.luxels, 3), _F))

    def solve(self, powers: Array, shining: Array | None, albedo: Array, still: float, tolerance: float) -> Any:
        """Light the scene.

        Args:
            powers: (l, 3) float32, of the lights.
            shining: (e, 3) float32: exitance of elements that are no lights; None if there is none.
            albedo: (n, 3) float32, of luxels.
            still: Factor for the light of what has no surface.
            tolerance: How much may change in the last pass, of all light.

        Returns:
            (n, 3) float32 on the device: irradiance; valid until this is called again.
        """
        gpu, k, e = self.gpu, self.kernels, (self.elements, 1)
        gpu.send(powers, self.powers)
        gpu.send(np.ascontiguousarray(albedo, _F), self.albedo)
        padded = np.zeros((self.elements + 3, 4), _F)
        if shining is not None:
            padded[3:, :3] = shining
        gpu.send(padded, self.shining)
        gpu.launch(k.receive, e, self.still, _F(still), self.rows, self.touched, self.powers, self.direct)
        self._exchange()
        known = self.direct
        if shining is not None:
            known = self.known
            self._pass_once(self.shining, self.direct, known)
        self._pass_on(known, tolerance)
        gpu.launch(k.scatter, e, self.luxel, self.front, self.received, self.result)
        return self.result

    def _pass_once(self, light: Any, known: Any, received: Any) -> None:
        """What elements receive of the `light` of all, which is changed, beside what is `known`."""
        gpu, k, e, spots = self.gpu, self.kernels, (self.elements, 1), self.spots
        if spots is not None:
            gpu.launch(k.power_of_spots, (len(self.spot_powers), 1), spots, light, self.spot_powers)
            gpu.launch(k.darken_spots, (len(spots.element), 1), spots, light)
            gpu.launch(k.receive, e, known, _F(1.0), spots.rows, spots.touched, self.spot_powers, self.base)
            known = self.base
        gpu.launch(k.pass_on, e, self.hits, light, known, received, self.change)

    def _exchange(self) -> None:
        """What elements receive, when groups of them see each other as wholes: conjugate gradients."""
        gpu, k, groups, parts, count = self.gpu, self.kernels, self.groups, (PARTS, 1), len(self.groups.area)
        gpu.launch(k.begin_groups, (count, 1), self.area, self.luxel, self.albedo, self.direct, self.shining, groups)
        gpu.launch(k.square, parts, 0, groups)
        gpu.launch(k.square, parts, 3, groups)
        for number in range(_MOST_STEPS):
            before = number % 2
            if number % _STEPS_UNSEEN == 0:
                sums = gpu.host(groups.sums).sum(1)
                if (sums[before] <= _ENOUGH**2 * sums[3]).all():
                    break
            gpu.launch(k.exchange, (count, STRIPS), groups)
            gpu.launch(k.multiply, (count, 1), groups)
            gpu.launch(k.measure, parts, groups)
            gpu.launch(k.step, parts, before, _ENOUGH**2, groups)
            gpu.launch(k.turn, parts, before, _ENOUGH**2, groups)
        gpu.launch(k.send_groups, (count, 1), groups)
        gpu.launch(k.exchange, (count, STRIPS), groups)
        gpu.launch(k.spread_groups, (count, 1), self.direct, groups, self.received)

    def _pass_on(self, known: Any, tolerance: float) -> None:
        """Pass light on until what elements receive settles."""
        gpu, k, e = self.gpu, self.kernels, (self.elements, 1)
        for _ in range(_MOST_PASSES):
            gpu.launch(k.send, e, self.luxel, self.albedo, self.received, self.light)
            self._pass_once(self.light, known, self.received)
            gpu.launch(k.sum_changes, (PARTS, 1), self.received, self.change, self.totals)
            changed, whole = gpu.host(self.totals).sum(1)
            if changed <= tolerance * whole:
                return
