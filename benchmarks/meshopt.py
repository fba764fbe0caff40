"""meshoptimizer's vertex-cache functions, called in the shared library of its wheel: no Python between the clock and the C++."""

from __future__ import annotations

import ctypes
import importlib.util
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np


class Missing(Exception):
    """meshoptimizer is not installed, or its library exports other names."""


class _Statistics(ctypes.Structure):
    _fields_ = [("transformed", ctypes.c_uint), ("warps", ctypes.c_uint), ("acmr", ctypes.c_float), ("atvr", ctypes.c_float)]


class Meshoptimizer:
    """The peer. Triangles are (m, 3) uint32 in C order."""

    def __init__(self) -> None:
        spec = importlib.util.find_spec("meshoptimizer")
        paths = [path for folder in (spec.submodule_search_locations or []) for path in Path(folder).glob("*.so")] if spec else []
        if not paths:
            raise Missing("pip install meshoptimizer")
        self._library = ctypes.CDLL(str(paths[0]))
        if not hasattr(self._library, "meshopt_analyzeVertexCache"):
            raise Missing("its library exports no meshopt_analyzeVertexCache")
        self._library.meshopt_analyzeVertexCache.restype = _Statistics
        self.name = f"meshoptimizer {version('meshoptimizer')}"

    def _call(self, name: str, triangles: Any, vertices: int, *more: int) -> Any:
        result = np.empty_like(triangles)
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (result, triangles)]
        getattr(self._library, name)(*pointers, ctypes.c_size_t(triangles.size), ctypes.c_size_t(vertices), *more)
        return result

    def optimize(self, triangles: Any, vertices: int) -> Any:
        return self._call("meshopt_optimizeVertexCache", triangles, vertices)

    def fifo(self, triangles: Any, vertices: int, target: int) -> Any:
        return self._call("meshopt_optimizeVertexCacheFifo", triangles, vertices, target)

    def reuse(self, triangles: Any, vertices: int, cache: int, warp: int = 0, group: int = 0) -> Any:
        pointer = triangles.ctypes.data_as(ctypes.c_void_p)
        return self._library.meshopt_analyzeVertexCache(pointer, ctypes.c_size_t(triangles.size), ctypes.c_size_t(vertices), cache, warp, group)
