"""The paper's schemes by name: how they walk, what they are made of, and what set-up costs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from luxel.studies.shading.interpolators import CORRECTED, COUNTER, INTERLEAVED, ONE_WAY

ENDS, TRUNCATED, PLANE = "ends", "truncated", "plane"
"""Where a span's values come from: both ends are exact to half a unit, and the slope is their difference by the length, rounded to nearest; or
rounded down, as a division does that stops; or one pixel of the triangle is exact, and all others come from it by the plane's two slopes."""


class Machine(NamedTuple):
    """What is charged beside filling, in steps.

    Attributes:
        edge: Both edge interpolators go to the next row.
        divide: The slope of a span from its ends; also of a plane, twice a triangle.
        overlapped: A row is set up while the one before is filled.
    """

    edge: int = 1
    divide: int = 3
    overlapped: bool = False


class Resources(NamedTuple):
    """Interpolators, and adders beside them; each interpolator is an adder and a register for x, or for each channel.

    Attributes:
        edge: Interpolators of x and of the channels, down an edge.
        line: Interpolators of x, along a span.
        code: Interpolators of the channels, along a span.
        adders: Other adders, each for all channels.
    """

    edge: int
    line: int
    code: int
    adders: int

    def sums(self, channels: int) -> int:
        """Adders in all."""
        return self.edge * (1 + channels) + self.line + (self.code + self.adders) * channels


@dataclass(frozen=True)
class Scheme:
    """A way to fill a triangle.

    Attributes:
        name: In tables.
        way: How a span is walked, one of `interpolators`' four.
        lanes: With how many interpolators; of a wave, how many pixels a step, 0 for all that are active.
        kind: "spans", "wave" or "midlines".
        border: Of a wave: the border is drawn first.
        again: Of a wave: it starts anew until nothing is left. Without, it is the literal reading, which leaves pixels out.
        own_strides: Interleaved: the increment of n pixels is divided out, and rounded once, where the paper adds up rounded slopes.
    """

    name: str
    way: int = ONE_WAY
    lanes: int = 1
    kind: str = "spans"
    border: bool = True
    again: bool = True
    own_strides: bool = False

    def resources(self, units: int) -> Resources:
        """What it is made of, when it wrote up to `units` pixels in a step."""
        if self.kind == "wave":  # every active pixel has its interpolator, and a seed its adder
            return Resources(2 if self.border else 0, 0, units, 1)
        extra = max(self.lanes.bit_count() - 1, 0) if self.way == INTERLEAVED else int(self.way == CORRECTED)  # 3 dI = 2 dI + dI; the remainder
        lines = 2 if self.way == COUNTER else 1
        if self.kind == "midlines":
            return Resources(2, 4 * lines, self.lanes, extra + 3 * self.lanes)
        return Resources(2, lines, self.lanes, extra)


CLASSICAL = Scheme("classical")
COUNTERED = Scheme("counter", COUNTER, 2)
INTERLEAVES = tuple(Scheme(f"interleaved {n}", INTERLEAVED, n) for n in (2, 3, 4, 8, 16))
WAVE = Scheme("wave", lanes=0, kind="wave")
MIDLINES = Scheme("midlines", kind="midlines")
CONTROL = Scheme("EC-DDA", CORRECTED)
SCHEMES = (CLASSICAL, COUNTERED, *INTERLEAVES, WAVE, MIDLINES, CONTROL)
"""The paper's, and a control that it does not have: endpoint-corrected slopes."""

VARIANTS = (
    Scheme("wave of 4", lanes=4, kind="wave"),
    Scheme("wave of 16", lanes=16, kind="wave"),
    Scheme("wave, seeds only", lanes=0, kind="wave", border=False),
    Scheme("midlines of interleaved 4", INTERLEAVED, 4, kind="midlines"),
    Scheme("interleaved 4, own strides", INTERLEAVED, 4, own_strides=True),
)
"""Other readings and combinations, which cover exactly as well."""

LITERAL = (
    Scheme("wave, one seed", lanes=0, kind="wave", border=False, again=False),
    Scheme("wave, border, one seed", lanes=0, kind="wave", again=False),
)
"""The wave to the letter: it does not reach every pixel."""
