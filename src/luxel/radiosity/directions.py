"""Directions: fixed sets that cover a hemisphere or a sphere evenly, so that results do not depend on chance."""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.arrays import Array


def _van_der_corput(n: int) -> Array:
    """(n,) float64: the radical inverse of 0 .. n - 1 in base 2."""
    values, scale, i = np.zeros(n), 0.5, np.arange(n)
    while i.any():
        values += scale * (i & 1)
        i >>= 1
        scale /= 2
    return values


def cosine_directions(n: int, first: int = 0) -> Array:
    """(n, 3) float64 unit vectors with density cos / pi about +z; the first `first` and the rest are each even (Hammersley points)."""
    groups = [first, n - first] if first else [n]
    points = [np.stack([(np.arange(k) + 0.5) / k, (_van_der_corput(k) + 0.5 / k) % 1.0], 1) for k in groups]
    return np.array([_on_hemisphere(float(u), float(v)) for u, v in np.concatenate(points)])


def _on_hemisphere(u, v):
    """From the unit square to the hemisphere about +z, by the cosine: cells stay compact (Shirley, Chiu 1997, "A low distortion map between disk and
    square")."""
    a, b = 2.0 * u - 1.0, 2.0 * v - 1.0
    if abs(a) > abs(b):
        radius, angle = a, math.pi / 4 * (b / a)
    else:
        radius, angle = b, math.pi / 2 - (math.pi / 4 * (a / b) if b != 0.0 else 0.0)
    return radius * math.cos(angle), radius * math.sin(angle), math.sqrt(max(1.0 - radius * radius, 0.0))


on_hemisphere = jit.part(_on_hemisphere)


def sphere_directions(n: int) -> Array:
    """(n, 3) float64 unit vectors, evenly spread: a Fibonacci lattice, each the middle of 4 pi / n."""
    i = np.arange(n) + 0.5
    y, angle = 1 - 2 * i / n, np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(angle), y, ring * np.sin(angle)], 1)


@jit.inlined
def turned(frame, local):
    """A direction given in a frame, whose rows are its axes."""
    x, y, z = local[0], local[1], local[2]
    return (
        frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z, frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z,
        frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z,
    )  # fmt: skip
