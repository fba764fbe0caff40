"""Numbers out of lines of text, all lines at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError


def words_per_line(text: bytes) -> Array:
    """(lines,) int64: how many words each line of `text`, which ends with a newline, has."""
    data = np.frombuffer(text, np.uint8)
    blank = (data == 32) | ((data >= 9) & (data <= 13))  # as C's isspace, which np.fromstring goes by
    begins = ~blank
    begins[1:] &= blank[:-1]
    return np.diff(np.cumsum(begins, dtype=np.int64)[data == 10], prepend=0)


def parse(text: bytes, dtype: type, where: str, line: Callable[[int], int] | None = None, expected: int | None = None) -> Array:
    """All numbers of `text` as float64 (`dtype` float) or int64 (int).

    Args:
        text: Words between blanks.
        dtype: float or int.
        where: For the error.
        expected: How many words there are, if known: a check on words that are several numbers ("1-1").
        line: Number in the file of the text's k-th line; None leaves it out of the error.

    Raises:
        FileError: A word is no number; the first is shown, with its line.
    """
    try:
        values: Array = np.fromstring(text, dtype, sep=" ")
        if expected is None or len(values) == expected:
            return values
    except (ValueError, DeprecationWarning):
        pass
    for k, content in enumerate(text.split(b"\n")):
        try:
            [dtype(word) for word in content.split()]
        except (ValueError, OverflowError):
            at = where if line is None else f"{where}, line {line(k)}"
            raise FileError(at, f"expected numbers, got {content.strip()[:80].decode('utf-8', 'replace')!r}") from None
    raise FileError(where, "expected numbers, got something else")


def table_lines(values: Array, counts: Array, widest: int = 12) -> Array:
    """(lines, width) float64: the numbers `values` of lines with `counts` each; NaN where a line has fewer than the
    longest."""
    width = min(int(counts.max(initial=0)), widest)
    if (counts == width).all():
        return values.reshape(len(counts), width)
    out = np.full((len(counts), width), np.nan)
    begin = np.cumsum(counts) - counts
    for k in range(width):
        has = counts > k
        out[has, k] = values[begin[has] + k]
    return out
