"""Low-pass filters of pictures that do not fit in memory, or are shared among ranks: bands of rows and strips of columns, from disk to disk.

What is done to one band needs nothing but the band, so that it can be done anywhere: `Spread` says who does it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.filter.borders import border_map
from luxel.filter.files import decoded, encoded
from luxel.filter.filters import Filter, apply, refuse_odd
from luxel.filter.spectral import cosine_frequencies

MEMORY = 1 << 31
"""Bytes of float32 numbers up to which a picture is filtered in one piece."""

Work = Callable[[int, Array], Array]
"""From the number of the first row (or column) of a band, and the band, to what becomes of it."""
Spread = Callable[[Work, Iterable[tuple[int, Array]]], Iterator[Array]]
"""Has the work done for each item, and gives the results in order: `alone`, or the `spread` of `luxel.cluster.comm`."""

_LEAST = 64  # rows of a band


class Job(NamedTuple):
    """A filter for a picture of a given shape.

    Attributes:
        shape: (h, w, c).
        dtype: What the result is stored as: uint8 and uint16 are encoded, anything else is linear light.
        filter, border, value, method, threads: As of `filters.apply`.
        memory: Bytes that a band may have as float32.
        bands: At least so many, where the picture has the rows for it.
    """

    shape: tuple[int, int, int]
    dtype: Any
    filter: Filter
    border: str = "mirror"
    value: float = 0.0
    method: str = "auto"
    threads: int = 1
    memory: int = MEMORY // 4
    bands: int = 1


def alone(work: Work, items: Iterable[tuple[int, Array]]) -> Iterator[Array]:
    """Do everything here."""
    return (work(number, item) for number, item in items)


def filtered_bands(source: Array | None, job: Job, progress: Callable[[float], None], spread: Spread = alone) -> Iterator[Array]:
    """Bands of rows of the filtered picture, from the top, as they are stored.

    A filter that is a kernel sees each band with as many rows more as it reaches, so there are no seams; one that is a function of
    frequency alone takes three passes over a file of its own: rows, columns and back, rows.

    Args:
        source: (h, w, c) as stored, in memory or a memory map; None on ranks other than the first, which run through and get nothing.
        job: The same on all ranks.
        progress: Told the part that is done.
        spread: Who does the work.
    """
    bands = _by_bands(source, job, spread) if job.filter.kernel is not None else _by_passes(source, job, spread)
    done = 0
    for band in bands:
        yield band
        done += len(band)
        progress(done / job.shape[0])


def _rows_each(job: Job, bytes_a_row: int, beside: int) -> int:
    """Rows of a band, if each of them and of the `beside` around it takes so much memory."""
    fits = job.memory // bytes_a_row - beside
    return max(_LEAST, min(fits, max(-(-job.shape[0] // job.bands), 2 * beside)))


def _taken(source: Array, rows: Array) -> Array:
    """Those rows as they are stored; any in place of -1, which stands for the constant."""
    first, last = int(rows.min()), int(rows.max())
    together = first >= 0 and len(rows) == last - first + 1 and bool((np.diff(rows) == 1).all())
    return source[first : last + 1] if together else source[rows]


def _light(band: Array, rows: Array, value: float, threads: int) -> Array:
    """Rows in linear light, the constant put in."""
    light = decoded(band, threads)
    if rows.min() < 0:
        light[rows < 0] = value
    return light


def _by_bands(source: Array | None, job: Job, spread: Spread) -> Iterator[Array]:
    height, reach = job.shape[0], job.filter.reach
    rows = border_map(height, reach, reach, job.border)
    count = _rows_each(job, 4 * job.shape[1] * job.shape[2], 2 * reach)
    items = () if source is None else ((first, _taken(source, rows[first : first + count + 2 * reach])) for first in range(0, height, count))
    return spread(partial(_filtered, job, rows), items)


def _filtered(job: Job, rows: Array, first: int, band: Array) -> Array:
    """A band that reaches beyond what is wanted of it, filtered."""
    reach = job.filter.reach
    names = rows[first : first + len(band)]
    light = _light(band, names, job.value, job.threads)
    method = "auto" if job.method == "dct" else job.method
    out = apply(light, job.filter, job.border, job.value, method, job.threads, names)
    return encoded(out[reach : len(out) - reach], job.dtype, job.threads)


def _by_passes(source: Array | None, job: Job, spread: Spread) -> Iterator[Array]:
    height, width, channels = job.shape
    wraps = job.border == "wrap"
    reach = 0 if job.border in ("mirror", "wrap") else job.filter.reach
    y_map, x_map = border_map(height, reach, reach, job.border), border_map(width, reach, reach, job.border)
    tall, wide = len(y_map), len(x_map)
    columns = wide // 2 + 1 if wraps else wide
    rows = max(1, min(job.memory // (8 * wide * channels), -(-tall // job.bands)))
    strip = max(1, min(job.memory // (16 * tall * channels), -(-columns // job.bands)))
    forth, up_and_down, back = partial(_row_spectra, job, y_map, x_map), partial(_columns_filtered, job, wide), partial(_rows_back, job, wide, reach)
    if source is None:
        for work in (forth, up_and_down, back):
            yield from spread(work, ())
        return
    with tempfile.TemporaryFile(prefix="luxel") as file:
        scratch = np.memmap(file, np.complex64 if wraps else np.float32, shape=(tall, columns, channels))
        starts = range(0, tall, rows)
        for first, part in zip(starts, spread(forth, ((k, _taken(source, y_map[k : k + rows])) for k in starts)), strict=True):
            scratch[first : first + rows] = part
        starts = range(0, columns, strip)
        for first, part in zip(starts, spread(up_and_down, ((k, scratch[:, k : k + strip]) for k in starts)), strict=True):
            scratch[:, first : first + strip] = part
        end = reach + height
        yield from spread(back, ((k, scratch[k : min(end, k + rows)]) for k in range(reach, end, rows)))


def _row_spectra(job: Job, y_map: Array, x_map: Array, first: int, band: Array) -> Array:
    from scipy.fft import dct, rfft

    names = y_map[first : first + len(band)]
    light = _light(band, names, job.value, job.threads).astype(np.float32, copy=False)
    if len(x_map) > job.shape[1]:
        light = light[:, x_map]
        light[:, x_map < 0] = job.value
    if not np.isfinite(light.sum(dtype=np.float64)):
        refuse_odd(light, names)
    return (rfft if job.border == "wrap" else dct)(light, axis=1, workers=job.threads)


def _columns_filtered(job: Job, wide: int, first: int, strip: Array) -> Array:
    from scipy.fft import dct, fft, idct, ifft

    assert job.filter.transfer is not None
    wraps, tall = job.border == "wrap", len(strip)
    fy, fx = (np.fft.fftfreq(tall), np.fft.rfftfreq(wide)) if wraps else (cosine_frequencies(tall), cosine_frequencies(wide))
    part: Array = (fft if wraps else dct)(np.ascontiguousarray(strip), axis=0, workers=job.threads)
    part *= job.filter.transfer(fy[:, None], fx[None, first : first + strip.shape[1]]).astype(np.float32)[..., None]
    return (ifft if wraps else idct)(part, axis=0, workers=job.threads)


def _rows_back(job: Job, wide: int, reach: int, first: int, band: Array) -> Array:
    from scipy.fft import idct, irfft

    plain = irfft(band, n=wide, axis=1, workers=job.threads) if job.border == "wrap" else idct(band, axis=1, workers=job.threads)
    return encoded(np.ascontiguousarray(plain[:, reach : reach + job.shape[1]]), job.dtype, job.threads)
