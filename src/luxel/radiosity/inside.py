"""Inside: luxels that lie in solids, such as the floor under a box, found by what they see: the backs of one-sided surfaces.

A luxel of which only a part is inside, its middle too, is moved to where it is free. The others get no light of their own (it would leak out as dark
edges) and no part in the solution; the lightmap fills them from their neighbours.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.jit import float_bits
from luxel.radiosity import packet
from luxel.radiosity.directions import cosine_directions, turned
from luxel.radiosity.element import samples_on
from luxel.radiosity.hemicube import frames_of
from luxel.radiosity.occlusion import Occlusion
from luxel.radiosity.packet import AT, DX, DY, DZ, FOUND, OX, OY, OZ, SLOPE, WIDTH

MOST_BACKS = 0.5
"""What sees more of them is inside a solid."""

_FIRST, _ALL = 4, 24  # rays, of which all are cast only where the first ones see any back
_FEW = 8  # rays of each sample of a luxel, where it is looked for a free place
_AT_ONCE = 1 << 14  # luxels, where it is


@jit.parallel_kernel
def _look(queue, scene, position, frames, directions, two_sided, side, reach, backs, outdoors):
    own_c, own_stack = np.zeros(packet.SCRATCH, np.float32), np.zeros(packet.STACK, np.int32)
    c, stack, scene, position = jit.borrow(own_c), jit.borrow(own_stack), jit.borrow(scene), jit.borrow(position)
    directions, frames, backs, outdoors = jit.borrow(directions), jit.borrow(frames), jit.borrow(backs), jit.borrow(outdoors)
    count = len(position)
    chunk = jit.take(queue)
    while chunk * WIDTH < count:
        first = chunk * WIDTH
        for k in range(len(directions)):
            for r in range(np.uint64(WIDTH)):
                i = min(first + np.int64(r), count - 1)  # the last packet is filled up with its last point's rays
                c[OX + r], c[OY + r], c[OZ + r] = position[i, 0], position[i, 1], position[i, 2]
                c[DX + r], c[DY + r], c[DZ + r] = turned(frames[i], directions[k])
                c[AT + r] = reach
            packet.meet_all(scene, c, stack)
            for r in range(np.uint64(min(WIDTH, count - first))):
                item = float_bits(c[FOUND + r])
                backs[first + np.int64(r)] += item >= 0 and side * c[SLOPE + r] > np.float32(0.0) and not two_sided[scene.triangle[item]]
                outdoors[first + np.int64(r)] |= item < 0
        chunk = jit.take(queue)
    own_c[0] = own_stack[0]  # they live until here


def _backs(scene: Occlusion, two_sided: Array, position: Array, normal: Array, directions: Array, reach: float, threads: int,
           side: float = 1.0) -> tuple[Array, Array]:  # fmt: skip
    """(n,) int32: how many of the directions (k, 3), in frames of n points, show the back of a one-sided triangle, or its front if `side` is -1, and
    (n,) bool: whether any shows nothing; neighbours among points are best together. The others as in `seen_backs`."""
    backs, outdoors = np.zeros(len(position), np.int32), np.zeros(len(position), np.bool_)
    given = position, frames_of(normal), directions.astype(np.float32), two_sided, np.float32(side), np.float32(reach)
    jit.run(_look, threads, scene, *given, backs, outdoors)
    return backs, outdoors


def seen_backs(scene: Occlusion, two_sided: Array, position: Array, normal: Array, reach: float, threads: int) -> Array:
    """How much of what each point sees, weighted by its cosine, is backs of one-sided triangles. Nothing for who sees the open: what lies below
    a sheet that hangs over it is in no solid.

    Args:
        scene: All triangles.
        two_sided: (m,) bool, of each.
        position, normal: (n, 3) float32: points, and the unit normals of the surface they are on.
        reach: Metres: no ray goes farther.

    Returns:
        (n,) float32, 0..1.
    """
    directions = cosine_directions(_ALL, _FIRST)
    backs, outdoors = _backs(scene, two_sided, position, normal, directions[:_FIRST], reach, threads)
    some = np.flatnonzero((backs > 0) & ~outdoors)
    share = np.zeros(len(position), np.float32)
    more, outdoors = _backs(scene, two_sided, position[some], normal[some], directions[_FIRST:], reach, threads)
    share[some] = np.where(outdoors, 0, backs[some] + more) / _ALL
    return share


def look_out(scene: Occlusion, shell: Array, position: Array, normal: Array, behind: bool, rays: int, reach: float, threads: int) -> Array:
    """(n,) int32: by how many of so many rays each point sees anything but the shell from inside.

    Args:
        shell: (m,) bool: two-sided triangles; of these the points are backs, if they are `behind`, and else fronts.
        The others: as in `seen_backs`.
    """
    return rays - _backs(scene, ~shell, position, normal, cosine_directions(rays), reach, threads, 1.0 if behind else -1.0)[0]


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
    places, shares = np.empty_like(position), np.empty(len(position), np.float32)
    for first in range(0, len(position), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        points = samples_on(position[some], u[some], v[some])
        is_free = _free(scene, two_sided, points, normal[some], reach, threads)
        share = is_free / np.maximum(is_free.sum(0), 1)
        middle = (points * share[:, :, None]).sum(0)
        best = np.where(is_free, ((points - middle) ** 2).sum(2), np.inf).argmin(0)
        places[some], shares[some] = points[best, np.arange(len(best))], is_free.mean(0, dtype=np.float32)
    return places, shares


def _free(scene: Occlusion, two_sided: Array, points: Array, normal: Array, reach: float, threads: int) -> Array:
    """(samples, n) bool: which samples (samples, n, 3) of n luxels see no backs."""
    samples = np.ascontiguousarray(points.transpose(1, 0, 2)).reshape(-1, 3)  # those of a luxel together
    normals, free = np.repeat(normal, len(points), 0), np.arange(len(samples))
    for directions in np.split(cosine_directions(_FEW, _FEW // 2), [1, _FEW // 2]):  # the first tells of most
        free = free[_backs(scene, two_sided, samples[free], normals[free], directions, reach, threads)[0] == 0]
    result = np.zeros((len(normal), len(points)), np.bool_)
    result.flat[free] = True
    return result.T
