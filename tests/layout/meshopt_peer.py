"""meshoptimizer's own analysers, out of the shared library in its wheel, or None."""

import ctypes
import importlib.util
from pathlib import Path

import numpy as np


class CacheStatistics(ctypes.Structure):
    _fields_ = [("transformed", ctypes.c_uint), ("warps", ctypes.c_uint), ("acmr", ctypes.c_float), ("atvr", ctypes.c_float)]


class FetchStatistics(ctypes.Structure):
    _fields_ = [("bytes", ctypes.c_uint), ("overfetch", ctypes.c_float)]


def _library():
    spec = importlib.util.find_spec("meshoptimizer")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for path in Path(folder).glob("*meshoptimizer*.so"):
            library = ctypes.CDLL(str(path))
            if hasattr(library, "meshopt_analyzeVertexCache"):
                library.meshopt_analyzeVertexCache.restype = CacheStatistics
                library.meshopt_analyzeVertexFetch.restype = FetchStatistics
                return library
    return None


LIBRARY = _library()


def _arguments(triangles, vertex_count):
    indices = np.ascontiguousarray(triangles, np.uint32)
    return indices, (indices.ctypes.data_as(ctypes.c_void_p), ctypes.c_size_t(indices.size), ctypes.c_size_t(vertex_count))


def analyze_cache(triangles, vertex_count, cache, warp=0, group=0):
    _keep, arguments = _arguments(triangles, vertex_count)
    return LIBRARY.meshopt_analyzeVertexCache(*arguments, cache, warp, group)


def analyze_fetch(triangles, vertex_count, stride):
    _keep, arguments = _arguments(triangles, vertex_count)
    return LIBRARY.meshopt_analyzeVertexFetch(*arguments, ctypes.c_size_t(stride))
