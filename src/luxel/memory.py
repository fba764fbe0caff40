"""Memory: how much is free, and large arrays of every frame that use it again, without asking the system every time.

A fresh large array costs more than filling it: the system hands out its pages one by one, when they are first touched, and cleared. So the memory of
an array from `reusable` is kept when nobody refers to it any more, and given to the next that fits.
"""

from __future__ import annotations

import math
import re
import sys
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array

LARGE = 1 << 18
"""Bytes; smaller arrays are made afresh."""

MOST_IDLE = 256 << 20
"""Bytes that are kept while nobody uses them."""

_MEMINFO = Path("/proc/meminfo")
_CGROUP = Path("/sys/fs/cgroup")
_GROUPS = (
    (_CGROUP / "memory.max", _CGROUP / "memory.current", _CGROUP / "memory.stat", "inactive_file"),
    (_CGROUP / "memory/memory.limit_in_bytes", _CGROUP / "memory/memory.usage_in_bytes", _CGROUP / "memory/memory.stat", "total_inactive_file"),
)

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


def peak_bytes() -> int:
    """The most memory that this process has had; where Linux tells it, without that of the process which started it."""
    status = Path("/proc/self/status")
    found = re.search(r"VmHWM:\s*(\d+) kB", status.read_text()) if status.exists() else None
    if found:
        return 1024 * int(found[1])
    import resource  # not on Windows

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def free_bytes() -> int | None:
    """Memory that this process may still take, without swapping: of the machine and of its control group; None if it cannot be told."""
    left = [room for room in (_of_machine(), _of_group()) if room is not None]
    return min(left, default=None)


def _of_machine() -> int | None:
    try:
        lines = dict(line.split(":", 1) for line in _MEMINFO.read_text().splitlines() if ":" in line)
        return int(lines["MemAvailable"].split()[0]) << 10
    except (OSError, KeyError, ValueError):
        return None


def _of_group() -> int | None:
    """What the limit of a container leaves; pages of files that it holds can be dropped."""
    for limit, used, stat, held in _GROUPS:
        try:
            dropped = dict(line.split() for line in stat.read_text().splitlines())[held]
            return int(limit.read_text()) - int(used.read_text()) + int(dropped)
        except (OSError, KeyError, ValueError):  # no such group, or "max": no limit
            continue
    return None
