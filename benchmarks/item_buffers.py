"""Two ways for a shooter to see: the hemicube, and the paper's projection of vertices to a hemisphere. What each costs, and how much it shows wrong.

    python benchmarks/item_buffers.py            # print
    python benchmarks/item_buffers.py --write    # and put the table into RESULTS.md
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from luxel.radiosity.hemicube import FACES, delta_form_factors, frames_of, see
from luxel.radiosity.hemisphere import see_hemisphere
from luxel.radiosity.nearest import nearest
from luxel.radiosity.occlusion import prepare
from luxel.raster.geometry import flatten
from luxel.scene.builtin import SCENES
from report import alternating, machine, median, table, write_section

_SHOOTERS = 32
_ASKED = 1500  # pixels of a shooter, drawn at random by how much they weigh, whose ray is cast
_NEAR = 1e-3


def shooters(positions: Any, triangles: Any, rng: Any) -> tuple[Any, Any]:
    """Points on the surface, a hair above it, and their frames."""
    a, b, c = (positions[triangles[:, k]].astype(float) for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    which = rng.choice(len(triangles), _SHOOTERS, p=area / area.sum())
    unit = normal[which] / area[which, None]
    return ((a + b + c)[which] / 3 + 1e-4 * unit).astype(np.float32), frames_of(unit)


def planes_of(positions: Any, triangles: Any) -> Any:
    """(m + 1,) int64: which plane each triangle lies in; last, none, for what shows nothing."""
    a, b, c = (positions[triangles[:, k]].astype(float) for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    _, plane = np.unique(np.round(np.column_stack([normal, (normal * a).sum(1)]), 4), axis=0, return_inverse=True)
    return np.append(plane.ravel(), -1)


def cube_ways(resolution: int) -> Any:
    """(5, n, n, 3) float64: the direction of each pixel of a hemicube, in its shooter's frame."""
    at = (np.arange(resolution) + 0.5) / resolution * 2 - 1
    x, y = np.meshgrid(at, -at)
    one = np.ones_like(x)
    return np.stack([np.stack(face, -1) for face in ((x, y, one), (one, x, y), (-one, x, y), (x, one, y), (x, -one, y))])


def disc_ways(resolution: int) -> tuple[Any, Any]:
    """(n, n, 3) float64 directions of a disc's pixels, and how much each weighs: as much as any other within the disc."""
    at = (np.arange(resolution) + 0.5) / resolution * 2 - 1
    x, y = np.meshgrid(at, -at)
    inside = x**2 + y**2 < 1
    return np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], -1), inside / inside.sum()


def shown_wrong(rays: Any, planes: Any, ids: Any, ways: Any, weights: Any, centers: Any, frames: Any, rng: Any) -> float:
    """The share of form factor whose pixel shows another plane than its ray meets; ids (s, pixels), ways (pixels, 3), weights (pixels,)."""
    wrong = []
    for seen, center, frame in zip(ids, centers.astype(float), frames.astype(float), strict=True):
        for pixel in rng.choice(len(weights), _ASKED, p=weights):
            way = 100 * ways[pixel] @ frame
            met = nearest(rays, *map(float, center), *map(float, way))[0]
            wrong.append(planes[met] != planes[max(seen[pixel], -1)])
    return float(np.mean(wrong))


def rows_of(name: str, repeats: int) -> list[list[str]]:
    geometry, rng = flatten(SCENES[name](), "none"), np.random.default_rng(0)
    positions, triangles = geometry.positions, geometry.triangles
    planar, rays, planes = np.ascontiguousarray(positions.T), prepare(positions, triangles), planes_of(positions, triangles)
    centers, frames = shooters(positions, triangles, rng)
    rows = []
    for resolution in (32, 64, 128):
        sizes = np.full(_SHOOTERS, resolution)
        cube, disc = alternating(
            repeats, lambda sizes=sizes: see(planar, triangles, centers, frames, sizes, _NEAR, 1),
            lambda n=resolution: see_hemisphere(planar, triangles, centers, frames, n, _NEAR, 1),
        )  # fmt: skip
        seen = see(planar, triangles, centers, frames, sizes, _NEAR, 1)
        cube_ids = seen.ids[: seen.start[-1]].reshape(_SHOOTERS, FACES * resolution**2)
        disc_ids = see_hemisphere(planar, triangles, centers, frames, resolution, _NEAR, 1)[0].reshape(_SHOOTERS, -1)
        ways, weights = disc_ways(resolution)
        factors = delta_form_factors(resolution).ravel()
        errors = (
            shown_wrong(rays, planes, cube_ids, cube_ways(resolution).reshape(-1, 3), factors / factors.sum(), centers, frames, rng),
            shown_wrong(rays, planes, disc_ids, ways.reshape(-1, 3), weights.ravel(), centers, frames, rng),
        )
        times = [f"{1e3 * median(seconds) / _SHOOTERS:.3f}" for seconds in (cube, disc)]
        rows.append([name, f"{len(triangles):,}", str(resolution), *times, *(f"{error:.2%}" for error in errors)])
        print("  ".join(rows[-1]), flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--write", action="store_true", help="put the table into RESULTS.md")
    options = parser.parse_args()
    print(machine(), flush=True)
    head = ["scene", "triangles", "pixels across", "hemicube, ms", "hemisphere, ms", "hemicube, wrong", "hemisphere, wrong"]
    text = table(head, [row for name in ("room-simple", "room-complex") for row in rows_of(name, options.repeats)])
    text += (
        f"\n\nMilliseconds a shooter on one thread, medians of {options.repeats}, of {_SHOOTERS} shooters at random on the surfaces. Wrong: the "
        f"share of form factor whose pixel shows another plane than a ray through its middle meets ({_ASKED} rays a shooter). A hemicube has five "
        "faces of so many pixels across; a hemisphere is one picture, in which the edges of large triangles stay straight where they should bend."
    )
    print(text)
    if options.write:
        write_section("Bake: hemicube and hemisphere", f"{machine()}.\n\n{text}")


if __name__ == "__main__":
    main()
