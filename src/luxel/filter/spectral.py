"""Filtering a whole picture by its spectrum.

A picture that goes on mirrored beyond its border is a sum of cosines, so its filter is a product in the domain of the cosine transform
(DCT-II; Martucci 1994, "Symmetric convolution and the discrete sine and cosine transforms"): exact mirrored borders, nothing added around,
and real numbers only. A picture that wraps takes the Fourier transform as it is. The other borders are added around the picture first.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from luxel.arrays import Array
from luxel.filter.borders import extended
from luxel.filter.transform import fftfreq2

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
    from scipy.fft import dctn, idctn

    factors = transfer(cosine_frequencies(image.shape[0])[:, None], cosine_frequencies(image.shape[1])[None]).astype(image.dtype)

    def one(plane: Array) -> Array:
        spectrum = dctn(plane, type=2, overwrite_x=True, workers=threads)
        spectrum *= factors
        return idctn(spectrum, type=2, overwrite_x=True, workers=threads)

    return _by_plane(image, one)


def _wrapped(image: Array, transfer: Transfer, threads: int) -> Array:
    from scipy.fft import irfft2, rfft2

    height, width, _ = image.shape
    factors = transfer(*fftfreq2(height, width, real=True)).astype(image.dtype)

    def one(plane: Array) -> Array:
        spectrum = rfft2(plane, workers=threads)
        spectrum *= factors
        return irfft2(spectrum, s=(height, width), workers=threads, overwrite_x=True)

    return _by_plane(image, one)


def _by_plane(image: Array, one: Callable[[Array], Array]) -> Array:
    """Each channel in turn as a plane of its own, which the transforms like better than interleaved ones."""
    out = np.empty_like(image)
    for channel in range(image.shape[2]):
        out[..., channel] = one(image[..., channel].copy())  # which the transform may overwrite
    return out


def by_kernel(image: Array, kernel: Array, before: tuple[int, int], border: str, value: float, threads: int) -> Array:
    """Convolve (h, w, c) with (kh, kw) through one transform of the whole extended picture.

    Args:
        before: How many rows and columns the kernel reaches up and left of a pixel; it reaches kh - 1 - before[0] down.
    """
    from scipy.fft import irfft2, next_fast_len, rfft2

    height, width, _ = image.shape
    tall, wide = kernel.shape[0] - 1, kernel.shape[1] - 1
    padded = extended(image, before, (tall - before[0], wide - before[1]), border, value)
    shape = next_fast_len(height + tall, real=True), next_fast_len(width + wide, real=True)
    factors = rfft2(kernel.astype(image.dtype), s=shape, workers=threads)

    def one(plane: Array) -> Array:
        spectrum = rfft2(plane, s=shape, workers=threads)
        spectrum *= factors
        return irfft2(spectrum, s=shape, workers=threads, overwrite_x=True)[tall : tall + height, wide : wide + width]

    out = np.empty_like(image)
    for channel in range(image.shape[2]):
        out[..., channel] = one(np.ascontiguousarray(padded[..., channel]))
    return out
