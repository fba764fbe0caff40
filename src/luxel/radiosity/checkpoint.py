"""Checkpoints: the state of a bake in a file, written beside and renamed, so that there is always a whole one."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from luxel import __version__
from luxel.arrays import Array
from luxel.errors import FileError, InputError
from luxel.io.files import atomic_write
from luxel.radiosity.solve import State, Step

SOLVER = 2
"""To be raised with every change of what the solver does, or of what a state means: what an older one has begun, another cannot end alike."""

_NO_CHECKPOINT = "expected a checkpoint of a bake; the file is something else, or damaged"
_START_ANEW = "delete it, or bake without --resume"
_ARRAYS = ("received", "direct", "unshot", "power", "emitted", "absorbed", "escaped")


def fingerprint(settings: Any, arrays: Iterable[Array]) -> str:
    """Of everything that the solution depends on."""
    digest = hashlib.sha256(repr(settings).encode())
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode())  # so that no array's end can pass for the next one's beginning
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def size(state: State) -> int:
    """Bytes that a checkpoint of it takes, about."""
    return sum(getattr(state, name).nbytes for name in _ARRAYS)


def save(path: Path, key: str, state: State) -> None:
    """Write the state.

    Raises:
        FileError: The file cannot be written; what was there stays.
    """
    ledger = np.array([[s.shots, *s.emitted, *s.absorbed, *s.escaped, *s.unshot] for s in state.ledger]).reshape(-1, 13)
    arrays = {name: getattr(state, name) for name in _ARRAYS}
    with atomic_write(path) as file:
        np.savez(file, version=np.array(_version()), key=np.array(key), counts=np.array([state.lights_left, state.shots]), ledger=ledger, **arrays)


def is_checkpoint(path: Path) -> bool:
    """Whether a file is a checkpoint of some bake, by any version; one that is damaged may be told from others no more, and is none."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as kept:
            return {"key", "counts", "ledger"} <= set(getattr(kept, "files", ()))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return False


def load(path: Path, key: str, fresh: State) -> State | None:
    """The state kept in a file; None if there is no file.

    Args:
        key: `fingerprint` of this bake.
        fresh: A state before the first shot, whose arrays have the shapes.

    Raises:
        FileError: The file cannot be read.
        InputError: It is of another bake, or of another version of luxel.
    """
    if not path.exists():
        return None
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as kept:
            version = str(kept["version"]) if "version" in kept else "" if "key" in kept else None  # the first checkpoints had none
            arrays = {name: kept[name] for name in (*_ARRAYS, "key", "counts", "ledger")} if version == _version() else {}
    except OSError as error:
        raise FileError(path, f"cannot read the checkpoint ({error.strerror or error})") from error
    except (ValueError, KeyError, EOFError, BadZipFile) as error:
        raise FileError(path, _NO_CHECKPOINT) from error
    if version is None:
        raise FileError(path, _NO_CHECKPOINT)
    if version != _version():
        raise InputError(f"{path}: the checkpoint is of another version of luxel, whose light may differ; {_START_ANEW}")
    if str(arrays["key"]) != key:
        raise InputError(f"{path}: the checkpoint is of another scene or other settings; {_START_ANEW}")
    for name in _ARRAYS:
        if arrays[name].shape != getattr(fresh, name).shape:
            raise FileError(path, f"{name}: expected {getattr(fresh, name).shape}, got {arrays[name].shape}")
    lights_left, shots = (int(count) for count in arrays["counts"])
    ledger = [Step(int(row[0]), *(row[1 + 3 * i : 4 + 3 * i] for i in range(4))) for row in arrays["ledger"]]
    return State(**{name: arrays[name] for name in _ARRAYS}, lights_left=lights_left, shots=shots, ledger=ledger)


def _version() -> str:
    return f"{__version__}, solver {SOLVER}"
