"""Two-dimensional transforms and low-pass filters of pictures that lie in slabs of rows, one a rank.

A transform along rows is each rank's own; then all ranks exchange blocks once, so that each holds a slab of columns, and transform those.
A spectrum stays in slabs of columns: what is done to it is done there, and the way back exchanges once more. Any size and any number of
ranks; a rank may have nothing. `dft2` is the parallel direct transform of "Anti-aliasing of triangle rasterisation, and its parallelisation"
(2021): blocks of output rows a rank, gathered on rank 0, threads within each rank for its hybrid.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.errors import InputError
from luxel.filter.borders import border_map, extended
from luxel.filter.filters import Filter, apply, refuse_odd
from luxel.filter.spectral import Transfer, cosine_frequencies
from luxel.filter.transform import dft2_rows

Along = Callable[..., Array]


def fft2(slab: Array, shape: tuple[int, int], comm: Comm, threads: int | None = None) -> Array:
    """The discrete Fourier transform of a picture (h, w) of which this rank has the rows `comm.share_out(h)[comm.rank]`.

    Args:
        slab: (its rows, w), real or complex; float32 and complex64 stay in single precision.
        shape: (h, w) of the whole.
        comm: The ranks; all of them call this.
        threads: Of each rank; None: all cores that it may use.

    Returns:
        (h, its columns) complex: the columns `comm.share_out(w)[comm.rank]` of the spectrum.
    """
    from scipy.fft import fft

    return _along(fft, _to_columns(_along(fft, slab, 1, threads), shape, comm), 0, threads)


def ifft2(slab: Array, shape: tuple[int, int], comm: Comm, threads: int | None = None) -> Array:
    """The inverse of `fft2`: from slabs of columns to slabs of rows, complex."""
    from scipy.fft import ifft

    return _along(ifft, _to_rows(_along(ifft, slab, 0, threads), shape, comm), 1, threads)


def _along(transform: Along, slab: Array, axis: int, threads: int | None, **options: Any) -> Array:
    if slab.size:
        return transform(slab, axis=axis, workers=jit.checked_threads(threads), **options)
    name = transform.__name__
    if name == "irfft":
        return np.empty((len(slab), options["n"], *slab.shape[2:]), slab.real.dtype)
    return slab.astype(np.result_type(slab.dtype, np.complex64) if name in ("fft", "ifft", "rfft") else slab.dtype)


def _to_columns(slab: Array, shape: tuple[int, int], comm: Comm) -> Array:
    """From a slab of rows to one of columns, (h, its columns)."""
    pieces = comm.exchange([slab[:, first:last] for first, last in comm.share_out(shape[1])])
    return np.concatenate(pieces, axis=0)


def _to_rows(slab: Array, shape: tuple[int, int], comm: Comm) -> Array:
    pieces = comm.exchange([slab[first:last] for first, last in comm.share_out(shape[0])])
    return np.concatenate(pieces, axis=1)


def by_transfer(slab: Array, shape: tuple[int, int], transfer: Transfer, border: str, comm: Comm, threads: int | None = None) -> Array:
    """Multiply the spectrum of a picture by a transfer function; its border is "mirror" (through cosine transforms) or "wrap".

    Args:
        slab: (its rows, w) or (its rows, w, c) float32 or float64.
        shape: (h, w) of the whole.
        transfer: As in `luxel.filter.spectral`.

    Returns:
        This rank's rows of the filtered picture.
    """
    from scipy.fft import dct, fft, idct, ifft, irfft, rfft

    width = shape[1]
    there: Any
    if border == "mirror":
        there, back, down, up, columns = dct, idct, dct, idct, width
        fy, fx = cosine_frequencies(shape[0]), cosine_frequencies(width)
    else:
        there, back, down, up, columns = rfft, irfft, fft, ifft, width // 2 + 1
        fy, fx = np.fft.fftfreq(shape[0]), np.fft.rfftfreq(width)
    options = {} if border == "mirror" else {"n": width}
    wide = (shape[0], columns)
    turned = _along(down, _to_columns(_along(there, slab, 1, threads), wide, comm), 0, threads)
    first, last = comm.share_out(columns)[comm.rank]
    factors = transfer(fy[:, None], fx[None, first:last]).astype(slab.dtype)
    turned = turned * factors.reshape(factors.shape + (1,) * (slab.ndim - 2))
    return _along(back, _to_rows(_along(up, turned, 0, threads), wide, comm), 1, threads, **options)


def dft2(image: Array | None, comm: Comm, threads: int | None = 1, inverse: bool = False) -> Array | None:
    """The direct transform (see `luxel.filter.dft2`), blocks of output rows a rank.

    Args:
        image: (h, w) on rank 0; None elsewhere.
        threads: Of each rank.
        inverse: The inverse transform.

    Returns:
        The whole transform on rank 0; None elsewhere.
    """
    whole = comm.share_array(image)
    first, last = comm.share_out(len(whole))[comm.rank]
    parts = comm.collect(dft2_rows(whole, first, last, inverse, threads))
    return None if parts is None else np.concatenate(parts)


def lowpass(image: Array | None, filter: Filter | None, comm: Comm, border: str = "mirror", value: float = 0.0, method: str = "auto",
            threads: int | None = None) -> Array | None:  # fmt: skip
    """Filter a picture that rank 0 has, (h, w, c) float32 or float64 in linear light.

    Kernels and Gaussians go by bands of rows with as many more as the filter reaches; filters that are a function of frequency by transforms in
    slabs. The result is one rank's to rounding.

    Args:
        image: On rank 0; None elsewhere.
        filter: From `luxel.filter.filters.make_filter`, on rank 0.
        comm: The ranks; all of them call this.
        border, value, method, threads: As of `luxel.filter.lowpass`.

    Returns:
        The filtered picture on rank 0; None elsewhere.
    """
    threads = comm.threads(threads)
    if image is not None and (comm.size == 1 or filter is None):
        assert filter is not None
        return apply(image, filter, border, value, method, threads)
    banded = comm.share(filter is not None and filter.kernel is not None)
    if banded:
        return _by_bands(image, filter, comm, border, value, method, threads)
    if method not in ("auto", "dct"):
        raise InputError(f"method: {method} cannot apply this filter, but dct can")
    return _by_slabs(image, filter, comm, border, value, threads)


def _by_bands(image: Array | None, filter: Filter | None, comm: Comm, border: str, value: float, method: str, threads: int) -> Array | None:
    bands = None
    kernel = None
    if image is not None:
        assert filter is not None
        assert filter.kernel is not None
        kernel = np.outer(*filter.taps) if filter.taps is not None else filter.kernel()
    height, taps, reach, kernel = comm.share((len(image), filter.taps, filter.reach, kernel) if image is not None and filter is not None else None)
    rows = border_map(height, reach, reach, border)
    shares = comm.share_out(height)
    if image is not None:
        bands = [_taken(image, rows[first : last + 2 * reach], value) for first, last in shares]
    band = comm.deal(bands)
    own = Filter(None, taps, lambda: kernel, reach)
    if len(band) > 2 * reach:
        first, last = shares[comm.rank]
        out = apply(band, own, border, value, "auto" if method == "dct" else method, threads, rows[first : last + 2 * reach])
        band = out[reach : len(out) - reach]
    else:
        band = band[:0]
    parts = comm.collect(band)
    return None if parts is None else np.concatenate(parts)


def _taken(image: Array, rows: Array, value: float) -> Array:
    band = image[rows]
    band[rows < 0] = value
    return band


def _by_slabs(image: Array | None, filter: Filter | None, comm: Comm, border: str, value: float, threads: int) -> Array | None:
    """All channels side by side; borders that no transform has are added around the picture first."""
    reach, slabs, wide = 0, None, image
    if image is not None:
        assert filter is not None
        reach = 0 if border in ("mirror", "wrap") else filter.reach
        wide = extended(image, (reach, reach), (reach, reach), border, value) if reach else image
        slabs = [wide[first:last] for first, last in comm.share_out(len(wide))]
    shape, transfer = comm.share((wide.shape, filter.transfer) if wide is not None and filter is not None else None)
    parts = comm.collect(by_transfer(comm.deal(slabs), shape[:2], transfer, "wrap" if border == "wrap" else "mirror", comm, threads))
    if parts is None or image is None:
        return None
    out = np.concatenate(parts)[reach : shape[0] - reach, reach : shape[1] - reach]
    if not np.isfinite(out[0, 0]).all():
        refuse_odd(image)
    return np.ascontiguousarray(out)
