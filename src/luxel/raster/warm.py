"""Warm: the first run's compilation on two cores.

Numba compiles one kernel at a time. So a child process compiles what finds the visible triangles, into the cache that both share, while
this one compiles what shades them, which takes twice as long. Nothing depends on it: what the child did not bring is compiled here.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from luxel import jit


def compile_visibility() -> None:
    """Compile project, bin and cover: draw one triangle."""
    from luxel.raster.bin import NO_CLIPPED, Parts, bin_triangles
    from luxel.raster.constants import sample_pattern
    from luxel.raster.cover import cover
    from luxel.raster.lanes import LANES
    from luxel.raster.project import View, Window, project

    window, pattern, tile = Window(0, 0, 8, 8, 8, 8), sample_pattern(1), 8
    positions, triangles = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], np.float32), np.array([[0, 1, 2]], np.int32)
    parts = Parts(np.array([0, 1], np.int32), np.zeros(1, np.int32), np.zeros(1, np.int32))
    screen, _ = project(positions, View(np.eye(4), 0.0), window, 1)
    bins = bin_triangles(triangles, screen, NO_CLIPPED, parts, 0, pattern, window, tile, 1)
    ids, depths = np.empty((1, tile * tile + LANES), np.int32), np.empty((0, tile * tile + LANES), np.float32)
    cover(bins, triangles, screen, NO_CLIPPED, pattern, 8, 8, 0, 1, ids, depths, 1)


def start() -> subprocess.Popen[bytes] | None:
    """Start the child if there is something to compile, somewhere to keep it, and a core to spare; else None."""
    from luxel.raster.cover import _cover
    from luxel.raster.shade import _shade

    python = Path(sys.executable or "").stem.lower().startswith("python")  # not an application that embeds us
    if jit.compiled(_cover) or jit.compiled(_shade) or not jit.cache_folder() or not python or (os.cpu_count() or 1) < 2:
        return None
    command = [sys.executable, "-c", "from luxel.raster.warm import compile_visibility as go; go()"]
    try:
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    except OSError:
        return None
