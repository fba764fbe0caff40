"""Filters of pictures, Fourier transforms, and how far two pictures are apart.

    from luxel.filter import lowpass
    soft = lowpass(picture, gaussian=2.5)

Importing this is cheap: what it offers is imported when it is first asked for.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from luxel.filter.filters import lowpass
    from luxel.filter.metrics import difference_picture, max_difference, psnr, rmse, ssim
    from luxel.filter.transform import dft2, fft2, idft2, ifft2, irfft2, rfft2

_HOMES = {
    "luxel.filter.filters": ("lowpass",),
    "luxel.filter.metrics": ("difference_picture", "max_difference", "psnr", "rmse", "ssim"),
    "luxel.filter.transform": ("dft2", "fft2", "idft2", "ifft2", "irfft2", "rfft2"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["dft2", "difference_picture", "fft2", "idft2", "ifft2", "irfft2", "lowpass", "max_difference", "psnr", "rfft2", "rmse", "ssim"]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = globals()[name] = getattr(importlib.import_module(_HOME[name]), name)
        return value
    raise AttributeError(f"module 'luxel.filter' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(_HOME))
