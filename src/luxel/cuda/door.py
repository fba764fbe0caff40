"""The only importer of numba.cuda: decorators for kernels and for the functions that they call.

Kernels are compiled without fused multiplication and addition, so that what is drawn on a GPU has the bits of what is drawn on a processor. Numba
has no option for that. NVVM, which it calls, has (-fma), and gets it here. With the variable NUMBA_ENABLE_CUDASIM kernels run as Python, thread by
thread, to be tested where there is no GPU.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from luxel import jit
from luxel.errors import ExtraMissingError

if importlib.util.find_spec("numba_cuda") is None:
    raise ExtraMissingError("numba-cuda", "cuda", "drawing on a GPU")

from numba import cuda

__all__ = ["SIMULATED", "VERSION", "columns", "configured", "cuda", "function", "initialise", "kernel", "libdevice"]

VERSION = str(importlib.import_module("numba_cuda").__version__)
SIMULATED = os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0")
libdevice: Any = None if SIMULATED else importlib.import_module("numba.cuda.libdevice")


def _numba(name: str) -> Any:
    """A part of Numba that newer versions of numba-cuda have a copy of."""
    try:
        return importlib.import_module(f"numba.cuda.core.{name}")
    except ImportError:
        return importlib.import_module(f"numba.core.{name}")


@contextmanager
def _unfused() -> Iterator[None]:
    """While in the block, NVVM is told not to fuse; what other threads compile waits."""
    from numba.cuda.cudadrv import nvvm

    global_compiler_lock = _numba("compiler_lock").global_compiler_lock

    with global_compiler_lock:
        before = nvvm.compile_ir
        nvvm.compile_ir = lambda *modules, **options: before(*modules, **{**options, "fma": 0})
        try:
            yield
        finally:
            nvvm.compile_ir = before


def function(python: Callable[..., Any]) -> Any:
    """A function that kernels call."""
    return cuda.jit(python, device=True)


def kernel(python: Callable[..., Any]) -> Any:
    """A grid: compiled when it is first launched, and kept on disk like those of `luxel.jit`."""
    if SIMULATED:
        return cuda.jit(python)
    config = _numba("config")
    before, folder = config.CACHE_DIR, jit.cache_folder()
    if folder:
        config.CACHE_DIR = str(Path(folder) / f"cuda-{VERSION}-{jit.digest(python.__module__)}")
    try:
        made = cuda.jit(python, lto=False, cache=bool(folder))  # what is linked at last would be fused again
    finally:
        config.CACHE_DIR = before
    compile_as_numba_does = made.compile

    def compile(signature: Any) -> Any:
        with _unfused():
            compiled = compile_as_numba_does(signature)
        compiled.library._nvvm_options["fma"] = 0  # also if it is compiled again, for another card in the same machine
        return compiled

    made.compile = compile
    return made


def configured(grid: Any, blocks: tuple[int, int], block: tuple[int, int]) -> Any:
    """A kernel to be called: without Numba's warning that few blocks leave most of a card idle, as small pictures do."""
    if SIMULATED:
        return grid[blocks, block]
    config = _numba("config")
    before, config.CUDA_LOW_OCCUPANCY_WARNINGS = config.CUDA_LOW_OCCUPANCY_WARNINGS, 0
    try:
        return grid[blocks, block]
    finally:
        config.CUDA_LOW_OCCUPANCY_WARNINGS = before


@cache
def _columns() -> Any:
    from numba.cuda.cudadrv.devicearray import DeviceNDArray

    class Columns(DeviceNDArray):  # type: ignore[misc]
        @property
        def _numba_type_(self) -> Any:
            return super()._numba_type_.copy(layout="F")

    return Columns


def columns(array: Any) -> Any:
    """The memory of an array that is stored column by column, which Numba knows as such also where it has one row, one column or none."""
    return _columns()(array.shape, array.strides, array.dtype, gpu_data=array.gpu_data)


def initialise() -> Any:
    """The current GPU, as Numba has it.

    Raises:
        Exception: Numba's: there is no driver, or no GPU, or it does not answer.
    """
    if not SIMULATED and not len(cuda.gpus):
        raise OSError("no GPU")
    return cuda.get_current_device()
