"""The rasteriser's source once more, for another machine: the same files, run with other decorators and with batches of one fragment.

`luxel.raster` is written for cores: its device functions work on planar batches (see `luxel.raster.channels`), and its decorators compile them
for the processor. A thread of a GPU draws one fragment at a time, and a batch of one is a handful of registers. So nothing is written twice: the
modules are executed again with `luxel.jit` and `luxel.raster.batch` replaced, into modules of their own that only the GPU's kernels see. What is
mended or added there is mended or added here.
"""

from __future__ import annotations

import builtins
import importlib
import importlib.util
import sys
import types
from collections.abc import Callable, Mapping
from typing import Any

_AGAIN = ("luxel.raster.", "luxel.radiosity.", "luxel.cuda.threads")
_PLAIN = ("luxel.raster.lanes", "luxel.raster.joint", "luxel.raster.rows")  # in vector instructions, and undecorated for a Numba that is switched off
_SINGLE = {
    "luxel.raster.batch": types.SimpleNamespace(FRAGMENTS=1, PITCH=1),
    "luxel.radiosity.batch": types.SimpleNamespace(RAYS=1, ELEMENTS=1),
}


class Again:
    """Modules of `luxel.raster`, `luxel.radiosity` and `luxel.cuda.threads`, executed again.

    Args:
        machine: Its name, which the modules' names end with.
        stands_for: What is imported in place of these modules, by name: at least `luxel.jit`.
        decorate: Applied to the functions of modules that are undecorated where Numba is switched off.
    """

    def __init__(self, machine: str, stands_for: Mapping[str, Any], decorate: Callable[..., Any]) -> None:
        self._machine = machine
        self._modules: dict[str, Any] = {**_SINGLE, **stands_for}
        self._decorate = decorate
        self._builtins = {**vars(builtins), "__import__": self._import}

    def load(self, name: str) -> Any:
        """The module `name`, executed again when it is first asked for."""
        if name not in self._modules:
            spec = importlib.util.find_spec(name)
            assert spec is not None
            assert spec.origin is not None
            module = types.ModuleType(f"{name} for {self._machine}")
            module.__dict__.update(__builtins__=self._builtins, __file__=spec.origin)
            self._modules[name] = sys.modules[module.__name__] = module  # Numba's caches find it by name
            with open(spec.origin, encoding="utf-8") as file:
                exec(compile(file.read(), spec.origin, "exec", dont_inherit=True), module.__dict__)
            for key, value in list(vars(module).items()):
                if name in _PLAIN and isinstance(value, types.FunctionType) and value.__module__ == module.__name__:
                    setattr(module, key, self._decorate(value))
        return self._modules[name]

    def _import(self, name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0) -> Any:
        found = self._found(name)
        if found is None:
            if name in ("luxel", "luxel.raster", "luxel.radiosity") and fromlist:  # from luxel import jit
                parts = {item: f"{name}.{item}" for item in fromlist}
                return types.SimpleNamespace(**{item: self._found(part) or importlib.import_module(part) for item, part in parts.items()})
            return importlib.__import__(name, globals, locals, fromlist, level)
        if not fromlist:
            raise ImportError(f"import {name}: write `from {name} import ...`, which can be executed again")
        return found

    def _found(self, name: str) -> Any:
        return self.load(name) if name in self._modules or name.startswith(_AGAIN) else None
