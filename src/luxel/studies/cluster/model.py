"""The model: seconds and bytes of a frame, divided over ranks.

A rank's drawing is a sum over triangles, covered pixels and tiles, each with a measured price. A message takes the network's latency and its bytes
over the bandwidth; a rank's messages of a round go one after the other, different ranks' at the same time. Whoever is last in a step is waited for;
steps in which all ranks agree take a tree of messages.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.cluster.plan import cut
from luxel.cluster.shares import group_count
from luxel.studies.cluster.facts import Facts
from luxel.studies.cluster.messages import claims, owners, rounds

DIVISIONS = ("screen, static", "screen", "objects", "both")
_STEPS = {"screen, static": 1, "screen": 2}  # of agreement in a frame
_STEPS_SHARED = 9  # the same where triangles are shared: costs, modes, tiles, claims and colours (lengths and all), places, figures


class Costs(NamedTuple):
    """Seconds of one thread.

    Attributes:
        frame: Of every frame.
        triangle: Of a triangle that is projected, binned and covered.
        visible: Of a triangle that is seen, in a tile: made ready for shading.
        pixel: Of a covered pixel: shaded and written.
        tile: Of a tile.
        skipped: Of a triangle that is left out with its 256 neighbours, since it cannot touch a rank's tiles.
        sample: Of a sample that is packed, sent and merged.
        owned: Of a covered pixel more, where triangles are shared: numbered for all, claimed, sent back and put into its place.
        byte: Of a byte that ranks exchange, beside the network: laid out, into fresh memory, and taken apart.
        travel: Of a covered pixel, of a rank's part of them, that comes from others: what the rest leaves out, such as waiting in every step.
        call: Of a message, in Python, beside the network's latency.
        step: Of two ranks that agree on something.
    """

    frame: float
    triangle: float
    visible: float
    pixel: float
    tile: float
    skipped: float
    sample: float
    owned: float
    byte: float
    travel: float
    call: float
    step: float


class Memory(NamedTuple):
    """Bytes of a rank: of any, of each triangle that it holds, and of each pixel of the screen."""

    base: float
    triangle: float
    pixel: float


class Network(NamedTuple):
    """Seconds of an empty message, and bytes a second, of each rank."""

    name: str
    latency: float
    bandwidth: float

    def send(self, messages: float, size: float, call: float = 0.0) -> float:
        """Seconds of so many messages of so many bytes in all, one after the other."""
        return messages * (self.latency + call) + size / self.bandwidth


class Frame(NamedTuple):
    """What a frame takes.

    Attributes:
        draw: Seconds of the slowest rank's drawing.
        mean: Of the mean rank's.
        compose: Seconds of composition, of claims and of the colours' way back.
        glue: Seconds until rank 0 has the picture.
        agree: Seconds of steps in which all ranks agree.
        composed: Bytes that a rank sends to composite, in the mean.
        memory: Bytes of the largest rank.
    """

    draw: float
    mean: float
    compose: float
    glue: float
    agree: float
    composed: float
    memory: float

    @property
    def seconds(self) -> float:
        """All of it."""
        return self.draw + self.compose + self.glue + self.agree


def alone(facts: Facts, costs: Costs) -> float:
    """Seconds of one rank."""
    return float(_tile_costs(facts, costs).sum()) + costs.frame


def _tile_costs(facts: Facts, costs: Costs) -> Array:
    drawn = facts.tile_triangles * facts.weight * costs.triangle + facts.seen * costs.visible
    return drawn + facts.tile_pixels * costs.pixel + costs.tile


def frame(facts: Facts, division: str, ranks: int, costs: Costs, memory: Memory, network: Network, composition: str = "radix",
          cores: int | None = None) -> Frame:  # fmt: skip
    """A frame divided over ranks.

    Args:
        facts: Of the frame.
        division: One of `DIVISIONS`.
        ranks: How many.
        costs, memory: Of the machine.
        network: Between ranks.
        composition: Where triangles are shared.
        cores: That the ranks share; None: each has its own.
    """
    pixels = facts.size[0] * facts.size[1]
    groups = {"objects": 1, "both": group_count(ranks)}.get(division, ranks)
    per_group = max(1, ranks // groups)
    work = _tile_costs(facts, costs)
    cuts = cut(np.ones(facts.tiles) if division.endswith("static") else work, np.ones(groups))
    inside = np.add.reduceat(np.append(work, 0.0), cuts[:-1]) * (np.diff(cuts) > 0)
    skipped = facts.all_triangles * costs.skipped if groups > 1 else 0.0
    if per_group == 1 and division not in ("objects", "both"):
        each = inside + skipped + costs.frame
    else:
        shares = np.bincount(owners(facts, per_group), minlength=per_group) / max(1, len(facts.owner))
        shaded = facts.tile_pixels.sum() * (costs.pixel + costs.owned) + facts.seen.sum() * costs.visible
        triangles = facts.tile_triangles.sum() * facts.weight * costs.triangle / per_group
        busiest = inside.max() / max(inside.mean(), 1e-12)
        each = (triangles + shaded * shares + facts.tiles * costs.tile) / groups * busiest + skipped / per_group + costs.frame
    crowd = max(1.0, ranks / cores) if cores else 1.0
    compose, composed = (0.0, 0.0) if per_group == 1 else _compose(facts, per_group, groups, costs, network, composition, crowd)
    glue = 0.0 if ranks == 1 else network.send(ranks - 1, 4 * pixels * (1 - 1 / ranks), costs.call)
    agree = _STEPS.get(division, _STEPS_SHARED) * math.log2(ranks) * (costs.step + network.latency)
    held = facts.all_triangles / per_group
    whole = memory.base + memory.triangle * held + memory.pixel * pixels
    return Frame(_drawn(each, crowd), float(each.mean()), compose, glue, agree, composed, whole)


def _drawn(each: Array, crowd: float) -> float:
    """Seconds until all have drawn; ranks that are more than cores take turns."""
    return float(max(each.max(), each.mean() * crowd))


def _compose(facts: Facts, ranks: int, groups: int, costs: Costs, network: Network, composition: str, crowd: float) -> tuple[float, float]:
    seconds = composed = 0.0
    for step in rounds(facts, ranks, composition, groups):
        most = max(int(step.sent.max()), int(step.got.max()))
        seconds += network.send(2 * step.partners, most, costs.call) + crowd * (costs.sample / 8 + costs.byte) * most
        composed += float(step.sent.mean())
    asked, colours = claims(facts, ranks, groups)
    seconds += crowd * costs.travel * colours / 12
    return seconds + network.send(2 * (ranks - 1), asked + colours, costs.call) + crowd * costs.byte * (asked + colours), composed


def row(name: str, made: Frame, ranks: int, one: float) -> dict[str, Any]:
    """A row of a table."""
    return {"division": name, "ranks": ranks, "ms": 1e3 * made.seconds, "draw, ms": 1e3 * made.draw, "compose, ms": 1e3 * made.compose,
            "glue, ms": 1e3 * made.glue, "agree, ms": 1e3 * made.agree, "efficiency": one / made.seconds / ranks,
            "composed, MB a rank": made.composed / 1e6, "memory, MB a rank": made.memory / 1e6}  # fmt: skip
