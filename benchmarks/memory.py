"""Peak memory of whole processes: one that loads a bumpy sphere from a binary PLY file and draws it, one that writes a huge PNG."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import luxel
from luxel.scene.builtin import bumpy_sphere, room

_PEAK = """
import json, pathlib, re, resource, sys
import luxel

def peak():
    status = pathlib.Path("/proc/self/status")  # getrusage's figure begins with that of the process which started this one
    if status.exists():
        return 1024 * int(re.search(r"VmHWM:\\s*(\\d+)", status.read_text())[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
"""

_LOAD_AND_DRAW = """
luxel.render(luxel.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), size=(64, 64))  # the compiled kernels
before = peak()
scene = luxel.load(sys.argv[1])
loaded = peak()
luxel.render(scene, size=(int(sys.argv[2]), int(sys.argv[3])), samples=int(sys.argv[4]))
print(json.dumps([scene.triangle_count, before, loaded, peak()]))
"""

_HUGE_PNG = """
from luxel.cli import main

assert main(["render", sys.argv[1], "-o", sys.argv[2], "--size", sys.argv[3], "--samples", "4", "-q"]) == 0
print(json.dumps(peak()))
"""


def run(code: str, *words: object) -> Any:
    """What a process of its own that runs `code` prints as JSON; `peak()` there gives its largest resident size in bytes."""
    done = subprocess.run([sys.executable, "-c", _PEAK + code, *map(str, words)], check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout)


def peaks(n: int, size: tuple[int, int], samples: int = 1) -> tuple[int, int, int, int]:
    """Triangles, and the largest resident size in bytes before loading, after loading, and after drawing."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sphere.ply"
        luxel.save(bumpy_sphere(n), path)
        triangles, before, loaded, drawn = run(_LOAD_AND_DRAW, path, *size, samples)
    return triangles, before, loaded, drawn


def huge_png(side: int) -> int:
    """Largest resident size in bytes of `luxel render` that draws the demo's room, `side` pixels square with MSAA 4, as PNG."""
    with tempfile.TemporaryDirectory() as folder:
        luxel.save(room(), Path(folder) / "room.glb")
        return int(run(_HUGE_PNG, Path(folder) / "room.glb", Path(folder) / "huge.png", side))


def sentence(n: int, size: tuple[int, int]) -> str:
    peaks(8, (64, 64))  # compiles, which takes memory too
    plain, multisampled = peaks(n, size), peaks(n, size, 4)
    triangles, before, loaded, drawn = plain
    return (
        f"a process that loads {triangles / 1e6:.1f} M triangles from a binary PLY file and draws them at {size[0]}x{size[1]} peaks at "
        f"{drawn / 1e6:.0f} MB ({before / 1e6:.0f} MB before loading, {loaded / 1e6:.0f} MB after it), with MSAA 4 at {multisampled[3] / 1e6:.0f} MB."
    )
