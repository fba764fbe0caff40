"""A picture's spectrum to look at."""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.filter.transform import fft2

_DECADES = 6


def spectrum_picture(image: Array, peak: float | None = None, threads: int | None = None) -> tuple[Array, float]:
    """The magnitude of a picture's spectrum, frequency 0 in the middle, on a logarithmic scale.

    Args:
        image: (h, w, c) in linear light; its channels are averaged (without an alpha, where there are 2 or 4).
        peak: What is white; None: the largest magnitude but for frequency 0. Black is a millionth of it.

    Returns:
        (h, w) uint8, and the peak.
    """
    colors = image[..., : image.shape[2] - (image.shape[2] in (2, 4))] if image.ndim == 3 else image[..., None]
    magnitude = np.abs(fft2(np.ascontiguousarray(colors.mean(-1)), jit.checked_threads(threads)))
    if peak is None:
        rest = magnitude.reshape(-1)[1:]
        peak = float(rest.max()) if len(rest) else 0.0
    scale = np.log10(np.maximum(magnitude / peak, 10.0**-_DECADES)) / _DECADES + 1 if peak > 0 else np.zeros(magnitude.shape)
    return np.fft.fftshift((255 * np.clip(scale, 0, 1) + 0.5).astype(np.uint8)), peak
