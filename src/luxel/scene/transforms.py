"""4x4 matrices, float64, column vectors, named target-from-source."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError

_ROWS = 1 << 16  # at a time: their temporaries stay in the cache


def translation(offset: object) -> Array:
    """(4, 4) from an offset (3,) in metres."""
    matrix = np.eye(4)
    matrix[:3, 3] = checked(offset, (3,), np.float64, "offset")
    return matrix


def scaling(factors: object) -> Array:
    """(4, 4) from factors (3,) along x, y and z."""
    return np.diag([*checked(factors, (3,), np.float64, "factors"), 1.0])


def rotation(axis: object, angle: float) -> Array:
    """(4, 4): `angle` radians counter-clockwise about `axis` (3,) (Rodrigues)."""
    x, y, z = _unit(checked(axis, (3,), np.float64, "axis"), "axis")
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def look_at(eye: object, target: object, up: object = (0.0, 1.0, 0.0)) -> Array:
    """World-from-camera (4, 4): at `eye`, -z towards `target`, y as near `up` as may be; all (3,) in metres."""
    eye_, target_, up_ = (checked(v, (3,), np.float64, n) for v, n in ((eye, "eye"), (target, "target"), (up, "up")))
    back = _unit(eye_ - target_, "eye - target")
    right = np.cross(up_, back)
    if np.linalg.norm(right) < 1e-9 * max(float(np.linalg.norm(up_)), 1e-300):  # looks along up: any right will do
        axis = np.eye(3)[np.abs(back).argmin()]  # +x for a look straight down, as a framed camera has it
        right = axis - axis @ back * back
    right = _unit(right, "up")
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, np.cross(back, right), back, eye_], 1)
    return matrix


def _unit(vector: Array, name: str) -> Array:
    length = np.linalg.norm(vector)
    if not (np.isfinite(length) and length > 0):
        raise InputError(f"{name}: expected a finite vector that is not zero, got {vector}")
    return vector / length


def mapped(points: Array, linear: Array) -> Array:
    """(n, 3) float64: points (n, 3) times `linear` (3, 3), a row at a time.

    Not by a matrix product, whose last bits depend on how many rows there are and on the processor: a mesh in parts must stay where it is.
    """
    out = np.empty((len(points), 3))
    with np.errstate(all="ignore"):  # what is not finite stays so
        for start in range(0, len(points), _ROWS):
            x, y, z = points[start : start + _ROWS].T.astype(np.float64)
            for k in range(3):
                out[start : start + _ROWS, k] = x * linear[0, k] + y * linear[1, k] + z * linear[2, k]
    return out
