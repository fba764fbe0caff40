"""What a render gives: a picture with everything that was asked for beside its colour."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError

_IDS = ("triangle", "object", "material")
_NOTEBOOK_PIXELS = 2_000_000  # a larger picture is shown halved as often as it takes


@dataclass(eq=False)
class Picture:
    """The outputs of one view, (h, w, ...) arrays with row 0 at the top; None for what was not asked for.

    Arrays are NumPy's, or `luxel.cuda.shared.DeviceArray` where they were left on a GPU; saving fetches those.

    Attributes:
        color: (h, w, 4) uint8, sRGB-encoded, with straight coverage alpha.
        linear: (h, w, 4) float32, linear light, premultiplied by alpha.
        depth: (h, w) float32, metres along the view axis; inf where there is nothing.
        triangle, object, material: (h, w) int32 ids, -1 where there is nothing.
        normal, position: (h, w, 3) float32, in world space; zeros where there is nothing.
        barycentric: (h, w, 3) float32, perspective-correct weights of the triangle's vertices.
        texcoord: (h, w, 2) float32, TEXCOORD_0.
        motion: (h, w, 2) float32, pixels from the other camera's picture to this one.
        seconds: Time taken, by stage.
    """

    color: Array | None = None
    linear: Array | None = None
    depth: Array | None = None
    triangle: Array | None = None
    object: Array | None = None
    material: Array | None = None
    normal: Array | None = None
    position: Array | None = None
    barycentric: Array | None = None
    texcoord: Array | None = None
    motion: Array | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels; (0, 0) for a picture without outputs."""
        for array in self.outputs().values():
            return array.shape[1], array.shape[0]
        return 0, 0

    def outputs(self) -> dict[str, Array]:
        """The arrays that are there, by name."""
        named = ((item.name, getattr(self, item.name)) for item in fields(self) if item.name != "seconds")
        return {name: array for name, array in named if array is not None}

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """The colour, (h, w, 4) uint8, made from `linear` where need be."""
        made = self.color is None
        color = self._encoded()
        if dtype is not None and np.dtype(dtype) != color.dtype:
            if copy is False:
                raise ValueError(f"a picture is uint8; {np.dtype(dtype)} needs a copy")
            return color.astype(dtype)
        return color.copy() if copy and not made else color

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the picture, whole or not at all, by the extension of `path`.

        .png and whatever else Pillow writes (.jpg, .webp, ...) hold the colour; .exr holds every output as named layers (extra `exr`):
        RGBA (linear, premultiplied), depth.Z, triangle.id and its like as uint32 (2^32 - 1 where there is nothing), normal.X and so on;
        .npz holds every output as an array.

        Raises:
            FileError: The extension is unknown, or the file cannot be written.
            InputError: There is no colour to write.
            ExtraMissingError: An .exr file, and the extra is not installed.
        """
        path = Path(path)
        extension = path.suffix.lower()
        if extension == ".exr":
            self._save_exr(path)
        elif extension == ".npz":
            self._save_npz(path)
        else:
            from luxel.io.images import write_image

            write_image(path, self._encoded())

    def _save_exr(self, path: Path) -> None:
        from luxel.io.images import write_exr

        layers: dict[str, Array] = {}
        for name, array in self.outputs().items():
            if name in ("color", "linear"):
                layers[""] = self._linear()
            elif name in _IDS:
                layers[f"{name}.id"] = np.asarray(array).view(np.uint32)
            else:
                layers[name] = np.asarray(array)
        if not layers:
            raise InputError("this picture has no outputs to save")
        write_exr(path, layers)

    def _save_npz(self, path: Path) -> None:
        from luxel.io.files import atomic_write

        with atomic_write(path) as file:
            np.savez_compressed(file, **self.outputs())  # type: ignore[arg-type]

    def _encoded(self) -> Array:
        """(h, w, 4) uint8 sRGB with straight alpha."""
        if self.color is not None:
            return np.asarray(self.color)
        if self.linear is None:
            raise InputError(f"this picture has no colour; it has {', '.join(self.outputs()) or 'no outputs'}")
        return encode(np.asarray(self.linear))

    def _linear(self) -> Array:
        """(h, w, 4) float32, linear and premultiplied."""
        from luxel.scene.colour import linear_from_srgb

        if self.linear is not None:
            return np.asarray(self.linear)
        color = self._encoded()
        alpha = color[..., 3:].astype(np.float32) / np.float32(255)
        return np.concatenate([linear_from_srgb(color[..., :3]) * alpha, alpha], -1)

    def _repr_png_(self) -> bytes | None:
        """For notebooks; a large picture is shown smaller."""
        if self.color is None and self.linear is None:
            return None
        from luxel.io.images import png_bytes

        color = self._encoded()
        step = 1
        while color[::step, ::step, 0].size > _NOTEBOOK_PIXELS:
            step *= 2
        return png_bytes(np.ascontiguousarray(color[::step, ::step]))

    def __repr__(self) -> str:
        width, height = self.size
        return f"Picture({width} x {height}: {', '.join(self.outputs()) or 'no outputs'})"


def encode(linear: Array) -> Array:
    """(h, w, 4) uint8 sRGB with straight alpha, of linear premultiplied RGBA (h, w, 4); in bands, so that little memory is taken."""
    from luxel.scene.colour import bytes_from_linear

    if linear.ndim != 3 or linear.shape[2] != 4:
        raise InputError(f"linear: expected (h, w, 4) float32, got {linear.shape} {linear.dtype}")
    out = np.empty(linear.shape, np.uint8)
    rows = max(1, (1 << 20) // max(linear.shape[1], 1))
    with np.errstate(all="ignore"):
        for start in range(0, len(linear), rows):
            part = linear[start : start + rows]
            alpha = np.clip(np.nan_to_num(part[..., 3:]), 0, 1)
            out[start : start + rows, :, :3] = bytes_from_linear(part[..., :3] / np.where(alpha > 0, alpha, 1))
            out[start : start + rows, :, 3:] = (alpha * 255 + 0.5).astype(np.uint8)
    return out


__all__ = ["Picture", "encode"]
