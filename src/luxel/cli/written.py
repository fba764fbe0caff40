"""What a bake writes, and what it says of that."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from luxel.cli.console import Console, seconds

if TYPE_CHECKING:
    from luxel.arrays import Array
    from luxel.cluster.comm import Comm
    from luxel.radiosity.bake import Baked
    from luxel.scene import Scene


@dataclass(frozen=True)
class Wishes:
    """What is to be written, and how."""

    output: Path
    convention: str
    white: float
    exr: bool
    layers: bool
    lights: bool
    only_indirect: bool
    occlusion: float | None


def shade(baked: Baked, wishes: Wishes, comm: Comm, threads: int | None) -> Array | None:
    """(n,) float32: each luxel's ambient occlusion, if it is asked for."""
    if wishes.occlusion is None:
        return None
    from luxel.radiosity.ambient_occlusion import ambient_occlusion
    from luxel.radiosity.bake import labour_of

    return ambient_occlusion(baked.atlas, baked.luxels, wishes.occlusion, labour=labour_of(threads, comm))


def lit(baked: Baked, wishes: Wishes, share: Array | None) -> Scene:
    """The scene with what is asked for in its lightmaps."""
    from luxel.radiosity import lightmap

    pages = lightmap.finish(baked.atlas, baked.luxels, baked.irradiance - baked.direct, baked.valid)[0] if wishes.only_indirect else baked.pages
    shade = None if share is None else lightmap.finish(baked.atlas, baked.luxels, share, baked.valid)[0]
    return lightmap.attach(baked.atlas, pages, shade)


def save(lit: Scene, baked: Baked, wishes: Wishes) -> list[Path]:
    """The files written, the scene's first."""
    from luxel.radiosity import lightmap
    from luxel.radiosity.output import save_baked, save_pages

    beside: list[Path] = []
    if wishes.layers:
        named = {name.replace(".", "_") or "lamp": lightmap.finish(baked.atlas, baked.luxels, e, baked.valid)[0] for name, e in baked.layers.items()}
        beside = save_pages(wishes.output.with_name(f"{wishes.output.stem}_layers.exr"), baked.pages, named)
    convention: Any = wishes.convention
    return save_baked(lit, wishes.output, convention, exr=wishes.exr, white=wishes.white, lights=wishes.lights) + beside


def say(console: Console, baked: Baked, written: list[Path], state: Path, took: float, ranks: list[dict[str, float]]) -> None:
    """Tell what has been baked and written, after `took` seconds."""
    import numpy as np

    from luxel.scene.inspect import flat_triangles

    last = baked.ledger[-1] if baked.ledger else None
    unshot, shots = (last.unshot_fraction, last.shots) if last else (0.0, 0)
    (width, height), pages, luxels = baked.atlas.size, baked.atlas.pages, len(baked.luxels.area)
    ledger = {} if last is None else {name: [float(x) for x in getattr(last, name)] for name in ("emitted", "absorbed", "escaped", "unshot")}
    data = {
        "output": [str(path) for path in written],
        "luxels": luxels,
        "pages": pages,
        "page": [width, height],
        "shots": int(shots),
        "unshot": float(unshot),
        "finished": baked.finished,
        "watts": ledger,
        "mean_irradiance": [float(x) for x in baked.irradiance[baked.valid].mean(0)] if baked.valid.any() else [0.0, 0.0, 0.0],
        "seconds": {**{name: float(value) for name, value in baked.seconds.items()}, "all": took},
        **({"ranks": ranks} if len(ranks) > 1 else {}),
    }
    flat = sum(int(np.count_nonzero(flat_triangles(mesh))) for mesh in baked.atlas.scene.meshes)
    if flat:
        console.note(f"{flat:,} triangle{'s have' if flat > 1 else ' has'} no area, and no light")
    if not baked.finished:
        console.note(f"stopped with {unshot:.2%} of the light unshot; the state is kept in {state}, and --resume goes on")
    on = f"a page of {width}x{height}" if pages == 1 else f"{pages} pages of {width}x{height}"
    by = f"{len(ranks)} ranks, " if len(ranks) > 1 else ""
    by_shots = f"{shots:,} shot{'s' if shots > 1 else ''}, " if shots else ""
    console.result(data, f"{written[0]}  ({luxels:,} luxels on {on}, {by_shots}{unshot:.2%} unshot; {by}{seconds(took)})")
