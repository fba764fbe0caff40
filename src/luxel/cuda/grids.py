"""Grids made from what one thread does: the same few lines for every kernel that needs no memory of its own.

A kernel is given how many threads are wanted along both axes, and all else as one tuple: `luxel.cuda.device.Gpu.launch` hands it over.
"""

from __future__ import annotations

import types
from typing import Any

from luxel.cuda.door import cuda, kernel


def _line(n, _, given):
    i, _ = cuda.grid(2)
    if i < n:
        body(i, *given)  # type: ignore[name-defined]  # noqa: F821 - see `named`


def _grid(n, m, given):
    i, j = cuda.grid(2)
    if i < n and j < m:
        body(i, j, *given)  # type: ignore[name-defined]  # noqa: F821


def named(text: Any, name: str, module: str, body: Any) -> Any:
    """The function `text` for a body. It is a global of the function, not of a closure: Numba keeps no closure over a compiled function on disk."""
    made = types.FunctionType(text.__code__, {**text.__globals__, "__name__": module, "body": body}, name)
    made.__qualname__ = name
    return made


def kernels(module: str, lines: dict[str, Any], grids: dict[str, Any]) -> dict[str, Any]:
    """Kernels of a module, by name.

    Args:
        module: Its name: who imports the bodies, so that what is kept on disk is compiled anew when they change.
        lines: Bodies that are given the number of the thread.
        grids: Bodies that are given its number along both axes.
    """
    return {name: kernel(named(text, name, module, body)) for text, bodies in ((_line, lines), (_grid, grids)) for name, body in bodies.items()}
