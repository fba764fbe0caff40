"""Memory that is used again: large arrays of every frame, without asking the system for them every time.

A fresh large array costs more than filling it: the system hands out its pages one by one, when they are first touched, and cleared. So the memory of
an array from `reusable` is kept when nobody refers to it any more, and given to the next that fits.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from luxel.arrays import Array

LARGE = 1 << 18
"""Bytes; smaller arrays are made afresh."""

MOST_IDLE = 256 << 20
"""Bytes that are kept while nobody uses them."""

_ALIGNMENT = 64
# The latest so many pieces at most. Its own operations are atomic: arrays come back from any thread, and while garbage is collected.
_idle: deque[Array] = deque(maxlen=64)


class _Lease:
    """Owns memory that is in use, through the arrays that have it as their base."""

    __slots__ = ("__array_interface__", "memory")

    def __init__(self, memory: Array) -> None:
        self.memory = memory
        start = -memory.ctypes.data % _ALIGNMENT
        self.__array_interface__: dict[str, Any] = memory[start : len(memory) - _ALIGNMENT + start].__array_interface__

    def __del__(self, idle: deque[Array] = _idle, most: int = MOST_IDLE) -> None:  # bound here: modules lose their names before the last arrays go
        idle.append(self.memory)
        try:
            while sum(map(len, tuple(idle))) > most:
                idle.popleft()
        except (IndexError, RuntimeError):  # another thread, or a collection in between, changed it: the next one trims
            pass


def _found(size: int) -> Array | None:
    """Idle memory of `size` bytes, or of not many more."""
    for _ in range(len(_idle)):
        try:
            memory = _idle.popleft()
        except IndexError:
            return None
        if size <= len(memory) - _ALIGNMENT <= size + size // 4 + LARGE:
            return memory
        _idle.append(memory)
    return None


def reusable(shape: tuple[int, ...], dtype: object) -> Array:
    """Like `np.empty(shape, dtype)`: what is in it is undefined. It begins at a multiple of 64 bytes if it is large."""
    kind = np.dtype(dtype)  # type: ignore[call-overload]
    size = math.prod(shape) * kind.itemsize
    if size < LARGE:
        return np.empty(shape, kind)
    memory = _found(size)
    array = np.asarray(_Lease(np.empty(size + _ALIGNMENT, np.uint8) if memory is None else memory))
    return array[:size].view(kind).reshape(shape)
