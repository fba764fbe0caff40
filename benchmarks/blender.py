"""Blender's Cycles as a peer: the same scene baked to the same lightmap, in a process of its own.

`bpy` is installed apart from luxel, as it wants a Python of its own version (bpy 5.0: 3.11), which LUXEL_BLENDER then names:

    python3.11 -m venv blender
    blender/bin/pip install bpy==5.0.1
    LUXEL_BLENDER=blender/bin/python python benchmarks/bake.py peers
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import luxel
from luxel.radiosity.bake import Baked
from pathtracer import Missing

_SCRIPT = Path(__file__).with_name("blender_bake.py")


class Cycles:
    """A Python with bpy: the one that LUXEL_BLENDER names, or this one."""

    def __init__(self) -> None:
        self.python = os.environ.get("LUXEL_BLENDER", sys.executable)
        try:
            found = subprocess.run([self.python, "-c", "import bpy; print(bpy.app.version_string)"], capture_output=True, text=True)
        except OSError as error:
            raise Missing(f"{self.python}: {error}") from None
        if found.returncode:
            raise Missing(f"bpy in {self.python}: {(found.stderr.strip().splitlines() or ['it does not start'])[-1]}")
        self.name = f"Cycles of Blender {found.stdout.split()[-1]}"

    def bake(self, baked: Baked, samples: list[int], threads: int) -> tuple[list[float], list[Any]]:
        """Seconds and irradiance (n, 3) of all luxels, for each number of samples; of a scene on one page, without textures, that its own
        surfaces light."""
        assert baked.atlas.pages == 1
        width, height = baked.atlas.size
        with tempfile.TemporaryDirectory() as folder:
            scene, out = Path(folder) / "scene.glb", Path(folder) / "light.npz"
            luxel.save(baked.atlas.scene, scene)
            words = [self.python, _SCRIPT, scene, out, width, height, threads, *samples]
            subprocess.run([str(word) for word in words], check=True, capture_output=True)
            with np.load(out) as result:
                seconds, light = list(map(float, result["seconds"])), result["light"]
        _, row, column = baked.luxels.texel.T
        return seconds, [math.pi * page[row, column] for page in light]
