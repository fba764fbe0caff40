"""Inside: luxels that lie in solids, such as the floor under a box, found by what they see: the backs of one-sided surfaces.

A luxel of which only a part is inside, its middle too, is moved to where it is free. The others get no light of their own (it would leak out as dark
edges) and no part in the solution; the lightmap fills them from their neighbours.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.directions import cosine_directions, turned
from luxel.radiosity.element import spots_on
from luxel.radiosity.hemicube import frames_of
from luxel.radiosity.nearest import nearest
from luxel.radiosity.occlusion import Occlusion

_FIRST, _ALL = 4, 24  # rays, of which all are cast only where the first ones see any back
_CHUNK = 512
_FEW = 8  # rays of each spot of a luxel, where it is looked for a free place


@jit.parallel_kernel
def _look(queue, scene, position, frames, directions, few, any_tells, two_sided, reach, backs):
    scene = jit.borrow(scene)
    directions, frames = jit.borrow(directions), jit.borrow(frames)
    count = len(position)
    chunk = jit.take(queue)
    while chunk * _CHUNK < count:
        for i in range(chunk * _CHUNK, min(count, (chunk + 1) * _CHUNK)):
            x, y, z = np.float64(position[i, 0]), np.float64(position[i, 1]), np.float64(position[i, 2])
            met = back = 0
            for k in range(len(directions)):
                if (k == few and back == 0) or (any_tells and back > 0):
                    break
                dx, dy, dz = turned(frames[i], directions[k])
                hit, side, _ = nearest(scene, x, y, z, dx * reach, dy * reach, dz * reach)
                met += 1
                back += hit >= 0 and side > 0.0 and not two_sided[hit]
            backs[i] = back / met
        chunk = jit.take(queue)


def seen_backs(scene: Occlusion, two_sided: Array, position: Array, normal: Array, reach: float, threads: int) -> Array:
    """How much of what each point sees, weighted by its cosine, is backs of one-sided triangles.

    Args:
        scene: All triangles.
        two_sided: (m,) bool, of each.
        position, normal: (n, 3) float32: points, and the unit normals of the surface they are on.
        reach: Metres: no ray goes farther.

    Returns:
        (n,) float32, 0..1.
    """
    directions = cosine_directions(_ALL, _FIRST)
    backs = np.zeros(len(position), np.float32)
    jit.run(_look, threads, scene, position, frames_of(normal), directions, _FIRST, False, two_sided, reach, backs)
    return backs


def free_places(scene: Occlusion, two_sided: Array, position: Array, normal: Array, u: Array, v: Array, reach: float,
                threads: int) -> tuple[Array, Array]:  # fmt: skip
    """Where luxels whose middle is inside a solid are not.

    Args:
        position, normal: (n, 3) float32: middles, and the unit normals of the surface.
        u, v: (n, 3) float32, metres: the sides of each luxel.
        The others: as in `seen_backs`.

    Returns:
        (n, 3) float32 positions, the free point nearest to the middle of all free ones; and (n,) float32: how much of the luxel is free, 0..1.
    """
    points = spots_on(position, u, v)
    backs = np.zeros(points.shape[:2], np.float32)
    rays, frames = cosine_directions(_FEW, _FEW // 2), frames_of(normal)
    for k in range(len(points)):
        jit.run(_look, threads, scene, points[k], frames, rays, _FEW, True, two_sided, reach, backs[k])
    free = backs == 0
    share = free / np.maximum(free.sum(0), 1)
    middle = (points * share[:, :, None]).sum(0)
    apart = np.where(free, ((points - middle) ** 2).sum(2), np.inf)
    best = apart.argmin(0)
    return points[best, np.arange(len(position))], free.mean(0, dtype=np.float32)
