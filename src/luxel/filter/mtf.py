"""The modulation transfer function: how much of each frequency a picture keeps, measured from the picture.

From a slanted edge as in ISO 12233: the edge crosses the pixels at every offset, so its profile is sampled finer than the pixels are; its
derivative is the line spread function, whose spectrum is the answer. And from a zone plate, ring by ring.
"""

from __future__ import annotations

import math

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.filter.patterns import zone_frequency, zone_plate

_FINER = 8


def edge_mtf(image: Array, degrees: float) -> tuple[Array, Array]:
    """Frequencies (n,) up to 0.5 cycles per pixel, across the edge, and the part of each that is kept (n,), 1 at frequency 0.

    Args:
        image: (h, w), linear light, of `patterns.slanted_edge`: an edge through the middle, `degrees` from upright.

    Raises:
        InputError: No picture of one channel, no edge in it, or an angle at which it does not cross the pixels' offsets.
    """
    plane = np.asarray(image, np.float64)
    if plane.ndim != 2 or min(plane.shape) < 16:
        raise InputError(f"image: expected (h, w) of at least 16 a side, got {np.shape(image)}")
    angle = math.radians(degrees)
    if not 0.02 < abs(math.tan(angle)) < 0.5:
        raise InputError(f"degrees: expected an edge 1.2 to 26 degrees from upright, got {degrees}")
    height, width = plane.shape
    x, y = np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2
    distance = math.cos(angle) * x[None] + math.sin(angle) * y[:, None]
    reach = int(width / 2 * math.cos(angle) - height / 2 * abs(math.sin(angle)))
    if reach < 4:
        raise InputError("image: too narrow for its height at this angle")
    places = np.floor((distance + reach) * _FINER).astype(np.int64)
    inside = (places >= 0) & (places < 2 * reach * _FINER)
    counts = np.bincount(places[inside], minlength=2 * reach * _FINER)
    profile = np.bincount(places[inside], plane[inside], minlength=2 * reach * _FINER)
    if (counts == 0).any():
        raise InputError("image: too few rows for this angle")
    spread = np.diff(profile / counts)
    if not abs(spread.sum()) > 1e-6:
        raise InputError("image: expected an edge, both sides are alike")
    frequencies = np.fft.rfftfreq(len(spread), 1 / _FINER)
    kept = np.abs(np.fft.rfft(spread)) / abs(spread.sum())
    kept /= np.sinc(frequencies / _FINER) ** 2  # what differences and averages over a bin took
    shown = frequencies <= 0.5
    return frequencies[shown], kept[shown]


def zone_mtf(image: Array, finest: float = 0.5, bins: int = 25) -> tuple[Array, Array, Array]:
    """What became of a zone plate, ring by ring.

    Args:
        image: (size, size), linear light: `patterns.zone_plate(size, finest)` after whatever is measured.
        finest: As of the zone plate.
        bins: Of frequency.

    Returns:
        Frequencies (bins,); the part of the pattern that is kept (its correlation with the pattern, 1 where it is whole); and what is there that is
        not the pattern, root mean square (aliases and noise; 0 where there is none).
    """
    plane = np.asarray(image, np.float64)
    if plane.ndim != 2 or plane.shape[0] != plane.shape[1] or len(plane) < 16:
        raise InputError(f"image: expected (size, size) of at least 16, got {np.shape(image)}")
    pattern = zone_plate(len(plane), finest) - 0.5
    ring = np.minimum((zone_frequency(len(plane), finest) / finest * bins).astype(np.int64), bins)
    sums = [np.bincount(ring.reshape(-1), values.reshape(-1), bins + 1)[:bins] for values in
            (np.ones_like(pattern), (plane - 0.5) * pattern, pattern**2)]  # fmt: skip
    kept = sums[1] / sums[2]
    rest = plane - 0.5 - np.append(kept, 0)[ring] * pattern
    other = np.sqrt(np.bincount(ring.reshape(-1), (rest**2).reshape(-1), bins + 1)[:bins] / sums[0])
    return (np.arange(bins) + 0.5) / bins * finest, kept, other
