"""A triangle, and what a scheme makes of it: filled with its interpolators, step by step.

All of them fill exactly the pixels that luxel's rasteriser covers. Three fill them by spans, from the left end, from both, or every n-th pixel each.
Two need help to fill them all, which is done and counted:

- The wave stops where the triangle is not 4-connected. It is read as the paper hints: two edge interpolators draw the border first, the wave fills
  what is within, and starts again from another seed in every part that it did not reach.
- Midlines give four congruent triangles, but not four congruent sets of pixels, unless all corners lie an even number of pixels apart. A copy writes
  what the triangle covers and nobody wrote; what is left is filled by the code interpolator at the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.raster.constants import SUBPIXEL
from luxel.studies.shading.coverage import Coverage, coverage, spans_of
from luxel.studies.shading.fixed import VALUE_BITS, Format, Plane, nearest, planes, wrap, wrap_all
from luxel.studies.shading.interpolators import INTERLEAVED, MOST_LANES, run_border, run_copies, run_rows, run_wave
from luxel.studies.shading.schemes import CLASSICAL, ENDS, PLANE, TRUNCATED, Machine, Resources, Scheme

DEFAULT, MACHINE = Format(), Machine()
_TURNED = np.array([0, 0, 0, 1])  # of midlines' copies: the one in the middle


class Triangle(NamedTuple):
    """What is filled: corners, values there, the exact planes of these, and the pixels."""

    corners: Array
    values: Array
    exact: list[Plane]
    covered: Coverage


def triangle(corners: object, values: object, screen: tuple[int, int, int, int] | None = None) -> Triangle:
    """A triangle to fill.

    Args:
        corners: (3, 2) integers, 1/256 pixel.
        values: (3, channels) integers, 2^-16.
        screen: x0, y0, x1, y1 in pixels, to which it is clipped; None, as many as it needs.

    Raises:
        InputError: Wrong shapes, corners on a line, or a triangle of more than 4096 pixels a side without a screen.
    """
    corners, values = checked(corners, (3, 2), np.int64, "corners"), checked(values, (3, "c"), np.int64, "values")
    return Triangle(corners, values, planes(corners, values), coverage(corners, screen))


@dataclass(frozen=True)
class Filled:
    """What a scheme made of a triangle; arrays are in pixels of its coverage's box.

    Attributes:
        step: (h, w) int32, the clock at which a pixel was written, from 0; -1 where none is.
        unit: (h, w) int32, the interpolator that wrote it.
        writes: (h, w) uint8, how often.
        value: (channels, h, w) int64, in units of the last place.
        steps: Clocks from the beginning to the last pixel.
        units: Pixels that could be written in a step.
        resources: What that took.
        seeds: Of a wave.
        repaired: Pixels that midlines' copies had left.
        refused: Writes of the template or its copies for which there was no pixel.
    """

    covered: Coverage
    step: Array
    unit: Array
    writes: Array
    value: Array
    steps: int
    units: int
    resources: Resources
    seeds: int = 0
    repaired: int = 0
    refused: int = 0

    @property
    def pixels(self) -> int:
        """How many were written."""
        return int((self.writes > 0).sum())

    @property
    def idle(self) -> int:
        """Pixels that could have been written in the steps that were taken, and were not."""
        return self.units * self.steps - self.pixels

    @property
    def utilisation(self) -> float:
        """Part of the steps in which a unit wrote a pixel."""
        return self.pixels / max(1, self.units * self.steps)


class _Sheet(NamedTuple):
    """The arrays that kernels write."""

    step: Array
    unit: Array
    writes: Array
    value: Array

    @classmethod
    def of(cls, mask: Array, channels: int) -> _Sheet:
        """Empty ones."""
        shape = mask.shape
        return cls(np.full(shape, -1, np.int32), np.full(shape, -1, np.int32), np.zeros(shape, np.uint8), np.zeros((channels, *shape), np.int64))


class _Spans(NamedTuple):
    """Spans, and what the interpolators' registers are loaded with; all (r, channels) but the plane's slopes, (channels,)."""

    rows: Array
    start: Array
    end: Array
    slope: Array
    stride: Array
    across: Array
    down: Array


def _spans(scheme: Scheme, exact: Sequence[Plane], rows: Array, x: int, y: int, form: Format, source: str) -> _Spans:
    """Set up spans whose rows count from pixel (x, y)."""
    shape = len(exact), len(rows)
    start, end, slope, stride = (np.zeros(shape, np.int64) for _ in range(4))
    gradients = np.array([plane.gradient(form) for plane in exact], np.int64).reshape(len(exact), 2)
    row, left, right = rows.T
    length = right - left
    for c, plane in enumerate(exact):
        if source != PLANE:
            start[c], end[c] = (plane.all_rounded(x + column, y + row, form) for column in (left, right))
            change = wrap_all(end[c] - start[c], form.bits)
            slope[c] = _share(change, length, source)
            stride[c] = _share(scheme.lanes * change, length, source) if scheme.own_strides else scheme.lanes * slope[c]
        else:
            first = plane.rounded(x + int(left[0]), y + int(row[0]), form)
            start[c] = first + (left - left[0]) * gradients[c, 0] + (row - row[0]) * gradients[c, 1]
            end[c], slope[c], stride[c] = start[c] + length * gradients[c, 0], gradients[c, 0], scheme.lanes * gradients[c, 0]
    loaded = [np.ascontiguousarray(wrap_all(v, form.bits).T) for v in (start, end, slope, stride if scheme.way == INTERLEAVED else slope)]
    return _Spans(rows, *loaded, *np.ascontiguousarray(gradients.T))


def _share(change: Array, length: Array, source: str) -> Array:
    """A change by a length, rounded to nearest or, TRUNCATED, down; 0 where the length is 0."""
    safe = np.maximum(length, 1)
    share = change // safe if source == TRUNCATED else (2 * change + safe) // (2 * safe)
    return np.where(length > 0, share, 0)


def fill(what: Triangle, scheme: Scheme = CLASSICAL, form: Format = DEFAULT, machine: Machine = MACHINE, source: str = ENDS) -> Filled:
    """Run a scheme over a triangle.

    Args:
        what: From `triangle`.
        scheme: One of SCHEMES, VARIANTS or LITERAL, or another.
        form: Of the registers of the channels.
        machine: What set-up costs.
        source: ENDS, TRUNCATED or PLANE. A wave takes the plane's slopes in any case, and from here its seeds and its border's values.

    Raises:
        InputError: Values at the corners that the registers cannot hold, an impossible format, or more than 16 lanes.
    """
    form = form.checked()
    if not 0 <= scheme.lanes <= MOST_LANES or source not in (ENDS, TRUNCATED, PLANE):
        known = f"{ENDS!r}, {TRUNCATED!r} or {PLANE!r}"
        raise InputError(f"fill: expected up to {MOST_LANES} lanes and {known}, got {scheme.lanes} and {source!r}")
    if np.abs(what.values).max(initial=0) > 1 << (form.integer + VALUE_BITS):
        most = np.abs(what.values).max() / 2**VALUE_BITS
        raise InputError(f"values: expected at most 2^{form.integer} in size for registers of {form}, got {most:g}")
    if what.covered.pixels == 0:
        sheet = _Sheet.of(what.covered.mask, len(what.exact))
        return Filled(what.covered, *sheet, 0, max(1, scheme.lanes), scheme.resources(1))
    run = {"spans": _fill_spans, "wave": _fill_wave, "midlines": _fill_midlines}[scheme.kind]
    return run(what, scheme, form, machine, source)


def _walk(scheme: Scheme, spans: _Spans, form: Format, machine: Machine, source: str, begun: int, sheet: _Sheet) -> int:
    """Fill spans; returns the clock after them."""
    steps = np.zeros(1, np.int64)
    row = machine.edge + (0 if source == PLANE else machine.divide)
    loaded = spans.start, spans.end, spans.slope, spans.stride
    run_rows(scheme.way, max(1, scheme.lanes), spans.rows, np.array([0, len(spans.rows)]), *loaded, form.bits, row, machine.overlapped, begun,
             *sheet, steps)  # fmt: skip
    return int(steps[0])


def _begun(machine: Machine, source: str) -> int:
    """The clock when a triangle's slopes are known."""
    return 2 * machine.divide if source == PLANE else 0


def _fill_spans(what: Triangle, scheme: Scheme, form: Format, machine: Machine, source: str) -> Filled:
    covered = what.covered
    sheet = _Sheet.of(covered.mask, len(what.exact))
    spans = _spans(scheme, what.exact, spans_of(covered.mask), covered.x, covered.y, form, source)
    steps = _walk(scheme, spans, form, machine, source, _begun(machine, source), sheet)
    return Filled(covered, *sheet, steps, scheme.lanes, scheme.resources(scheme.lanes))


def inside_of(mask: Array) -> Array:
    """(h, w) bool: the pixels of a mask whose four neighbours are in it too; the others are its border."""
    m = np.pad(mask, 1)
    return mask & m[:-2, 1:-1] & m[2:, 1:-1] & m[1:-1, :-2] & m[1:-1, 2:]


def halved(corners: Array) -> tuple[int, int]:
    """A pixel within the triangle: that of the middle between one corner and the middle of the other two, by additions and shifts."""
    x, y = (2 * corners[0] + corners[1] + corners[2]) >> 2
    return int(x) // SUBPIXEL, int(y) // SUBPIXEL


def _fill_wave(what: Triangle, scheme: Scheme, form: Format, machine: Machine, source: str) -> Filled:
    covered = what.covered
    sheet = _Sheet.of(covered.mask, len(what.exact))
    spans = _spans(scheme, what.exact, spans_of(covered.mask), covered.x, covered.y, form, source)
    todo, clock = covered.mask, _begun(machine, PLANE)
    if scheme.border:
        todo = inside_of(covered.mask)
        clock = run_border(spans.rows, todo, spans.start, spans.end, spans.across, form.bits, machine.edge, clock, *sheet)
    told = np.zeros(3, np.int64)
    x, y = halved(what.corners)
    if todo.any():
        seed = np.array([x - covered.x, y - covered.y])
        run_wave(todo.astype(np.uint8), scheme.again, scheme.lanes, seed, spans.rows, spans.start, spans.across, spans.down, form.bits, machine.edge,
                 clock + 2, *sheet, told)  # fmt: skip
        clock = told[2]
    units = max(int(told[1]), 2 if scheme.border else 1)
    return Filled(covered, *sheet, int(sheet.step.max()) + 1, units, scheme.resources(units), int(told[0]))


def _fill_midlines(what: Triangle, scheme: Scheme, form: Format, machine: Machine, source: str) -> Filled:
    covered, corners = what.covered, what.corners
    channels = len(what.exact)
    template = coverage(np.stack([corners[0], (corners[0] + corners[1]) >> 1, (corners[0] + corners[2]) >> 1]))
    sheet, own = _Sheet.of(covered.mask, channels), _Sheet.of(template.mask, channels)
    clock = _begun(machine, source) + machine.edge  # the three constants come from three adders in one step
    todo, refused = covered.mask.astype(np.uint8), 0
    if template.pixels:
        spans = _spans(scheme, what.exact, spans_of(template.mask), template.x, template.y, form, source)
        clock = _walk(scheme, spans, form, machine, source, clock, own)
        ys, xs = np.nonzero(own.step >= 0)
        order = np.argsort(own.step[ys, xs], kind="stable")
        ys, xs = ys[order], xs[order]
        offset, constant = _copies(what, template, form)
        clocks, numbers = (a[ys, xs].astype(np.int64) for a in own[:2])
        values = np.ascontiguousarray(own.value[:, ys, xs])
        refused = run_copies(xs, ys, clocks, numbers, values, offset, _TURNED, constant, scheme.lanes, form.bits, todo, *sheet)
    left = _runs(todo)
    if len(left):
        spans = _spans(CLASSICAL, what.exact, left, covered.x, covered.y, form, ENDS)
        clock = _walk(CLASSICAL, spans, form, machine, ENDS, clock, sheet)
    units = 4 * scheme.lanes
    return Filled(covered, *sheet, clock, units, scheme.resources(units), 0, int(todo.sum()), refused)


def _copies(what: Triangle, template: Coverage, form: Format) -> tuple[Array, Array]:
    """Offsets (4, 2) from the template's box to the triangle's, the nearest whole pixels, and constants (4, channels): of the template, of two moved
    copies, and of the one in the middle, turned by 180 degrees."""
    a, b, c = (tuple(int(v) for v in corner) for corner in what.corners)
    moves = [tuple(nearest(to[k] - a[k], 2 * SUBPIXEL) for k in range(2)) for to in (a, b, c)]
    turn = tuple(nearest(2 * a[k] + b[k] + c[k], 2 * SUBPIXEL) - 1 for k in range(2))
    box, own = (what.covered.x, what.covered.y), (template.x, template.y)
    offset = [[move[k] + own[k] - box[k] for k in range(2)] for move in moves] + [[turn[k] - own[k] - box[k] for k in range(2)]]
    scale = form.fraction
    constant = [[nearest((p.p * dx + p.q * dy) << scale, p.d) for p in what.exact] for dx, dy in moves]
    constant.append([nearest((p.p * turn[0] + p.q * turn[1] + 2 * p.r) << scale, p.d) for p in what.exact])
    return np.array(offset, np.int64), np.array([[wrap(v, form.bits) for v in row] for row in constant], np.int64).reshape(4, len(what.exact))


def _runs(todo: Array) -> Array:
    """(r, 3) int64: row, first and last pixel of all runs of a mask, which may have several a row."""
    edges = np.diff(np.pad(todo.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    y, first = np.nonzero(edges == 1)
    return np.stack([y, first, np.nonzero(edges == -1)[1] - 1], 1).astype(np.int64)
