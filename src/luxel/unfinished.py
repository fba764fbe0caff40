"""Unfinished: what this process is writing, told to whoever clears it away should the process die before it can (`luxel.cluster.failure`)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

Listener = Callable[[str, bool], None]

_listeners: list[Listener] = []


def listen(listener: Listener) -> None:
    """Have `listener(path, True)` called before a file or folder is begun, and `listener(path, False)` when it is finished, renamed or removed."""
    _listeners.append(listener)


@contextmanager
def unfinished(path: str | os.PathLike[str]) -> Iterator[None]:
    """Around the making of a file or folder that is worth nothing until the block ends."""
    name = str(Path(path).absolute())
    for listener in _listeners:
        listener(name, True)
    try:
        yield
    finally:
        for listener in _listeners:
            listener(name, False)
