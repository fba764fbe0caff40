"""Agree: before any work, that all ranks would do the same."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from luxel.cluster.comm import Comm
from luxel.errors import InputError

_PIECES, _PIECE = 16, 1 << 16  # of a file: so many bytes here and there tell two files apart


def fingerprint(path: Path) -> str:
    """What a file is: its size and a hash of pieces of it, the first and the last among them; or why it cannot be read. Of a folder, its files."""
    try:
        if path.is_dir():
            files = "\n".join(f"{each.name}: {fingerprint(each)}" for each in sorted(path.iterdir()) if each.is_file())
            return f"{files.count(chr(10)) + 1} files, {hashlib.sha256(files.encode()).hexdigest()[:12]}"
        size = path.stat().st_size
        digest = hashlib.sha256()
        with path.open("rb") as file:
            for at in np.linspace(0, max(0, size - _PIECE), _PIECES).astype(np.int64).tolist():
                file.seek(at)
                digest.update(file.read(_PIECE))
    except OSError as error:
        return f"unreadable ({error.strerror})"
    return f"{size} bytes, {digest.hexdigest()[:12]}"


def agree(comm: Comm, paths: tuple[Path, ...] = (), **told: Any) -> None:
    """See that all ranks have the same versions, files and options.

    Args:
        comm: All ranks.
        paths: Files that each of them reads.
        told: Whatever else must be the same, by name.

    Raises:
        InputError: On every rank: a rank differs from rank 0, and in what.
    """
    mine = {name: version(name) for name in ("luxel", "numba", "llvmlite", "numpy")} | {"Python": platform.python_version()}
    mine |= {str(path): fingerprint(path) for path in paths} | {name: repr(value) for name, value in told.items()}
    everyone = comm.gather(mine)
    for rank, theirs in enumerate(everyone):
        for name, value in theirs.items():
            if value != everyone[0].get(name):
                raise InputError(f"ranks differ in {name}: {everyone[0].get(name)} on rank 0, {value} on rank {rank}")
