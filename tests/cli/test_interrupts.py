"""Interrupts at the very places where what they raise would break the compiler, or be dropped."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt" or bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="POSIX signals while kernels compile")

KERNEL = """
import os, signal, sys
import numpy as np
from llvmlite.binding import ffi
from luxel import interrupts, jit

@jit.device
def inner(x):
    return x / 2

@jit.kernel
def outer(values):
    kept = np.empty_like(values)
    for i in range(len(values)):
        kept[i] = inner(values[i])
    return kept

name, number = sys.argv[1], signal.Signals[sys.argv[2]]

def call(self, *arguments):
    with self._lock:
        answer = self._cfn(*arguments)
        if self._cfn.__name__ == name:
            os.kill(os.getpid(), number)
        return answer

interrupts.stop_on_signals()
ffi._lib_fn_wrapper.__call__ = call
said = "nothing raised"
try:
    outer(np.arange(4.0))
except KeyboardInterrupt:
    said = "interrupted"
except Exception as error:
    said = repr(error)
print(said, len(outer.signatures), flush=True)  # what has been raised is gone here, and with it all that it held
os._exit(interrupts.exit_code())
"""


def interrupted(tmp_path, function, number=signal.SIGINT):
    """A process that compiles a kernel, or loads it if it did so before, and has a signal as soon as a function of LLVM has ended."""
    script = tmp_path / "script.py"
    if not script.exists():
        script.write_text(KERNEL)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run([sys.executable, script, function, number.name], capture_output=True, text=True, env=environment)


@pytest.mark.parametrize("function", ["LLVMPY_LinkModules", "LLVMPY_AddModule", "LLVMPY_DisposeString", "LLVMPY_DisposePassBuilder"])
def test_an_interrupted_compilation_ends_before_its_next_pass(tmp_path, function):
    done = interrupted(tmp_path, function)
    assert (done.returncode, done.stdout, done.stderr) == (130, "interrupted 0\n", "")


def test_sigterm_ends_a_compilation_too(tmp_path):
    done = interrupted(tmp_path, "LLVMPY_LinkModules", signal.SIGTERM)
    assert (done.returncode, done.stdout, done.stderr) == (143, "interrupted 0\n", "")


def test_an_interrupt_while_a_kernel_is_loaded_waits_for_it(tmp_path):
    first = interrupted(tmp_path, "none")
    assert (first.stdout, first.stderr) == ("nothing raised 1\n", "")
    done = interrupted(tmp_path, "LLVMPY_CreateByteString")
    assert (done.returncode, done.stdout, done.stderr) == (130, "interrupted 1\n", "")
