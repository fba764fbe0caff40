"""What each way of anti-aliasing costs, and how near it comes to what is right: error over time, scene by scene."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import luxel
from luxel.arrays import Array
from luxel.filter import coverage, lowpass
from luxel.filter.antialias import decimate
from luxel.filter.metrics import edge_pixels, edge_rmse, ssim
from luxel.raster.render import Prepared
from luxel.scene.builtin.bumpy import bumpy_sphere_scene
from luxel.scene.builtin.paper import two_triangles
from luxel.scene.colour import bytes_from_linear
from luxel.studies.report import Report
from luxel.studies.study import Context

Draw = Callable[[Prepared, Any, int], Array]


class Mode(NamedTuple):
    """A way of anti-aliasing: its name, its family, and what draws (h, w, 4) float32, linear and premultiplied, from a scene, a camera and a size."""

    name: str
    family: str
    draw: Draw


def _render(prepared: Prepared, camera: Any, size: int, **options: Any) -> Array:
    picture = luxel.render(prepared, camera, (size, size), outputs="linear", background=(0.02, 0.02, 0.02), **options).linear
    assert picture is not None
    return picture


def _drawn(**options: Any) -> Draw:
    return lambda prepared, camera, size: _render(prepared, camera, size, **options)


def _decimated(rate: int) -> Draw:
    return lambda prepared, camera, size: decimate(_render(prepared, camera, size * rate), rate)


def _blurred(sigma: float) -> Draw:
    return lambda prepared, camera, size: lowpass(_render(prepared, camera, size), gaussian=sigma)


def modes() -> list[Mode]:
    """Every way that luxel has, and the paper's blurred edge: a filter after the picture is sampled."""
    found = [Mode("none", "none", _drawn(samples=1))]
    found += [Mode(f"MSAA {n}", "MSAA", _drawn(samples=n)) for n in (2, 4, 8, 16)]
    found += [Mode("MSAA 4, grid", "MSAA, the paper's grid", _drawn(samples=4, pattern="grid"))]
    found += [Mode(f"SSAA {n}x{n}", "SSAA", _drawn(ssaa=n)) for n in (2, 3, 4, 8)]
    filters = ("tent", "gaussian", "mitchell", "blackman-harris")
    found += [Mode(f"MSAA 16, {name}", "MSAA, wider filters", _drawn(samples=16, filter=name)) for name in filters]
    found += [Mode(f"low-pass, {n}x{n}", "low-pass and decimate", _decimated(n)) for n in (2, 4)]
    found += [Mode(f"blurred after, sigma {s}", "blurred after", _blurred(s)) for s in (0.5, 1.0)]
    return found


def reference(prepared: Prepared, camera: Any, size: int) -> Array:
    """The mean of 256 shaded samples a pixel: 8 x 8 of a picture of twice the size, and of that two by two pixels."""
    fine = _render(prepared, camera, 2 * size, ssaa=8)
    return fine.reshape(size, 2, size, 2, 4).mean((1, 3), dtype=np.float32)


def zone_plate_scene(rings: int = 40, segments: int = 360) -> tuple[luxel.Scene, luxel.Camera]:
    """A Fresnel zone plate of triangles: white rings whose pitch falls with the radius, before nothing; seen from straight above."""
    radius = np.sqrt(np.arange(2 * rings + 1) / (2 * rings))
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    around = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    inner = np.arange(segments)
    following = (inner + 1) % segments
    quads = np.concatenate([np.stack([inner, inner + segments, following], -1), np.stack([following, inner + segments, following + segments], -1)])
    positions = np.concatenate([around * r for k in range(rings) for r in radius[2 * k : 2 * k + 2]])
    triangles = np.concatenate([quads + 2 * k * segments for k in range(rings)])
    scene = luxel.Scene(name="zone plate")
    scene.add(luxel.Mesh(positions, triangles), luxel.Material(shading="unlit", double_sided=True))
    return scene, luxel.Camera.look_at((0, 0, 2), (0, 0, 0), yfov=None, height=2.02, near=0.1, far=10)


def floor_scene(squares: int = 160) -> tuple[luxel.Scene, luxel.Camera]:
    """A checkerboard floor to the horizon: every second square, as triangles."""
    x, z = np.meshgrid(np.arange(squares) - squares // 2, -np.arange(squares))
    white = (x + z) % 2 == 0
    x, z = x[white], z[white]
    corners = np.stack([np.stack([x + i, 0 * x, z - j], -1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], 1)
    triangles = np.concatenate([4 * np.arange(len(x))[:, None] + np.array(half) for half in ((0, 1, 2), (0, 2, 3))])
    scene = luxel.Scene(name="checkerboard floor")
    scene.add(luxel.Mesh(corners.reshape(-1, 3).astype(float), triangles), luxel.Material(shading="unlit", double_sided=True))
    camera = luxel.Camera.look_at((0.3, 1.2, 1), (0.3, 0.6, -6), yfov=np.radians(50), near=0.1, far=1000)
    return scene, camera


def scenes(context: Context, size: int) -> dict[str, tuple[luxel.Scene, Any]]:
    """The paper's triangles, a zone plate, a floor to the horizon, and a fine mesh: the dragon, where there is a folder with it."""
    paper = two_triangles()
    found = {"two triangles": (paper, paper.cameras[0]), "zone plate": zone_plate_scene(), "checkerboard floor": floor_scene()}
    dragon = None if context.meshes is None else context.meshes / "dragon_vrip.ply"
    if dragon is not None and dragon.exists() and not context.quick:
        mesh = luxel.load(dragon)
        found["dragon"] = mesh, luxel.camera_for(mesh, (size, size))
    else:
        mesh = bumpy_sphere_scene(60)
        found["bumpy sphere"] = mesh, luxel.camera_for(mesh, (size, size))
    return found


def run(context: Context, report: Report) -> None:
    """Every mode on every scene: its time, and its error against 256 samples and, where that can be had, against exact areas."""
    size, repeats = (160, 3) if context.quick else (400, 7)
    report.say(f"## Quality against cost\n\n{size} x {size} pixels, {context.threads} threads, linear light. The error is the RMSE over edge pixels "
               "against the mean of 256 shaded samples a pixel.")  # fmt: skip
    rows: list[dict[str, Any]] = []
    strips = []
    for name, (scene, camera) in scenes(context, size).items():
        prepared = luxel.prepare(scene)
        right = reference(prepared, camera, size)
        edges = edge_pixels(right)
        exact = _exact(scene, camera, size) if name == "two triangles" else None
        times, pictures = _timed(prepared, camera, size, repeats)
        for mode in modes():
            picture = pictures[mode.name]
            row = {"scene": name, "mode": mode.name, "family": mode.family, "time, ms": 1e3 * times[mode.name]}
            row |= {"edge RMSE": edge_rmse(picture[..., :3], right[..., :3], edges), "SSIM": ssim(picture[..., :3], right[..., :3])}
            if exact is not None:
                row["edge RMSE, exact areas"] = edge_rmse(picture[..., :3], exact[0], exact[1])
            rows.append(row)
        if exact is not None:
            row = {"scene": name, "mode": "256 samples", "family": "reference", "edge RMSE, exact areas": edge_rmse(right[..., :3], *exact)}
            rows.append(row)
        strips.append(_strip(pictures, right, size))
    report.table("quality", "Error and time of every mode", rows)
    report.picture("quality", "None, MSAA 4, SSAA 4x4, low-pass 4x4, blurred after (sigma 1), and 256 samples", np.concatenate(strips),
                   "A piece of each scene, row by row, enlarged.")  # fmt: skip
    _figure(report, rows)


def _timed(prepared: Prepared, camera: Any, size: int, repeats: int) -> tuple[dict[str, float], dict[str, Array]]:
    """Median seconds of each mode, in turns, and its picture."""
    pictures = {mode.name: mode.draw(prepared, camera, size) for mode in modes()}  # the first call compiles
    taken: dict[str, list[float]] = {mode.name: [] for mode in modes()}
    for _ in range(repeats):
        for mode in modes():
            start = time.perf_counter()
            mode.draw(prepared, camera, size)
            taken[mode.name].append(time.perf_counter() - start)
    return {name: statistics.median(times) for name, times in taken.items()}, pictures


def _exact(scene: luxel.Scene, camera: Any, size: int) -> tuple[Array, Array]:
    """The picture by exact areas, and its edge pixels; the nearest triangle is the scene's first."""
    corners = np.array([mesh.positions for mesh in scene.meshes])
    colors = [mesh.colors[0, :3] for mesh in scene.meshes if mesh.colors is not None]
    places, _ = coverage.on_screen(corners, camera, (size, size))
    return coverage.exact_picture(places, colors, (0.02, 0.02, 0.02), (size, size))


def _strip(pictures: dict[str, Array], right: Array, size: int) -> Array:
    """The same piece of several pictures, side by side, three times as large."""
    names = ("none", "MSAA 4", "SSAA 4x4", "low-pass, 4x4", "blurred after, sigma 1.0")
    side = min(72, size)
    detail = np.abs(pictures["none"] - right).sum(-1)  # the piece where most is wrong
    rows, columns = range(0, size - side + 1, 8), range(0, size - side + 1, 8)
    total = np.cumsum(np.cumsum(np.pad(detail, ((1, 0), (1, 0))), 0), 1)
    wrong = {(y, x): total[y + side, x + side] - total[y, x + side] - total[y + side, x] + total[y, x] for y in rows for x in columns}
    y, x = max(wrong, key=lambda place: wrong[place])
    pieces = [bytes_from_linear(p[y : y + side, x : x + side, :3]) for p in (*(pictures[name] for name in names), right)]
    return np.concatenate([np.repeat(np.repeat(piece, 3, 0), 3, 1) for piece in pieces], 1)


def _figure(report: Report, rows: list[dict[str, Any]]) -> None:
    """One plot: a colour a family, a marker a scene."""
    names = list(dict.fromkeys(row["scene"] for row in rows))
    families = list(dict.fromkeys(row["family"] for row in rows if "time, ms" in row))
    with report.figure("tradeoff", "Error against time", "Lower left is better. Lines join the modes of a family on one scene.", (10.0, 6.0)) as axes:
        for k, family in enumerate(families):
            for name, marker in zip(names, "o^sD", strict=False):
                chosen = [row for row in rows if row["scene"] == name and row["family"] == family and "time, ms" in row]
                label = family if name == names[0] else None
                axes.plot([r["time, ms"] for r in chosen], [r["edge RMSE"] for r in chosen], marker=marker, color=f"C{k}", lw=0.8, label=label)
        for name, marker in zip(names, "o^sD", strict=False):
            axes.plot([], [], marker=marker, color="grey", ls="", label=name)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("time of a picture, ms")
        axes.set_ylabel("RMSE of edge pixels against 256 samples")
