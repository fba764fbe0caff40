"""luxel on a GPU: beside the memory traffic that no version can do without, luxel on the machine's processor, and nvdiffrast's CUDA rasteriser.
Radiosity is in `gpu_bake`.

    python benchmarks/gpu.py                           # all parts
    python benchmarks/gpu.py frames --largest 1000000  # some
    python benchmarks/gpu.py --write                   # and keep the tables in RESULTS-gpu.md

Frames are 1920x1080, the picture left on the device. nvdiffrast is measured where it is installed; it finds ids, depth and barycentric
coordinates (no colour, no clipping by a guard band), so it is held against luxel's ids and depth.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import luxel
from luxel.cuda.device import gpu
from luxel.cuda.frame import draw_views
from luxel.cuda.resident import Resident
from luxel.errors import LuxelError
from luxel.raster.render import Options, Prepared, prepare, render
from luxel.scene.builtin.bumpy import bumpy_sphere_scene
from luxel.scene.framing import camera_for, turntable
from report import machine, median, meshes, milliseconds, table, write_section

SIZE = (1920, 1080)
SPHERES = (10_000, 100_000, 1_000_000, 10_000_000, 100_000_000)
FAILED: list[str] = []
PARTS = ("suite", "ceilings", "frames", "stages", "samples", "split", "views", "rooms", "growth", "relight", "factors", "first", "leak")
RESULTS = Path(__file__).with_name("RESULTS-gpu.md")
COLOR, IDS = Options(outputs=("color",)), Options(outputs=("triangle", "depth"))


def seconds(job: Callable[[], Any], repeats: int = 15) -> float:
    """Median of one run, the GPU's work included; three runs before do not count."""
    taken = []
    for i in range(repeats + 3):
        start = time.perf_counter()
        job()
        gpu().wait()
        if i >= 3:
            taken.append(time.perf_counter() - start)
    return median(taken)


def drawing(resident: Resident, cameras: list[Any], size: tuple[int, int], options: Options, keep: bool = True) -> Callable[[], Any]:
    """What draws these views."""
    return partial(draw_views, resident, cameras, size, options, [None] * len(cameras), keep)


def copy_rate() -> float:
    """Bytes a second that the GPU's memory moves, read and written counted, copying a large array."""
    source = gpu().empty((1 << 28,), np.uint32)
    target = gpu().empty((1 << 28,), np.uint32)
    return 2 * source.nbytes / seconds(lambda: target.copy_to_device(source))


def floor(prepared: Prepared, size: tuple[int, int], samples: int, rate: float) -> float:
    """Seconds that moving what must be moved once takes: indices, positions, projected vertices there and back, keys cleared, written and read,
    vertex normals, pixels."""
    geometry, pixels = prepared.geometry, size[0] * size[1]
    return (geometry.triangles.nbytes + geometry.positions.nbytes + 32 * len(geometry.positions) + 24 * samples * pixels
            + geometry.normals.nbytes + 4 * pixels) / rate  # fmt: skip


def scenes(largest: int) -> Iterator[tuple[str, luxel.Scene]]:
    for count in SPHERES:
        if count <= largest:
            yield "bumpy sphere", bumpy_sphere_scene(round((count / 4) ** 0.5))
    folder = meshes()
    if folder is not None and (folder / "dragon_vrip.ply").exists():
        yield "dragon", luxel.load(folder / "dragon_vrip.ply")


def nvdiffrast(prepared: Prepared, camera: luxel.Camera) -> float | None:
    """Seconds of nvdiffrast's rasteriser with the same mesh on the same screen; None if it is not there or gives up."""
    try:
        import nvdiffrast.torch as peer
        import torch
    except ImportError:
        return None
    context = peer.RasterizeCudaContext()
    matrix = torch.tensor(camera.clip_from_world(SIZE), dtype=torch.float32, device="cuda")
    positions = torch.tensor(prepared.geometry.positions, device="cuda")
    homogeneous = torch.cat([positions, torch.ones_like(positions[:, :1])], 1)
    triangles = torch.tensor(prepared.geometry.triangles, device="cuda")

    def draw() -> None:
        clip = homogeneous @ matrix.T
        clip = torch.stack([clip[:, 0], clip[:, 1], clip[:, 3] - 2 * clip[:, 2], clip[:, 3]], 1)  # its depth grows away from the eye
        peer.rasterize(context, clip[None].contiguous(), triangles, (SIZE[1], SIZE[0]))
        torch.cuda.synchronize()

    try:
        return seconds(draw)
    except RuntimeError as error:
        print(f"nvdiffrast: {str(error).splitlines()[0]}", file=sys.stderr)
        return None


def ceilings() -> str:
    rate = copy_rate()
    return f"{gpu().name}, compute capability {'.'.join(map(str, gpu().capability))}; a copy moves {rate / 1e12:.2f} TB/s, read and written."


def frames(largest: int) -> str:
    rows, rate = [], copy_rate()
    for name, scene in scenes(largest):
        free, prepared = gpu().free_memory(), prepare(scene)
        resident = Resident(gpu(), prepared)
        camera = camera_for(scene, SIZE)
        color = seconds(drawing(resident, [camera], SIZE, COLOR))
        ids = seconds(drawing(resident, [camera], SIZE, IDS))
        held = free - gpu().free_memory()
        count, least = len(prepared.geometry.triangles), floor(prepared, SIZE, 1, rate)
        cpu = median([once(partial(render, prepared, camera, SIZE)) for _ in range(4)][1:])
        peer = nvdiffrast(prepared, camera)
        rows.append([name, f"{count:,}", milliseconds(color), f"{count / color / 1e9:.2f}", milliseconds(least), f"{color / least:.1f}x",
                     milliseconds(cpu), f"{cpu / color:.0f}x", milliseconds(ids), "–" if peer is None else milliseconds(peer),
                     "–" if peer is None else f"{peer / ids:.1f}x", f"{held / 1e6:,.0f}"])  # fmt: skip
        print(*rows[-1], flush=True)  # if time runs out
    head = ["scene", "triangles", "colour, ms", "Gtri/s", "traffic floor, ms", "over floor", "processor, ms", "faster", "ids and depth, ms",
            "nvdiffrast, ms", "faster", "GPU memory, MB"]  # fmt: skip
    return table(head, rows)


def once(job: Callable[[], Any]) -> float:
    """Seconds of one run."""
    start = time.perf_counter()
    job()
    return time.perf_counter() - start


def stages(largest: int) -> str:
    """What each stage takes when the next waits for it."""
    rows, names = [], ("prepare", "project", "cover", "shade", "fetch")
    for name, scene in scenes(largest):
        resident = Resident(gpu(), prepare(scene))
        resident.measured = True
        camera = camera_for(scene, SIZE)
        taken = [draw_views(resident, [camera], SIZE, COLOR, [None], keep=True)[0].seconds for _ in range(10)][3:]
        rows.append([name, f"{scene.triangle_count:,}", *(milliseconds(median([one[stage] for one in taken])) for stage in names)])
    return table(["scene", "triangles", *(f"{name}, ms" for name in names)], rows)


def samples(largest: int) -> str:
    scene = bumpy_sphere_scene(round((min(largest, 1_000_000) / 4) ** 0.5))
    prepared = prepare(scene)
    resident, camera, rows = Resident(gpu(), prepared), camera_for(scene, SIZE), []
    for text, options in (*((f"MSAA {n}", {"samples": n}) for n in (1, 2, 4, 8, 16)), ("SSAA 3x3", {"ssaa": 3}),
                          ("MSAA 4, Mitchell", {"samples": 4, "filter": "mitchell"})):  # fmt: skip
        here = seconds(drawing(resident, [camera], SIZE, Options(**options)))
        cpu = median([once(partial(render, prepared, camera, SIZE, **options)) for _ in range(4)][1:])
        rows.append([text, milliseconds(here), milliseconds(cpu), f"{cpu / here:.0f}x"])
    return f"{scene.triangle_count:,} triangles.\n\n" + table(["anti-aliasing", "GPU, ms", "processor, ms", "faster"], rows)


def split(largest: int) -> str:
    """Up to how many pixels of its box one thread draws a triangle, and how large the tiles are that warps draw."""
    rows = []
    for count in (100, 10_000, 1_000_000):
        if count > largest:
            continue
        scene = bumpy_sphere_scene(round((count / 4) ** 0.5))
        resident, camera = Resident(gpu(), prepare(scene)), camera_for(scene, SIZE)
        for side in (16, 32, 64):
            row = [f"{scene.triangle_count:,}", side]
            for pixels in (8, 16, 32, 64, 128, 256, 1024):
                resident.split, resident.side = pixels, side
                row.append(milliseconds(seconds(drawing(resident, [camera], SIZE, IDS), 9)))
            rows.append(row)
    return table(["triangles", "tile", *(f"{p} px, ms" for p in (8, 16, 32, 64, 128, 256, 1024))], rows)


def views(largest: int) -> str:
    """Many small pictures of one mesh."""
    scene = bumpy_sphere_scene(50)
    prepared = prepare(scene)
    resident, around, rows = Resident(gpu(), prepared), turntable(scene, 1000, size=(128, 128)), []
    for batch in (1, 10, 100, 1000):
        cameras = around[:batch]
        here = seconds(drawing(resident, cameras, (128, 128), COLOR), 7) / batch
        back = seconds(drawing(resident, cameras, (128, 128), COLOR, keep=False), 7) / batch
        rows.append([batch, f"{1 / here:,.0f}", f"{1 / back:,.0f}"])
    cpu = once(lambda: [render(prepared, camera, (128, 128)) for camera in around[:100]]) / 100
    text = f"{scene.triangle_count:,} triangles, 128x128. The processor, all cores: {1 / cpu:,.0f} views a second.\n\n"
    return text + table(["views in a batch", "views/s, left on the device", "views/s, fetched"], rows)


_FIRST = (
    "import time; t = time.perf_counter(); import luxel; from luxel.scene.builtin.bumpy import bumpy_sphere_scene as s;"
    "p = luxel.prepare(s(50), device='cuda'); luxel.render(p, size=(1920, 1080)); a = time.perf_counter() - t;"
    "t = time.perf_counter(); luxel.render(p, size=(1920, 1080)); print(a, time.perf_counter() - t)"
)


def first(largest: int) -> str:
    """A process that draws one picture, then a second: with an empty cache of kernels, and with a full one."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("cold", "warm"):
            environment = {**os.environ, "NUMBA_CACHE_DIR": folder, "CUDA_CACHE_PATH": f"{folder}/driver"}
            done = subprocess.run([sys.executable, "-c", _FIRST], env=environment, capture_output=True, text=True, check=True)
            rows.append([name, *(f"{float(word):.2f}" for word in done.stdout.split())])
    return table(["cache", "first picture, s, start of Python to NumPy array", "second, s"], rows)


def leak(largest: int) -> str:
    """Memory before and after many frames."""
    import psutil

    scene = bumpy_sphere_scene(50)
    resident, camera, process = Resident(gpu(), prepare(scene)), camera_for(scene, (320, 240)), psutil.Process()

    def draw(count: int) -> float:
        start = time.perf_counter()
        for i in range(count):
            draw_views(resident, [camera], (320, 240), COLOR, [None], keep=i % 2 == 0)
        gpu().wait()
        return time.perf_counter() - start

    draw(500)
    free, held = gpu().free_memory(), process.memory_info().rss
    taken = draw(10_000)
    grown = (free - gpu().free_memory()) / 1e6, (process.memory_info().rss - held) / 1e6
    return f"10,000 frames of 320x240 in {taken:.1f} s: {grown[0]:+.1f} MB on the device, {grown[1]:+.1f} MB in the process."


def suite(largest: int) -> str:
    """The tests, all of them on this GPU; what failed is shown, and ends this with an error."""
    command = [sys.executable, "-m", "pytest", "tests/cuda", "-q", "-p", "no:cacheprovider", "-rs"]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True)
    lines = done.stdout.strip().splitlines()
    if done.returncode:
        print(done.stdout, done.stderr, file=sys.stderr)
        FAILED.append("suite")
    left_out = [f"- {line}" for line in lines if line.startswith(("SKIPPED", "FAILED"))]
    return "\n".join(["`pytest tests/cuda`: " + lines[-1].strip("= "), "", *left_out])


def part(name: str) -> Callable[[int], str]:
    """What makes a table."""
    if name in ("rooms", "growth", "relight", "factors"):
        import gpu_bake

        return getattr(gpu_bake, name)
    return globals()[name]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="which tables; all if none is named")
    parser.add_argument("--largest", type=int, default=SPHERES[-1], help="triangles")
    parser.add_argument("--write", action="store_true", help="keep the tables in RESULTS-gpu.md")
    arguments = parser.parse_args()
    try:
        gpu()
    except LuxelError as error:
        raise SystemExit(f"gpu: {error}") from None
    for name in arguments.parts or PARTS:
        started = time.perf_counter()
        text = ceilings() if name == "ceilings" else part(name)(arguments.largest)
        print(f"## {name}\n\n{text}\n\n({time.perf_counter() - started:.0f} s)\n", flush=True)
        if arguments.write:
            write_section(name.capitalize(), f"{text}\n\n{gpu().name}; {machine()}", RESULTS)
    if FAILED:
        raise SystemExit(f"gpu: {', '.join(FAILED)} failed")


if __name__ == "__main__":
    main()
