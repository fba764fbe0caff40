"""A prepared scene on the GPU, and the buffers that its pictures are drawn in: both stay there from frame to frame."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.raster.bin import NO_CLIPPED
from luxel.raster.materials import GOURAUD
from luxel.raster.render import Prepared
from luxel.raster.shade import vertex_material

SPLIT = 64
"""Pixels: a thread draws a triangle whose box has so many at most, a warp each tile of a larger one."""

SIDE = 32
"""Of a tile that a warp draws, in pixels."""

_ITEMS, _CANDIDATES = 1 << 16, 1 << 12  # rows of the first queue


class Resident:
    """What of a scene does not depend on the camera, on the GPU.

    Attributes:
        gpu: Where it is: a `luxel.cuda.device.Gpu`.
        prepared: What it was made of.
        fallback: Whether the processor draws what does not fit.
        geometry, materials, vertex_materials: As in `prepared`, arrays on the device.
        vertex_material: (n,) int32, the material of each vertex; chosen: (materials,) bool: lit at vertices. Both empty without Gouraud shading.
        split, side: See `SPLIT` and `SIDE`; they change speed and nothing else.
        measured: Wait for each stage, so that `Picture.seconds` tells what it takes.
        lock: Held while a picture is drawn: threads of the processor draw one after the other.
    """

    def __init__(self, gpu: Any, prepared: Prepared, fallback: bool = False) -> None:
        if prepared.hardware is not None:
            raise InputError("device cuda: shading hardware is a model that runs on the processor; expected another shading")
        size = sum(array.nbytes for part in prepared[1:4] if part is not None for array in part if isinstance(array, np.ndarray))
        gpu.expect(size, "the scene")
        self.gpu, self.prepared, self.fallback = gpu, prepared, fallback
        self.geometry, self.materials = gpu.copied(prepared.geometry), gpu.copied(prepared.materials)
        self.vertex_materials: Any = None
        if prepared.vertex_materials is not None:
            self.vertex_materials = gpu.copied(prepared.vertex_materials)
            self.vertex_material = gpu.array(vertex_material(prepared.geometry))
            self.chosen = gpu.array(prepared.materials.flags & GOURAUD != 0)
        self.no_clipped, self.no_clipped_f = gpu.copied(NO_CLIPPED), gpu.array(NO_CLIPPED.screen.view(np.float32))
        self.split, self.side, self.measured, self.lock = SPLIT, SIDE, False, threading.Lock()
        self._buffers: dict[str, Any] = {}
        self._sent: dict[str, Array] = {}
        self._room = _ITEMS, _CANDIDATES

    def buffer(self, name: str, shape: tuple[int, ...], dtype: Any) -> Any:
        """An array of this name, the same as last time if it has the same shape; what is in it is undefined."""
        known = self._buffers.get(name)
        if known is None or known.shape != shape or known.dtype != np.dtype(dtype):
            self._buffers.pop(name, None)  # before the new one is made: both may not fit
            known = None
            self._buffers[name] = known = self.gpu.empty(shape, dtype)
        return known


    def sent(self, name: str, host: Array) -> Any:
        """A copy of an array on the device, in the buffer of this name; nothing is copied if it is there already."""
        known = self._sent.get(name)
        if known is None or known.shape != host.shape or known.dtype != host.dtype or not np.array_equal(known, host, equal_nan=False):
            self.gpu.send(host, self.buffer(name, host.shape, host.dtype))
            self._sent[name] = host.copy()
        return self._buffers[name]

    def held(self) -> int:
        """Bytes of all buffers."""
        return sum(array.nbytes for array in self._buffers.values())

    def room(self, items: int, candidates: int) -> tuple[int, int]:
        """Rows for a queue: at least so many, and as many as were ever wanted."""
        self._room = max(items, self._room[0]), max(candidates, self._room[1])
        return self._room
