"""Array contracts: every kernel sees one dtype and layout, normalised here at the door."""

from __future__ import annotations

from typing import Any

import numpy as np

from luxel.errors import InputError

Array = np.ndarray[Any, np.dtype[Any]]


def checked(value: object, shape: tuple[int | str, ...], dtype: object, name: str) -> Array:
    """Return `value` as a C-contiguous array of `dtype` whose shape fits `shape`.

    Args:
        value: Anything `np.asarray` takes. Not copied when it already fits.
        shape: One entry an axis: a number must match, a letter matches any length (equal letters match equal lengths).
        dtype: The dtype wanted. Integers never come from floats, and never wrap.
        name: What to call the array in the error.

    Raises:
        InputError: "triangles: expected (m, 3) int32, got (3, 7) float64".
    """
    want = np.dtype(dtype)  # type: ignore[call-overload]
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name}: expected {_spell(shape)} {want}, got a ragged {type(value).__name__}") from error
    lengths: dict[str, int] = {}
    fits = array.ndim == len(shape) and all(
        have == (lengths.setdefault(need, have) if isinstance(need, str) else need)
        for need, have in zip(shape, array.shape, strict=True)
    )
    kinds = "iub" if want.kind in "iu" else "iufb"
    if not fits or array.dtype.kind not in kinds:
        if fits and array.size == 0:  # np.asarray([]) is float64; an empty list of indices is no error
            return np.zeros(array.shape, want)
        raise InputError(f"{name}: expected {_spell(shape)} {want}, got {array.shape} {array.dtype}")
    if want.kind in "iu" and array.dtype != want and array.size:
        info = np.iinfo(want)
        low, high = int(array.min()), int(array.max())
        if low < info.min or high > info.max:
            raise InputError(f"{name}: values {low} .. {high} do not fit {want}")
    return np.ascontiguousarray(array, want)


def _spell(shape: tuple[int | str, ...]) -> str:
    return "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
