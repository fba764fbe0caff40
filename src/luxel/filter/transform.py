"""Two-dimensional discrete Fourier transforms: the direct sum of the paper, as its baseline, and the fast transform for use.

`dft2` and `idft2` are the quadruple loop of "Anti-aliasing of triangle rasterisation, and its parallelisation" (2021), O(h^2 w^2), which the
paper calls FFT: with w = 2 pi (u i / h + v j / w), F[u, v] = sum over i, j of f[i, j] (cos w - i sin w), and back with + and 1 / (h w).
What differs: u i and v j are reduced modulo h and w as integers before they become an angle, so that accuracy does not suffer from large
angles. They exist to be measured against; `fft2` and its kin give the same numbers some 10,000 times sooner, through SciPy's pocketfft
(docs/decisions/0009-filters.md says why that).
"""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError

__all__ = ["dft2", "dft2_rows", "fft2", "fftfreq2", "idft2", "ifft2", "irfft2", "rfft2"]


@jit.parallel_kernel
def _sums(queue, source, out, first, sign, scale):
    """Rows of the direct sum: row r of `out` is row first + r of the transform. A number is a pair (real, imaginary)."""
    height, width = source.shape[0], source.shape[1]
    turn = 2.0 * pi
    row = jit.take(queue)
    while row < len(out):
        u = first + row
        for v in range(width):
            real = imaginary = scale * 0
            for i in range(height):
                for j in range(width):
                    angle = turn * ((u * i % height) / height + (v * j % width) / width)
                    c, s = scale * cos(angle) / scale, scale * sign * sin(angle) / scale
                    real += source[i, j, 0] * c - source[i, j, 1] * s
                    imaginary += source[i, j, 0] * s + source[i, j, 1] * c
            out[row, v, 0] = real * scale
            out[row, v, 1] = imaginary * scale
        row = jit.take(queue)


def dft2(image: object, threads: int | None = 1) -> Array:
    """The discrete Fourier transform by the direct quadruple sum: a baseline to measure, not a tool.

    Args:
        image: (h, w) real or complex; float32 and complex64 are summed in float32, everything else in float64.
        threads: Output rows are shared among so many; None: all cores.

    Returns:
        (h, w) complex64 or complex128: row u, column v holds frequency (u / h, v / w) in cycles per pixel.

    Raises:
        InputError: Not a picture of one channel, or empty.
    """
    return _direct(image, -1, threads)


def idft2(spectrum: object, threads: int | None = 1) -> Array:
    """The inverse of `dft2`, by the direct sum, divided by h w. Arguments, result and errors as there."""
    return _direct(spectrum, 1, threads)


def dft2_rows(image: object, first: int, last: int, inverse: bool = False, threads: int | None = 1) -> Array:
    """Rows first .. last - 1 of `dft2`, or of `idft2` where `inverse`: the share of one worker in the paper's parallel transform."""
    array = _plane(image)
    if not 0 <= first <= last <= len(array):
        raise InputError(f"rows: expected 0 <= first <= last <= {len(array)}, got {first} .. {last}")
    return _direct_rows(array, 1 if inverse else -1, first, last, threads)


def _direct(image: object, sign: int, threads: int | None) -> Array:
    array = _plane(image)
    return _direct_rows(array, sign, 0, len(array), threads)


def _direct_rows(array: Array, sign: int, first: int, last: int, threads: int | None) -> Array:
    single = array.dtype in (np.float32, np.complex64)
    real, wide = (np.float32, np.complex64) if single else (np.float64, np.complex128)
    source = np.ascontiguousarray(array, wide).view(real).reshape(*array.shape, 2)
    out = np.empty((last - first, array.shape[1], 2), real)
    scale = real(1 if sign < 0 else 1 / array.size)
    jit.run(_sums, min(jit.checked_threads(threads), max(1, last - first)), source, out, first, real(sign), scale)
    return out.view(wide)[..., 0]


def fft2(image: object, threads: int | None = None, overwrite: bool = False) -> Array:
    """The discrete Fourier transform of (h, w) or (..., h, w), any sizes, over the last two axes.

    Args:
        image: Real or complex; float32 and complex64 stay in single precision. Planes (channels) come first.
        threads: None: all cores.
        overwrite: Complex planes may be destroyed: they are transformed in place, which saves memory.

    Returns:
        complex64 or complex128, of the same shape.

    Raises:
        InputError: Fewer than two axes, empty, or not numbers.
    """
    import scipy.fft

    return scipy.fft.fft2(_planes(image), workers=jit.checked_threads(threads), overwrite_x=overwrite)


def ifft2(spectrum: object, threads: int | None = None, overwrite: bool = False) -> Array:
    """The inverse of `fft2`; `overwrite` lets it destroy its argument, which saves memory."""
    import scipy.fft

    return scipy.fft.ifft2(_planes(spectrum), workers=jit.checked_threads(threads), overwrite_x=overwrite)


def rfft2(image: object, threads: int | None = None) -> Array:
    """`fft2` of real numbers: only the w // 2 + 1 columns that are not the conjugate of others. Arguments and errors as there."""
    import scipy.fft

    array = _planes(image)
    if array.dtype.kind == "c":
        raise InputError(f"rfft2: expected real numbers, got {array.dtype}")
    return scipy.fft.rfft2(array, workers=jit.checked_threads(threads))


def irfft2(spectrum: object, shape: tuple[int, int], threads: int | None = None, overwrite: bool = False) -> Array:
    """The inverse of `rfft2`, of height and width `shape`.

    Raises:
        InputError: As of `fft2`, or the spectrum is not that of such a picture.
    """
    import scipy.fft

    array = _planes(spectrum)
    if array.shape[-2:] != (shape[0], shape[1] // 2 + 1):
        raise InputError(f"irfft2: a picture of {shape[0]} x {shape[1]} has a spectrum of {shape[0]} x {shape[1] // 2 + 1}, got {array.shape[-2:]}")
    return scipy.fft.irfft2(array, s=shape, workers=jit.checked_threads(threads), overwrite_x=overwrite)


def fftfreq2(height: int, width: int, real: bool = False) -> tuple[Array, Array]:
    """Frequencies of rows (h, 1) and of columns (1, w), or (1, w // 2 + 1) where `real`, in cycles per pixel."""
    columns = np.fft.rfftfreq(width) if real else np.fft.fftfreq(width)
    return np.fft.fftfreq(height)[:, None], columns[None, :]


def _planes(value: object) -> Array:
    array = np.asarray(value)
    if array.ndim < 2 or array.size == 0 or array.dtype.kind not in "iubfc":
        raise InputError(f"expected numbers (..., h, w) with at least one pixel, got {array.shape} {array.dtype}")
    kept: Any = (np.float32, np.float64, np.complex64, np.complex128)
    return array if array.dtype in kept else array.astype(np.complex128 if array.dtype.kind == "c" else np.float64)


def _plane(value: object) -> Array:
    array = _planes(value)
    if array.ndim != 2:
        raise InputError(f"expected one plane (h, w), got {array.shape}")
    return array
