"""luxel diff: how far two pictures are apart."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet
from luxel.errors import LuxelWarning

if TYPE_CHECKING:
    from luxel.arrays import Array

EXAMPLE = "luxel diff before.png after.png --max-rmse 0.01 --output difference.png"


def diff(
    a: Annotated[Path, typer.Argument(metavar="A", help="A picture: .png, .jpg, .exr, .hdr and others.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Another of the same size.")],
    max_rmse: Annotated[str, typer.Option("--max-rmse", metavar="X", help="Up to this RMSE (white is 1) they count as the same.")] = "0",
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="A .png of where they differ; white differs most."),
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Compare two pictures: RMSE, PSNR, SSIM.

    Exit code 0: the same. 1: different. 2: they cannot be compared.
    """
    from luxel.filter.metrics import difference_picture
    from luxel.io.images import write_png

    most = values.number(max_rmse, "--max-rmse", "a number of at least 0", lambda x: x >= 0)
    if output is not None:
        values.output(output, (".png",))
    first, second, unlike = _finite(*_pair(a, b))
    figures = _figures(first, second, unlike)
    same = figures["rmse"] <= most and not unlike.any()
    if output is not None:
        picture = difference_picture(first, second)
        picture[unlike] = 255
        write_png(output, picture)
    data = {"same": same, **figures, "output": None if output is None else str(output)}
    Console(quiet, as_json).result(data, _sentence(figures, same, output))
    if not same:
        raise typer.Exit(1)


def _pair(a: Path, b: Path) -> tuple[Array, Array]:
    """Both pictures, with as many channels: grey is spread to RGB, and a missing alpha is opaque."""
    from luxel.errors import InputError
    from luxel.io.images import read_image

    first, second = read_image(a), read_image(b)
    if first.shape[:2] != second.shape[:2]:
        sizes = (f"{name} is {p.shape[1]}x{p.shape[0]}" for name, p in ((a, first), (b, second)))
        raise InputError(f"pictures of one size expected: {', '.join(sizes)}")
    if first.dtype != second.dtype:
        raise InputError(f"{a} is {first.dtype} and {b} is {second.dtype}: encoded and linear pictures do not compare")
    channels = {first.shape[2], second.shape[2]}
    return (first, second) if len(channels) == 1 else (_rgba(first), _rgba(second))


def _finite(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Both pictures without what is not finite in either, and (h, w) bool: the pixels at which that is not the same in both."""
    import numpy as np

    with np.errstate(invalid="ignore"):
        wild = ~(np.isfinite(a) & np.isfinite(b))
        unlike = (wild & (a != b) & ~(np.isnan(a) & np.isnan(b))).any(-1)
    if wild.any():
        count = int(wild.any(-1).sum())
        what = "they count as different where they are not the same in both, and not in the figures"
        warnings.warn(f"{count:,} pixels hold NaN or infinity: {what}", LuxelWarning, stacklevel=2)
        a, b = np.where(wild, 0, a), np.where(wild, 0, b)
    return a, b, unlike


def _rgba(picture: Array) -> Array:
    import numpy as np

    opaque = np.full((*picture.shape[:2], 1), 255 if picture.dtype == np.uint8 else 1, picture.dtype)
    alpha = picture[..., -1:] if picture.shape[2] in (2, 4) else opaque
    color = picture[..., :3] if picture.shape[2] >= 3 else np.repeat(picture[..., :1], 3, 2)
    return np.concatenate([color, alpha], 2)


def _figures(a: Array, b: Array, unlike: Array) -> dict[str, Any]:
    """The metrics, as JSON has them (no infinity: PSNR of equal pictures is None)."""
    import numpy as np

    from luxel.filter.metrics import max_difference, psnr, rmse, ssim

    peak = 1.0 if a.dtype == np.uint8 else max(1.0, float(a.max()), float(b.max()))  # float pictures may be brighter
    ratio = psnr(a, b, peak)
    return {
        "rmse": rmse(a, b),
        "psnr": ratio if np.isfinite(ratio) else None,
        "ssim": ssim(a, b, peak),
        "max_difference": max_difference(a, b),
        "differing_pixels": int(((a != b).any(-1) | unlike).sum()),
        "pixels": int(a.shape[0] * a.shape[1]),
        "peak": peak,
    }


def _sentence(figures: dict[str, Any], same: bool, output: Path | None) -> str:
    if figures["differing_pixels"] == 0:
        return "the same: every pixel is equal"
    part = figures["differing_pixels"] / figures["pixels"]
    psnr = "inf" if figures["psnr"] is None else f"{figures['psnr']:.2f}"
    lines = [
        "the same, as far as asked" if same else "different",
        f"  RMSE                {figures['rmse']:.6f}",
        f"  PSNR                {psnr} dB",
        f"  SSIM                {figures['ssim']:.6f}",
        f"  largest difference  {figures['max_difference']:.6f}",
        f"  differing pixels    {figures['differing_pixels']:,} of {figures['pixels']:,} ({part:.2%})",
    ]
    if output is not None:
        lines.append(f"  {output}")
    return "\n".join(lines)
