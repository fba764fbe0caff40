"""Filtering a whole picture by its spectrum.

A picture that goes on mirrored beyond its border is a sum of cosines, so its filter is a product in the domain of the cosine transform
(DCT-II; Martucci 1994, "Symmetric convolution and the discrete sine and cosine transforms"): exact mirrored borders, nothing added around,
and real numbers only. A picture that wraps takes the Fourier transform as it is. The other borders are added around the picture first.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from luxel.arrays import Array
from luxel.filter.borders import extended
from luxel.filter.transform import fftfreq2

_STRIP = 1 << 22  # bytes of columns transformed at once

Transfer = Callable[[Array, Array], Array]
"""Factors of the frequencies along rows (h, 1) and columns (1, w), cycles per pixel; real and even."""


def by_transfer(image: Array, transfer: Transfer, border: str, value: float, reach: int, threads: int) -> Array:
    """Multiply the spectrum of (h, w, c) float32 or float64 by `transfer`.

    Args:
        border: "mirror" and "wrap" are exact for any filter. For "clamp" and "constant" the picture is extended by `reach` pixels and mirrored
            beyond: exact where the filter reaches no further.
        value: The constant.
    """
    if border == "wrap":
        return _wrapped(image, transfer, threads)
    if border == "mirror":
        return _mirrored(image, transfer, threads)
    height, width, _ = image.shape
    wide = extended(image, (reach, reach), (reach, reach), border, value)
    return np.ascontiguousarray(_mirrored(wide, transfer, threads)[reach : reach + height, reach : reach + width])


def cosine_frequencies(count: int) -> Array:
    """Cycles per pixel of the DCT-II's coefficients of `count` pixels: 0 .. (count - 1) / (2 count)."""
    return np.arange(count) / (2 * count)


def _mirrored(image: Array, transfer: Transfer, threads: int) -> Array:
    from scipy.fft import dct, idct

    fy, fx = (cosine_frequencies(count) for count in image.shape[:2])
    spectrum = dct(image, axis=1, workers=threads)
    _columns(spectrum, spectrum, slice(None), lambda strip: transfer(fy[:, None], fx[None, strip]), dct, idct, threads)
    return idct(spectrum, axis=1, overwrite_x=True, workers=threads)


def _wrapped(image: Array, transfer: Transfer, threads: int) -> Array:
    from scipy.fft import fft, ifft, irfft, rfft

    fy, fx = fftfreq2(image.shape[0], image.shape[1], real=True)
    spectrum = rfft(image, axis=1, workers=threads)
    _columns(spectrum, spectrum, slice(None), lambda strip: transfer(fy, fx[:, strip]), fft, ifft, threads)
    return irfft(spectrum, n=image.shape[1], axis=1, overwrite_x=True, workers=threads)


def _columns(spectrum: Array, out: Array, rows: slice, factors: Callable[[slice], Array], there: Callable[..., Array],
             back: Callable[..., Array], threads: int) -> None:  # fmt: skip
    """Transform columns (h, w, c), multiply, and put `rows` of what comes back into `out`: a strip of columns at a time, brought together so that
    it is read from the cache. All channels side by side: planes of their own take up to twice as long."""
    step = max(1, _STRIP // (spectrum.itemsize * spectrum.shape[0] * spectrum.shape[2]))
    for first in range(0, spectrum.shape[1], step):
        strip = slice(first, first + step)
        part = there(np.ascontiguousarray(spectrum[:, strip]), axis=0, overwrite_x=True, workers=threads)
        part *= factors(strip).astype(part.dtype)[..., None]
        out[:, strip] = back(part, axis=0, overwrite_x=True, workers=threads)[rows]


def by_kernel(image: Array, kernel: Array, before: tuple[int, int], border: str, value: float, threads: int) -> Array:
    """Convolve (h, w, c) with (kh, kw) through one transform of the whole extended picture.

    Args:
        before: How many rows and columns the kernel reaches up and left of a pixel; it reaches kh - 1 - before[0] down.
    """
    from scipy.fft import fft, ifft, irfft, next_fast_len, rfft, rfft2

    height, width, _ = image.shape
    tall, wide = kernel.shape[0] - 1, kernel.shape[1] - 1
    padded = extended(image, before, (tall - before[0], wide - before[1]), border, value)
    shape = next_fast_len(height + tall, real=True), next_fast_len(width + wide, real=True)
    factors = rfft2(kernel.astype(image.dtype), s=shape, workers=threads)
    spectrum = rfft(padded, n=shape[1], axis=1, workers=threads)
    down, rows = partial(fft, n=shape[0]), slice(tall, tall + height)  # rows that are wrapped round are not brought back
    kept = np.empty((height, *spectrum.shape[1:]), spectrum.dtype)
    _columns(spectrum, kept, rows, lambda strip: factors[:, strip], down, ifft, threads)
    return np.ascontiguousarray(irfft(kept, n=shape[1], axis=1, overwrite_x=True, workers=threads)[:, wide : wide + width])
