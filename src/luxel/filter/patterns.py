"""Test pictures of which every pixel is known exactly, in linear light."""

from __future__ import annotations

import math

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError


def zone_plate(size: int, finest: float = 0.5, rate: int = 1) -> Array:
    """(size, size) float64: circles 0.5 + 0.5 cos(2 pi finest r^2 / size), sampled, not averaged.

    Their frequency grows evenly from 0 in the middle to `finest` cycles per pixel at distance size / 2, along the axes; the corners hold 1.41
    times as much. What a sampling cannot show comes back as circles elsewhere.

    Args:
        size: Pixels a side.
        finest: Above 0.5 the picture has what its pixels cannot show.
        rate: Samples a pixel along each axis: (rate size, rate size) samples of the same picture.
    """
    _check(size, rate)
    x = (np.arange(size * rate) + 0.5) / rate - size / 2
    return 0.5 + 0.5 * np.cos(2 * np.pi * finest * (x[:, None] ** 2 + x**2) / size)


def zone_frequency(size: int, finest: float = 0.5) -> Array:
    """(size, size): the frequency of `zone_plate` at each pixel, in cycles per pixel."""
    x = np.arange(size) + 0.5 - size / 2
    return 2 * finest * np.hypot(x[:, None], x) / size


def slanted_edge(size: int, degrees: float = 5.0, rate: int = 1) -> Array:
    """(size, size) float64: 0 left and 1 right of a line through the middle, `degrees` from upright; each pixel the exact area that is right of it.

    Args:
        rate: As of `zone_plate`.
    """
    _check(size, rate)
    angle = math.radians(degrees)
    across, along = math.cos(angle), math.sin(angle)
    x = (np.arange(size * rate) + 0.5) / rate - size / 2
    distance = (across * x[None] + along * x[:, None]) * rate  # of a pixel's centre from the line, in samples
    return _area_right(distance, abs(across), abs(along))


def _area_right(distance: Array, a: float, b: float) -> Array:
    """Part of a unit square on the positive side of a line at `distance` from its centre with the normal (a, b): the integral of a trapezium."""
    long, short = max(a, b), min(a, b)
    half, flat = (long + short) / 2, (long - short) / 2
    d = np.clip(distance, -half, half)
    if short < 1e-12:
        return d / long + 0.5
    ramp = np.maximum(half - np.abs(d), 0) ** 2 / (2 * long * short)  # the small triangle that is cut off
    middle = 0.5 + d / long
    return np.where(np.abs(d) <= flat, middle, np.where(d > 0, 1 - ramp, ramp))


def checkerboard(size: int, square: float, rate: int = 1) -> Array:
    """(size, size) float64: 0 and 1 in squares of `square` pixels, sampled."""
    _check(size, rate)
    x = np.floor((np.arange(size * rate) + 0.5) / rate / square)
    return (x[:, None] + x) % 2


def _check(size: int, rate: int) -> None:
    if size < 1 or rate < 1:
        raise InputError(f"expected a size and a rate of at least 1, got {size} and {rate}")
