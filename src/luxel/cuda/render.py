"""Drawing on the GPU: what stands for `luxel.raster.frame.draw` where a scene is prepared there."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

from luxel.cuda.device import find
from luxel.cuda.frame import draw_views
from luxel.cuda.resident import Resident
from luxel.errors import DeviceError, LuxelWarning
from luxel.raster import frame
from luxel.raster.picture import Picture
from luxel.raster.render import Options, Prepared
from luxel.scene.camera import Camera


def lay_out(prepared: Prepared, device: str) -> Prepared:
    """The scene laid out on `device`: "cpu", "cuda", or "auto".

    Raises:
        InputError: No such device, or a scene that a GPU cannot draw.
        ExtraMissingError, DeviceError: "cuda", and it cannot be used.
    """
    gpu = find(device)
    if gpu is None:
        return prepared._replace(resident=None)
    if prepared.resident is not None:
        return prepared
    try:
        return prepared._replace(resident=Resident(gpu, prepared, fallback=device == "auto"))
    except DeviceError as error:
        if device != "auto":
            raise
        _fall_back(error)
        return prepared


def _fall_back(error: DeviceError) -> None:
    warnings.warn(f"device auto: drawing on the processor: {error}", LuxelWarning, stacklevel=4)


def draw(prepared: Prepared, camera: Camera | None, size: tuple[int, int], options: Options, previous: Camera | None,
         progress: Callable[[float], None] | None, keep: bool = False) -> Picture:  # fmt: skip
    """One picture; arguments as in `luxel.raster.frame.draw`, and `keep` leaves its arrays on the GPU."""
    return draw_many(prepared, [camera], size, options, [previous], keep, progress)[0]


def draw_many(prepared: Prepared, cameras: Sequence[Camera | None], size: tuple[int, int], options: Options, previous: Sequence[Camera | None],
              keep: bool = False, progress: Callable[[float], None] | None = None) -> list[Picture]:  # fmt: skip
    """A picture for each camera, drawn together; arguments as in `luxel.cuda.frame.draw_views`."""
    try:
        return draw_views(prepared.resident, cameras, size, options, previous, keep, progress)
    except DeviceError as error:
        if not prepared.resident.fallback:
            raise
        _fall_back(error)
        return [frame.draw(prepared, camera, size, options, before, progress) for camera, before in zip(cameras, previous, strict=True)]
