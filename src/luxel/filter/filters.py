"""Low-pass filters of pictures: Gaussian, Butterworth, ideal, or any kernel, by whichever way of convolving is cheapest."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.filter import cost, light, overlap, transfer
from luxel.filter.borders import border_map, checked_border
from luxel.filter.direct import direct
from luxel.filter.separable import separable
from luxel.filter.spectral import Transfer, by_kernel, by_transfer

_RANK_ONE = 1e-9  # of the largest weight: a kernel so near to a product of a column and a row is one


class Filter(NamedTuple):
    """A filter, in every form that it has.

    Attributes:
        transfer: Its factor of each frequency, if it is even; None for a kernel.
        taps: Its weights along columns and rows, if it is their product.
        kernel: Its weights (kh, kw), made when asked for.
        reach: How many pixels it looks around.
    """

    transfer: Transfer | None
    taps: tuple[Array, Array] | None
    kernel: Callable[[], Array] | None
    reach: int


def lowpass(image: object, *, gaussian: float | None = None, butterworth: tuple[float, float] | None = None, ideal: float | None = None,
            kernel: object = None, border: str = "mirror", value: float = 0.0, encoded: bool | None = None, method: str = "auto",
            threads: int | None = None) -> Array:  # fmt: skip
    """Filter a picture, in linear light.

    Exactly one of the first four says how:

    Args:
        image: (h, w) or (h, w, 1..4). uint8 and uint16 are taken as sRGB with straight alpha (2 or 4 channels), floats as linear numbers,
            all channels alike (so colours with an alpha must be premultiplied, as in `Picture.linear`).
        gaussian: Standard deviation in pixels; the weights end at 4 of them.
        butterworth: (cut-off in cycles per pixel, order).
        ideal: Cut-off in cycles per pixel.
        kernel: (kh, kw) weights, convolved: out[y, x] = sum of kernel[i, j] image[y + (kh - 1) // 2 - i, x + (kw - 1) // 2 - j]. Integers
            (a picture) are scaled to sum to 1; floats are taken as they are.
        border: What lies beyond the picture: "mirror" (c b a | a b c), "clamp" (a a a), "wrap", "constant". Butterworth and ideal filters
            reach infinitely far; for "clamp" and "constant" they see 16 / cut-off pixels beyond the border.
        value: The constant, linear, in every channel.
        encoded: Whether the numbers are sRGB with straight alpha; None: integers are, floats are not.
        method: "separable" and "direct" sums, "tiles" (overlap-save FFT), "fft" or "dct" of the whole picture; "auto" takes the cheapest.
            They agree to rounding.
        threads: None: all cores.

    Returns:
        The filtered picture, of the same shape and dtype.

    Raises:
        InputError: No or several filters, a shape or dtype that is no picture, numbers that are not finite, a method that cannot do it.
    """
    border, threads = checked_border(border), jit.checked_threads(threads)
    chosen = make_filter(gaussian, butterworth, ideal, kernel)
    array, shape = checked_picture(image)
    whole = array.dtype.kind == "u"
    linear = (not whole) if encoded is None else not encoded
    if not whole and not linear:
        raise InputError(f"encoded: floats are taken as linear, got {array.dtype}; decode them with luxel.scene.colour.linear_from_srgb")
    if not np.isfinite(value):
        raise InputError(f"value: expected a finite number, got {value!r}")
    if whole:
        source = light.decode(array, not linear, threads)
    else:
        source = np.ascontiguousarray(array, np.float32 if array.dtype.itemsize < 8 else np.float64)
    out = apply(source, chosen, border, float(value), method, threads)
    if whole:
        return light.encode(out, array.dtype, not linear, threads).reshape(shape)
    return out.astype(array.dtype, copy=False).reshape(shape)


def checked_picture(image: object) -> tuple[Array, tuple[int, ...]]:
    """(h, w, c) and the shape it came in; floats, uint8 or uint16 with 1 to 4 channels."""
    try:
        array = np.asarray(image)
    except ValueError as error:
        raise InputError(f"image: expected a picture (h, w) or (h, w, 1..4), got a ragged {type(image).__name__}") from error
    shape = array.shape
    if array.ndim == 2:
        array = array[..., None]
    if array.ndim != 3 or array.size == 0 or not 1 <= array.shape[2] <= 4:
        raise InputError(f"image: expected (h, w) or (h, w, 1..4) with at least one pixel, got {shape}")
    if array.dtype not in (np.uint8, np.uint16, np.float16, np.float32, np.float64):
        raise InputError(f"image: expected uint8, uint16, float16, float32 or float64, got {array.dtype}")
    return array, shape


def make_filter(gaussian: Any = None, butterworth: Any = None, ideal: Any = None, kernel: Any = None) -> Filter:
    """The filter that exactly one of the arguments of `lowpass` describes."""
    named = {"gaussian": gaussian, "butterworth": butterworth, "ideal": ideal, "kernel": kernel}
    given = [name for name, value in named.items() if value is not None]
    if len(given) != 1:
        raise InputError(f"expected one of gaussian, butterworth, ideal and kernel, got {' and '.join(given) or 'none'}")
    if gaussian is not None:
        return _gaussian(gaussian)
    if kernel is not None:
        return _kernel(kernel)
    if ideal is not None:
        function: Any = partial(transfer.ideal, cutoff=ideal)
        cutoff = ideal
    else:
        try:
            cutoff, order = butterworth
        except (TypeError, ValueError):
            raise InputError(f"butterworth: expected (cutoff, order), got {butterworth!r}") from None
        function = partial(transfer.butterworth, cutoff=cutoff, order=order)
    function(0.0, 0.0)  # it checks its arguments
    return Filter(function, None, None, int(np.ceil(16 / cutoff)))


def _gaussian(sigma: object) -> Filter:
    taps = transfer.gaussian_taps(transfer.checked_sigma(sigma))

    def factors(fy: Array, fx: Array) -> Array:
        return transfer.response(taps, fy.reshape(-1)).reshape(fy.shape) * transfer.response(taps, fx.reshape(-1)).reshape(fx.shape)

    return Filter(factors, (taps, taps), lambda: taps[:, None] * taps, len(taps) // 2)


def _kernel(value: object) -> Filter:
    array = np.asarray(value)
    array = array[..., 0] if array.ndim == 3 and array.shape[2] == 1 else array
    if array.ndim != 2 or array.size == 0 or array.dtype.kind not in "iuf":
        raise InputError(f"kernel: expected numbers (kh, kw), at least one, got {array.shape} {array.dtype}")
    weights = array.astype(np.float64)
    if not np.isfinite(weights).all():
        raise InputError("kernel: expected finite numbers, got some that are not")
    if array.dtype.kind in "iu":
        if not weights.sum() > 0:
            raise InputError("kernel: a picture is scaled to sum to 1, this one sums to 0 or less")
        weights /= weights.sum()
    return Filter(None, _factors(weights), lambda: weights, max(weights.shape) - 1)


def _factors(weights: Array) -> tuple[Array, Array] | None:
    """The column and the row whose product a kernel is, if there are such."""
    if min(weights.shape) == 1:
        return (weights[:, 0], np.ones(1)) if weights.shape[1] == 1 else (np.ones(1), weights[0])
    i, j = np.unravel_index(np.abs(weights).argmax(), weights.shape)
    if weights[i, j] == 0:
        return np.zeros(len(weights)), np.zeros(weights.shape[1])
    column, row = weights[:, j], weights[i] / weights[i, j]
    return (column, row) if np.abs(column[:, None] * row - weights).max() <= _RANK_ONE * np.abs(weights[i, j]) else None


def plans(filter: Filter, shape: tuple[int, int, int], border: str, threads: int = 1) -> list[cost.Plan]:
    """Every way to apply a filter to a picture of `shape`, the cheapest first."""
    found: list[cost.Plan | None] = []
    if filter.transfer is not None:
        found.append(cost.dct(shape, 0 if border in ("mirror", "wrap") else filter.reach))
    if filter.taps is not None:
        found.append(cost.separable(shape, sum(map(len, filter.taps))))
    if filter.kernel is not None:
        size = (len(filter.taps[0]), len(filter.taps[1])) if filter.taps is not None else filter.kernel().shape
        taps = size[0] * size[1] if filter.taps is not None else np.count_nonzero(filter.kernel())
        found += [cost.direct(shape, int(taps)), cost.tiles(shape, size, threads), cost.fft(shape, size)]  # type: ignore[arg-type]
    return sorted((plan for plan in found if plan is not None), key=lambda plan: plan.cost)


def apply(image: Array, filter: Filter, border: str, value: float, method: str, threads: int, rows: Array | None = None) -> Array:
    """Filter (h, w, c) float32 or float64 as it stands; arguments as of `lowpass`. `rows`: what to call its rows in an error."""
    if method not in ("auto", *cost.METHODS):
        raise InputError(f"method: expected auto or one of {', '.join(cost.METHODS)}; got {method!r}")
    every = plans(filter, image.shape, border, threads)  # type: ignore[arg-type]
    ways = [plan for plan in every if method in ("auto", plan.method)]
    if not ways:
        raise InputError(f"method: {method} cannot apply this filter, but {' and '.join(sorted(plan.method for plan in every))} can")
    out, finite = _apply(ways[0], image, filter, border, value, threads)
    if not finite:
        refuse_odd(image, rows)
    return out


def refuse_odd(image: Array, rows: Array | None = None) -> None:
    """Raise InputError where a number of (h, w, c) is not finite; `rows` are the numbers of its rows, where not 0, 1, 2 ..."""
    odd = np.argwhere(~np.isfinite(image))
    if len(odd):
        y, x, channel = odd[0]
        where = f"row {y if rows is None else rows[y]}, column {x}, channel {channel}"
        raise InputError(f"image: expected finite numbers, got {image[y, x, channel]} at {where} ({len(odd)} in all)")


def _apply(plan: cost.Plan, image: Array, filter: Filter, border: str, value: float, threads: int) -> tuple[Array, bool]:
    """The filtered picture, and whether it is finite: one number that is not spoils others, so what comes out tells."""
    if plan.method == "dct":
        assert filter.transfer is not None
        out = by_transfer(image, filter.transfer, border, value, filter.reach, threads)
        return out, bool(np.isfinite(out[0, 0]).all())  # it would have spoilt all
    if plan.method == "separable":
        assert filter.taps is not None
        column, row = filter.taps
    else:
        assert filter.kernel is not None
        kernel = filter.kernel()
        column, row = kernel[:, 0], kernel[0]
    tall, wide = len(column) - 1, len(row) - 1
    top, left = tall - tall // 2, wide - wide // 2  # what it reaches up and left
    if plan.method == "fft":
        out = by_kernel(image, kernel, (top, left), border, value, threads)
        return out, bool(np.isfinite(out[0, 0]).all())
    y_map = border_map(image.shape[0], top, tall - top, border)
    x_map = border_map(image.shape[1], left, wide - left, border)
    out = np.empty_like(image)
    if plan.method == "separable":
        finite = separable(image, out, y_map, _turned(column, image), x_map, left, _turned(row, image), value, threads)
    elif plan.method == "direct":
        finite = direct(image, out, y_map, x_map, left, _turned(kernel, image), value, threads)
    else:
        finite = overlap.overlap_save(image, out, y_map, x_map, kernel, value, plan.size, threads)
    return out, finite


def _turned(weights: Array, image: Array) -> Array:
    """Weights in the order in which pixels meet them, of the picture's dtype."""
    return np.ascontiguousarray(np.flip(weights), image.dtype)
