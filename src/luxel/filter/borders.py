"""What lies beyond the border of a picture, as tables of the places to take it from."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError

BORDERS = ("mirror", "clamp", "wrap", "constant")

_NUMPY = {"mirror": "symmetric", "clamp": "edge", "wrap": "wrap", "constant": "constant"}


def checked_border(border: object) -> str:
    """`border`, if it is one of BORDERS."""
    if border not in BORDERS:
        raise InputError(f"border: expected one of {', '.join(BORDERS)}; got {border!r}")
    return str(border)


def border_map(length: int, before: int, after: int, border: str) -> Array:
    """(before + length + after,) int64: which of `length` elements stands at -before .. length + after - 1; -1 for the constant.

    "mirror" repeats the outermost element (d c b a | a b c d | d c b a), as often as it takes; "clamp" repeats that one alone; "wrap" begins
    again at the other end.
    """
    place = np.arange(-before, length + after, dtype=np.int64)
    if border == "mirror":
        place %= 2 * length
        return np.where(place < length, place, 2 * length - 1 - place)
    if border == "clamp":
        return np.clip(place, 0, length - 1)
    if border == "wrap":
        return place % length
    return np.where((place >= 0) & (place < length), place, -1)


def extended(image: Array, before: tuple[int, int], after: tuple[int, int], border: str, value: float) -> Array:
    """The picture (h, w, c) with as many rows and columns more around it."""
    widths = [(before[0], after[0]), (before[1], after[1]), (0, 0)]
    constant = {"constant_values": value} if border == "constant" else {}
    return np.pad(image, widths, _NUMPY[border], **constant)  # type: ignore[call-overload]
