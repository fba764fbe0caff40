"""What is synthesised: the paper's five modules, each with a stream at either end, and the whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from luxel.errors import InputError


@dataclass(frozen=True)
class Design:
    """A circuit that can stand by itself.

    Attributes:
        name: As reports have it.
        top: Of its outermost module.
        make: Makes it, an Amaranth component with the streams `i` and `o`.
        per_fragment: Whether it has to take one thing a clock for a fragment a clock; else one a triangle.
    """

    name: str
    top: str
    make: Callable[[], Any]
    per_fragment: bool


def designs(names: list[str] | None = None) -> list[Design]:
    """Those named, or all, the whole last.

    Raises:
        InputError: No such design.
    """
    from luxel.hardware.rtl.area import AreaFloat
    from luxel.hardware.rtl.barycentric import Barycentrics, Color
    from luxel.hardware.rtl.reciprocal import Inverse
    from luxel.hardware.rtl.streams import Streamed
    from luxel.hardware.rtl.whole import COORDINATE_BITS, Interpolator, ScanConversion

    inside = 2 * COORDINATE_BITS  # bits of an area, and of an edge function inside a triangle
    known = [
        Design("area", "area", lambda: Streamed(AreaFloat(COORDINATE_BITS)), False),
        Design("reciprocal", "reciprocal", lambda: Streamed(Inverse(inside)), False),
        Design("scan", "scan_conversion", ScanConversion, True),
        Design("barycentrics", "barycentrics", lambda: Streamed(Barycentrics(inside)), True),
        Design("color", "color_streamed", lambda: Streamed(Color()), True),
        Design("whole", "interpolator", Interpolator, True),
    ]
    for name in names or []:
        if name not in [each.name for each in known]:
            raise InputError(f"module: expected one of {', '.join(each.name for each in known)}; got {name}")
    return [each for each in known if names is None or each.name in names]
