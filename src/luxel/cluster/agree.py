"""Agree: before any work, that all ranks would do the same."""

from __future__ import annotations

import hashlib
import json
import platform
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from luxel.cluster.comm import Comm
from luxel.errors import InputError

_NAMES = 1 << 20  # bytes of an .obj or .mtl file that are searched for names of others
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


def files_of(path: Path) -> list[Path]:
    """A file, and those beside it that it names: buffers and images of a .gltf, materials of an .obj and their images; as far as can be told."""
    out = [path]
    with suppress(OSError, ValueError, AttributeError, TypeError):
        folder, kind = path.parent, path.suffix.lower()
        if kind == ".gltf":
            document = json.loads(path.read_bytes())
            uris = [each.get("uri") or "data:" for key in ("buffers", "images") for each in document.get(key, ())]
            out += [folder / unquote(uri) for uri in uris if not uri.startswith("data:")]
        elif kind in (".obj", ".mtl"):
            with path.open("rb") as file:
                lines = file.read(_NAMES).decode(errors="surrogateescape").splitlines()
            words = [line.split(None, 1) for line in lines if line.lstrip().startswith(("mtllib", "map_", "norm", "bump", "disp"))]
            for word, *rest in words:
                name = rest[0].strip() if rest else ""
                out += files_of(folder / name) if word == "mtllib" else [folder / name.split()[-1]]
    return list(dict.fromkeys(out))


def agree(comm: Comm, paths: tuple[Path, ...] = (), **told: Any) -> None:
    """See that all ranks have the same versions, files and options.

    Args:
        comm: All ranks.
        paths: Files that each of them reads; what they name (`files_of`) is looked at too.
        told: Whatever else must be the same, by name.

    Raises:
        InputError: On every rank: a rank differs from rank 0, and in what.
    """
    mine = {name: version(name) for name in ("luxel", "numba", "llvmlite", "numpy")} | {"Python": platform.python_version()}
    mine |= {str(each): fingerprint(each) for path in paths for each in files_of(path)} | {name: repr(value) for name, value in told.items()}
    everyone = comm.gather(mine)
    for rank, theirs in enumerate(everyone):
        for name in [*everyone[0], *theirs]:
            first, other = everyone[0].get(name, "nothing"), theirs.get(name, "nothing")
            if first != other:
                raise InputError(f"ranks differ in {name}: {first} on rank 0, {other} on rank {rank}")
