"""Transport that is kept: other lights, other colours, the same walls, without looking again who sees whom.

    direct light of the new lights -> mean radiosity of the patches, by conjugate gradients -> every patch gives to every element, once

The patches' equations are b = d + rho F b with F from patch to patch. With areas a, and G = a F made symmetric (reciprocity), y = sqrt(a / rho) b
turns them into (1 - R G R) y = sqrt(a / rho) d, R = sqrt(rho / a): symmetric and positive definite while rho < 1 and the rows of G sum to at most a.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.errors import FileError, InputError
from luxel.radiosity.solve import Problem, Rows, patch_starts
from luxel.radiosity.transport import AREA, BLOCK, gather, receive

_ENOUGH = 1e-5  # of the norm of the right-hand side
_MOST_STEPS = 100
_VERSION = 1


@dataclass(eq=False)
class Transport:
    """What every patch and every light gives to every element of a baked scene, per unit of radiosity.

    Attributes:
        luxel: (e,) int32: the luxel of each element; `front` (e,) bool: it is its front.
        area: (e,) float32, m2.
        starts: (p + 1,) int64: where the elements of each patch begin.
        rows, touched, scale: Of the patches, as in `luxel.radiosity.solve.Rows`; the first p rows are theirs, those of the l lights follow.
        exchange: (p, p) float32: G, symmetric, m2.
        point_luxel, point_area, point_starts: Of the points of the lights: their luxels (k,), areas (k,), and where each light's begin (l + 1,).
        still: (3, e) float32: irradiance of lights without a surface, W/m2.
        emission: (n, 3) float32: radiant exitance of each luxel at the bake, W/m2.
        albedo: (n, 3) float32: of each luxel at the bake.
    """

    luxel: Array
    front: Array
    area: Array
    starts: Array
    rows: Array
    touched: Array
    scale: Array
    exchange: Array
    point_luxel: Array
    point_area: Array
    point_starts: Array
    still: Array
    emission: Array
    albedo: Array

    def solve(self, emission: Array | None = None, albedo: Array | None = None, *, still: float = 1.0, threads: int | None = None) -> Array:
        """Light the scene anew.

        Args:
            emission: (n, 3) radiant exitance of each luxel, W/m2; None: as baked.
            albedo: (n, 3), each below 1; None: as baked.
            still: Factor for the light of what has no surface (point, spot and directional lights, the sky).
            threads: None: all cores this process may use. The result does not depend on it.

        Returns:
            (n, 3) float32: irradiance on the front of each luxel, W/m2.

        Raises:
            InputError: A shape is wrong, or a value negative, not finite, or an albedo of 1 or more.
        """
        emission = self.emission if emission is None else self._checked(emission, "emission", np.inf)
        albedo = self.albedo if albedo is None else self._checked(albedo, "albedo", 1.0)
        return self.spread(self.still * np.float32(still), emission, albedo, jit.checked_threads(threads))

    def spread(self, received: Array, emission: Array, albedo: Array, threads: int) -> Array:
        """(n, 3) float32 irradiance per luxel, from `received` (3, e) float32, which is added to, and the luxels' exitance and albedo (n, 3)."""
        lights, patches = len(self.point_starts) - 1, len(self.starts) - 1
        shining = emission[self.luxel] * self.front[:, None]
        if lights:
            power = np.add.reduceat(emission[self.point_luxel] * self.point_area[:, None], self.point_starts[:-1], 0)
            glow = power / np.add.reduceat(self.point_area, self.point_starts[:-1])[:, None] * self.scale[patches:, None]
            receive(self.rows, self.touched, patches + np.arange(lights), glow.astype(np.float32), received, threads)
            point = np.zeros(len(emission), bool)
            point[self.point_luxel] = True
            shining[point[self.luxel]] = 0
        area = np.add.reduceat(self.area.astype(np.float64), self.starts[:-1])
        rho = self._means(albedo[self.luxel])
        first = self._means(received.T * albedo[self.luxel] + shining)
        radiosity = _conjugate_gradients(self.exchange, area, rho, first)
        receive(self.rows, self.touched, np.arange(patches), (radiosity * self.scale[:patches, None]).astype(np.float32), received, threads)
        result = np.zeros(emission.shape, np.float32)
        front = np.flatnonzero(self.front)
        result[self.luxel[front]] = received[:, front].T
        return result

    def _means(self, values: Array) -> Array:
        """(p, 3) float64: area-weighted means over patches of (e, 3)."""
        weight = self.area.astype(np.float64)
        sums = np.add.reduceat(values * weight[:, None], self.starts[:-1], 0)
        return sums / np.add.reduceat(weight, self.starts[:-1])[:, None]

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
        beside = path.with_name(path.name + ".part")
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        arrays["rows"] = self.rows.reshape(-1, BLOCK)[self.touched.ravel()]  # only the blocks that are not all zero
        try:
            with open(beside, "wb") as file:
                np.savez(file, version=np.array(_VERSION), **arrays)
            beside.replace(path)
        except OSError as error:
            beside.unlink(missing_ok=True)
            raise FileError(path, f"the transport cannot be written ({error.strerror or error})") from error

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
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise FileError(path, f"expected a kept transport ({error})") from error
        packed, touched = arrays["rows"], arrays["touched"]
        rows = np.zeros((touched.size, BLOCK), np.uint16)
        if packed.shape != (int(touched.sum()), BLOCK):
            raise FileError(path, f"rows: expected {(int(touched.sum()), BLOCK)}, got {packed.shape}")
        rows[touched.ravel()] = packed
        arrays["rows"] = rows.reshape(len(touched), -1)
        return cls(**arrays)


def transport_of(problem: Problem, luxel: Array, front: Array, rows: Rows, light_rows: Rows, still: Array, emission: Array, albedo: Array,
                 threads: int) -> Transport:  # fmt: skip
    """Gather what a solve has left; `rows` and `light_rows` must be complete, with room for all patches."""
    tree, numbers = problem.patches.tree, problem.elements.numbers
    patches, starts = len(tree.patches), patch_starts(tree)
    lights = 0 if problem.lights is None else len(problem.lights.tree.patches)
    width = -(-numbers.shape[1] // BLOCK) * BLOCK
    kept = np.zeros((patches + lights, width), np.uint16)
    kept[:patches, : numbers.shape[1]] = rows.rows[rows.slot]
    touched, scale = rows.touched[rows.slot], rows.scale[rows.slot]
    points = np.zeros(0, np.int32), np.zeros(0), np.zeros(1, np.int64)
    if problem.lights is not None:
        kept[patches:, : numbers.shape[1]] = light_rows.rows[light_rows.slot]
        touched = np.concatenate([touched, light_rows.touched[light_rows.slot]])
        scale = np.concatenate([scale, light_rows.scale[light_rows.slot]])
        points = problem.point_luxel, problem.lights.numbers[AREA].astype(np.float64), patch_starts(problem.lights.tree)
    given = gather(kept[:patches], touched[:patches], scale[:patches], numbers[AREA], starts, threads)
    exchange = ((given + given.T) / 2).astype(np.float32)
    return Transport(luxel, front, numbers[AREA].copy(), starts, kept, touched, scale, exchange, *points, still, emission, albedo)


def _conjugate_gradients(exchange: Array, area: Array, rho: Array, first: Array) -> Array:
    """(p, 3) float64: the patches' radiosity from what they send on of the light of lights, `first` (p, 3), and their albedo `rho` (p, 3)."""
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
        image = way - root * (exchange @ (root * way))
        along = (way.astype(np.float64) * image).sum(0)
        step = np.divide(square, along, out=np.zeros(3), where=along > 0).astype(np.float32)
        x += step * way
        residual -= step * image
        new = (residual.astype(np.float64) ** 2).sum(0)
        way = residual + np.divide(new, square, out=np.zeros(3), where=square > 0).astype(np.float32) * way
        square = new
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(scale > 0, x / scale, first)
