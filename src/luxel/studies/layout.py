"""Greedy mesh layout for the vertex cache (2016): its experiments, and those of the papers that it compares itself with.

What it measured on five models with a graphics card is measured here on meshes made by code, on any folder of models, and on whatever
draws: OpenGL through EGL (a card, or llvmpipe) and luxel's own rasteriser.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.errors import LuxelError
from luxel.io.files import tell
from luxel.studies.report import Report, published
from luxel.studies.study import HERE, Context, Study

PAPER = "the paper (2016)"
SANDER = "Sander, Nehab, Barczak 2007, figure 9"
_EXAMPLE = ((1, 2), (1, 1), (2, 1), (3, 3))  # (C1, C2) of the paper's four candidates
_PRINTED = ((1.25, 1.5, 2.5, 3.17), (1.75, 2.5, 4.5, 4.17))  # their costs in the paper: Lin & Yu's without C3, and its own
_FIGURE_9 = {  # ACMR of a FIFO of 12, 16, 24, 32, read off the published plots, +-0.002
    "bunny": {"K-Cache-Reorder": (0.628, 0.627, 0.624, 0.621), "Hoppe 1999": (0.641, 0.617), "Tipsify": (0.697, 0.651, 0.601, 0.578)},
    "fandisk": {"K-Cache-Reorder": (0.622, 0.621, 0.617, 0.614), "Hoppe 1999": (0.640, 0.617), "Tipsify": (0.693, 0.641, 0.598, 0.576)},
    "buddha": {"K-Cache-Reorder": (0.651, 0.647, 0.634, 0.623), "Hoppe 1999": (0.709, 0.674), "Tipsify": (0.728, 0.684, 0.636, 0.611)},
    "dragon": {"K-Cache-Reorder": (0.667, 0.663, 0.652, 0.643), "Hoppe 1999": (0.716, 0.685), "Tipsify": (0.740, 0.694, 0.645, 0.625)},
}
_TIMES = {"Tipsify": 2.5, "Hoppe 1999": 5.7, "K-Cache-Reorder": 296.0}  # seconds, of 784,000 triangles, in the same paper
_CACHES = (12, 16, 24, 32)
_SIZES = (4, 6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 48, 56, 64)
_SLOW = ("look-ahead", "auto")
_SIDE = 64  # pixels, of pictures whose drawing is timed
_MODELS = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")


class Model(NamedTuple):
    """A mesh to be laid out."""

    name: str
    positions: Array
    triangles: Array


@dataclass
class _Run:
    """What all parts of the study need."""

    context: Context
    report: Report
    models: list[Model]
    orders: list[str]

    @property
    def quick(self) -> bool:
        return self.context.quick

    def laid(self, model: Model, name: str, cache: int = 12) -> tuple[Array, float]:
        """The model's triangles in an order made for a FIFO of `cache`, and the seconds it took; one thread."""
        if name.startswith("meshoptimizer"):
            return _peer(model, name, cache)
        from luxel.layout import order

        start = time.perf_counter()
        found = order(model.triangles, len(model.positions), name, cache, positions=model.positions, threads=1)
        return found.triangles, time.perf_counter() - start


def run(context: Context, report: Report) -> None:
    """Every part of the study, shortest first."""
    _example(report)
    study = _Run(context, report, list(_models(context)), _orders())
    _warm(study)
    parts: list[Callable[[_Run], None]] = [_pictures, _published, _overdraw, _gpus, _rates, _growth, _sizes, _all_orders]
    for i, part in enumerate(parts):
        part(study)
        context.progress((i + 1) / len(parts))


def _models(context: Context) -> Iterator[Model]:
    """Meshes made by code, in an order that helps nobody, and those of the folder."""
    from luxel.scene.builtin import bumpy_sphere, icosphere, torus

    rng = np.random.default_rng(7)
    for mesh, name in ((torus(segments=120, sides=60), "torus"), (icosphere(subdivisions=5), "icosphere"), (bumpy_sphere(100), "bumpy sphere")):
        yield Model(name, mesh.positions, mesh.triangles[rng.permutation(len(mesh.triangles))])
    if context.meshes is not None:
        for path in sorted(context.meshes.iterdir()):
            if path.suffix.lower() in _MODELS:
                yield from _loaded(path, 150_000 if context.quick else 1 << 30)


def _loaded(path: Path, most: int) -> Iterator[Model]:
    """The file as one mesh; nothing if it cannot be read, or has more than `most` triangles."""
    from luxel.io import load
    from luxel.layout.optimize import seen_of

    if path.stat().st_size > 40 * most:  # no format takes more bytes for a triangle and its share of vertices
        return
    try:
        seen = seen_of(load(path, normals=False))
    except LuxelError as error:
        tell(path.name, f"left out: {error}")
        return
    if seen is not None and 100 <= len(seen[1]) <= most:
        yield Model(path.stem, seen[0], seen[1])


def _orders() -> list[str]:
    from importlib.util import find_spec

    from luxel.layout import ORDERS

    peers = ["meshoptimizer", "meshoptimizer Fifo"] if find_spec("meshoptimizer") else []
    return [*(name for name in ORDERS if name != "greedy-fifo"), *peers]  # for a FIFO that is greedy


def _peer(model: Model, name: str, cache: int) -> tuple[Array, float]:
    """meshoptimizer's general order, or its Fifo at the target near `cache` that serves it best."""
    import meshoptimizer

    from luxel.layout import acmr

    flat, n = np.ascontiguousarray(model.triangles.reshape(-1), np.uint32), len(model.positions)
    best: tuple[float, Array, float] | None = None
    for target in (0,) if name == "meshoptimizer" else range(cache, cache + 4):
        out = np.empty_like(flat)
        start = time.perf_counter()
        if target:
            meshoptimizer.optimize_vertex_cache_fifo(out, flat, len(flat), n, target)
        else:
            meshoptimizer.optimize_vertex_cache(out, flat, len(flat), n)
        taken = time.perf_counter() - start
        faces = out.astype(np.int32).reshape(-1, 3)
        rate = acmr(faces, cache)
        if best is None or rate < best[0]:
            best = rate, faces, taken
    assert best is not None
    return best[1], best[2]


def _warm(study: _Run) -> None:
    """Compile everything, so that no time has it in it."""
    small = Model("", study.models[0].positions, study.models[0].triangles[:200])
    for name in study.orders:
        study.laid(small, name)


def _example(report: Report) -> None:
    """The paper's worked example: which of four candidates each cost prefers."""
    rows = []
    for k, name in enumerate(("Lin & Yu: C1 + 0.5 / C2", "2016: C1 + 0.5 / C2 + C1 / C2")):
        ours = [c1 + 0.5 / c2 + k * c1 / c2 for c1, c2 in _EXAMPLE]
        for source, costs in ((HERE, ours), (PAPER, _PRINTED[k])):
            rows.append({"cost": name, "source": source} | {f"C1 {c[0]}, C2 {c[1]}": v for c, v in zip(_EXAMPLE, costs, strict=True)})
    report.table("example", "The paper's example", rows, "Cost of four candidates; C3 left out. Least is drawn first.")


def _best_name(study: _Run) -> str:
    return next((name for name in ("look-ahead", "greedy-2016", "lin-yu", "tipsify") if name in study.orders), "auto")


def _pictures(study: _Run) -> None:
    """Triangles by place and by misses, before and after, as in the paper."""
    from luxel.layout.pictures import picture
    from luxel.scene.mesh import Mesh
    from luxel.scene.scene import Scene

    chosen = [m for m in study.models if "bunny" in m.name.lower()] or study.models[2:3]
    for model in chosen[:1]:
        laid = study.laid(model, _best_name(study))[0]
        scenes = [Scene.from_mesh(Mesh(model.positions, triangles)) for triangles in (model.triangles, laid)]
        note = f"{model.name}, {len(model.triangles):,} triangles; {_best_name(study)}, FIFO 12. The paper shows its models so."
        study.report.picture("order", "Before and after", picture(scenes[0], scenes[1], threads=study.context.threads), note)


def _published(study: _Run) -> None:
    """Beside the published comparison: each order made once for 12, as K-Cache-Reorder was; Tipsify for each size."""
    from luxel.layout import acmr

    rows: list[dict[str, Any]] = []
    for name, figures in _FIGURE_9.items():
        model = next((m for m in study.models if name in m.name.lower()), None)
        for order, values in figures.items():
            rows.append({"model": name, "order": order, "source": SANDER} | {f"FIFO {k}": v for k, v in zip(_CACHES, values, strict=False)})
        if model is None or (study.quick and len(model.triangles) > 100_000):
            continue
        for order in (o for o in study.orders if o not in ("file", "random", "morton", "auto")):
            made = {k: study.laid(model, order, k)[0] for k in (_CACHES if order == "tipsify" else (12,))}
            rates = {f"FIFO {k}": acmr(made.get(k, made[12]), k) for k in _CACHES}
            rows.append({"model": name, "order": order, "source": HERE, "triangles": len(model.triangles)} | rates)
    note = "Their models of these names may have other numbers of triangles. All orders but Tipsify are made once, for a FIFO of 12."
    study.report.table("published", "The published comparison", rows, note)


def _overdraw(study: _Run) -> None:
    """What sorting clusters costs and brings."""
    from luxel.layout import acmr
    from luxel.layout.occlusion import sort_clusters
    from luxel.layout.overdraw import overdraw

    rows = []
    for model in study.models[: 4 if study.quick else None]:
        laid = study.laid(model, "tipsify")[0]
        for limit in (None, 1.0, 1.02, 1.05, 1.1, 1.2):
            faces = laid if limit is None else sort_clusters(laid, model.positions, limit=limit).triangles
            seen = overdraw(faces, model.positions, threads=study.context.threads)
            rows.append({"model": model.name, "limit": "not sorted" if limit is None else limit, "source": HERE, "ACMR 12": acmr(faces, 12),
                         "overdraw": seen.mean, "worst view": seen.worst})  # fmt: skip
    study.report.table("overdraw", "Overdraw against cache misses", rows, "Tipsify's order for a FIFO of 12, clusters sorted; mean of 32 views.")


def _gpus(study: _Run) -> None:
    """Vertices transformed on GPU models, by orders made for them and for a plain FIFO."""
    from luxel.layout import order
    from luxel.layout.batch import MODELS, reuse

    rows = []
    for model in study.models[: 4 if study.quick else None]:
        n, name = len(model.positions), "auto" if len(model.triangles) < 100_000 else "tipsify"
        plain = {"file": model.triangles, "FIFO 12": study.laid(model, name)[0]}
        plain |= {peer: study.laid(model, peer)[0] for peer in study.orders if peer == "meshoptimizer"}
        own = {gpu: order(model.triangles, n, name, profile=gpu, positions=model.positions).triangles for gpu in MODELS}
        for label in (*plain, "its own"):
            rates = {f"ATVR {gpu}": reuse(plain.get(label, own[gpu]), gpu, n).atvr for gpu in MODELS}
            rows.append({"model": model.name, "order made for": label, "source": HERE} | rates)
    study.report.table("gpus", "GPU models", rows, "The models are meshoptimizer's; ATVR is 1 at best. `its own`: made for the model measured.")


def _rates(study: _Run) -> None:
    """Drawing rate against ACMR, on OpenGL and on luxel, each order of one mesh; the paper: the rate rises as ACMR falls."""
    from luxel.scene.builtin import bumpy_sphere
    from luxel.studies.gl import Renderer

    gl = Renderer()
    rows: list[dict[str, Any]] = []
    for n in (60, 120) if study.quick else (60, 120, 240):
        mesh = bumpy_sphere(n)
        model = Model(f"bumpy sphere {n}", mesh.positions, mesh.triangles)
        for name in study.orders:
            rows.append(_rate(study, gl, model, mesh.normals, name))
    renderers = [key for key in ("OpenGL, M triangles/s", "luxel, M triangles/s") if key in rows[0]]
    largest = [row for row in rows if row["triangles"] == rows[-1]["triangles"]]
    sensible = [row for row in largest if row["order"] != "random"]
    links = (f"{key.partition(',')[0]} {_link(largest, key):+.2f} ({_link(sensible, key):+.2f} without the random one)" for key in renderers)
    told = f"OpenGL is {gl.name}." if gl.name is not None else f"OpenGL was left out: {gl.missing}."
    note = f"""{told} Pictures of {_SIDE} x {_SIDE}: vertices are most of the work. The paper found, on a graphics card, that the rate
rises as ACMR falls, and that pictures a second fall as the mesh grows, nearly in inverse proportion. Here the correlation of rate and ACMR
at 12, over the orders of the largest mesh, is {", ".join(links)}: -1 would be the paper's finding, 0 none. luxel (on one thread) transforms each
vertex once whatever the order is, so ACMR says nothing of it; what an order changes for it is the locality of memory."""
    study.report.table("rates", "Drawing rate against ACMR", rows, note)
    with study.report.figure("rates", "Drawing rate against ACMR, by order") as axes:
        for key, mark in zip(renderers, "os", strict=False):
            for count in sorted({row["triangles"] for row in rows}):
                part = [(row["ACMR 12"], row[key]) for row in rows if row["triangles"] == count]
                axes.plot(*zip(*part, strict=True), mark, label=f"{key.partition(',')[0]}, {count:,} triangles")
        axes.set_xlabel("ACMR, FIFO 12")
        axes.set_ylabel("M triangles/s")
        axes.set_ylim(0)


def _rate(study: _Run, gl: Any, model: Model, normals: Array | None, name: str) -> dict[str, Any]:
    """How fast one order of a model is drawn."""
    from luxel.layout import acmr
    from luxel.raster.render import prepare, render
    from luxel.scene.framing import frame
    from luxel.scene.mesh import Mesh
    from luxel.scene.scene import Scene

    faces = study.laid(model, name)[0]
    scene = Scene.from_mesh(Mesh(model.positions, faces, normals))
    camera, ready = frame(scene, size=(_SIDE, _SIDE)), prepare(scene)
    row = {"triangles": len(faces), "order": name, "source": HERE, "ACMR 12": acmr(faces, 12), "ACMR 32": acmr(faces, 32)}
    taken = {} if gl.name is None else {"OpenGL": gl.seconds(model.positions, faces, camera, _SIDE)}
    taken["luxel"] = _median(lambda: render(ready, camera, (_SIDE, _SIDE), threads=1))
    row |= {f"{key}, M triangles/s": len(faces) / value / 1e6 for key, value in taken.items()}
    return row | {f"{key}, pictures/s": 1 / value for key, value in taken.items()}


def _link(rows: list[dict[str, Any]], key: str) -> float:
    """Pearson's correlation of ACMR at 12 and a rate."""
    x, y = [row["ACMR 12"] for row in rows], [row[key] for row in rows]
    return float(np.corrcoef(x, y)[0, 1]) if len(x) > 1 and np.std(x) > 0 and np.std(y) > 0 else 0.0


def _median(job: Callable[[], object], repeats: int = 7) -> float:
    taken = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        job()
        taken.append(time.perf_counter() - start)
    return statistics.median(taken[1:])


def _growth(study: _Run) -> None:
    """Time and ACMR as the mesh grows."""
    from luxel.layout import acmr
    from luxel.scene.builtin import bumpy_sphere

    rng = np.random.default_rng(3)
    rows = []
    for n in (30, 60, 120) if study.quick else (30, 60, 120, 240, 480):
        mesh = bumpy_sphere(n)
        model = Model("", mesh.positions, mesh.triangles[rng.permutation(len(mesh.triangles))])
        for name in (o for o in study.orders if o not in ("file", "random")):
            faces, taken = study.laid(model, name)
            rows.append({"triangles": len(faces), "order": name, "source": HERE, "seconds": taken, "M triangles/s": len(faces) / taken / 1e6,
                         "ACMR 12": acmr(faces, 12)})  # fmt: skip
    theirs = [{"triangles": 784_000, "order": name, "source": f"{SANDER.rpartition(',')[0]}, Pentium 4", "seconds": taken,
               "M triangles/s": 0.784 / taken} for name, taken in _TIMES.items()]  # fmt: skip
    study.report.table("growth", "As the mesh grows", [*rows, *theirs], "A bumpy sphere in random order; one thread, compiled before.")
    with study.report.figure("growth", "Time to order a mesh, one thread") as axes:
        for name in dict.fromkeys(str(row["order"]) for row in rows):
            part = [(row["triangles"], row["seconds"]) for row in rows if row["order"] == name]
            axes.loglog(*zip(*part, strict=True), "o-", label=name)
        axes.set_xlabel("triangles")
        axes.set_ylabel("seconds")


def _sizes(study: _Run) -> None:
    """ACMR over the size of the cache, every order made for each size."""
    from luxel.layout import acmr
    from luxel.layout.cache import used_vertices

    model = next((m for m in study.models if "bunny" in m.name.lower()), study.models[-1])
    sizes = _CACHES if study.quick else _SIZES
    names = [name for name in study.orders if name != "random"]
    rates = {name: {k: acmr(study.laid(model, name, k)[0], k) for k in sizes} for name in names}
    rows = [{"order": name, "source": HERE} | {f"FIFO {k}": v for k, v in by_size.items()} for name, by_size in rates.items()]
    floor = used_vertices(model.triangles, len(model.positions)) / len(model.triangles)
    note = f"{model.name}; every order is made for the size that it is measured at. None can be below {floor:.3f}, vertices over triangles."
    study.report.table("sizes", "Sizes of the cache", rows, note)
    with study.report.figure("sizes", f"ACMR over the size of the cache, {model.name}") as axes:
        for name, by_size in rates.items():
            if name not in ("file", "morton", "auto"):  # far above, or the same as look-ahead
                axes.plot(list(by_size), list(by_size.values()), "o-", markersize=3, label=name)
        found = next((figures for key, figures in _FIGURE_9.items() if key in model.name.lower()), {})
        for name, values in found.items():
            published(axes, _CACHES[: len(values)], values, f"{name}, Sander et al. 2007")
        axes.axhline(floor, color="black", linewidth=1, label="vertices / triangles")
        axes.set_xlabel("vertices in the FIFO")
        axes.set_ylabel("ACMR")


def _all_orders(study: _Run) -> None:
    """Every order of every model: ACMR and time."""
    from luxel.layout import acmr

    rows, means = [], []
    for name in study.orders:
        rates = []
        for model in study.models:
            if study.quick and name in _SLOW and len(model.triangles) > 100_000:
                continue
            made = {k: study.laid(model, name, k) for k in (12, 16)}
            rates.append([acmr(made[k][0], k) for k in (12, 16)])
            taken = made[12][1]
            rows.append({"model": model.name, "triangles": len(model.triangles), "order": name, "source": HERE, "ACMR 12": rates[-1][0],
                         "ACMR 16": rates[-1][1], "seconds": taken, "M triangles/s": len(model.triangles) / taken / 1e6})  # fmt: skip
        mean = np.mean(rates, 0)
        means.append({"order": name, "source": HERE, "ACMR 12": float(mean[0]), "ACMR 16": float(mean[1]), "models": len(rates)})
    rows.sort(key=lambda row: (row["model"], row["ACMR 12"]))
    study.report.table("means", "Orders, mean over the models", sorted(means, key=lambda row: row["ACMR 12"]))
    study.report.table("orders", "Orders, model by model", rows, "Each made for the FIFO that it is measured by; one thread.")


STUDY = Study(
    "layout",
    "Triangle orders for the vertex cache",
    "the greedy mesh layout of 2016, with Lin & Yu 2006 and Sander, Nehab & Barczak 2007",
    run,
)
