"""Ten thousand renders in one process: what the process holds as they go by.

    python benchmarks/lasting.py [renders] [--write]

Scenes, sizes, samples, filters, outputs and cameras change from one to the next; every 16th picture is large enough for arrays that are used
again. Prints resident memory every tenth of the way, how much of it waits to be used again, and the growth after the first tenth, which brings
everything to its full size.
"""

import argparse
import gc
import time

import numpy as np
import psutil

import luxel
import memory as peak
from luxel import memory
from luxel.scene.builtin import shapes
from report import machine, write_section


def scenes():
    for seed in range(4):
        rng, scene = np.random.default_rng(seed), luxel.Scene(lights=[luxel.Light()])
        materials = [luxel.Material(), luxel.Material((1, 0, 0, 0.5), alpha_mode="BLEND"), luxel.Material(shading="pbr", metallic=1.0)]
        for k in range(8):
            place = np.eye(4)
            place[:3, 3] = rng.uniform(-1, 1, 3)
            scene.add(shapes.sphere(0.4, 24 + 8 * k), materials[(k + seed) % 3], place)
        yield luxel.prepare(scene)


def renders(count: int) -> list[float]:
    """Resident MiB after every tenth of `count` renders."""
    prepared, process = list(scenes()), psutil.Process()
    held, started, digest = [], time.perf_counter(), 0
    for k in range(count):
        camera = luxel.Camera.look_at([4 * np.cos(k), 1, 4 * np.sin(k)], [0, 0, 0])
        scale = 5 + k % 3 if k % 16 == 0 else 1
        size = scale * (48 + k % 7 * 16), scale * (36 + k % 5 * 16)
        picture = luxel.render(
            prepared[k % 4], camera, size, samples=(1, 4)[k % 2], filter=("box", "tent")[k % 5 == 0],
            outputs=(("color",), ("color", "depth", "triangle"), ("linear", "normal"))[k % 3],
        )  # fmt: skip
        digest ^= hash(np.asarray(picture).tobytes())
        if (k + 1) % max(1, count // 10) == 0:
            gc.collect()
            held.append(process.memory_info().rss / 2**20)
            idle = sum(map(len, memory._idle)) / 2**20
            print(f"{k + 1:6d} renders  {held[-1]:7.1f} MiB, {idle:.1f} idle  {time.perf_counter() - started:6.1f} s", flush=True)
    print(f"growth after the first tenth: {held[-1] - held[0]:+.1f} MiB over {count - count // 10} renders")
    return held


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("renders", type=int, nargs="?", default=10_000)
    parser.add_argument("--write", action="store_true", help="put the figures, and the peaks of memory, into RESULTS.md")
    options = parser.parse_args()
    held = renders(options.renders)
    if options.write:
        triangles, before, loaded, _ = peak.peaks(1582, (64, 64))
        arrays = 12 * triangles + 4 * (3 + 3 + 2) * triangles // 2  # half as many vertices, with normals and texture coordinates
        text = (
            f"{machine()}\n\n`python benchmarks/lasting.py --write`. {options.renders:,} renders in one process, every 16th of them large: MiB "
            f"held after every tenth of them {', '.join(f'{mib:.0f}' for mib in held)}; up to 256 of it wait to be used again (`luxel.memory`).\n\n"
            f"`luxel render --size 16384 --samples 4` of the demo's room, to PNG, peaks at {peak.huge_png(16384) / 1e6:.0f} MB.\n\n"
            f"A process that loads {triangles / 1e6:.1f} M triangles from a binary PLY file (arrays of {arrays / 1e6:.0f} MB) peaks at "
            f"{loaded / 1e6:.0f} MB ({before / 1e6:.0f} MB before loading)."
        )
        write_section("Lasting", text)


if __name__ == "__main__":
    main()
