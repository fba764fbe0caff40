"""Arrays on the GPU, for other libraries to use where they are: by `__cuda_array_interface__` (CuPy, PyTorch, Numba) and DLPack (and JAX)."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from luxel.arrays import Array

CUDA, CPU = 2, 1
"""Kinds of devices, by DLPack's numbers."""

_KINDS = {"i": 0, "u": 1, "f": 2}
_NAME = b"dltensor"


class _Device(ctypes.Structure):
    _fields_ = (("kind", ctypes.c_int32), ("number", ctypes.c_int32))


class _Type(ctypes.Structure):
    _fields_ = (("code", ctypes.c_uint8), ("bits", ctypes.c_uint8), ("lanes", ctypes.c_uint16))


class _Tensor(ctypes.Structure):
    _fields_ = (
        ("data", ctypes.c_void_p), ("device", _Device), ("ndim", ctypes.c_int32), ("dtype", _Type), ("shape", ctypes.POINTER(ctypes.c_int64)),
        ("strides", ctypes.POINTER(ctypes.c_int64)), ("byte_offset", ctypes.c_uint64),
    )  # fmt: skip


class _Managed(ctypes.Structure):
    pass


_Deleter = ctypes.CFUNCTYPE(None, ctypes.POINTER(_Managed))
_Managed._fields_ = (("tensor", _Tensor), ("context", ctypes.c_void_p), ("deleter", _Deleter))  # type: ignore[misc]
_Destructor = ctypes.CFUNCTYPE(None, ctypes.c_void_p)

_new = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, _Destructor)(("PyCapsule_New", ctypes.pythonapi))
_valid = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p)(("PyCapsule_IsValid", ctypes.pythonapi))
_pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)(("PyCapsule_GetPointer", ctypes.pythonapi))

_lent: dict[int, Any] = {}  # what capsules stand for, by address, until whoever took them is done


@_Deleter
def _give_back(managed: Any) -> None:
    _lent.pop(ctypes.addressof(managed.contents), None)


@_Destructor
def _forget(capsule: Any) -> None:
    if _valid(capsule, _NAME):  # nobody took it: who takes one renames it
        _lent.pop(_pointer(capsule, _NAME) or 0, None)


class DeviceArray:
    """An array that stays where it is, contiguous in row-major order.

    Attributes:
        shape: Length along each axis.
        dtype: NumPy's.
        pointer: Address of the first element, on the device.
    """

    def __init__(self, pointer: int, shape: tuple[int, ...], dtype: Any, fetch: Callable[[], Array], device: tuple[int, int] = (CUDA, 0)) -> None:
        """`fetch` gives a copy in the processor's memory, and keeps the memory from being given back."""
        self.pointer, self.shape, self.dtype, self._fetch, self._device = pointer, tuple(map(int, shape)), np.dtype(dtype), fetch, device

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape))

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        return self.size * self.dtype.itemsize

    def numpy(self) -> Array:
        """A copy in the processor's memory."""
        return self._fetch()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        if copy is False:
            raise ValueError("an array on the GPU can only be copied to the processor")
        array = self.numpy()
        return array if dtype is None else array.astype(dtype, copy=False)

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        if self._device[0] != CUDA:
            raise AttributeError("not in a GPU's memory")
        return {"shape": self.shape, "typestr": self.dtype.str, "data": (self.pointer, False), "version": 3, "strides": None, "stream": None}

    def __dlpack_device__(self) -> tuple[int, int]:
        return self._device

    def __dlpack__(self, *, stream: Any = None, max_version: Any = None, dl_device: Any = None, copy: bool | None = None) -> Any:
        """A capsule of this memory. Whatever drew it is done, so no stream needs to wait."""
        if copy or (dl_device is not None and tuple(dl_device) != self._device):
            raise BufferError("this array is handed over where it is, without a copy")
        managed, shape = _Managed(), (ctypes.c_int64 * max(self.ndim, 1))(*self.shape)
        strides = (ctypes.c_int64 * max(self.ndim, 1))(*(math.prod(self.shape[axis + 1 :]) for axis in range(self.ndim)))
        kind = _Type(_KINDS[self.dtype.kind], 8 * self.dtype.itemsize, 1)
        managed.tensor = _Tensor(self.pointer, _Device(*self._device), self.ndim, kind, shape, strides, 0)
        managed.deleter = _give_back
        _lent[ctypes.addressof(managed)] = managed, shape, strides, self
        return _new(ctypes.addressof(managed), _NAME, _forget)

    def __repr__(self) -> str:
        return f"DeviceArray({self.shape}, {self.dtype})"
