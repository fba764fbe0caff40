"""Pictures: in which order each scheme fills a triangle, the wave after some steps, midlines' copies, and the seam of counter interpolation."""

from __future__ import annotations

from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.raster.constants import SUBPIXEL
from luxel.studies.report import Report
from luxel.studies.shading.accuracy import level, pixel_errors
from luxel.studies.shading.fill import Filled, Triangle, fill, triangle
from luxel.studies.shading.fixed import VALUE_BITS, Format
from luxel.studies.shading.schemes import CLASSICAL, CONTROL, COUNTERED, INTERLEAVES, LITERAL, MIDLINES, PLANE, VARIANTS, WAVE
from luxel.studies.shading.shapes import glossy_triangle
from luxel.studies.study import Context

Row = dict[str, Any]
IN_ROWS = (CLASSICAL, COUNTERED, INTERLEAVES[0], INTERLEAVES[2])
SHOWN = (CLASSICAL, COUNTERED, INTERLEAVES[0], INTERLEAVES[2], WAVE, VARIANTS[2], MIDLINES, VARIANTS[3])
_GREY = 255 << VALUE_BITS


def shown_triangle(size: int = 56) -> Triangle:
    """A triangle with no special angles."""
    corners = np.array([[0.02, 0.1], [0.98, 0.32], [0.3, 0.97]]) * size * SUBPIXEL
    return triangle(np.round(corners).astype(np.int64), [[20 << VALUE_BITS], [_GREY], [120 << VALUE_BITS]])


def thin_triangle() -> Triangle:
    """Two pixels wide, at an angle."""
    return triangle([[0, 0], [56 * SUBPIXEL, 31 * SUBPIXEL], [55 * SUBPIXEL, 33 * SUBPIXEL]], [[0], [_GREY], [_GREY]])


def when(filled: Filled) -> Array:
    """(h, w) float64: the step at which each pixel was written, NaN where none was."""
    return np.where(filled.writes > 0, filled.step, np.nan)


def panels(images: list[Array], across: int, gap: int = 3) -> tuple[Array, list[tuple[int, int]]]:
    """Equal arrays side by side, `across` a row, with NaN between them; and where each begins, x and y."""
    height, width = (max(image.shape[k] for image in images) + gap for k in range(2))
    sheet = np.full((-(-len(images) // across) * height, across * width), np.nan)
    places = [(k % across * width, k // across * height) for k in range(len(images))]
    for image, (x, y) in zip(images, places, strict=True):
        sheet[y + gap : y + gap + image.shape[0], x : x + image.shape[1]] = image
    return sheet, places


def draw(report: Report, name: str, title: str, images: list[Array], labels: list[str], note: str, across: int = 4, **options: Any) -> None:
    """A sheet of labelled panels."""
    sheet, places = panels(images, across, 9)
    size = (2.3 * across, 0.5 + 2.3 * across * sheet.shape[0] / sheet.shape[1])
    with report.figure(name, title, note, size) as axes:
        axes.imshow(sheet, interpolation="nearest", **options)
        axes.set_axis_off()
        axes.grid(False)
        for label, (x, y) in zip(labels, places, strict=True):
            axes.text(x, y + 6, label, fontsize=8)


def run(context: Context, report: Report, facts: Row) -> None:
    """All of them; they are the same in a quick run."""
    what, thin = shown_triangle(), thin_triangle()
    filled = [fill(what, scheme) for scheme in SHOWN]
    labels = [f"{scheme.name}: {f.steps} steps" for scheme, f in zip(SHOWN, filled, strict=True)]
    note = "Dark first, light last, each in its own time. `wave` draws its border first; midlines fill four at once, and then what their copies left."
    draw(report, "order", "The order in which each scheme fills", [when(f) / f.steps for f in filled], labels, note, cmap="viridis", vmin=0, vmax=1)
    _rows(report)
    _waves(report, what)
    _thin(report, thin)
    copies = fill(what, MIDLINES)
    even = fill(triangle(np.array([[0, 0], [54, 8], [8, 52]]) * SUBPIXEL, [[0], [_GREY], [_GREY]]), MIDLINES)
    labels = ["an even number of pixels apart", f"any corners: {copies.repaired} left"]
    note = "Template, two moved copies, and the middle one, turned by 180 degrees. Light: pixels that no copy wrote, filled at the end."
    draw(report, "midlines", "Midlines: which copy wrote each pixel", [_who(even), _who(copies)], labels, note, 2, cmap="tab20c", vmin=0, vmax=19)
    _seam(report)
    _phong(report)


def _who(filled: Filled) -> Array:
    """Which of the copies wrote each pixel; those that were left are the last to be written, one a step, by unit 0."""
    last = np.sort(filled.step[filled.writes > 0])[len(filled.step[filled.writes > 0]) - filled.repaired :] if filled.repaired else np.array([])
    drawn = np.where(filled.writes > 0, filled.unit * 4.0, np.nan)
    return np.where(np.isin(filled.step, last) & (filled.writes > 0), 19, drawn)


def within_row(filled: Filled) -> Array:
    """(h, w) float64: how far each row was, from 0 to 1, when a pixel was written; NaN where none was."""
    begun = np.where(filled.writes > 0, filled.step, np.iinfo(np.int32).max).min(1, keepdims=True)
    took = np.maximum(filled.step.max(1, keepdims=True) - begun, 1)
    return np.where(filled.writes > 0, (filled.step - begun) / took, np.nan)


def _rows(report: Report) -> None:
    """What the order of the whole triangle does not show: in which order, and by whom, each row is written."""
    what = shown_triangle(24)
    filled = [fill(what, scheme) for scheme in IN_ROWS]
    units = [np.where(f.writes > 0, f.unit / max(f.units - 1, 1), np.nan) for f in filled]
    labels = [*(f"{scheme.name}: when" for scheme in IN_ROWS), *(f"{scheme.name}: by whom" for scheme in IN_ROWS)]
    note = "When: dark first, light last, each row in its own time. By whom: a colour for each interpolator."
    draw(report, "rows", "The order in each row", [*map(within_row, filled), *units], labels, note, cmap="viridis", vmin=0, vmax=1)


def _waves(report: Report, what: Triangle) -> None:
    filled = fill(what, VARIANTS[2])
    covered, first = filled.writes > 0, int(filled.step[filled.writes > 0].min())
    steps = [2, 6, 12, 20, 28]
    images = [np.where(covered, np.where(filled.step < k + first, filled.step, -12.0), np.nan) for k in [*steps, filled.steps]]
    labels = [*(f"after {k} steps" for k in steps), "at the end"]
    draw(report, "wave", "The wave after some steps", images, labels, "From one seed; dark: not reached.", 3, cmap="inferno")


def _thin(report: Report, thin: Triangle) -> None:
    cases = {"one seed, to the letter": LITERAL[0], "border first, one seed": LITERAL[1], "more seeds": VARIANTS[2], "border first, more seeds": WAVE}
    images, labels = [], []
    for label, scheme in cases.items():
        filled = fill(thin, scheme, source=PLANE)
        missed = thin.covered.mask & (filled.writes == 0)
        images.append(np.where(missed, -0.4, when(filled) / filled.steps))
        labels.append(f"{label}: {int(missed.sum())} missed")
    note = f"{thin.covered.pixels} pixels, which are not 4-connected. Black: missed."
    draw(report, "thin", "The wave in a triangle two pixels wide", images, labels, note, 2, cmap="inferno", vmin=-0.4, vmax=1)


def _seam(report: Report) -> None:
    form = Format(8, 8)
    values = np.array([[20.0], [118.4], [65.66]]) * 2**VALUE_BITS  # slopes near the middle of two numbers of this format
    what = triangle([[0, 0], [120 * SUBPIXEL, 9 * SUBPIXEL], [20 * SUBPIXEL, 60 * SUBPIXEL]], values.astype(np.int64))
    images, labels, most = [], [], 0.0
    for scheme in (CLASSICAL, COUNTERED, CONTROL):
        y, x, found = pixel_errors(what, fill(what, scheme, form), form)
        image = np.full(what.covered.mask.shape, np.nan)
        image[y, x] = found[0] / form.ulp
        images.append(image)
        labels.append(f"{scheme.name}: at most {np.abs(image[y, x]).max():.1f}")
        most = max(most, np.abs(image[y, x]).max())
    note = "Counter interpolation has half the error, and a seam in mid-span that is as large as the whole error of one interpolator."
    draw(report, "seam", "Errors at 8.8, units of the last place", images, labels, note, 3, cmap="coolwarm", vmin=-most, vmax=most)


def _phong(report: Report) -> None:
    """Normals at 8.8, normalised and lit, beside exact ones."""
    form = Format(8, 8)
    what = glossy_triangle(np.random.default_rng(4), 2600)
    images, labels = [], []
    for scheme in (CLASSICAL, COUNTERED, MIDLINES, CONTROL):
        filled = fill(what, scheme, form)
        y, x, wrong = pixel_errors(what, filled, form)
        held = filled.value[:, y, x] * form.ulp
        image = np.full(what.covered.mask.shape, np.nan)
        image[y, x] = level(held)
        images.append(image)
        labels.append(f"{scheme.name}: off by {np.abs(level(held) - level(held - wrong)).max():.1f}")
    exact = images[-1].copy()
    exact[y, x] = level(held - wrong)
    labels.append("exact")
    title = "Phong's normals at 8.8, normalised and lit"
    draw(report, "phong", title, [*images, exact], labels, "Off by: levels of 255.", 5, cmap="gray", vmin=0, vmax=255)
