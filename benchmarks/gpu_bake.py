"""Tables of `benchmarks/gpu.py` about radiosity: baking and relighting on a GPU, beside the same machine's processor with all its cores.

A bake's set-up (layout, luxels, patches) is the processor's in both cases and is given by itself. What counts is the light: looking around, lights,
passing on until 0.1 % is unshot.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import luxel
from luxel.cuda.device import gpu
from luxel.cuda.relight import resident
from luxel.radiosity.bake import Baked, bake
from luxel.radiosity.lighting import Progress
from luxel.scene.builtin import SCENES
from report import median, milliseconds, table

ROOMS = ("room-simple", "room-complex")
PAPER = {"room-simple": 2.0, "room-complex": 79.0}
"""Seconds on the paper's GPU."""

LUXELS = (14_000, 60_000, 250_000, 1_000_000, 4_000_000)
_LIGHT = ("direct", "solve", "gather")
_FIRST_DENSITY = 10.0


class Timed(NamedTuple):
    """A bake, and its seconds: of the set-up, of looking around, of all the light; and bytes of the GPU's memory in use at its end."""

    baked: Baked
    before: float
    looking: float
    light: float
    held: int


def timed(name: str, device: str, density: float | None = None, **options: Any) -> Timed:
    """Bake a built-in scene."""
    marks: list[tuple[float, float]] = []
    free = gpu().free_memory()

    def progress(unshot: float, state: Progress) -> None:
        marks.append((time.perf_counter(), state.looked))

    baked = bake(SCENES[name](), density=density, device=device, progress=progress, tolerance=1e-3, **options)
    looked = [k for k, (_, share) in enumerate(marks) if share > 0]
    looking = marks[looked[-1]][0] - marks[max(looked[0] - 1, 0)][0] if looked else 0.0
    light = sum(baked.seconds.get(stage, 0.0) for stage in _LIGHT)
    return Timed(baked, sum(baked.seconds.values()) - light, looking, light, free - gpu().free_memory())


def rooms(largest: int) -> str:
    """The paper's rooms, to 0.1 % unshot."""
    rows = []
    for name in ROOMS:
        for quality in ("draft", "normal", "final", "progressive"):
            runs = [timed(name, "cuda", quality=quality) for _ in range(4)][1:]
            here = sorted(runs, key=lambda run: run.light)[1]
            cpu = median([timed(name, "cpu", quality=quality).light for _ in range(4)][1:])
            luxels, ratio, paper = len(here.baked.luxels.area), cpu / here.light, PAPER[name] / here.light
            rows.append([name, quality, f"{luxels:,}", f"{here.before:.2f}", milliseconds(here.looking), milliseconds(here.light),
                         len(here.baked.ledger), milliseconds(cpu), f"{ratio:.1f}x", f"{paper:.0f}x"])  # fmt: skip
    head = ["scene", "quality", "luxels", "set-up, s", "looking around, ms", "all light, ms", "steps", "processor, ms", "faster", "than the paper's"]
    return table(head, rows)


def growth(largest: int) -> str:
    """room-complex with more and more luxels."""
    first, rows = timed("room-complex", "cuda", _FIRST_DENSITY), []
    for count in LUXELS:
        run = timed("room-complex", "cuda", _FIRST_DENSITY * (count / len(first.baked.luxels.area)) ** 0.5)
        n = len(run.baked.luxels.area)
        patches = run.light / n * 1e9
        rows.append([f"{n:,}", f"{run.before:.1f}", milliseconds(run.looking), milliseconds(run.light), f"{patches:.0f}", f"{run.held / 1e9:.2f}"])
        print(*rows[-1], flush=True)  # if time runs out
    return table(["luxels", "set-up, s", "looking around, ms", "all light, ms", "ns a luxel", "GPU memory left in use, GB"], rows)


def relight(largest: int) -> str:
    """Kept transport of the rooms, solved for other lights."""
    from gpu import once, seconds

    rows = []
    for name in ROOMS:
        transport = bake(SCENES[name](), transport=True, device="cuda").transport
        assert transport is not None
        there, emission = resident(transport), 2 * transport.emission
        here = seconds(partial(there.solve, transport.powers(emission), None, transport.albedo, 1.0, 1e-3), 9)
        whole = seconds(partial(transport.solve, emission, device="cuda"), 9)
        cpu = median([once(partial(transport.solve, emission)) for _ in range(6)][1:])
        rows.append([name, f"{len(transport.area):,}", milliseconds(here), milliseconds(whole), milliseconds(cpu), f"{cpu / whole:.0f}x"])
    return table(["scene", "elements", "left on the device, ms", "fetched, ms", "processor, ms", "faster"], rows)


def factors(largest: int) -> str:
    """Form factors of a furnished room in patches; the second run, as the first compiles."""
    from form_factors import room
    from gpu import once

    rows = []
    for size in (0.75, 0.4, 0.2):
        meshes, found = room(size), {}

        def run(device: str) -> float:
            return once(lambda: found.update({device: luxel.form_factors(meshes, one_sided=True, device=device)}))  # noqa: B023 - called at once

        here, cpu = ([run(device) for _ in range(2)][1] for device in ("cuda", "cpu"))
        apart = np.abs(found["cuda"].data / found["cpu"].data - 1).max() if found["cuda"].nnz == found["cpu"].nnz else np.nan
        rows.append([f"{len(meshes):,}", f"{found['cpu'].nnz:,}", f"{here:.2f}", f"{cpu:.2f}", f"{cpu / here:.1f}x", f"{apart:.1e}"])
        print(*rows[-1], flush=True)  # if time runs out
    return table(["surfaces", "factors", "GPU, s", "processor, s", "faster", "largest difference"], rows)
