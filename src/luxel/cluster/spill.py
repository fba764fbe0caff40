"""Spill: arrays laid aside on disk, in a file without a name that goes with the process, however that ends."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError


class Spill:
    """Arrays under keys, in the order in which they come.

    Args:
        folder: On the disk that is to hold them; None: where temporary files go.

    Raises:
        FileError: Here and from all methods: the disk is full, or fails.
    """

    def __init__(self, folder: Path | None) -> None:
        self._where = f"a file without a name in {str(folder or tempfile.gettempdir())!r}"
        with self._door():
            self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        self._places: dict[Any, list[tuple[int, tuple[int, ...], np.dtype[Any]]]] = {}

    def put(self, key: Any, array: Array) -> None:
        """Lay an array aside."""
        if array.size:
            with self._door():
                place = self._file.seek(0, 2)  # which writes what is still held back
            self._places.setdefault(key, []).append((place, array.shape, array.dtype))
            with self._door():
                self._file.write(np.ascontiguousarray(array).data)

    def get(self, key: Any) -> list[Array]:
        """What was put under a key."""
        out = []
        for place, shape, dtype in self._places.get(key, ()):
            array = np.empty(shape, dtype)
            with self._door():
                self._file.seek(place)
                got = self._file.readinto(array.reshape(-1).view(np.uint8).data)
            assert got == array.nbytes
            out.append(array)
        return out

    @contextmanager
    def _door(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise FileError(self._where, f"cannot lay parts aside: {error.strerror or error}") from error

    def close(self) -> None:
        """Give the disk its room back."""
        with suppress(OSError):  # it is not needed any more
            self._file.close()
