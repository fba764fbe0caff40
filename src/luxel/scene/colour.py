"""The sRGB transfer function (IEC 61966-2-1), for NumPy arrays."""

from __future__ import annotations

from functools import cache

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError


def srgb_from_linear(linear: object) -> Array:
    """Encode linear light, any shape, to sRGB in 0..1, float32; values outside 0..1 are clamped (NaN to 0)."""
    value = np.clip(np.nan_to_num(np.asarray(linear, np.float64), nan=0.0, posinf=1.0, neginf=0.0), 0, 1)
    curved = 1.055 * np.maximum(value, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(value <= 0.0031308, 12.92 * value, curved).astype(np.float32)


def linear_from_srgb(encoded: object) -> Array:
    """Decode sRGB, any shape, to linear light, float32: uint8 is taken as 0..255, floats as 0..1.

    Raises:
        InputError: The array is neither uint8 nor floating.
    """
    value = np.asarray(encoded)
    if value.dtype == np.uint8:
        return _table()[value]
    if value.dtype.kind != "f":
        raise InputError(f"linear_from_srgb: expected uint8 or floats, got {value.dtype}")
    return _decoded(value.astype(np.float64)).astype(np.float32)


def bytes_from_linear(linear: object) -> Array:
    """Encode linear light, any shape, to sRGB uint8, rounded to nearest."""
    return (srgb_from_linear(linear) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def _decoded(value: Array) -> Array:
    curved = ((np.maximum(value, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(value <= 0.04045, value / 12.92, curved)


@cache
def _table() -> Array:
    table = _decoded(np.arange(256) / 255).astype(np.float32)
    table.setflags(write=False)  # it is shared
    return table
