"""The GPU: found, or an error that says why not; its memory, and launching."""

from __future__ import annotations

import math
import warnings
from functools import cache, partial
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cuda.shared import CPU, CUDA, DeviceArray
from luxel.errors import DeviceError, ExtraMissingError, InputError, LuxelWarning

DEVICES = ("cpu", "cuda", "auto")
LEAST_CAPABILITY = (7, 5)
"""Of a card; CUDA's compilers have none for older ones."""

_BLOCK = 128


class Gpu:
    """A card that can be drawn on.

    Attributes:
        name: What its maker calls it.
        capability: Compute capability, (major, minor).
    """

    def __init__(self) -> None:
        from luxel.cuda import door

        self._door, self._cuda, self._simulated = door, door.cuda, door.SIMULATED
        try:
            device = door.initialise()
        except Exception as error:  # Numba's own kinds of errors, and those of the driver's bindings
            raise DeviceError(f"device cuda: expected an NVIDIA GPU and its driver; {_reason(error)}") from error
        self._compiled: dict[Any, Any] = {}
        self._number = 0 if self._simulated else int(device.id)
        self.name = "simulator" if self._simulated else _text(device.name)
        self.capability = (9, 0) if self._simulated else tuple(device.compute_capability)
        if self.capability < LEAST_CAPABILITY:
            least, came = (".".join(map(str, pair)) for pair in (LEAST_CAPABILITY, self.capability))
            raise DeviceError(f"device cuda: expected a GPU of compute capability {least} or more; {self.name} has {came}")

    @property
    def kernels(self) -> Any:
        """What it can launch; imported when first asked for."""
        from luxel.cuda import kernels

        return kernels

    def free_memory(self) -> int:
        """Bytes that can be had."""
        if self._simulated:
            return 1 << 32
        return int(self._cuda.current_context().get_memory_info()[0])

    def array(self, host: Array) -> Any:
        """A copy on the device, row by row."""
        there = self.empty(host.shape, host.dtype)
        self.send(host, there)
        return there

    def copied(self, arrays: Any) -> Any:
        """A named tuple with all its arrays copied to the device, deep down."""
        if isinstance(arrays, np.ndarray):
            return self.array(arrays)
        return type(arrays)(*map(self.copied, arrays)) if isinstance(arrays, tuple) else arrays

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """An array whose values are undefined, row by row."""
        return self._allocated(shape, dtype, "C")

    def columns(self, shape: tuple[int, int], dtype: Any) -> Any:
        """The same, stored column by column: threads that are neighbours along the first axis write to neighbouring places.

        A kernel is compiled for one or the other. Which it is does not depend on the shape, as it would for Numba where there is one row or column.
        """
        there = self._allocated(shape, dtype, "F")
        return there if self._simulated else self._door.columns(there)

    def _allocated(self, shape: tuple[int, ...], dtype: Any, order: str) -> Any:
        if self._simulated:
            return np.zeros(shape, dtype, order=order)  # type: ignore[call-overload]
        try:
            return self._cuda.device_array(shape, dtype, order=order)
        except Exception as error:
            if "OUT_OF_MEMORY" not in str(error):
                raise
            size = math.prod(shape) * np.dtype(dtype).itemsize
            raise DeviceError(f"device cuda: {_size(size)} of memory wanted, {_size(self.free_memory())} free on {self.name}") from error

    def host(self, array: Any) -> Array:
        """A copy in the processor's memory."""
        return np.array(array) if self._simulated else array.copy_to_host()

    def send(self, host: Array, array: Any) -> None:
        """Copy to an array on the device."""
        if self._simulated:
            array[...] = host
        elif host.size:
            array.copy_to_device(np.ascontiguousarray(host))

    def shared(self, array: Any) -> list[DeviceArray]:
        """The rows of an array, for other libraries to use where they are."""
        if self._simulated:
            return [DeviceArray(row.ctypes.data, row.shape, row.dtype, row.copy, (CPU, 0)) for row in array]
        first, shape, device = array.device_ctypes_pointer.value, array.shape[1:], (CUDA, self._number)
        step = math.prod(shape) * array.dtype.itemsize
        return [DeviceArray(first + i * step, shape, array.dtype, partial(_fetch, array, i), device) for i in range(array.shape[0])]

    def view(self, array: Any, dtype: Any) -> Any:
        """The same memory as another type of the same size."""
        return array.view(dtype)

    def launch(self, kernel: Any, shape: tuple[int, int], *given: Any) -> None:
        """Start a grid of at least shape[0] threads for each of shape[1] views; it gets the shape, and what is given as one tuple.

        Numba would look at the types of all that is given each time. A kernel of luxel is always given the same, so they are looked at once.
        """
        if 0 in shape:
            return
        block = 4 if self._simulated else _BLOCK  # it starts a thread of the system for each
        configured = self._door.configured(kernel, (-(-shape[0] // block), shape[1]), (block, 1))
        known = self._compiled.get(kernel)
        if known is not None:
            known.launch((*shape, given), configured.griddim, configured.blockdim, configured.stream, configured.sharedmem)
            return
        configured(*shape, given)
        if not self._simulated:
            (self._compiled[kernel],) = kernel.overloads.values()

    def wait(self) -> None:
        """Until all that was launched is done."""
        if not self._simulated:
            self._cuda.synchronize()

    def expect(self, size: int, what: str, instead: str = "a smaller picture, fewer samples or fewer triangles") -> None:
        """Raise a DeviceError if `size` bytes are not to be had; `instead` is what is expected then."""
        free = self.free_memory()
        if size > free:
            raise DeviceError(f"device cuda: {what} needs {_size(size)} of memory, {_size(free)} are free on {self.name}; "
                              f"expected {instead}")  # fmt: skip


def _fetch(array: Any, row: int) -> Array:
    return array[row].copy_to_host()


def _size(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e8 else f"{size / 1e6:.1f} MB"


def _text(name: Any) -> str:
    return name.decode() if isinstance(name, bytes) else str(name)


def _reason(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip() and not line.startswith("Error at driver init")]
    return lines[0] if lines else type(error).__name__


@cache
def gpu() -> Gpu:
    """The GPU.

    Raises:
        ExtraMissingError: The package numba-cuda is not installed.
        DeviceError: No driver, no GPU, or too old a one.
    """
    return Gpu()


def find(device: str, doing: str = "drawing", stacklevel: int = 3) -> Gpu | None:
    """What `device` names: None for the processor.

    Args:
        device: "cpu", "cuda", or "auto": a GPU if there is one, else the processor, with a warning that says why.
        doing: What the processor does then.

    Raises:
        InputError: It names none of these.
        ExtraMissingError, DeviceError: For "cuda", as `gpu`.
    """
    if device not in DEVICES:
        raise InputError(f"device: expected one of {', '.join(DEVICES)}; got {device!r}")
    if device == "cpu":
        return None
    try:
        return gpu()
    except (DeviceError, ExtraMissingError) as error:
        if device == "cuda":
            raise
        warnings.warn(f"device auto: {doing} on the processor: {error}", LuxelWarning, stacklevel=stacklevel)
        return None
