"""Modules 4 and 5 of the hardware paper: barycentric coordinates of a fragment, and its colour."""

from __future__ import annotations

from amaranth import C, Cat, unsigned

from luxel.hardware.float24 import FLOAT24, ONE
from luxel.hardware.interpolator import LUXEL, Precision
from luxel.hardware.rtl.floats import Add, FromInteger, Multiply
from luxel.hardware.rtl.pipeline import Operator, Pipeline, Timed

_WORD = unsigned(FLOAT24.bits)
CORNERS, CHANNELS = "abc", "rgb"
COLORS = tuple(f"{channel}_{corner}" for corner in CORNERS for channel in CHANNELS)


class Barycentrics(Operator):
    """beta = l_ca / 2A, gamma = l_ab / 2A, alpha = (1 - beta) - gamma: two multiplications and two additions.

    Args:
        width: Bits of an edge function inside a triangle.
        precision: Formats of the edge functions and of 1 / 2A.
    """

    def __init__(self, width: int, precision: Precision = LUXEL) -> None:
        self.width, self.precision = width, precision
        shapes = {"l_ca": unsigned(width), "l_ab": unsigned(width), "inverse": unsigned(precision.reciprocal_format.bits)}
        super().__init__(f"barycentrics_{width}_{precision.edge}_{precision.reciprocal}", shapes)

    def build(self, p: Pipeline, l_ca: Timed, l_ab: Timed, inverse: Timed) -> dict[str, Timed]:
        """Float24."""
        e, r = self.precision.edge_format, self.precision.reciprocal_format
        beta, gamma = (
            p.call(Multiply(FLOAT24, e, r), a=p.call(FromInteger(self.width, e), v=edge), b=inverse)
            for edge in (l_ca, l_ab)
        )  # fmt: skip
        rest = p.call(Add(FLOAT24), a=Timed(C(ONE, FLOAT24.bits), 0), b=negated(beta))
        alpha = p.call(Add(FLOAT24), a=rest, b=negated(gamma))
        return {"alpha": alpha, "beta": beta, "gamma": gamma}


class Color(Operator):
    """(alpha Ca + beta Cb) + gamma Cc in three channels: each three multiplications and two additions."""

    def __init__(self) -> None:
        shapes = dict.fromkeys(("alpha", "beta", "gamma", *COLORS), _WORD)
        super().__init__("color", shapes)

    def build(self, p: Pipeline, alpha: Timed, beta: Timed, gamma: Timed, **colors: Timed) -> dict[str, Timed]:
        """Float24."""
        return {
            channel: p.call(Channel(), alpha=alpha, beta=beta, gamma=gamma, **{corner: colors[f"{channel}_{corner}"] for corner in CORNERS})
            for channel in CHANNELS
        }


class Channel(Operator):
    """One channel of a colour."""

    def __init__(self) -> None:
        super().__init__("channel", dict.fromkeys(("alpha", "beta", "gamma", *CORNERS), _WORD))

    def build(self, p: Pipeline, alpha: Timed, beta: Timed, gamma: Timed, a: Timed, b: Timed, c: Timed) -> dict[str, Timed]:
        """Float24."""
        first, second, third = (p.call(Multiply(FLOAT24), a=weight, b=color) for weight, color in ((alpha, a), (beta, b), (gamma, c)))
        both = p.call(Add(FLOAT24), a=first, b=second)
        return {"value": p.call(Add(FLOAT24), a=both, b=third)}


def negated(word: Timed) -> Timed:
    """With its sign turned."""
    return Timed(Cat(word.value[:-1], ~word.value[-1]), word.time)
