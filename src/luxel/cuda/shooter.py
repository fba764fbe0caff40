"""Progressive refinement on a GPU: the brightest patches are chosen and shoot there; the processor hears nothing but sums."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from luxel.cuda.threads.choose import GROUP, PARTS, Batch, Kept
from luxel.cuda.threads.shoot import Shots
from luxel.radiosity.solve import Problem, Rows, at_once

if TYPE_CHECKING:
    from luxel.cuda.labour import GpuLabour


def _rounds(patches: int, most: int) -> list[int]:
    """How many go on after each round of `luxel.cuda.threads.choose.pick`; the last has one group."""
    counts = [most * -(-patches // GROUP)]
    while counts[-1] > most:
        counts.append(most * -(-counts[-1] // GROUP))
    return counts


class Shooter:
    """Lets patches shoot, batch by batch.

    Args:
        labour: Who draws hemicubes and fills rows.
        problem: What is solved.
        rows: Where rows of the patches are kept; their numbers are kept here.
    """

    def __init__(self, labour: GpuLabour, problem: Problem, rows: Rows) -> None:
        gpu, source, there = labour.gpu, problem.patches, labour.there
        tree, patches, blocks = source.tree, len(source.tree.patches), rows.touched.shape[1]
        self.labour, self.gpu, self.kernels, self.problem, self.rows = labour, gpu, labour.kernels, problem, rows.rows
        self.most = b = at_once(patches)
        self.bright, self.candidates = gpu.empty((patches,), np.float64), gpu.empty((patches,), np.int32)
        self.rounds = [gpu.empty((count,), np.int32) for count in _rounds(patches, b)]
        self.batch = Batch(
            gpu.empty((b,), np.int32), gpu.empty((b,), np.int64), gpu.empty((b, 3), np.float32), gpu.empty((b, 3), np.float64),
        )  # fmt: skip
        self.kept = Kept(
            gpu.array(rows.slot), gpu.array(rows.touched), gpu.array(rows.scale), gpu.array(rows.lost), gpu.array(np.zeros(1, np.int64)), rows.kept
        )
        centers, frames, wanted = gpu.empty((b, 3), np.float32), gpu.empty((b, 3, 3), np.float32), gpu.empty((b,), np.bool_)
        self.cubes = labour.cubes(problem.occluders, source.resolution, problem.near, centers, frames, wanted)
        self.shooters = there(tuple(source.shooters))
        self.node, self.escapes = gpu.empty((b,), np.int32), gpu.empty((b, 2), np.uint64)
        span, child, place = there((tree.span, tree.child, tree.place))
        self.shots = Shots(span, child, place, there(source.numbers), self.node, self.batch.slots)
        self.sums, self.shares = gpu.empty((b, blocks), np.float64), gpu.empty((b, PARTS), np.float64)
        self.gained = gpu.empty((3, rows.rows.shape[1]), np.float32)
        self.rays = problem.rays if problem.rays.always else problem.rays._replace(number=0)

    def shoot(self, power: Any) -> tuple[Batch, Any]:
        """Let the brightest patches shoot, of `power` (p, 3) float64 W. Returns who, and what elements gain, (3, n) float32; all on the GPU."""
        self._choose(power)
        launch, k, problem, batch, b = self.gpu.launch, self.kernels, self.problem, self.batch, self.most
        launch(k.place_rows, (1, 1), batch, self.kept, self.cubes.wanted)
        launch(k.aim_shooters, (b, 1), batch, self.shooters, self.node, self.cubes, self.escapes)
        self.labour.draw(self.cubes, self.escapes)
        self.labour.fill(problem.own, problem.occluders, self.rays, self.shots, self.cubes, self.rows, self.sums)
        launch(k.share_rows, (PARTS, b), batch, self.cubes, self.sums, self.kept, self.shares)
        launch(k.settle_rows, (b, 1), batch, self.cubes, self.node, self.shots.place, power, self.shares, self.escapes, self.kept)
        launch(k.receive_rows, (self.gained.shape[1], 1), batch.slots, self.rows, self.kept.touched, batch.powers, self.gained)
        return batch, self.gained

    def _choose(self, power: Any) -> None:
        launch, k, candidates = self.gpu.launch, self.kernels, self.candidates
        launch(k.find_bright, (len(candidates), 1), power, self.bright, candidates)
        for winners in self.rounds:
            launch(k.clear_winners, (len(winners), 1), winners)
            launch(k.pick, (len(candidates), 1), self.bright, candidates, self.most, winners)
            candidates = winners
        launch(k.line_up, (self.most, 1), candidates, self.batch)
