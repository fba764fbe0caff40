"""Spill: arrays laid aside on disk, in a file without a name that goes with the process, however that ends."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array


class Spill:
    """Arrays under keys, in the order in which they come.

    Args:
        folder: On the disk that is to hold them; None: where temporary files go.
    """

    def __init__(self, folder: Path | None) -> None:
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        self._places: dict[Any, list[tuple[int, tuple[int, ...], np.dtype[Any]]]] = {}

    def put(self, key: Any, array: Array) -> None:
        """Lay an array aside."""
        if array.size:
            self._places.setdefault(key, []).append((self._file.seek(0, 2), array.shape, array.dtype))
            self._file.write(np.ascontiguousarray(array).data)

    def get(self, key: Any) -> list[Array]:
        """What was put under a key."""
        out = []
        for place, shape, dtype in self._places.get(key, ()):
            self._file.seek(place)
            array = np.empty(shape, dtype)
            got = self._file.readinto(array.reshape(-1).view(np.uint8).data)
            assert got == array.nbytes
            out.append(array)
        return out

    def close(self) -> None:
        """Give the disk its room back."""
        self._file.close()
