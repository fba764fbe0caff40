"""The only Numba policy: how kernels are compiled, cached and run on threads. Nothing else imports Numba (a lint rule keeps it so).

Kernels are compiled lazily, release the GIL, divide like NumPy (no exceptions inside) and never use fast-math: the same bits on every
machine matter more than the last percent. They are cached on disk for the user, keyed by Numba's version and by the text of the kernel's
own file and of every luxel file it imports, so an edit anywhere below a kernel compiles it anew.

Threads are Python threads that call the same kernel on one work queue (`run`, `take`), not Numba's parallel loops. Why: see
docs/decisions/0002-threads.md.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils, event
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import intrinsic

from luxel import interrupts
from luxel.errors import InputError
from luxel.helpers import call_together

__all__ = [
    "DISABLED", "array_data", "available_threads", "borrow", "cache_folder", "cgutils", "checked_threads", "compiled", "count_bits", "device",
    "digest", "floor", "floor32", "inlined", "intrinsic", "ir", "kernel", "lowest_bit", "on_compile", "parallel_kernel", "part", "prefetch", "run",
    "take", "types",
]  # fmt: skip

def _skip_blas_probe() -> None:
    """Import numba.np.arraymath without its probe for BLAS, which imports scipy.linalg (0.15 s) only to see whether SciPy is there: it is."""
    if "numba.np.arraymath" in sys.modules:
        return
    try:
        from numba.np import linalg

        probe = linalg.ensure_blas
        linalg.ensure_blas = lambda: None
        try:
            importlib.import_module("numba.np.arraymath")
        finally:
            linalg.ensure_blas = probe
    except (ImportError, AttributeError):  # another Numba: it takes its time
        pass


_skip_blas_probe()

_IMPORT = re.compile(r"^\s*(?:from\s+(luxel[\w.]*)\s+import\s+([\w, ]+|\([^)]*\))|import\s+(luxel[\w.]*))", re.MULTILINE)


@cache
def _source(module: str) -> Path | None:
    """Its file; luxel's own are found without importing what they lie in, which may be half imported now."""
    top, *parts = module.split(".")
    if top == "luxel":
        place = Path(__file__).parent.joinpath(*parts)
        return next((path for path in (Path(f"{place}.py"), place / "__init__.py") if path.is_file()), None)
    try:
        spec = importlib.util.find_spec(module)
    except (ModuleNotFoundError, ValueError):  # ValueError: __main__
        return None
    return Path(spec.origin) if spec and spec.origin else None


@cache
def _imports(module: str) -> tuple[str, ...]:
    path = _source(module)
    if path is None:
        return ()
    found = set()
    for origin, names, plain in _IMPORT.findall(path.read_text(encoding="utf-8")):
        found.add(plain or origin)
        found |= {f"{origin}.{name.strip().split(' as ')[0]}" for name in names.strip("()").split(",") if name.strip()}
    return tuple(sorted(name for name in found if _source(name)))


@cache
def digest(module: str) -> str:
    """Hash of the text of `module` and of all luxel modules that it imports, directly or not."""
    seen: set[str] = set()
    todo = [module]
    while todo:
        name = todo.pop()
        if name not in seen and (name == module or name.startswith("luxel.")):  # a test's or a user's kernel has a name of its own
            seen.add(name)
            todo += _imports(name)
    hashed = hashlib.sha256()
    for name in sorted(seen):
        path = _source(name)
        if path is not None and path.exists():
            hashed.update(path.read_bytes())
    return hashed.hexdigest()[:16]


@cache
def cache_folder() -> str:
    """Where compiled kernels are kept: NUMBA_CACHE_DIR, else XDG_CACHE_HOME/luxel or ~/.cache/luxel; "" if none can be written."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    root = Path(chosen) if chosen else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "luxel"
    folder = root / f"numba-{numba.__version__}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe-{os.getpid()}-{threading.get_ident()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        print(f"luxel: compiled kernels cannot be kept in {folder} ({error}); every start compiles anew", file=sys.stderr)  # noqa: T201
        return ""
    return str(folder)


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    if numba.config.DISABLE_JIT:
        return function
    folder = cache_folder()
    before = numba.config.CACHE_DIR
    if folder:  # the locator reads the setting when the function is decorated: put it back for everybody else's kernels
        numba.config.CACHE_DIR = str(Path(folder) / digest(function.__module__))
    try:
        return numba.njit(cache=bool(folder), nogil=True, error_model="numpy", **options)(function)
    finally:
        numba.config.CACHE_DIR = before


_PART: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def device(function: Callable[..., Any]) -> Any:
    """A function called by kernels, on the CPU and (compiled anew) on the GPU.

    It may take, index and slice arrays but not make or return any: it is compiled without Numba's reference counting, which would cost
    some 10 ns for every array handed on.
    """
    return _compiled(function, _nrt=False)


def part(function: Callable[..., Any]) -> Any:
    """A device function that kernels call and Python does not: it needs no wrapper and no cache of its own, so it compiles sooner."""
    if numba.config.DISABLE_JIT:
        return function
    return numba.njit(**_PART)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """A device function pasted into its callers, for code that the compiler must see whole to vectorise. Not to be called from Python."""
    if numba.config.DISABLE_JIT:
        return function
    return numba.njit(**_PART, forceinline=True)(function)


def kernel(function: Callable[..., Any]) -> Any:
    """A function over arrays, run by one thread."""
    return _compiled(function)


def parallel_kernel(function: Callable[..., Any]) -> Any:
    """A kernel for `run`: its first argument is the queue from which it takes the numbers of its items.

    @parallel_kernel
    def double(queue, values):
        i = take(queue)
        while i < len(values):
            values[i] *= 2
            i = take(queue)
    """
    return _compiled(function)


floor = np.floor
"""Of a float64, a float64; a GPU has another."""

floor32 = np.floor
"""Of a float32, a float32; a GPU has another."""

DISABLED = bool(numba.config.DISABLE_JIT)
"""NUMBA_DISABLE_JIT is set: kernels run as plain Python, for debuggers and coverage."""


def array_data(context: Any, builder: Any, signature: Any, arguments: Any, which: int) -> Any:
    """In an intrinsic's code generator: pointer to the first element of the array that is argument `which`."""
    return context.make_array(signature.args[which])(context, builder, arguments[which]).data


if DISABLED:
    _lock = threading.Lock()

    def borrow(value: Any) -> Any:
        """The same array, or named tuple of arrays, uncounted."""
        return value

    def take(queue: Any) -> int:
        """The next number of the queue, from 0; each is given once."""
        with _lock:
            queue[0] += 1
            return int(queue[0]) - 1

    def float_bits(value: Any) -> Any:
        """The bits of a float32 as int32."""
        return np.float32(value).view(np.int32)

    def bits_float(bits: Any) -> Any:
        """The float32 that has these bits, given as int32."""
        return np.int32(bits).view(np.float32)

    def lowest_bit(bits: Any) -> int:
        """The place of the lowest bit set of a uint64 that is not 0."""
        return (int(bits) & -int(bits)).bit_length() - 1

    def count_bits(bits: Any) -> int:
        """How many bits of a uint64 are set."""
        return int(bits).bit_count()

    def prefetch(array: Any, index: Any) -> None:
        """Nothing, without a compiler."""

else:

    def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value)
            array.meminfo = cgutils.get_null_value(array.meminfo.type)
            array.parent = cgutils.get_null_value(array.parent.type)
            return array._getvalue()
        if isinstance(kind, types.BaseTuple):
            fields = [_without_owner(context, builder, k, builder.extract_value(value, i)) for i, k in enumerate(list(kind))]
            return context.make_tuple(builder, kind, fields)
        return value

    @intrinsic
    def borrow(typingctx: Any, value: Any) -> Any:
        """The same array, or named tuple of arrays, uncounted: it can be handed on at no cost, and must not outlive its owner.

        A kernel borrows its arguments and its own scratch before its loops, because counting references costs some 10 ns an array and call.
        """

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return _without_owner(context, builder, signature.args[0], arguments[0])

        return value(value), codegen

    @intrinsic
    def _fetch_add(typingctx: Any, queue: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            one = context.get_constant(types.int64, 1)
            return builder.atomic_rmw("add", array_data(context, builder, signature, arguments, 0), one, "monotonic")

        return types.int64(queue), codegen

    @numba.njit(inline="always")
    def take(queue: Any) -> int:
        """The next number of the queue, from 0; each is given once."""
        return _fetch_add(queue)

    @intrinsic
    def float_bits(typingctx: Any, value: Any) -> Any:
        """The bits of a float32 as int32."""

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(types.int32))

        return types.int32(types.float32), codegen

    @intrinsic
    def bits_float(typingctx: Any, bits: Any) -> Any:
        """The float32 that has these bits, given as int32."""

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.bitcast(arguments[0], context.get_value_type(types.float32))

        return types.float32(types.int32), codegen

    @intrinsic
    def lowest_bit(typingctx: Any, bits: Any) -> Any:
        """The place of the lowest bit set of a uint64 that is not 0."""

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

        return types.int64(types.uint64), codegen

    @intrinsic
    def count_bits(typingctx: Any, bits: Any) -> Any:
        """How many bits of a uint64 are set."""

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return builder.ctpop(arguments[0])

        return types.int64(types.uint64), codegen

    @intrinsic
    def prefetch(typingctx: Any, array: Any, index: Any) -> Any:
        """Ask for the cache line of element `index` (uint64) of an array of one axis, which will soon be read. It may be one past the end."""

        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
            place = builder.bitcast(builder.gep(array_data(context, builder, signature, arguments, 0), [arguments[1]]), byte)
            kind = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
            function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
            builder.call(function, [place, *(ir.Constant(word, k) for k in (0, 3, 1))])  # to read, into all caches, of data
            return context.get_dummy_value()

        return types.void(array, types.uint64), codegen


def available_threads() -> int:
    """Cores this process may use: LUXEL_THREADS, else its CPU affinity."""
    wanted = os.environ.get("LUXEL_THREADS")
    if wanted:
        return checked_threads(wanted)
    return len(own_cores())


def own_cores() -> set[int]:
    """The numbers of the cores on which this process may run."""
    return set(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else set(range(os.cpu_count() or 1))


def checked_threads(threads: object) -> int:
    """`threads` as a number >= 1; None means `available_threads()`."""
    if threads is None:
        return available_threads()
    try:
        number = int(threads)  # type: ignore[call-overload]
        whole = isinstance(threads, str) or number == threads
    except (TypeError, ValueError, OverflowError):
        number, whole = 0, False
    if number < 1 or not whole or isinstance(threads, bool):
        raise InputError(f"threads: expected a whole number of at least 1, got {threads!r}")
    return number


def run(kernel: Callable[..., Any], threads: int, *arguments: Any) -> None:
    """Call a `parallel_kernel` from `threads` threads at once (this one included) on one queue, and wait for all of them."""
    call_together(kernel, threads, np.zeros(1, np.int64), *arguments)


def compiled(kernel: Any) -> bool:
    """Whether a kernel need not be compiled: it has been, or it is kept in the cache (for these or other argument types)."""
    if DISABLED or kernel.signatures:
        return True
    cache = getattr(kernel, "_cache", None)
    folder = getattr(cache, "cache_path", "")
    return bool(folder) and any(Path(folder).glob(f"*.{kernel.py_func.__name__}-*.nbi"))


class _Listener(event.Listener):
    def __init__(self, told: Callable[[str], None]) -> None:
        self.told = told

    def on_start(self, event: Any) -> None:
        self.told(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: Any) -> None:
        pass


class _SafePoints(event.Listener):
    """Where a thread that compiles or loads a kernel may be interrupted: before each pass of the compiler, and after all.

    Not in between. LLVM's objects would be freed twice, by Python and by the object that just took them over. And what is raised where LLVM asks
    Python for code from the cache is dropped, so that LLVM goes on without that code, and kernels call what is not there.
    """

    def on_start(self, event: Any) -> None:
        if event.kind == "numba:run_pass":
            interrupts.raise_deferred()

    def on_end(self, event: Any) -> None:
        if not global_compiler_lock.is_locked():  # by this thread
            interrupts.raise_deferred()


def _compile_uninterrupted() -> None:
    """Without counting: the lock knows best whether this thread has it, whatever has been raised."""
    interrupts.defer(global_compiler_lock.is_locked)
    points = _SafePoints()
    event.register("numba:run_pass", points)
    event.register("numba:compiler_lock", points)


_compile_uninterrupted()


@contextmanager
def on_compile(told: Callable[[str], None]) -> Iterator[None]:
    """While in the block, `told` is called with a kernel's name when its compilation starts (not when it is loaded from the cache)."""
    with event.install_listener("numba:compile", _Listener(told)):
        yield
