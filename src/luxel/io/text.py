"""Numbers out of lines of text, all lines at once."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array


def words_per_line(text: bytes) -> Array:
    """(lines,) int64: how many words each line of `text`, which ends with a newline, has."""
    data = np.frombuffer(text, np.uint8)
    blank = data <= 32
    begins = ~blank
    begins[1:] &= blank[:-1]
    return np.diff(np.cumsum(begins, dtype=np.int64)[data == 10], prepend=0)


def table_lines(values: Array, counts: Array, widest: int = 12) -> Array:
    """(lines, width) float64: the numbers `values` of lines with `counts` each; NaN where a line has fewer than the longest."""
    width = min(int(counts.max(initial=0)), widest)
    if (counts == width).all():
        return values.reshape(len(counts), width)
    out = np.full((len(counts), width), np.nan)
    begin = np.cumsum(counts) - counts
    for k in range(width):
        has = counts > k
        out[has, k] = values[begin[has] + k]
    return out
