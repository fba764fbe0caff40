"""Low-pass filters of pictures that do not fit in memory: bands of rows and strips of columns, from disk to disk."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator

import numpy as np

from luxel.arrays import Array
from luxel.filter.borders import border_map
from luxel.filter.files import decoded
from luxel.filter.filters import Filter, apply, refuse_odd
from luxel.filter.spectral import cosine_frequencies

MEMORY = 1 << 31
"""Bytes of float32 numbers up to which a picture is filtered in one piece."""


def filtered_bands(source: Array, filter: Filter, border: str, value: float, method: str, threads: int, memory: int,
                   progress: Callable[[float], None]) -> Iterator[Array]:  # fmt: skip
    """Bands of rows of the filtered picture, from the top, in linear light.

    A filter that is a kernel sees each band with as many rows more as it reaches, so there are no seams; one that is a function of
    frequency alone takes three passes over a file of its own: rows, columns and back, rows.

    Args:
        source: (h, w, c) as stored, in memory or a memory map.
        filter, border, value, method, threads: As of `filters.apply`.
        memory: Bytes that a band may have as float32.
        progress: Told the part that is done.
    """
    if filter.kernel is not None:
        bands = _by_bands(source, filter, border, value, method, threads, memory)
    else:
        bands = _by_passes(source, filter, border, value, threads, memory)
    done = 0
    for band in bands:
        yield band
        done += len(band)
        progress(done / len(source))


def _rows(source: Array, rows: Array, value: float, threads: int) -> Array:
    """Those rows in linear light; -1 stands for the constant."""
    first, last = int(rows.min()), int(rows.max())
    together = len(rows) == last - first + 1 and bool((np.diff(rows) == 1).all()) and first >= 0
    band = decoded(source[first : last + 1] if together else source[rows], threads)
    if first < 0:
        band[rows < 0] = value
    return band


def _by_bands(source: Array, filter: Filter, border: str, value: float, method: str, threads: int, memory: int) -> Iterator[Array]:
    height, reach = len(source), filter.reach
    rows = border_map(height, reach, reach, border)
    count = max(64, memory // (4 * int(np.prod(source.shape[1:]))) - 2 * reach)
    for first in range(0, height, count):
        last = min(height, first + count)
        band = _rows(source, rows[first : last + 2 * reach], value, threads)
        names = rows[first : last + 2 * reach]
        yield apply(band, filter, border, value, "auto" if method == "dct" else method, threads, names)[reach : reach + last - first]


def _by_passes(source: Array, filter: Filter, border: str, value: float, threads: int, memory: int) -> Iterator[Array]:
    from scipy.fft import dct, fft, idct, ifft, irfft, rfft

    assert filter.transfer is not None
    height, width, channels = source.shape
    part: Array
    wraps = border == "wrap"
    reach = 0 if border in ("mirror", "wrap") else filter.reach
    y_map, x_map = border_map(height, reach, reach, border), border_map(width, reach, reach, border)
    tall, wide = len(y_map), len(x_map)
    columns = wide // 2 + 1 if wraps else wide
    fy, fx = (np.fft.fftfreq(tall), np.fft.rfftfreq(wide)) if wraps else (cosine_frequencies(tall), cosine_frequencies(wide))
    with tempfile.TemporaryFile(prefix="luxel") as file:
        scratch = np.memmap(file, np.complex64 if wraps else np.float32, shape=(tall, columns, channels))
        rows = max(1, memory // (8 * wide * channels))
        for first in range(0, tall, rows):
            band = _rows(source, y_map[first : first + rows], value, threads).astype(np.float32, copy=False)
            if reach:
                band = band[:, x_map]
                band[:, x_map < 0] = value
            if not np.isfinite(band.sum(dtype=np.float64)):
                refuse_odd(band, y_map[first : first + rows])
            scratch[first : first + rows] = (rfft if wraps else dct)(band, axis=1, workers=threads)
        strip = max(1, memory // (16 * tall * channels))
        for first in range(0, columns, strip):
            part = (fft if wraps else dct)(np.ascontiguousarray(scratch[:, first : first + strip]), axis=0, workers=threads)
            part *= filter.transfer(fy[:, None], fx[None, first : first + strip]).astype(np.float32)[..., None]
            scratch[:, first : first + strip] = (ifft if wraps else idct)(part, axis=0, workers=threads)
        for first in range(reach, reach + height, rows):
            part = scratch[first : min(reach + height, first + rows)]
            plain = irfft(part, n=wide, axis=1, workers=threads) if wraps else idct(part, axis=1, workers=threads)
            yield np.ascontiguousarray(plain[:, reach : reach + width])
