"""`luxel.optimize`: a mesh in the layout that a GPU's caches like, with everything it carries, and a report of what that brought.

The steps, in this order, those in brackets on request: (weld equal vertices), (drop degenerate triangles), (drop duplicates), order the
triangles, (sort clusters against overdraw), number the vertices by first use. None of them changes what is drawn.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.io import load
from luxel.io.files import tell
from luxel.io.flatten import placed
from luxel.layout import clean
from luxel.layout.batch import Model, model_of
from luxel.layout.cache import POLICIES
from luxel.layout.checks import checked_cache, checked_triangles
from luxel.layout.fetch import renumber
from luxel.layout.measure import Draw, Measures, measure
from luxel.layout.occlusion import sort_clusters
from luxel.layout.partition import Crew
from luxel.layout.reorder import ORDERS, order
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

Progress = Callable[[float], None]
_ATTRIBUTES = ("positions", "normals", "texcoords", "texcoords1", "colors", "tangents")


@dataclass(frozen=True)
class Options:
    """What to do; see `optimize`. Checked when made.

    Raises:
        InputError: A name is not known, or a number is out of range.
    """

    order: str = "auto"
    cache: int = 12
    policy: str = "fifo"
    profile: str | Model | None = None
    overdraw: float | None = None
    weld: bool = False
    drop_degenerate: bool = False
    drop_duplicates: bool = False
    drop_unused: bool = False
    threads: int | None = None
    seconds: float | None = None
    more: dict[str, Any] = field(default_factory=dict)
    crew: Crew | None = None

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            raise InputError(f"order: expected one of {', '.join(ORDERS)}, got {self.order!r}")
        if self.policy not in POLICIES:
            raise InputError(f"policy: expected one of {', '.join(POLICIES)}, got {self.policy!r}")
        checked_cache(self.cache)
        if self.profile is not None:
            model_of(self.profile)
        limit = self.overdraw
        if limit is not None and not (isinstance(limit, (int, float)) and 1 <= limit < np.inf):
            raise InputError(f"overdraw: expected how many times the cache misses it may cost, at least 1 (such as 1.05), got {limit!r}")
        jit.checked_threads(self.threads)
        if self.seconds is not None and not (isinstance(self.seconds, (int, float)) and 0 < self.seconds < np.inf):
            raise InputError(f"seconds: expected a number above 0, got {self.seconds!r}")

    @property
    def target(self) -> str:
        """The cache that the order is made for, in words."""
        return f"{self.policy.upper()} {self.cache}" if self.profile is None else str(self.profile)


@dataclass
class Report:
    """What `optimize` did.

    Attributes:
        target: The cache that the order was made for.
        orders: The order that won, for each list of triangles.
        before, after: Measures; None if they were not asked for.
        welded, degenerate, duplicates, unused: Vertices or triangles that went.
        seconds: By stage.
        triangle_source: For each mesh (m,) int32: triangle i was triangle `triangle_source[i]`.
        vertex_source: For each mesh (n,) int32: vertex i was vertex `vertex_source[i]`, so `array[vertex_source]` brings along what else you have.
    """

    target: str
    orders: list[str] = field(default_factory=list)
    before: Measures | None = None
    after: Measures | None = None
    welded: int = 0
    degenerate: int = 0
    duplicates: int = 0
    unused: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    triangle_source: list[Array] = field(default_factory=list)
    vertex_source: list[Array] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Plain lists, numbers and strings, for JSON; without the two sources."""
        data = asdict(replace(self, triangle_source=[], vertex_source=[]))
        del data["triangle_source"], data["vertex_source"]
        return data

    def lap(self, stage: str, start: float) -> None:
        """Add the seconds since `start` to a stage."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start

    def refuse_nothing(self) -> None:
        """Raise InputError if there was no triangle, not even one that was dropped."""
        if set(self.orders) <= {"empty"} and not self.degenerate:
            raise InputError("triangles: expected at least one triangle to order, got none")


class Laid(NamedTuple):
    """Lists of triangles over one set of vertices, laid out.

    Attributes:
        triangles: Each (m, 3) int32, with new vertex numbers.
        triangle_source: Each (m,) int32: triangle i was triangle `source[i]` of its list.
        vertex_source: (k,) int32: new vertex i was vertex `source[i]`.
        vertex_target: (n,) int32: where each old vertex went; -1 if it went away.
    """

    triangles: list[Array]
    triangle_source: list[Array]
    vertex_source: Array
    vertex_target: Array


def tell_polygons(where: object, counts: Array) -> None:
    """Say what becomes of the faces of a file that are no triangles; `counts` (f,) are their corners."""
    polygons, few = int(np.count_nonzero(counts > 3)), int(np.count_nonzero(counts < 3))
    if polygons:
        tell(where, f"{polygons} polygons with more than 3 corners become triangles")
    if few:
        tell(where, f"{few} faces with fewer than 3 corners are dropped")


def lay_out(lists: Sequence[Array], vertex_count: int, options: Options, report: Report, positions: Array | None = None,
            rows: Callable[[], Array] | None = None, cull: bool = True, renumbered: bool = True, needed: Array | None = None,
            progress: Progress | None = None) -> Laid:  # fmt: skip
    """Lay out lists of triangles, each drawn by itself, that share their vertices.

    Args:
        lists: Each (m, 3) int32.
        vertex_count: Of the vertices they share.
        options: What to do.
        report: Gets what was done.
        positions: (n, 3) float32, for what asks where things are.
        rows: Makes the (n, words) uint32 by which vertices are compared when welding (`clean.vertex_rows`).
        cull: Back faces are not drawn: for overdraw.
        renumbered: False keeps the vertices where they are.
        needed: Vertices that something else names: they are not unused.
        progress: To be told the fraction that is done.
    """
    start = time.perf_counter()
    target, kept = np.arange(vertex_count, dtype=np.int32), np.arange(vertex_count, dtype=np.int32)
    if options.weld and rows is not None and renumbered:
        target, kept = clean.weld(rows())
        report.welded += vertex_count - len(kept)
        positions = None if positions is None else positions[kept]
    made, sources = [], []
    for triangles in lists:
        faces, _ = checked_triangles(triangles, vertex_count)
        faces, source = _cleaned(target[faces], positions, options, report)
        made.append(faces)
        sources.append(source)
    report.lap("clean", start)
    total, done = max(1, sum(map(len, made))), 0
    for i, faces in enumerate(made):
        begin, part = done / total, len(faces) / total
        made[i], chosen = _ordered(faces, len(kept), options, report, positions, cull, _scaled(progress, begin, part))
        sources[i] = sources[i][chosen]
        done += len(faces)
        if progress is not None:
            progress(done / total)
    start = time.perf_counter()
    joined = np.concatenate(made) if made else np.zeros((0, 3), np.int32)
    if renumbered:
        named = np.zeros((0, 3), np.int32) if needed is None else np.repeat(target[needed][:, None], 3, 1)
        numbered, order_of = renumber(np.concatenate([joined, named]), len(kept), keep_unused=not options.drop_unused)
        joined = numbered[: len(joined)]
        report.unused += len(kept) - len(order_of)
    else:
        order_of = np.arange(len(kept), dtype=np.int32)
    place = np.full(len(kept), -1, np.int32)
    place[order_of] = np.arange(len(order_of), dtype=np.int32)
    report.lap("renumber", start)
    cuts = np.cumsum([len(faces) for faces in made])[:-1]
    return Laid([np.ascontiguousarray(part) for part in np.split(joined, cuts)] if made else [], sources, kept[order_of], place[target])


def _cleaned(faces: Array, positions: Array | None, options: Options, report: Report) -> tuple[Array, Array]:
    source = np.arange(len(faces), dtype=np.int32)
    if options.drop_degenerate and len(faces):
        keep = ~clean.degenerate(faces, positions)
        report.degenerate += int(np.count_nonzero(~keep))
        faces, source = faces[keep], source[keep]
    if options.drop_duplicates and len(faces):
        keep = ~clean.duplicate(faces)
        report.duplicates += int(np.count_nonzero(~keep))
        faces, source = faces[keep], source[keep]
    return faces, source


def _ordered(faces: Array, vertices: int, options: Options, report: Report, positions: Array | None, cull: bool,
             progress: Progress | None) -> tuple[Array, Array]:  # fmt: skip
    """Triangles in their new order, and where each came from."""
    if not len(faces):
        report.orders.append("empty")
        return faces, np.zeros(0, np.int32)
    start = time.perf_counter()
    told = None if progress is None else lambda done, total: progress(done / max(total, 1))
    # One list may use few of many shared vertices: the order sees those alone.
    local, used = renumber(faces, vertices, keep_unused=False)
    points = None if positions is None else positions[used]
    if points is not None:
        wrong = np.nonzero(~np.isfinite(points).all(1))[0]
        if len(wrong):
            raise InputError(f"positions: expected finite numbers, got {points[wrong[0]].tolist()} at vertex {used[wrong[0]]}")
    found = order(local, len(used), options.order, options.cache, options.policy, options.profile, points,
                  threads=options.threads, seconds=options.seconds, progress=told, crew=options.crew, **options.more)  # fmt: skip
    report.orders.append(found.order)
    report.lap("order", start)
    triangles, source = found.triangles, found.source
    if options.overdraw is not None and points is not None:
        start = time.perf_counter()
        sorted_ = sort_clusters(triangles, points, options.cache, options.policy, options.profile, options.overdraw, cull, options.threads)
        triangles, source = sorted_.triangles, source[sorted_.source]
        report.lap("overdraw", start)
    return used[triangles], source


def _scaled(progress: Progress | None, begin: float, part: float) -> Progress | None:
    return None if progress is None else lambda done: progress(begin + part * done)


def optimize(source: Any, order: str = "auto", cache: int = 12, policy: str = "fifo", profile: str | Model | None = None, *,
             overdraw: float | None = None, weld: bool = False, drop_degenerate: bool = False, drop_duplicates: bool = False,
             drop_unused: bool = False, threads: int | None = None, seconds: float | None = None, measures: bool = True,
             progress: Progress | None = None, **more: Any) -> tuple[Any, Report]:  # fmt: skip
    """Lay meshes out for the caches of a GPU; what is drawn stays the same, with all attributes.

    Args:
        source: What `luxel.load` takes. Arrays (positions, triangles) come back as arrays, of the same dtypes; a Mesh as a Mesh; a trimesh object
            as one; a Scene or a path as a Scene. The input is not changed.
        order: One of `luxel.layout.ORDERS`; "auto" is never worse than the input.
        cache, policy: The cache to order for: its size in vertices, at least 3, and "fifo" or "lru".
        profile: In place of these a GPU model: "nvidia", "amd", "intel", "mobile".
        overdraw: Then sort clusters of triangles against overdraw; it may cost so many times the cache misses (1.05 is a good limit).
            None leaves the order as it is.
        weld: First make one of vertices that are equal in all attributes.
        drop_degenerate: Drop triangles of which two corners are in one place.
        drop_duplicates: Drop triangles that come again with the same vertices and winding.
        drop_unused: Drop vertices that no triangle uses; else they go to the end.
        threads: None: all that the process may use.
        seconds: How long each mesh's order may take, about, where the order can choose.
        measures: Also measure before and after (some seconds for a million triangles).
        progress: Called with the fraction that is done.
        more: Further options of `luxel.layout.order`, such as `weights`, `width` and `depth`.

    Returns:
        The result and a Report.

    Raises:
        InputError: An option is wrong, or the arrays are: an index is out of range, a position that a triangle uses is not finite, there are no
            triangles or 2^31 indices.
        FileError: `source` is a path that cannot be read.
    """
    options = Options(order, cache, policy, profile, overdraw, weld, drop_degenerate, drop_duplicates, drop_unused, threads, seconds, more)
    report = Report(options.target)
    if isinstance(source, (tuple, list)) and len(source) == 2:
        return _optimize_arrays(source, options, report, measures, progress), report
    trimesh = sys.modules.get("trimesh")
    if trimesh is not None and isinstance(source, (trimesh.Trimesh, trimesh.Scene)):
        from luxel.layout.foreign import optimize_trimesh

        return optimize_trimesh(source, options, report, measures, progress), report
    scene = load(source, normals=False) if isinstance(source, (str, os.PathLike)) else load(source)
    result = optimize_scene(scene, options, report, measures, progress)
    return (result.meshes[0] if isinstance(source, Mesh) else result), report


def optimize_scene(scene: Scene, options: Options, report: Report, measures: bool = True, progress: Progress | None = None) -> Scene:
    """A scene with its meshes laid out; the rest is shared with the input."""
    if measures:
        report.before = measure_scene(scene, report, options.threads)
    total = max(1, sum(len(mesh.triangles) for mesh in scene.meshes))
    done, meshes = 0, []
    for mesh in scene.meshes:
        meshes.append(_optimize_mesh(mesh, options, report, _culled(scene, mesh), _scaled(progress, done / total, len(mesh.triangles) / total)))
        done += len(mesh.triangles)
    result = replace(scene, meshes=meshes)
    report.refuse_nothing()
    if measures:
        report.after = measure_scene(result, report, options.threads)
    return result


def _culled(scene: Scene, mesh: Mesh) -> bool:
    return not (0 <= mesh.material < len(scene.materials) and scene.materials[mesh.material].double_sided)


def _optimize_mesh(mesh: Mesh, options: Options, report: Report, cull: bool, progress: Progress | None) -> Mesh:
    arrays = {name: getattr(mesh, name) for name in _ATTRIBUTES if getattr(mesh, name) is not None}
    laid = lay_out([mesh.triangles], len(mesh.positions), options, report, mesh.positions,
                   lambda: clean.vertex_rows(list(arrays.values())), cull, progress=progress)  # fmt: skip
    report.triangle_source.append(laid.triangle_source[0])
    report.vertex_source.append(laid.vertex_source)
    kept = {name: array[laid.vertex_source] for name, array in arrays.items()}
    return replace(mesh, triangles=laid.triangles[0], **kept)


def _optimize_arrays(source: Any, options: Options, report: Report, measures: bool, progress: Progress | None) -> tuple[Array, Array]:
    """(positions, triangles) of the dtypes given."""
    positions, given = np.asarray(source[0]), np.asarray(source[1])
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise InputError(f"positions: expected (n, 3), got {positions.shape}")
    points = checked(positions, ("n", 3), np.float32, "positions")
    faces, _ = checked_triangles(given, len(points))
    stride = 12
    if measures:
        report.before = _measured(Draw(faces, len(points), stride), points, report, options.threads)
    laid = lay_out([faces], len(points), options, report, points, lambda: clean.vertex_rows([positions]), progress=progress)
    report.triangle_source.append(laid.triangle_source[0])
    report.vertex_source.append(laid.vertex_source)
    report.refuse_nothing()
    if measures:
        report.after = _measured(Draw(laid.triangles[0], len(laid.vertex_source), stride), points[laid.vertex_source], report, options.threads)
    dtype = given.dtype if given.dtype.kind in "iu" else np.dtype(np.int32)
    return positions[laid.vertex_source], laid.triangles[0].astype(dtype, copy=False)


def _measured(draw: Draw, points: Array, report: Report, threads: int | None) -> Measures:
    start = time.perf_counter()
    found = measure([draw], (points, draw.triangles, np.ones(len(draw.triangles), bool)), threads)
    report.lap("measure", start)
    return found


def measure_scene(scene: Scene, report: Report, threads: int | None = None) -> Measures:
    """The measures of a scene: caches and fetches of each mesh once, overdraw of all its instances in their order."""
    start = time.perf_counter()
    found = measure(draws_of(scene), seen_of(scene), threads)
    report.lap("measure", start)
    return found


def draws_of(scene: Scene) -> list[Draw]:
    """Each mesh as one draw call, with all its attributes interleaved."""
    return [Draw(mesh.triangles, len(mesh.positions), _stride(mesh)) for mesh in scene.meshes]


def _stride(mesh: Mesh) -> int:
    return sum(4 * array.shape[1] for name in _ATTRIBUTES if (array := getattr(mesh, name)) is not None)


def seen_of(scene: Scene) -> tuple[Array, Array, Array] | None:
    """All instances in world space: positions, triangles, and of which the back faces are not drawn."""
    bare = replace(scene, meshes=[Mesh(mesh.positions, mesh.triangles, material=mesh.material) for mesh in scene.meshes])
    meshes = [placed(bare, instance) for instance in scene.instances]
    if not meshes:
        return None
    starts = np.cumsum([0] + [len(mesh.positions) for mesh in meshes])
    triangles = [mesh.triangles + np.int32(start) for mesh, start in zip(meshes, starts, strict=False)]
    cull = [np.full(len(mesh.triangles), _culled(scene, mesh)) for mesh in meshes]
    return np.concatenate([mesh.positions for mesh in meshes]), np.concatenate(triangles), np.concatenate(cull)
