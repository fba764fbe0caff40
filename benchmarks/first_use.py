"""First use: seconds from a cold cache to a picture, then warm; a small picture through the API; how soon the help answers.

    python benchmarks/first_use.py
    python benchmarks/first_use.py --write      # and put the table into RESULTS.md
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import luxel
from luxel.scene.builtin import torus
from report import machine, median, meshes, milliseconds, table, write_section

_SMALL = """
import json, time
import luxel
from luxel.scene.builtin import bumpy_sphere_scene
prepared = luxel.prepare(bumpy_sphere_scene(16))
times = []
for _ in range(200):
    start = time.perf_counter()
    luxel.render(prepared, size=(64, 64))
    times.append(time.perf_counter() - start)
print(json.dumps(times[20:]))
"""


def model(folder: Path) -> Path:
    """The teapot where there is one, else a torus made by code."""
    teapot = (meshes() or folder) / "teapot.obj"
    if teapot.exists():
        return teapot
    luxel.save(torus(), folder / "torus.obj")
    return folder / "torus.obj"


def command(words: list[str], cache: Path) -> tuple[float, str]:
    """Seconds that a whole `luxel` process takes, and what it says on stderr."""
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"XDG_CACHE_HOME": str(cache)}
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-m", "luxel", *words], env=environment, check=True, capture_output=True, text=True)
    return time.perf_counter() - start, done.stderr


def small(cache: Path) -> float:
    """Seconds of one 64x64 picture of 1,024 triangles in a process that has drawn some."""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
    done = subprocess.run([sys.executable, "-c", _SMALL], env=environment, check=True, capture_output=True, text=True)
    return median(json.loads(done.stdout))


def measure(repeats: int) -> str:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cache, picture, file = folder / "cache", str(folder / "out.png"), model(folder)
        render = ["render", str(file), "-o", picture]
        cold, said = command(render, cache)
        warm = median([command(render, cache)[0] for _ in range(repeats)])
        demo_cold = command(["demo", "-o", picture], folder / "cache2")[0]
        demo_warm = median([command(["demo", "-o", picture], cache)[0] for _ in range(repeats + 1)][1:])
        helped = median([command(["--help"], cache)[0] for _ in range(repeats + 1)][1:])
        note = said.strip() or "nothing"
        rows = [
            [f"`luxel render {file.name}`, cold cache", f"{cold:.1f} s"],
            [f"`luxel render {file.name}`, warm, whole process", f"{warm:.2f} s"],
            ["`luxel demo`, cold cache", f"{demo_cold:.1f} s"],
            ["`luxel demo`, warm, whole process", f"{demo_warm:.2f} s"],
            ["`luxel --help`", f"{helped:.2f} s"],
            ["64x64 picture through the API", f"{milliseconds(small(cache))} ms"],
        ]
        kept = sum(path.stat().st_size for path in cache.rglob("*") if path.is_file())
    return f"""{machine()}. Medians of {repeats}; 1280x720, MSAA 4 but for the last.

{table(["what", "time"], rows)}

In the cold run it says: "{note}". The kernels' cache then holds {kept / 1e6:.1f} MB.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--write", action="store_true", help="put the table into RESULTS.md")
    options = parser.parse_args()
    text = measure(options.repeats)
    print(text)
    if options.write:
        write_section("First use", text)


if __name__ == "__main__":
    main()
