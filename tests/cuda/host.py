"""A stand-in for the GPU: the same threads, compiled for the processor and run one after the other. What it leaves out are the grids themselves
(`luxel.cuda.kernels`), which the simulator runs, and the compiler for the GPU."""

import weakref

import loops
import needs_numba_cuda  # noqa: F401 - before what it may skip
import numpy as np

from luxel.errors import DeviceError


class Host:
    """The methods of `luxel.cuda.device.Gpu`."""

    name, kernels = "host", loops

    def __init__(self, memory=1 << 32):
        self.memory, self.held, self.peak = memory, 0, 0  # bytes, and the most that arrays have had at a time

    def free_memory(self):
        return self.memory

    def expect(self, size, what, instead=""):
        if size > self.memory:
            raise DeviceError(f"{what} needs {size}")

    def _counted(self, array):
        def gone(size=array.nbytes):
            self.held -= size

        self.held += array.nbytes
        self.peak = max(self.peak, self.held)
        weakref.finalize(array, gone)
        return array

    def array(self, host):
        there = self.empty(host.shape, host.dtype)
        there[...] = host
        return there

    def copied(self, arrays):
        if isinstance(arrays, np.ndarray):
            return self.array(arrays)
        return type(arrays)(*map(self.copied, arrays)) if isinstance(arrays, tuple) else arrays

    def empty(self, shape, dtype):
        array = self._counted(np.empty(shape, dtype))
        array.reshape(-1).view(np.uint8)[:] = 0xAB  # what is read before it is written shows
        return array

    def columns(self, shape, dtype):
        return self.empty(shape[::-1], dtype).T

    def send(self, host, array):
        array[...] = host

    def host(self, array):
        return array.copy(order="K")

    def view(self, array, dtype):
        return array.view(dtype)

    def shared(self, array):
        return array

    def wait(self):
        pass

    def launch(self, kernel, shape, *given):
        if 0 not in shape:
            kernel(*shape, given)
