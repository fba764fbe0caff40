"""Spots: elements whose light comes by rows, as `luxel.radiosity.gather.Spots.apart`; their rows are received as lights' are (`light`)."""

from __future__ import annotations

import numpy as np

from luxel.jit import part
from luxel.radiosity.gather import lit_around

_F = np.float32


@part
def brightness(k, hits, numbers, root, result):
    """result[k] float64: how bright it is where element `k` is seen; see `luxel.radiosity.gather.lit_around`."""
    result[k] = lit_around(k, hits, numbers, numbers, root)


@part
def power_of(s, spots, light, powers):
    """powers[s] (3,) float32: what patch `s` of the spots sends, of the `light` (3 + n, 4) of all elements."""
    area = red = green = blue = _F(0.0)
    for k in range(spots.starts[s], spots.starts[s + 1]):
        i, a = np.int64(spots.element[k]) + 3, spots.area[k]
        area, red, green, blue = area + a, red + light[i, 0] * a, green + light[i, 1] * a, blue + light[i, 2] * a
    powers[s, 0], powers[s, 1], powers[s, 2] = red / area, green / area, blue / area


@part
def hide(k, spots, light):
    """Rays bring nothing of the element that point `k` of the spots is of."""
    i = np.int64(spots.element[k]) + 3
    light[i, 0] = light[i, 1] = light[i, 2] = _F(0.0)
