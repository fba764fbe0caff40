"""Render: a scene and a camera to a picture, or band by band to a file, in memory that does not grow with the picture. See `frame`."""

from __future__ import annotations

import operator
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.hardware import interpolator
from luxel.raster import frame, modelled
from luxel.raster.constants import SAMPLE_COUNTS, SUBPIXEL, sample_pattern
from luxel.raster.geometry import Geometry, flatten
from luxel.raster.materials import GOURAUD, MaterialTable, pack_materials
from luxel.raster.modelled import Interpolate
from luxel.raster.outputs import SHAPES
from luxel.raster.picture import Picture
from luxel.raster.resolve import FILTERS
from luxel.scene.camera import Camera
from luxel.scene.framing import camera_for
from luxel.scene.scene import Scene

OUTPUTS = ("color", "linear", *SHAPES)
LOWPASS = "lowpass"
_BAND_BYTES = 96 << 20
_VIEWS_AT_ONCE = 1024
_LOWPASS_MOST = 1 << 27  # samples; 2 GB of linear light, and some more to filter it


@dataclass(frozen=True)
class Options:
    """How to draw; see `render` for what each means. Checked when made.

    Raises:
        InputError: A value is not one that can be drawn with.
    """

    samples: int = 1
    pattern: str = "standard"
    ssaa: int = 1
    filter: str = "box"
    background: Any = None
    outputs: tuple[str, ...] = ("color",)
    exposure: float = 0.0
    threads: int | None = None
    tile: int = 64
    positions: Array = field(init=False)
    fill: Array = field(init=False)

    def __post_init__(self) -> None:
        if isinstance(self.outputs, str):
            object.__setattr__(self, "outputs", (self.outputs,))
        if not isinstance(self.outputs, Iterable):
            raise InputError(f"outputs: expected some of {', '.join(OUTPUTS)}; got {self.outputs!r}")
        object.__setattr__(self, "outputs", tuple(self.outputs))
        for name in self.outputs:
            if name not in OUTPUTS:
                raise InputError(f"outputs: expected some of {', '.join(OUTPUTS)}; got {name!r}")
        if not self.outputs:
            raise InputError(f"outputs: expected some of {', '.join(OUTPUTS)}; got none")
        if not isinstance(self.samples, (int, np.integer)) or self.samples not in SAMPLE_COUNTS:
            raise InputError(f"samples: expected 1, 2, 4, 8 or 16, got {self.samples!r}")
        if self.filter not in (*FILTERS, LOWPASS):
            raise InputError(f"filter: expected one of {', '.join(FILTERS)} or {LOWPASS}; got {self.filter!r}")
        if self.filter == LOWPASS and self.ssaa == 1:
            raise InputError(f"filter: {LOWPASS} filters the picture that ssaa draws at a higher rate: expected ssaa 2 to 8, got 1")
        if not isinstance(self.tile, (int, np.integer)) or self.tile not in (8, 16, 32, 64, 128):
            raise InputError(f"tile: expected 8, 16, 32, 64 or 128, got {self.tile!r}")
        if not isinstance(self.exposure, (int, float, np.floating, np.integer)) or not abs(self.exposure) <= 64:
            raise InputError(f"exposure: expected -64 to 64 stops, got {self.exposure!r}")
        object.__setattr__(self, "tile", int(self.tile))
        object.__setattr__(self, "threads", jit.checked_threads(self.threads))
        object.__setattr__(self, "positions", _pattern(self.samples, self.pattern, self.ssaa))
        object.__setattr__(self, "fill", _background(self.background))


_kept_options = lru_cache(maxsize=64, typed=True)(Options)


def _options(*values: Any) -> Options:
    """The options of one frame are mostly those of the last: they are checked once."""
    try:
        return _kept_options(*values)
    except TypeError:  # a list, or an array: nothing to find it by
        return Options(*values)


def _pattern(samples: int, pattern: str, ssaa: int) -> Array:
    if not (isinstance(ssaa, (int, np.integer)) and 1 <= ssaa <= 8):
        raise InputError(f"ssaa: expected a whole number from 1 to 8, got {ssaa!r}")
    if pattern not in ("standard", "grid"):
        raise InputError(f"pattern: expected standard or grid, got {pattern!r}")
    if ssaa == 1:
        return sample_pattern(samples, pattern)
    if samples != 1:
        raise InputError(f"samples and ssaa: expected one of them to be 1, got {samples} and {ssaa}")
    step = np.round((np.arange(ssaa) + 0.5) * SUBPIXEL / ssaa).astype(np.int32)
    return np.stack(np.meshgrid(step, step), -1).reshape(-1, 2)


def _background(value: Any) -> Array:
    wanted = f"background: expected linear RGB of at least 0, and alpha from 0 to 1 if any, got {value!r}"
    try:
        color = checked([0, 0, 0, 0] if value is None else value, ("n",), np.float32, "background")
    except InputError as error:
        raise InputError(wanted) from error
    if len(color) not in (3, 4) or not np.isfinite(color).all() or (color < 0).any() or (color[3:] > 1).any():
        raise InputError(wanted)
    alpha = color[3] if len(color) == 4 else 1.0
    return np.array([*(color[:3] * alpha), alpha], np.float32)


class Prepared(NamedTuple):
    """What of a scene does not depend on the camera: pass it in place of the scene to draw it again without preparing it again.

    `resident` is the scene on the GPU, if it was prepared for one (`luxel.cuda.resident.Resident`).
    """

    scene: Scene
    geometry: Geometry
    materials: MaterialTable
    vertex_materials: MaterialTable | None
    hardware: Interpolate | None = None
    resident: Any = None


def prepare(scene: Any, shading: str | None = None, cull: str = "material", device: str = "cpu") -> Prepared:
    """Lay a scene out for drawing; it must not be changed while the result is in use.

    Args:
        scene: A Scene, or anything `luxel.load` takes.
        shading, cull: As in `render`.
        device: Where it is to be drawn: "cpu", "cuda" (it stays in the GPU's memory), or "auto".
    """
    if not isinstance(scene, Scene):
        from luxel.io import load

        scene = load(scene)
    if cull not in ("material", "back", "none"):
        raise InputError(f"cull: expected material, back or none; got {cull!r}")
    materials, hardware = pack_materials(scene, shading), interpolator.shade if shading == "hardware" else None
    if hardware is not None:
        modelled.check(scene)
    vertex_materials = pack_materials(scene, shading, vertices=True) if materials.features & GOURAUD else None
    prepared = Prepared(scene, flatten(scene, cull), materials, vertex_materials, hardware)
    return _on(device, prepared)


def _on(device: str | None, prepared: Prepared) -> Prepared:
    """The scene on a device; None leaves it where it is."""
    if device is None or (device == "cpu" and prepared.resident is None):
        return prepared
    from luxel.cuda.render import lay_out

    return lay_out(prepared, device)


def _prepared(scene: Any, shading: str | None, cull: str, device: str | None = None) -> Prepared:
    if not isinstance(scene, Prepared):
        return prepare(scene, shading, cull, device or "cpu")
    if shading is not None or cull != "material":
        raise InputError("shading and cull: a prepared scene has its own; give them to prepare")
    return _on(device, scene)


def _drawer(prepared: Prepared, on_device: bool) -> Callable[..., Picture]:
    """What draws it where it is."""
    if prepared.resident is None:
        if on_device:
            raise InputError("on_device: the scene is drawn on the processor; expected device cuda")
        return frame.draw
    from luxel.cuda.render import draw

    return partial(draw, keep=on_device)


def render(scene: Any, camera: Camera | None = None, size: tuple[int, int] = (1280, 720), *, samples: int = 1, pattern: str = "standard",
           ssaa: int = 1, filter: str = "box", shading: str | None = None, cull: str = "material", background: Any = None,
           outputs: Iterable[str] = ("color",), previous_camera: Camera | None = None, exposure: float = 0.0, threads: int | None = None,
           tile: int = 64, device: str | None = None, on_device: bool = False,
           progress: Callable[[float], None] | None = None) -> Picture:  # fmt: skip
    """Draw a scene.

    Args:
        scene: A Scene, a `Prepared` one, or anything `luxel.load` takes: a path, a trimesh object, a pair of arrays.
        camera: None takes the scene's first camera, or one that frames it.
        size: Width and height in pixels.
        samples: Per pixel (MSAA): 1, 2, 4, 8 or 16; shaded once a pixel and triangle.
        pattern: "standard" sample positions, or "grid" (2x2, with 4 samples).
        ssaa: n for n x n shaded samples a pixel.
        filter: How samples make a pixel: "box", "tent", "gaussian", "mitchell", "blackman-harris"; or "lowpass", with `ssaa`: the picture is
            drawn at n times the rate, loses in its spectrum what pixels cannot show, and is decimated (`luxel.filter.antialias`).
        shading: "flat", "gouraud", "phong", "pbr" or "unlit" for all materials; None: what each asks for ("phong" if it does not). "hardware":
            "gouraud" with the bits that the circuit of `luxel.hardware` makes: colours linear on the screen, without textures.
        cull: Which back faces are not drawn: those of single-sided materials ("material"), all ("back"), none ("none").
        background: Linear RGB or RGBA behind everything; None is transparent.
        outputs: Which fields of the picture to make: "color", "linear", "depth", "triangle", "object", "material", "normal", "position",
            "barycentric", "texcoord", "motion". All but the first two come from the first sample of each pixel, and from what is opaque.
        previous_camera: Motion is measured from its picture to this one; None: no motion.
        exposure: Stops; light is multiplied by 2 to this power.
        threads: None: all cores this process may use.
        tile: Side of a tile in pixels; changes speed, and colours by rounding, but not ids or depth.
        device: "cpu"; "cuda": an NVIDIA GPU, with the same ids and depth to the last bit; "auto": a GPU if one can be used, else the processor, with
            a warning that says why. None: where a prepared scene was prepared, else the processor.
        on_device: Leave the picture's arrays on the GPU, for other libraries to take without a copy (`luxel.cuda.shared.DeviceArray`).
        progress: Called with the fraction that is done.

    Returns:
        A Picture.

    Raises:
        InputError: A value that cannot be drawn with.
        FileError: The file to load is missing or broken.
        DeviceError, ExtraMissingError: Device "cuda", and no GPU can be used.
    """
    options = _options(samples, pattern, ssaa, filter, background, outputs, exposure, jit.checked_threads(threads), tile)
    started = time.perf_counter()
    prepared = _prepared(scene, shading, cull, device)
    if on_device and options.filter == LOWPASS:
        raise InputError(f"on_device: filter {LOWPASS} works on the processor; expected another filter")
    picture = render_prepared(prepared, camera, checked_size(size), options, previous_camera, progress, _drawer(prepared, on_device))
    picture.seconds = {"prepare": time.perf_counter() - started - sum(picture.seconds.values()), **picture.seconds}
    return picture


def render_prepared(prepared: Prepared, camera: Camera | None, size: tuple[int, int], options: Options, previous: Camera | None = None,
                    progress: Callable[[float], None] | None = None, draw: Callable[..., Picture] = frame.draw) -> Picture:  # fmt: skip
    """What `render` does once its arguments are checked; `draw` stands for `frame.draw`, and may leave its picture to another process."""
    if options.filter == LOWPASS:
        return _draw_lowpassed(prepared, camera, size, options, previous, progress, draw)
    return draw(prepared, camera, size, options, previous, progress)


def render_views(scene: Any, cameras: Iterable[Camera], size: tuple[int, int] = (1280, 720), *, shading: str | None = None,
                 cull: str = "material", device: str | None = None, **options: Any) -> Iterator[Picture]:  # fmt: skip
    """Draw a scene from many cameras: what does not depend on the camera is prepared once. Arguments as in `render`.

    On a GPU they are drawn together, as many as fit into its memory, up to 1024 at a time.

    Yields:
        A Picture for each camera, in order.
    """
    prepared, together = _prepared(scene, shading, cull, device), set(options) <= {item.name for item in fields(Options)} | {"on_device"}
    if prepared.resident is None or not together or options.get("filter") == LOWPASS:
        for camera in cameras:
            yield render(prepared, camera, size, **options)
        return
    from luxel.cuda.render import draw_many

    keep, chosen, left = options.pop("on_device", False), Options(**options), iter(cameras)
    while batch := list(islice(left, _VIEWS_AT_ONCE)):
        yield from draw_many(prepared, batch, checked_size(size), chosen, [None] * len(batch), keep)


def render_to_png(path: Any, scene: Any, camera: Camera | None = None, size: tuple[int, int] = (1280, 720), *, shading: str | None = None,
                  cull: str = "material", progress: Callable[[float], None] | None = None, **options: Any) -> dict[str, float]:  # fmt: skip
    """Draw a picture of any size straight into a PNG file, band by band, in bounded memory. Arguments as in `render`.

    Returns:
        Seconds by stage.
    """
    from luxel.io.images import PngStream

    width, height = checked_size(size)
    known = {item.name for item in fields(Options) if item.init} - {"outputs"}
    for name in options:
        if name not in known:
            raise InputError(f"render_to_png: expected options among {', '.join(sorted(known))}; got {name}")
    chosen = Options(**options)
    if chosen.filter == LOWPASS:
        raise InputError(f"render_to_png: filter {LOWPASS} needs the whole picture at once; use render")
    prepared = _prepared(scene, shading, cull)
    rows = max(chosen.tile, (_BAND_BYTES // (8 * width)) // chosen.tile * chosen.tile)
    margin = 0 if chosen.filter == "box" else chosen.tile
    seconds: dict[str, float] = {}
    with PngStream(path, width, height) as stream:
        for top in range(0, height, rows):
            first, last = max(0, top - margin), min(height, top + rows + margin)
            band = frame.draw(prepared, camera, (width, height), chosen, None, None, (first, last))
            started = time.perf_counter()
            assert band.color is not None
            stream.write(band.color[top - first : min(height, top + rows) - first])
            band.seconds["write"] = time.perf_counter() - started
            seconds = {name: seconds.get(name, 0.0) + value for name, value in band.seconds.items()}
            if progress:
                progress(min(1.0, (top + rows) / height))
    return seconds


def checked_size(size: Any) -> tuple[int, int]:
    """`size` as width and height in pixels.

    Raises:
        InputError: It is no such pair.
    """
    try:
        width, height = (operator.index(side) for side in size)
    except (TypeError, ValueError):
        raise InputError(f"size: expected (width, height) in pixels, got {size!r}") from None
    if not (1 <= width <= 1 << 20 and 1 <= height <= 1 << 20):
        raise InputError(f"size: expected 1 to 1048576 pixels a side, got {width} x {height}")
    return width, height


def _draw_lowpassed(prepared: Prepared, camera: Camera | None, size: tuple[int, int], options: Options, previous: Camera | None,
                    progress: Callable[[float], None] | None, draw: Callable[..., Picture]) -> Picture:  # fmt: skip
    """Draw a picture at `ssaa` times the rate and decimate it in frequency; what is not colour is drawn at its own rate."""
    from luxel.filter.antialias import decimate
    from luxel.filter.light import encode

    rate, threads = options.ssaa, options.threads or 1
    if size[0] * size[1] * rate**2 > _LOWPASS_MOST:
        most = f"{_LOWPASS_MOST / 1e6:.0f} million samples"
        raise InputError(f"filter: {LOWPASS} holds the finer picture whole: expected at most {most}, got {rate * size[0]} x {rate * size[1]}")
    camera = camera or camera_for(prepared.scene, size)
    plain = replace(options, ssaa=1, filter="box", outputs=("linear",))
    picture = draw(prepared, camera, (rate * size[0], rate * size[1]), plain, None, progress)
    seconds, started = picture.seconds, time.perf_counter()
    linear = None if picture.linear is None else decimate(picture.linear, rate, threads=threads)
    color = encode(linear, np.uint8, True, threads) if "color" in options.outputs and linear is not None else None
    seconds["lowpass"] = time.perf_counter() - started
    rest = tuple(name for name in options.outputs if name not in ("color", "linear"))
    picture = draw(prepared, camera, size, replace(plain, outputs=rest), previous, None) if rest else Picture()
    seconds = {name: seconds.get(name, 0.0) + picture.seconds.get(name, 0.0) for name in {**seconds, **picture.seconds}}
    return replace(picture, color=color, linear=linear if "linear" in options.outputs else None, seconds=seconds)
