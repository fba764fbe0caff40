"""Anti-aliasing by frequency: a picture drawn at a higher rate loses, in its spectrum, what pixels cannot show, and is then decimated.

The second remedy of "Anti-aliasing of triangle rasterisation, and its parallelisation" (2021): remove the high frequencies, then sample. Here both
are one step. In the cosine transform (DCT-II) of a mirrored picture the low-pass is a product, and sampling at the pixels' centres folds
what is left beyond the pixels' Nyquist frequency back into the range below it: cos(pi (2 n - k) (i + 1/2) / n) = -cos(pi k (i + 1/2) / n).
Simply leaving that out would be a sharper filter than was asked for, and draw ripples along edges. Beyond twice the Nyquist frequency next to
nothing is left, and it is left out: rows first, so that only the columns that stay are transformed at full height.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.filter.filters import checked_picture
from luxel.filter.transfer import butterworth

CUTOFF, ORDER = 0.4, 4.0
"""The default Butterworth filter: cut-off in cycles per pixel, and order. See docs/decisions/0009-filters.md for how they were chosen."""


def decimate(picture: object, rate: int, cutoff: float = CUTOFF, order: float = ORDER, threads: int | None = None) -> Array:
    """Low-pass a picture drawn at `rate` times the rate, and take every `rate`-th sample of it at the pixels' centres.

    Args:
        picture: (rate h, rate w, c) or (rate h, rate w) float16 to float64, linear light, premultiplied by alpha.
        rate: Samples a pixel along each axis, 1 or more.
        cutoff, order: Of the Butterworth filter, in cycles per pixel of the result; beyond 1 nothing passes.
        threads: None: all cores.

    Returns:
        (h, w, c) or (h, w), of the picture's dtype. Values stay between the least and the largest of each channel, which the filter would
        overshoot at sharp edges; so colours stay no larger than where alpha is 1, and alpha stays in 0..1.

    Raises:
        InputError: A size that is no multiple of the rate, integers, a cut-off or order that there is not.
    """
    array, shape = checked_picture(picture)
    if not isinstance(rate, (int, np.integer)) or rate < 1:
        raise InputError(f"rate: expected a whole number of at least 1, got {rate!r}")
    if array.dtype.kind != "f":
        raise InputError(f"picture: expected linear light in floats, got {array.dtype}")
    height, width, channels = array.shape
    if height % rate or width % rate:
        raise InputError(f"picture: expected a size that is a multiple of {rate}, got {width} x {height}")
    workers = jit.checked_threads(threads)
    kind = np.float64 if array.dtype == np.float64 else np.float32
    low, high = array.min((0, 1)), array.max((0, 1))
    if not np.isfinite([low, high]).all():
        raise InputError("picture: expected finite numbers, got some that are not")
    out = np.empty((height // rate, width // rate, channels), kind)
    fy, fx = np.arange(min(height, 2 * len(out))) / (2 * len(out)), np.arange(min(width, 2 * out.shape[1])) / (2 * out.shape[1])
    factors = (butterworth(fy[:, None], fx[None], cutoff, order) / rate**2).astype(kind)
    for channel in range(channels):
        out[..., channel] = _decimated(array[..., channel].astype(kind), factors, rate, workers)
    np.clip(out, low, high, out=out)
    return out.astype(array.dtype, copy=False).reshape(out.shape if len(shape) == 3 else out.shape[:2])


def _decimated(plane: Array, factors: Array, rate: int, workers: int) -> Array:
    from scipy.fft import dct, idctn

    kept = dct(plane, axis=1, overwrite_x=True, workers=workers)[:, : factors.shape[1]]
    kept = dct(kept, axis=0, workers=workers)[: len(factors)]
    kept *= factors
    folded = _folded(_folded(kept, plane.shape[0] // rate).T, plane.shape[1] // rate).T
    return idctn(folded, overwrite_x=True, workers=workers)


def _folded(coefficients: Array, count: int) -> Array:
    """The coefficients of `count` samples (at their centres) of rows of up to twice as many coefficients."""
    out = coefficients[:count].copy()
    beyond = coefficients[count + 1 :][::-1]  # that of `count` itself is zero at every centre
    out[1:][len(out) - 1 - len(beyond) :] -= beyond
    return out
