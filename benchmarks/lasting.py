"""Ten thousand renders in one process: what the process holds as they go by.

    python benchmarks/lasting.py [renders]

Scenes, sizes, samples, filters, outputs and cameras change from one to the next; every 16th picture is large enough for arrays that are used
again. Prints resident memory every tenth of the way, how much of it waits to be used again, and the growth after the first tenth, which brings
everything to its full size.
"""

import gc
import sys
import time

import numpy as np
import psutil

import luxel
from luxel import memory
from luxel.scene.builtin import shapes


def scenes():
    for seed in range(4):
        rng, scene = np.random.default_rng(seed), luxel.Scene(lights=[luxel.Light()])
        materials = [luxel.Material(), luxel.Material((1, 0, 0, 0.5), alpha_mode="BLEND"), luxel.Material(shading="pbr", metallic=1.0)]
        for k in range(8):
            place = np.eye(4)
            place[:3, 3] = rng.uniform(-1, 1, 3)
            scene.add(shapes.sphere(0.4, 24 + 8 * k), materials[(k + seed) % 3], place)
        yield luxel.prepare(scene)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
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


if __name__ == "__main__":
    main()
