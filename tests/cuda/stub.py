"""A GPU without a driver: Numba's own arrays and kernels, typed, compiled and given their arguments as for a card, and then not launched."""

import re
from importlib import import_module
from types import SimpleNamespace

import needs_numba_cuda  # noqa: F401 - before what it may skip
import numpy as np

from luxel import jit
from luxel.cuda import door
from luxel.cuda.device import Gpu
from luxel.cuda.threads.settle import PARTS, SUMS

typeof = import_module("numba.cuda.typing.typeof").typeof
BYTES = {"u8": 1, "b8": 1, "u32": 4, "b32": 4, "f32": 4, "u64": 8, "b64": 8, "f64": 8}


class _Memory:
    __cuda_memory__ = True
    device_ctypes_pointer = SimpleNamespace(value=4096)
    handle = SimpleNamespace(value=4096)

    def view(self, *_):
        return self

    def __int__(self):
        return 4096


CARDS = [(7, 5), (9, 0)]


def install(patch, *modules):
    """Let Numba believe in a card of compute capability 9.0. Returns what is launched: kernels of Numba by name of luxel's.

    The kernels of `modules` are compiled for `CARDS`, and kept on disk beside those for real cards until their source changes.
    """
    dispatcher, codegen, devices = (import_module(f"numba.cuda.{name}") for name in ("dispatcher", "codegen", "cudadrv.devices"))
    launched = Stub.launched = {}
    context = SimpleNamespace(device=SimpleNamespace(compute_capability=(9, 0), id=0))
    patch.setattr(devices, "get_context", lambda *_: context)
    patch.setattr(dispatcher, "get_current_device", lambda: context.device)
    patch.setattr(codegen.CUDACodeLibrary, "_ensure_cc", lambda self, card: card or (9, 0))
    patch.setattr(dispatcher._Kernel, "bind", lambda self: [self._codelibrary.get_asm_strs(card) for card in CARDS])
    keep_on_disk(patch, dispatcher, modules)

    def launch(self, arguments, *_):
        assert tuple(map(typeof, arguments)) == self.argument_types  # whatever their shapes are
        check_arguments(self, arguments)

    patch.setattr(dispatcher._Kernel, "launch", launch)
    return launched


def keep_on_disk(patch, dispatcher, modules):
    """Give kernels caches of their own: what is compiled here has no machine code, and must not be found on a real card."""
    config, folder = door._numba("config"), jit.cache_folder()
    for module in modules:
        for kernel in [item for item in vars(module).values() if hasattr(item, "py_func")] if folder else []:
            with patch.context() as changed:
                changed.setattr(config, "CACHE_DIR", f"{folder}/stub-{door.VERSION}-{jit.digest(module.__name__)}")
                kept = dispatcher.CUDACache(kernel.py_func)
            patch.setattr(kernel, "_cache", kept)


def parameters(text):
    """Kinds of the parameters of a kernel's PTX."""
    head = text[text.index(".entry") :]
    return re.findall(r"\.param \.(\w+)", head[: head.index("{")])


def check_arguments(kernel, arguments):
    """What Numba makes of the arguments is what the kernel's machine code expects, and no array is copied there and back."""
    given, copied = [], []
    for kind, value in zip(kernel.argument_types, arguments, strict=True):
        kernel._prepare_args(kind, value, 0, copied, given)
    assert not copied
    wanted = parameters(kernel.library.get_asm_strs((9, 0))[0])
    assert len(given) == len(wanted)
    for value, kind in zip(given, wanted, strict=True):
        size = 1 if isinstance(value, bool) else 8 if isinstance(value, int) else len(bytes(value)) if hasattr(value, "_type_") else None
        assert size in (None, BYTES[kind])


def array(shape, dtype, strides=None):
    from_shape = import_module("numba.cuda.api").prepare_shape_strides_dtype
    strides = from_shape(shape, None, np.dtype(dtype), "C")[1] if strides is None else strides
    return import_module("numba.cuda.cudadrv.devicearray").DeviceNDArray(tuple(shape), strides, np.dtype(dtype), gpu_data=_Memory())


class Stub(Gpu):
    """`luxel.cuda.device.Gpu` on such a card. What it fetches makes every stage follow: one of each count, and one layer of blended triangles."""

    def __init__(self):
        self._door, self._cuda, self._simulated, self._number = door, door.cuda, False, 0
        self.name, self.capability, self.layers, self._compiled = "stub", (9, 0), 1, {}
        self.steps = 0

    def free_memory(self):
        return 1 << 40

    def launch(self, kernel, shape, *given):
        super().launch(kernel, shape, *given)
        if 0 not in shape:
            self.launched[kernel.py_func.__name__] = self._compiled[kernel]

    def _allocated(self, shape, dtype, order):
        made = import_module("numba.cuda.api").prepare_shape_strides_dtype(shape, None, np.dtype(dtype), order)
        return array(shape, dtype, made[1])

    def send(self, host, array):
        assert (host.shape, host.dtype) == (array.shape, array.dtype)

    def wait(self):
        pass

    def host(self, array):
        if array.dtype == np.int64:
            return np.ones(array.shape, np.int64)
        if array.shape == (SUMS, PARTS):  # of light on its way: after lights have shot there is some, and then none
            self.steps += 1
            return np.ones(array.shape) if self.steps == 1 else np.zeros(array.shape)
        if array.dtype == np.float64:  # groups of elements never settle, and light does at once
            first = np.zeros(array.shape)
            first[min(3 - array.ndim, len(first) - 1)] = 1
            return first
        if array.shape == (1,):
            self.layers -= 1
            return np.array([self.layers >= 0])
        return np.zeros(array.shape, array.dtype)
