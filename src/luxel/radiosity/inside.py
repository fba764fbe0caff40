"""Inside: luxels that lie in solids, such as the floor under a box, found by what they see: the backs of one-sided surfaces.

They get no light of their own (it would leak out as dark edges) and no part in the solution; the lightmap fills them from their neighbours.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.radiosity.directions import cosine_directions, turned
from luxel.radiosity.hemicube import frames_of
from luxel.radiosity.nearest import nearest
from luxel.radiosity.occlusion import Occlusion

_FIRST, _ALL = 4, 24  # rays, of which all are cast only where the first ones see any back
_CHUNK = 512


@jit.parallel_kernel
def _look(queue, scene, position, frames, directions, two_sided, reach, backs):
    scene = jit.borrow(scene)
    directions, frames = jit.borrow(directions), jit.borrow(frames)
    count = len(position)
    chunk = jit.take(queue)
    while chunk * _CHUNK < count:
        for i in range(chunk * _CHUNK, min(count, (chunk + 1) * _CHUNK)):
            x, y, z = np.float64(position[i, 0]), np.float64(position[i, 1]), np.float64(position[i, 2])
            met = back = 0
            for k in range(_ALL):
                if k == _FIRST and back == 0:
                    break
                dx, dy, dz = turned(frames[i], directions[k])
                hit, side = nearest(scene, x, y, z, dx * reach, dy * reach, dz * reach)
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
    jit.run(_look, threads, scene, position, frames_of(normal), directions, two_sided, reach, backs)
    return backs
