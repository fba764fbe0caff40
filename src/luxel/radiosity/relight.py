"""Transport that is kept: other lights, other colours, the same walls, without looking again who sees whom.

    direct light of the new lights -> mean radiosity of groups of elements, by conjugate gradients
                                   -> irradiance of every element, by conjugate residuals

The groups' equations are b = d + rho F b with F from group to group. With areas a, and G = a F made symmetric (reciprocity), y = sqrt(a / rho) b
turns them into (1 - R G R) y = sqrt(a / rho) d, R = sqrt(rho / a): symmetric and positive definite while rho < 1 and the rows of G sum to at most a.
They are where the elements begin, whose own light is what their rays meet (`gather`), and where they end: what is missing then is small, and what it
brings elsewhere is again found by groups.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.errors import FileError, InputError
from luxel.io.files import atomic_write
from luxel.radiosity.element import AREA
from luxel.radiosity.gather import Sight, Spots, exchange_of, no_spots
from luxel.radiosity.labour import Labour
from luxel.radiosity.patches import patch_starts
from luxel.radiosity.solve import Rows, groups
from luxel.radiosity.transport import BLOCK, receive

if TYPE_CHECKING:
    from luxel.radiosity.elements import Cut
    from luxel.radiosity.luxels import Luxels

_ENOUGH = 1e-3  # of the norm of the right-hand side
_MOST_STEPS = 100
_SETTLED = 1e-3  # of the light: how much of it may be missing
_LEFT = 0.5  # of what is missing: what the groups leave of it, or less (0.45 in the paper's rooms)
_VERSION = 5


@dataclass(eq=False)
class Transport:
    """What every element of a baked scene sees, and what every light gives to it, per unit of radiosity.

    Attributes:
        luxel: (e,) int32: the luxel of each element; `front` (e,) bool: it is its front.
        area: (e,) float32, m2.
        starts: (p + 1,) int64: where the elements of each group begin.
        exchange: (p, p) float32: G, symmetric, m2.
        hits: (e, r) int32: what each sees; see `luxel.radiosity.gather.Sight`.
        spot_element, spot_area, spot_starts, spot_rows, spot_touched: Of bright elements, as in `luxel.radiosity.gather.Spots`.
        rows, touched: Of the l lights, as in `luxel.radiosity.solve.Rows`.
        point_luxel, point_share, point_area, point_starts: Of the points of the lights: their luxels (k,), exitance relative to these (k, 3),
            areas (k,), and where each light's begin (l + 1,).
        still: (3, e) float32: irradiance of lights without a surface, W/m2.
        emission: (n, 3) float32: radiant exitance of each luxel at the bake, W/m2.
        albedo: (n, 3) float32: of each luxel at the bake.
    """

    luxel: Array
    front: Array
    area: Array
    starts: Array
    exchange: Array
    hits: Array
    spot_element: Array
    spot_area: Array
    spot_starts: Array
    spot_rows: Array
    spot_touched: Array
    rows: Array
    touched: Array
    point_luxel: Array
    point_share: Array
    point_area: Array
    point_starts: Array
    still: Array
    emission: Array
    albedo: Array

    def solve(self, emission: Array | None = None, albedo: Array | None = None, *, still: float = 1.0, tolerance: float = _SETTLED,
              threads: int | None = None, device: str = "cpu") -> Array:  # fmt: skip
        """Light the scene anew.

        Args:
            emission: (n, 3) radiant exitance of each luxel, W/m2; None: as baked. What was dark at the bake is no lamp: its light is only what the
                rays of other luxels meet of it, which is coarse.
            albedo: (n, 3), each below 1; None: as baked.
            still: Factor for the light of what has no surface (point, spot and directional lights, the sky).
            tolerance: How much of the light may be missing when another pass from element to element would be needed.
            threads: None: all cores this process may use. The result does not depend on it.
            device: "cpu"; "cuda": a GPU, where what is kept stays until this object goes; or "auto": a GPU if one can be used.

        Returns:
            (n, 3) float32: irradiance on the front of each luxel, W/m2.

        Raises:
            InputError: A shape is wrong, or a value negative, not finite, or an albedo of 1 or more.
            DeviceError, ExtraMissingError: Device "cuda", and no GPU can be used.
        """
        if not 0 <= still < np.inf:
            raise InputError(f"still: expected a finite factor of at least 0, got {still!r}")
        if not 0 < tolerance < np.inf:
            raise InputError(f"tolerance: expected a share above 0, got {tolerance!r}")
        emission = self.emission if emission is None else self._checked(emission, "emission", np.inf)
        albedo = self.albedo if albedo is None else self._checked(albedo, "albedo", 1.0)
        if device != "cpu":
            from luxel.cuda.relight import solved

            result = solved(self, emission, albedo, still, tolerance, device)
            if result is not None:
                return result
        return self.spread(self.still * np.float32(still), emission, albedo, tolerance, jit.checked_threads(threads))

    def spread(self, direct: Array, emission: Array, albedo: Array, tolerance: float, threads: int) -> Array:
        """(n, 3) float32 irradiance per luxel, from `direct` (3, e), which is added to, and the luxels' exitance and albedo (n, 3)."""
        rho = np.ascontiguousarray(albedo[self.luxel].T)
        shining = self._shine(direct, emission, threads)
        received = direct + self._exchanged(direct, rho, shining, threads)
        labour, sight = Labour(threads), Sight(self.hits, np.zeros(0), np.zeros(0, np.bool_), self.spots)
        known = direct if shining is None else direct + labour.bounce(sight, shining)
        received, missing = _conjugate_residuals(lambda e: labour.bounce(sight, (rho * e).T.copy()), known, received, tolerance / _LEFT)
        received += missing + self._exchanged(missing, rho, None, threads)
        result = np.zeros(emission.shape, np.float32)
        front = np.flatnonzero(self.front)
        result[self.luxel[front]] = np.maximum(received[:, front].T, 0)
        return result

    @property
    def spots(self) -> Spots | None:
        """The bright elements, if there are any."""
        return Spots(self.spot_element, self.spot_area, self.spot_starts, self.spot_rows, self.spot_touched) if len(self.spot_element) else None

    def _shine(self, direct: Array, emission: Array, threads: int) -> Array | None:
        """Add to `direct` what the lights give; the exitance (e, 3) of elements that were no lights at the bake, None if they all are dark."""
        lights = len(self.point_starts) - 1
        if lights:
            receive(self.rows, self.touched, np.arange(lights), self.powers(emission), direct, threads)
        return self.shining(emission)

    def powers(self, emission: Array) -> Array:
        """(l, 3) float32: the lights' mean exitance, of the luxels' (n, 3)."""
        if len(self.point_starts) == 1:
            return np.zeros((0, 3), np.float32)
        power = np.add.reduceat(emission[self.point_luxel] * self.point_share * self.point_area[:, None], self.point_starts[:-1], 0)
        return (power / np.add.reduceat(self.point_area, self.point_starts[:-1])[:, None]).astype(np.float32)

    def shining(self, emission: Array) -> Array | None:
        """(e, 3): exitance of elements that were no lights at the bake, None if they all are dark; of the luxels' (n, 3)."""
        dark = emission.sum(1) > 0
        dark[self.point_luxel] = False
        return (emission * dark[:, None])[self.luxel] if dark.any() else None

    def _exchanged(self, direct: Array, albedo: Array, shining: Array | None, threads: int) -> Array:
        """(3, e) float32: what groups get from each other, the same for all elements of one; `albedo` (3, e)."""
        bounced = direct * albedo if shining is None else direct * albedo + shining.T
        rho, first = self._means(albedo), self._means(bounced)
        area = np.add.reduceat(self.area, self.starts[:-1], dtype=np.float64)
        radiosity = _conjugate_gradients(self.exchange, area, rho, first, threads)
        given = _product(self.exchange, radiosity.astype(np.float32), threads) / area[:, None]
        return np.repeat(given, np.diff(self.starts), 0).T.astype(np.float32)

    def _means(self, values: Array) -> Array:
        """(p, 3) float64: area-weighted means over groups of (3, e)."""
        sums = np.add.reduceat(values * self.area, self.starts[:-1], 1, dtype=np.float64)
        return (sums / np.add.reduceat(self.area, self.starts[:-1], dtype=np.float64)).T

    def _checked(self, values: object, name: str, least_wrong: float) -> Array:
        array = checked(values, self.emission.shape, np.float32, name)
        if not (np.isfinite(array).all() and (array >= 0).all() and (array < least_wrong).all()):
            raise InputError(f"{name}: expected finite values from 0 to below {least_wrong:g}")
        return array

    def save(self, path: str | Path) -> None:
        """Write it to a file (NumPy's .npz, uncompressed), beside and then renamed.

        Raises:
            FileError: It cannot be written.
        """
        path = Path(path)
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        with atomic_write(path) as file:
            np.savez(file, version=np.array(_VERSION), **arrays)

    @classmethod
    def load(cls, path: str | Path) -> Transport:
        """Read what `save` wrote.

        Raises:
            FileError: There is no such file, or it holds something else.
        """
        try:
            with open(path, "rb") as file, np.load(file, allow_pickle=False) as kept:
                if int(kept["version"]) != _VERSION:
                    raise FileError(path, f"expected a transport of version {_VERSION}, got {int(kept['version'])}")
                arrays = {field.name: kept[field.name] for field in fields(cls)}
        except OSError as error:
            raise FileError(path, f"cannot read the transport ({error.strerror or error})") from error
        except (ValueError, KeyError, EOFError, BadZipFile) as error:
            raise FileError(path, "expected a kept transport; the file is something else, or damaged") from error
        return cls(**arrays)


def transport_of(cut: Cut, lights: Rows, sight: Sight, still: Array, luxels: Luxels, labour: Labour) -> Transport | None:
    """What a bake leaves: the rows of its `lights`, complete, and what its elements see; None on processes that do not lead."""
    problem, area, starts = cut.problem, cut.problem.elements.numbers[AREA].copy(), groups(cut.problem.patches.tree)
    points = np.zeros(0, np.int32), np.zeros((0, 3), np.float32), np.zeros(0), np.zeros(1, np.int64)
    if problem.lights is not None:
        points = problem.point_luxel, problem.point_share, problem.lights.numbers[AREA].astype(np.float64), patch_starts(problem.lights.tree)
    hits = labour.team.collect(labour.fetch(sight.hits), len(area))
    spots = sight.spots or no_spots(problem.own.numbers.shape[1])
    spot_rows = _collected(labour.fetch(spots.rows), spots.touched, len(area), labour)
    light_rows = _collected(labour.fetch(lights.rows)[lights.slot], lights.touched[lights.slot], len(area), labour)
    if hits is None:
        return None
    return Transport(
        cut.luxel, ~cut.back, area, starts, exchange_of(hits, starts, area, labour.threads), hits, *spots[:3], *spot_rows, *light_rows, *points,
        still, luxels.emission, luxels.albedo,
    )  # fmt: skip


def _collected(rows: Array, touched: Array, n: int, labour: Labour) -> tuple[Array, Array]:
    """Everybody's parts of `Rows.rows` and `touched`, of n elements, where the process leads; nothing elsewhere."""
    whole = labour.team.collect(rows.T, n), labour.team.collect(touched.T, -(-n // BLOCK), grain=1)
    return tuple(np.ascontiguousarray(part.T) if part is not None else np.zeros((0, 0)) for part in whole)  # type: ignore[return-value]


def _conjugate_residuals(passed_on: Callable[[Array], Array], known: Array, x: Array, tolerance: float) -> tuple[Array, Array]:
    """x that solves x = known + passed_on(x), each row by itself, and what is still missing (Eisenstat, Elman, Schultz 1983, "GCR").

    Args:
        passed_on: Linear; from (3, n) to (3, n) float32.
        known: (3, n) float32.
        x: (3, n) float32 to begin with; changed.
        tolerance: How large the sum over what is missing may be, of the sum of x.
    """
    residual = known + passed_on(x) - x
    ways: list[tuple[Array, Array]] = []  # each with its image
    for _ in range(_MOST_STEPS):
        if np.abs(residual).sum(dtype=np.float64) <= tolerance * x.sum(dtype=np.float64):
            break
        way = residual.copy()
        image = way - passed_on(way)
        for old, seen in ways:
            share = _dots(image, seen)
            image -= share * seen
            way -= share * old
        image_length = np.sqrt(np.einsum("ij,ij->i", image, image, dtype=np.float64))[:, None]
        scale = np.divide(1.0, image_length, out=np.zeros((3, 1)), where=image_length > 0).astype(np.float32)
        way *= scale
        image *= scale
        step = _dots(residual, image)
        x += step * way
        residual -= step * image
        ways.append((way, image))
    return x, residual


def _dots(a: Array, b: Array) -> Array:
    """(3, 1) float32: products of rows."""
    return np.einsum("ij,ij->i", a, b)[:, None]


@jit.parallel_kernel
def _multiply(queue, exchange, values, result):
    exchange, values, result = jit.borrow(exchange), jit.borrow(values), jit.borrow(result)
    count = np.uint64(len(exchange))
    first = np.uint64(jit.take(queue) * BLOCK)
    while first < count:
        last = min(count, first + np.uint64(BLOCK))
        for c in range(3):
            for q in range(first, last):
                result[c, q] = np.float32(0.0)
            for p in range(count):
                value = values[p, c]
                for q in range(first, last):
                    result[c, q] += exchange[p, q] * value
        first = np.uint64(jit.take(queue) * BLOCK)


def _product(exchange: Array, values: Array, threads: int) -> Array:
    """exchange (p, p), symmetric, times values (p, 3), float32. A library's threads would go on turning for some milliseconds, in the way of ours."""
    result = np.empty((3, len(exchange)), np.float32)
    jit.run(_multiply, threads, exchange, values, result)
    return result.T


def _conjugate_gradients(exchange: Array, area: Array, rho: Array, first: Array, threads: int) -> Array:
    """(p, 3) float64: the groups' radiosity from what they send on of the light of lights, `first` (p, 3), and their albedo `rho` (p, 3)."""
    root = np.sqrt(rho / area[:, None]).astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(rho > 0, np.sqrt(area[:, None] / rho), 0.0)
    right = (scale * first).astype(np.float32)
    x = np.zeros_like(right)
    residual, way = right.copy(), right.copy()
    square = (residual.astype(np.float64) ** 2).sum(0)
    target = _ENOUGH**2 * square
    for _ in range(_MOST_STEPS):
        if (square <= target).all():
            break
        image = way - root * _product(exchange, root * way, threads)
        along = (way.astype(np.float64) * image).sum(0)
        step = np.divide(square, along, out=np.zeros(3), where=along > 0).astype(np.float32)
        x += step * way
        residual -= step * image
        new = (residual.astype(np.float64) ** 2).sum(0)
        way = residual + np.divide(new, square, out=np.zeros(3), where=square > 0).astype(np.float32) * way
        square = new
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(scale > 0, x / scale, first)
