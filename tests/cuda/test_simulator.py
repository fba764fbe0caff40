"""The grids: indices, bounds, the memory of threads and what they share, in Numba's simulator."""

import os
import subprocess
import sys
from pathlib import Path

import needs_numba_cuda  # noqa: F401 - skips without numba-cuda
import pytest

PICTURES = ("opaque", "masked_and_blended", "pieces", "lit_at_vertices", "by_render", "relit", "baked", "form_factors")


@pytest.mark.parametrize("picture", PICTURES)
def test_pictures_in_the_simulator(picture):
    """Its threads are the system's, and do not inherit that NumPy is to be quiet: a division by zero is no error on a GPU."""
    script = Path(__file__).with_name("simulated.py")
    quiet = ["-W", "ignore::RuntimeWarning"]
    done = subprocess.run([sys.executable, *quiet, script, picture], env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout == "same\n"
