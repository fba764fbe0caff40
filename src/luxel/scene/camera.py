"""Cameras: perspective and orthographic, placed by matrix, by `look_at`, or framed around a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.scene.checks import number
from luxel.scene.transforms import look_at


@dataclass(eq=False)
class Camera:
    """Looks down its own -z with +y up, as in glTF.

    Attributes:
        world_from_camera: (4, 4) float64, rigid.
        yfov: Vertical field of view in radians; None for an orthographic camera.
        height: Metres that an orthographic picture is high.
        near: Metres; what is nearer is clipped. Positive for perspective; an orthographic one may have any.
        far: Metres; what is farther is clipped; inf for no limit (perspective only).
        aspect: Width over height, or None for the picture's own.
        name: As in the file; may be empty.

    Raises:
        InputError: A value is no number or out of range, or the matrix cannot be inverted.
    """

    world_from_camera: Array | None = None
    yfov: float | None = float(np.radians(45.0))
    height: float = 2.0
    near: float = 0.01
    far: float = float("inf")
    aspect: float | None = None
    name: str = ""

    def __post_init__(self) -> None:
        matrix = np.eye(4) if self.world_from_camera is None else self.world_from_camera
        self.world_from_camera = checked(matrix, (4, 4), np.float64, "world_from_camera")
        if not np.isfinite(self.world_from_camera).all():
            raise InputError("world_from_camera: expected finite numbers")
        if not np.linalg.det(self.world_from_camera[:3, :3]):
            raise InputError("world_from_camera: expected a matrix that can be inverted")
        if self.far != np.inf:
            number(self.far, "far")
        for name in ("near", "height", *(name for name in ("yfov", "aspect") if getattr(self, name) is not None)):
            number(getattr(self, name), name)
        if self.yfov is not None and not 0 < self.yfov < np.pi:
            raise InputError(f"yfov: expected radians between 0 and pi, got {self.yfov}")
        if self.yfov is None and not (0 < self.height < np.inf and np.isfinite(self.near) and np.isfinite(self.far)):
            lens = f"{self.height}, {self.near}, {self.far}"
            raise InputError(f"orthographic camera: expected a finite height > 0, near and far, got {lens}")
        if self.aspect is not None and not 0 < self.aspect < np.inf:
            raise InputError(f"aspect: expected a finite number > 0, got {self.aspect}")
        if not (self.far > self.near and (self.yfov is None or self.near > 0)):
            raise InputError(f"expected 0 < near < far, got near {self.near}, far {self.far}")

    @classmethod
    def look_at(cls, eye: object, target: object, up: object = (0.0, 1.0, 0.0), **rest: object) -> Camera:
        """A camera at `eye` that looks at `target`, both (3,) in metres, with y as near `up` as may be; `rest` as in the constructor.

        Raises:
            InputError: `eye` and `target` are one place, `up` is zero, or as of the constructor.
        """
        return cls(look_at(eye, target, up), **rest)  # type: ignore[arg-type]

    @property
    def eye(self) -> Array:
        """(3,) float64: where the camera is, in metres."""
        assert self.world_from_camera is not None
        return self.world_from_camera[:3, 3]

    def clip_from_world(self, size: tuple[int, int]) -> Array:
        """(4, 4) float64 for a picture of `size` (width, height): clip x, y in -w..w, z the depth, w.

        Depth is reversed. Perspective: z / w = near / distance, 1 at the near plane and 0 at infinity (`far` only clips). Orthographic:
        z falls linearly from 1 at `near` to 0 at `far`, and w = 1. So depth is affine in the picture, as exact as float32 allows.
        """
        assert self.world_from_camera is not None
        aspect = self.aspect or size[0] / size[1]
        camera_from_world = np.linalg.inv(self.world_from_camera)
        clip = np.zeros((4, 4))
        if self.yfov is None:
            clip[0, 0], clip[1, 1] = 2 / (self.height * aspect), 2 / self.height
            clip[2, 2], clip[2, 3] = 1 / (self.far - self.near), self.far / (self.far - self.near)
            clip[3, 3] = 1
        else:
            f = 1 / np.tan(self.yfov / 2)
            clip[0, 0], clip[1, 1] = f / aspect, f
            clip[2, 3], clip[3, 2] = self.near, -1
        return clip @ camera_from_world

    def with_pose(self, world_from_camera: Array) -> Camera:
        """The same lens at another place."""
        return replace(self, world_from_camera=world_from_camera)
