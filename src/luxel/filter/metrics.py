"""How far two pictures are apart.

Pictures are arrays (h, w) or (h, w, c): uint8 and uint16 are taken as 0..1, floats as they are. Both are compared as
they come, without a change of colour space: the values of an 8-bit sRGB file are close to even steps for the eye, which
is what SSIM wants; linear light of any range suits RMSE. A NaN in a picture makes the figures NaN.

SSIM: Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to structural similarity" (2004)
with their 11 x 11 Gaussian window of sigma 1.5, K1 = 0.01 and K2 = 0.03; window sums mirror the picture at its border.
"""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError

_SIGMA, _RADIUS, _K1, _K2 = 1.5, 5, 0.01, 0.03


def rmse(a: object, b: object) -> float:
    """Root of the mean squared difference over all pixels and channels; 0 for equal pictures.

    Raises:
        InputError: The shapes differ, a dtype is not one of a picture, or there are no pixels.
    """
    p, q = _pair(a, b)
    return float(np.sqrt(np.mean(np.square(p - q))))


def psnr(a: object, b: object, data_range: float = 1.0) -> float:
    """Peak signal-to-noise ratio, 20 log10(data_range / RMSE), in dB; inf for equal pictures.

    Args:
        a: A picture.
        b: Another of the same shape.
        data_range: The largest value that is possible.

    Raises:
        InputError: As of `rmse`, or the range is not positive.
    """
    _check_range(data_range)
    error = rmse(a, b)
    return float(20 * np.log10(data_range / error)) if error > 0 else float("inf")


def max_difference(a: object, b: object) -> float:
    """Largest absolute difference of any pixel in any channel.

    Raises:
        InputError: As of `rmse`.
    """
    p, q = _pair(a, b)
    return float(np.abs(p - q).max())


def ssim(a: object, b: object, data_range: float = 1.0) -> float:
    """Structural similarity, the mean over pixels and channels: 1 for equal pictures, about 0 for unrelated ones.

    Args:
        a: A picture.
        b: Another of the same shape.
        data_range: The largest value that is possible; it scales the two constants.

    Raises:
        InputError: As of `rmse`, or the range is not positive.
    """
    return float(ssim_map(a, b, data_range).mean())


def ssim_map(a: object, b: object, data_range: float = 1.0) -> Array:
    """(h, w, c) float64: the structural similarity at each pixel and channel; arguments and errors as of `ssim`."""
    _check_range(data_range)
    p, q = _pair(a, b)
    c1, c2 = (_K1 * data_range) ** 2, (_K2 * data_range) ** 2
    mean_p, mean_q = _window(p), _window(q)
    var_p = _window(p * p) - mean_p**2
    var_q = _window(q * q) - mean_q**2
    covariance = _window(p * q) - mean_p * mean_q
    luminance = (2 * mean_p * mean_q + c1) / (mean_p**2 + mean_q**2 + c1)
    return luminance * (2 * covariance + c2) / (var_p + var_q + c2)


def edge_rmse(picture: object, reference: object, edges: object = None) -> float:
    """`rmse` over the edge pixels alone: the rest of a picture is the same for every way of anti-aliasing, and hides what differs.

    Args:
        picture: A picture.
        reference: What it should be, of the same shape: drawn with many samples (the papers take 256), or exact (`luxel.filter.coverage`).
        edges: (h, w) bool, which pixels count; None: those that differ from a neighbour by more than 1/255 in the reference.

    Raises:
        InputError: As of `rmse`, a mask of another size, or no edge pixels.
    """
    p, q = _pair(picture, reference)
    mask = edge_pixels(q) if edges is None else np.asarray(edges)
    if mask.shape != q.shape[:2] or mask.dtype != bool:
        raise InputError(f"edges: expected {q.shape[:2]} bool, got {mask.shape} {mask.dtype}")
    if not mask.any():
        raise InputError("edges: expected at least one edge pixel, got none")
    return float(np.sqrt(np.mean(np.square(p[mask] - q[mask]))))


def edge_pixels(picture: object, threshold: float = 1 / 255) -> Array:
    """(h, w) bool: the pixels that differ from one of their four neighbours by more than `threshold` in some channel."""
    p = _picture(picture, "picture")
    edges = np.zeros(p.shape[:2], bool)
    down, right = (np.abs(np.diff(p, axis=axis)).max(-1) > threshold for axis in (0, 1))
    edges[1:] |= down
    edges[:-1] |= down
    edges[:, 1:] |= right
    edges[:, :-1] |= right
    return edges


def difference_picture(a: object, b: object, gain: float | None = None) -> Array:
    """(h, w, 3) uint8: where two pictures differ, from black (equal) over red and yellow to white (most).

    Args:
        a: A picture; a pixel counts by its channel that differs most.
        b: Another of the same shape.
        gain: What the difference is multiplied by before 1 is white; None makes the largest difference white.

    Raises:
        InputError: As of `rmse`, or the gain is not positive.
    """
    if gain is not None and (not isinstance(gain, (int, float, np.number)) or not gain > 0):
        raise InputError(f"gain: expected a factor > 0, got {gain!r}")
    p, q = _pair(a, b)
    difference = np.abs(p - q).max(-1)
    largest = difference.max()
    if gain is None:
        gain = 1 / largest if largest > 0 else 1.0
    heat = np.clip(difference * gain, 0, 1)
    ramp = np.clip(3 * heat[..., None] - np.arange(3), 0, 1)  # red fills first, then green, then blue
    return np.round(255 * ramp).astype(np.uint8)


def _pair(a: object, b: object) -> tuple[Array, Array]:
    """Both as (h, w, c) float64."""
    p, q = _picture(a, "a"), _picture(b, "b")
    if p.shape != q.shape:
        raise InputError(f"pictures of one shape expected, got {_spell(p)} and {_spell(q)}")
    return p, q


def _picture(value: object, name: str) -> Array:
    array = np.asarray(value)
    if array.ndim == 2:
        array = array[..., None]
    if array.ndim != 3 or array.size == 0:
        raise InputError(f"{name}: expected a picture (h, w) or (h, w, c) with at least one pixel, got {array.shape}")
    if array.dtype in (np.uint8, np.uint16):
        return array / float(np.iinfo(array.dtype).max)
    if array.dtype.kind not in "fb":
        raise InputError(f"{name}: expected uint8, uint16 or float, got {array.dtype}")
    return array.astype(np.float64)


def _spell(picture: Array) -> str:
    height, width, channels = picture.shape
    return f"{width}x{height} with {channels} channel{'s' * (channels > 1)}"


def _check_range(data_range: float) -> None:
    if not isinstance(data_range, (int, float, np.number)) or not data_range > 0:
        raise InputError(f"data_range: expected a number > 0, got {data_range!r}")


def _window(picture: Array) -> Array:
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(picture, _SIGMA, mode="reflect", radius=_RADIUS, axes=(0, 1))
