"""Warm: the first run's compilation on two cores.

Numba compiles one kernel at a time. So a child process compiles what finds the visible triangles, into the cache that both share, while
this one compiles what shades them, which takes longer, and comes to `cover_tile` last. Nothing depends on it: what the child did not bring is
compiled here.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from luxel import jit


def compile_visibility() -> None:
    """Compile cover, project and bin: draw one triangle."""
    from luxel.raster.bin import NO_CLIPPED, Bins, Parts, bin_triangles
    from luxel.raster.constants import sample_pattern
    from luxel.raster.cover import cover
    from luxel.raster.lanes import LANES
    from luxel.raster.project import View, Window, project

    window, pattern, tile = Window(0, 0, 8, 8, 8, 8), sample_pattern(1), 8
    ids, depths = np.empty((1, tile * tile + LANES), np.int32), np.empty((0, tile * tile + LANES), np.float32)
    nothing = Bins(np.zeros(2, np.int32), np.zeros(0, np.int32), 1, 1, tile)
    positions, triangles = np.array([[-1, -1, 0], [1, -1, 0], [0, 1, 0]], np.float32), np.array([[0, 1, 2]], np.int32)
    cover(nothing, triangles, np.zeros((3, 4), np.int32), NO_CLIPPED, pattern, 8, 8, 0, 1, ids, depths, 1)
    parts = Parts(np.array([0, 1], np.int32), np.zeros(1, np.int32), np.zeros(1, np.int32))
    screen, _ = project(positions, View(np.eye(4), 0.0), window, 1)
    bin_triangles(triangles, screen, NO_CLIPPED, parts, 0, pattern, window, tile, 1)


_asked = False


def start() -> subprocess.Popen[bytes] | None:
    """Start the child if there is something to compile, somewhere to keep it, and a core to spare; else None. Once in a process."""
    global _asked
    if _asked:
        return None
    _asked = True
    from luxel.raster.project import _project
    from luxel.raster.shade import _shade

    python = Path(sys.executable or "").stem.lower().startswith("python")  # not an application that embeds us
    if jit.compiled(_shade) or jit.compiled(_project) or not jit.cache_folder() or not python or (os.cpu_count() or 1) < 2:
        return None
    command = [sys.executable, "-c", "from luxel.raster.warm import compile_visibility as go; go()"]
    try:
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    except OSError:
        return None
