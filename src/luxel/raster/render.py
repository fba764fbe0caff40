"""Render: a scene and a camera to a picture, stage by stage and band by band.

The picture is drawn in windows no larger than the guard band allows, and each window in bands of tile rows whose per-sample buffers stay
under a fixed size, so memory does not grow with the number of samples, nor, when streamed to a file, with the picture.
"""

from __future__ import annotations

import operator
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array, checked
from luxel.clock import Clock
from luxel.errors import InputError
from luxel.hardware import interpolator
from luxel.memory import reusable
from luxel.raster import modelled, warm
from luxel.raster.bin import BLEND, MASK, NO_CLIPPED, OPAQUE, Bins, bin_triangles
from luxel.raster.clip import clip
from luxel.raster.constants import MAX_SIZE, SAMPLE_COUNTS, SUBPIXEL, sample_pattern
from luxel.raster.cover import cover
from luxel.raster.fragments import NEEDS_POSITION, Eye, drawn
from luxel.raster.geometry import Geometry, flatten
from luxel.raster.lanes import LANES
from luxel.raster.lighting import LightTable, pack_lights
from luxel.raster.materials import GOURAUD, NEEDS_VIEW, MaterialTable, pack_materials
from luxel.raster.modelled import Interpolate
from luxel.raster.outputs import SHAPES, Outputs, write_outputs
from luxel.raster.picture import Picture
from luxel.raster.project import View, Window, project
from luxel.raster.resolve import FILTERS, filter_taps, resolve
from luxel.raster.runs import Samples
from luxel.raster.shade import Look, Target, Tiles, light_vertices, shade
from luxel.scene.camera import Camera
from luxel.scene.framing import camera_for
from luxel.scene.scene import Scene

OUTPUTS = ("color", "linear", *SHAPES)
LOWPASS = "lowpass"
_WINDOW = MAX_SIZE // 2
_BAND_BYTES = 96 << 20
_LOWPASS_MOST = 1 << 27  # samples; 2 GB of linear light, and some more to filter it
_NO_COLOR, _NO_LINEAR, _NO_SAMPLES = np.empty((0, 0), np.uint32), np.empty((0, 0, 4), np.float32), np.empty((0, 0), np.float32)


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
    """What of a scene does not depend on the camera: pass it in place of the scene to draw it again without preparing it again."""

    scene: Scene
    geometry: Geometry
    materials: MaterialTable
    vertex_materials: MaterialTable | None
    hardware: Interpolate | None = None


def prepare(scene: Any, shading: str | None = None, cull: str = "material") -> Prepared:
    """Lay a scene out for drawing; it must not be changed while the result is in use.

    Args:
        scene: A Scene, or anything `luxel.load` takes.
        shading, cull: As in `render`.
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
    return Prepared(scene, flatten(scene, cull), materials, vertex_materials, hardware)


def _prepared(scene: Any, shading: str | None, cull: str) -> Prepared:
    if not isinstance(scene, Prepared):
        return prepare(scene, shading, cull)
    if shading is not None or cull != "material":
        raise InputError("shading and cull: a prepared scene has its own; give them to prepare")
    return scene


def render(scene: Any, camera: Camera | None = None, size: tuple[int, int] = (1280, 720), *, samples: int = 1, pattern: str = "standard",
           ssaa: int = 1, filter: str = "box", shading: str | None = None, cull: str = "material", background: Any = None,
           outputs: Iterable[str] = ("color",), previous_camera: Camera | None = None, exposure: float = 0.0, threads: int | None = None,
           tile: int = 64, progress: Callable[[float], None] | None = None) -> Picture:  # fmt: skip
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
        progress: Called with the fraction that is done.

    Returns:
        A Picture.

    Raises:
        InputError: A value that cannot be drawn with.
        FileError: The file to load is missing or broken.
    """
    options = Options(samples, pattern, ssaa, filter, background, outputs, exposure, threads, tile)  # type: ignore[arg-type]
    started = time.perf_counter()
    prepared = _prepared(scene, shading, cull)
    draw = _draw_lowpassed if options.filter == LOWPASS else _draw
    picture = draw(prepared, camera, _checked_size(size), options, previous_camera, progress)
    picture.seconds = {"prepare": time.perf_counter() - started - sum(picture.seconds.values()), **picture.seconds}
    return picture


def render_views(scene: Any, cameras: Iterable[Camera], size: tuple[int, int] = (1280, 720), *, shading: str | None = None,
                 cull: str = "material", **options: Any) -> Iterator[Picture]:  # fmt: skip
    """Draw a scene from many cameras: what does not depend on the camera is prepared once. Arguments as in `render`.

    Yields:
        A Picture for each camera, in order.
    """
    prepared = _prepared(scene, shading, cull)
    for camera in cameras:
        yield render(prepared, camera, size, **options)


def render_to_png(path: Any, scene: Any, camera: Camera | None = None, size: tuple[int, int] = (1280, 720), *, shading: str | None = None,
                  cull: str = "material", progress: Callable[[float], None] | None = None, **options: Any) -> dict[str, float]:  # fmt: skip
    """Draw a picture of any size straight into a PNG file, band by band, in bounded memory. Arguments as in `render`.

    Returns:
        Seconds by stage.
    """
    from luxel.io.images import PngStream

    width, height = _checked_size(size)
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
            band = _draw(prepared, camera, (width, height), chosen, None, None, (first, last))
            started = time.perf_counter()
            assert band.color is not None
            stream.write(band.color[top - first : min(height, top + rows) - first])
            band.seconds["write"] = time.perf_counter() - started
            seconds = {name: seconds.get(name, 0.0) + value for name, value in band.seconds.items()}
            if progress:
                progress(min(1.0, (top + rows) / height))
    return seconds


def _checked_size(size: Any) -> tuple[int, int]:
    try:
        width, height = (operator.index(side) for side in size)
    except (TypeError, ValueError):
        raise InputError(f"size: expected (width, height) in pixels, got {size!r}") from None
    if not (1 <= width <= 1 << 20 and 1 <= height <= 1 << 20):
        raise InputError(f"size: expected 1 to 1048576 pixels a side, got {width} x {height}")
    return width, height


class _View(NamedTuple):
    """A camera with everything that a draw needs of it."""

    camera: Camera
    view: View
    eye: Eye
    lights: LightTable
    geometry: Geometry
    features: int
    previous: Array | None


def _see(prepared: Prepared, camera: Camera | None, size: tuple[int, int], previous: Camera | None, threads: int) -> _View:
    camera = camera or camera_for(prepared.scene, size)
    if not isinstance(camera, Camera):
        raise InputError(f"camera: expected a Camera, got {type(camera).__name__}")
    assert camera.world_from_camera is not None
    perspective = camera.yfov is not None
    least_depth = float(camera.near / camera.far) if perspective else 0.0
    direction = camera.world_from_camera[:3, 2] / np.linalg.norm(camera.world_from_camera[:3, 2])
    eye = Eye(camera.eye.astype(np.float32), direction.astype(np.float32), not perspective)
    lights, materials, geometry = pack_lights(prepared.scene, camera), prepared.materials, prepared.geometry
    features = materials.features
    if features & NEEDS_VIEW or bool((lights.lights[:, 3] != 0).any()):
        features |= NEEDS_POSITION
    if prepared.vertex_materials is not None:
        lit = light_vertices(geometry, materials.flags & GOURAUD != 0, prepared.vertex_materials, lights, eye, threads)
        geometry = geometry._replace(colors=lit)
    if previous is not None and not isinstance(previous, Camera):
        raise InputError(f"previous_camera: expected a Camera, got {type(previous).__name__}")
    motion = previous.clip_from_world(size) if previous is not None else None
    return _View(camera, View(camera.clip_from_world(size), least_depth), eye, lights, geometry, features, motion)


def _draw(prepared: Prepared, camera: Camera | None, size: tuple[int, int], options: Options, previous: Camera | None,
          progress: Callable[[float], None] | None, rows: tuple[int, int] | None = None) -> Picture:  # fmt: skip
    """Draw the pixel rows `rows` (all if None) of a picture."""
    clock = Clock()
    width, height = size
    first, last = rows or (0, height)
    assert options.threads is not None
    seen = _see(prepared, camera, size, previous, options.threads)
    names = set(options.outputs)
    target = Target(
        reusable((last - first, width), np.uint32) if "color" in names else _NO_COLOR,
        reusable((last - first, width, 4), np.float32) if "linear" in names else _NO_LINEAR,
        _NO_SAMPLES,
    )
    outputs = Outputs.wanted(names - {"motion"} if previous is None else names, width, last - first)
    clock.lap("prepare")
    if (target.color.size or target.linear.size) and prepared.hardware is None:
        _warm_up(prepared, seen, options, target)
        clock.lap("compile")
    corners = [(x, y) for y in range(first, last, _WINDOW) for x in range(0, width, _WINDOW)]
    margin = 0 if options.filter == "box" else options.tile  # what filters reach beyond the window
    for number, (x, y) in enumerate(corners):
        told = None if progress is None else lambda part, number=number: progress((number + part) / len(corners))
        left, top = max(0, x - margin), max(first, y - margin)
        right, bottom = min(width, x + _WINDOW + margin), min(last, y + _WINDOW + margin)
        keep = x - left, y - top, min(width, x + _WINDOW) - left, min(last, y + _WINDOW) - top
        window = Window(left, top, right - left, bottom - top, width, height)
        _draw_window(prepared, seen, window, keep, (left, top - first), options, target, outputs, clock, told)
    fields = {name: array for name, array in outputs._asdict().items() if array.size}
    if "motion" in names and previous is None:
        fields["motion"] = np.zeros((last - first, width, 2), np.float32)
    if "color" in names:
        fields["color"] = target.color.view(np.uint8).reshape(last - first, width, 4)
    if "linear" in names:
        fields["linear"] = target.linear
    return Picture(**fields, seconds=clock.seconds)


def _draw_lowpassed(prepared: Prepared, camera: Camera | None, size: tuple[int, int], options: Options, previous: Camera | None,
                    progress: Callable[[float], None] | None) -> Picture:  # fmt: skip
    """Draw a picture at `ssaa` times the rate and decimate it in frequency; what is not colour is drawn at its own rate."""
    from luxel.filter.antialias import decimate
    from luxel.filter.light import encode

    rate, threads = options.ssaa, options.threads or 1
    if size[0] * size[1] * rate**2 > _LOWPASS_MOST:
        most = f"{_LOWPASS_MOST / 1e6:.0f} million samples"
        raise InputError(f"filter: {LOWPASS} holds the finer picture whole: expected at most {most}, got {rate * size[0]} x {rate * size[1]}")
    camera = camera or camera_for(prepared.scene, size)
    plain = replace(options, ssaa=1, filter="box", outputs=("linear",))
    picture = _draw(prepared, camera, (rate * size[0], rate * size[1]), plain, None, progress)
    seconds, started = picture.seconds, time.perf_counter()
    linear = decimate(picture.linear, rate, threads=threads)
    color = encode(linear, np.uint8, True, threads) if "color" in options.outputs else None
    seconds["lowpass"] = time.perf_counter() - started
    rest = tuple(name for name in options.outputs if name not in ("color", "linear"))
    picture = _draw(prepared, camera, size, replace(plain, outputs=rest), previous, None) if rest else Picture()
    seconds = {name: seconds.get(name, 0.0) + picture.seconds.get(name, 0.0) for name in {**seconds, **picture.seconds}}
    return replace(picture, color=color, linear=linear if "linear" in options.outputs else None, seconds=seconds)


def _warm_up(prepared: Prepared, seen: _View, options: Options, target: Target) -> None:
    """Where nothing is compiled yet, compile visibility in a child process and, by shading no tiles, shading in this one."""
    child = warm.start()
    if child is None:
        return
    try:
        nothing = drawn(seen.geometry, np.empty((0, 4), np.int32), NO_CLIPPED)
        tiles, samples = Tiles(0, 0, 0, options.tile, 1, 1, 0, 0), Samples(options.positions, options.ssaa > 1)
        shade(tiles, np.zeros(0, np.uint8), np.empty((0, 1), np.int32), samples, nothing, _look(prepared, seen, options), target, 1)
        child.wait(60)
    except subprocess.TimeoutExpired:
        pass
    finally:
        child.kill()
        child.wait()


def _look(prepared: Prepared, seen: _View, options: Options) -> Look:
    return Look(prepared.materials, seen.lights, seen.eye, seen.features, np.float32(2.0**options.exposure), options.fill)


def _draw_window(prepared: Prepared, seen: _View, window: Window, keep: tuple[int, int, int, int], place: tuple[int, int], options: Options,
                 target: Target, outputs: Outputs, clock: Clock, progress: Callable[[float], None] | None) -> None:  # fmt: skip
    geometry, threads, pattern, tile = seen.geometry, options.threads or 1, options.positions, options.tile
    screen, unsafe = project(geometry.positions, seen.view, window, threads)
    clock.lap("project")
    clipped = clip(geometry.positions, geometry.triangles, screen, seen.view, window, threads) if unsafe else NO_CLIPPED
    clock.lap("clip")
    modes = set(geometry.parts.alpha_mode.tolist()) | {OPAQUE}
    bins = {
        mode: bin_triangles(geometry.triangles, screen, clipped, geometry.parts, mode, pattern, window, tile, threads) for mode in modes
    }  # fmt: skip
    clock.lap("bin")
    band = _Band(prepared, seen, window, keep, place, options, target, outputs, clock, screen, clipped, bins)
    across, down = bins[OPAQUE].across, bins[OPAQUE].down
    rows = max(1, band.tiles_at_once // across)
    for first in range(0, down, rows):
        band.draw(first, min(down, first + rows))
        if progress:
            progress(min(1.0, (first + rows) / down))


class _Band:
    """Draws bands of a window's tile rows, one after the other in the same buffers."""

    def __init__(self, prepared: Prepared, seen: _View, window: Window, keep: tuple[int, int, int, int], place: tuple[int, int],
                 options: Options, target: Target, outputs: Outputs, clock: Clock, screen: Array, clipped: Any,
                 bins: dict[int, Bins]) -> None:  # fmt: skip
        self.materials, self.seen, self.window, self.keep, self.place, self.options = prepared.materials, seen, window, keep, place, options
        self.drawn, self.look = drawn(seen.geometry, screen, clipped), _look(prepared, seen, options)
        self.target, self.outputs, self.clock = target, outputs, clock
        self.screen, self.clipped, self.bins = screen, clipped, bins
        self.colored = len(target.color) > 0 or len(target.linear) > 0
        self.beside = any(array.size for array in outputs)
        self.hardware = prepared.hardware
        self.per_sample = self.colored and (options.filter != "box" or BLEND in bins or self.hardware is not None)
        self.apron = 0 if options.filter == "box" else 1
        self.keep_depth = self.beside or len(bins) > 1
        occupied = sum((np.diff(b.start) > 0).astype(np.uint8) for mode, b in bins.items() if mode != BLEND)
        self.occupied = np.minimum(occupied, 1).astype(np.uint8)
        self.pixels = len(options.positions) * options.tile**2
        per_tile = 4 * self.pixels * (1 + self.keep_depth + 2 * (BLEND in bins) + 4 * self.per_sample)
        self.tiles_at_once = max(1, _BAND_BYTES // per_tile)

    def draw(self, first_row: int, last_row: int) -> None:
        """Draw tile rows first_row .. last_row - 1."""
        across, down = self.bins[OPAQUE].across, self.bins[OPAQUE].down
        top, bottom = max(0, first_row - self.apron), min(down, last_row + self.apron)
        first, last = top * across, bottom * across
        ids, depths = self._visible(first, last)
        self.clock.lap("cover")
        if self.beside:
            self._outputs(first, last, ids, depths)
            self.clock.lap("outputs")
        if not self.colored:
            return
        target = self.target
        if self.per_sample:
            target = Target(_NO_COLOR, _NO_LINEAR, reusable((last - first, 4 * self.pixels), np.float32))
            target.samples.fill(0.0)
        self._shade(first, last, ids, target, self.occupied)
        self.clock.lap("shade")
        if self.per_sample:
            if BLEND in self.bins:
                self._blend(first, last, ids, depths, target)
                self.clock.lap("blend")
            self._resolve(first_row, last_row, top, bottom, target.samples)
            self.clock.lap("resolve")

    def _visible(self, first: int, last: int) -> tuple[Array, Array]:
        o, w, geometry = self.options, self.window, self.seen.geometry
        ids = reusable((last - first, self.pixels + LANES), np.int32)
        depths = reusable((last - first if self.keep_depth else 0, self.pixels + LANES), np.float32)
        cover(self.bins[OPAQUE], geometry.triangles, self.screen, self.clipped, o.positions, w.width, w.height, first, last, ids, depths,
              o.threads or 1, len(self.bins) > 1)  # fmt: skip
        if MASK in self.bins:
            self._layer(MASK, first, last, ids, depths)
        return ids, depths

    def _layer(self, mode: int, first: int, last: int, ids: Array, depths: Array, peeled: Array | None = None) -> bool:
        from luxel.raster.layer import layer

        return layer(self.bins[mode], self.seen.geometry, self.screen, self.clipped, self.materials, self.options.positions, self.window.width,
                     self.window.height, first, last, ids, depths, self.options.threads or 1, peeled)  # fmt: skip

    def _shade(self, first: int, last: int, ids: Array, target: Target, occupied: Array, blend: bool = False) -> None:
        o, w, seen = self.options, self.window, self.seen
        if self.hardware is not None:
            modelled.shade(self.hardware, self.bins[OPAQUE], occupied, first, last, w.width, w.height, ids, o.positions, o.ssaa > 1,
                           seen.geometry, self.screen, self.clipped, blend, target.samples, o.threads or 1)  # fmt: skip
            return
        tiles = Tiles(first, last, self.bins[OPAQUE].across, o.tile, w.width, w.height, *self.place)
        shade(tiles, occupied, ids, Samples(o.positions, o.ssaa > 1), self.drawn, self.look, target, o.threads or 1)

    def _blend(self, first: int, last: int, ids: Array, depths: Array, target: Target) -> None:
        peeled = reusable(ids.shape, np.int32)
        occupied = (np.diff(self.bins[BLEND].start) > 0).astype(np.uint8)
        while self._layer(BLEND, first, last, ids, depths, peeled):
            self._shade(first, last, peeled, target, occupied, blend=True)

    def _resolve(self, first_row: int, last_row: int, top: int, bottom: int, samples: Array) -> None:
        o, w, tile = self.options, self.window, self.options.tile
        taps, weights = filter_taps(o.filter, o.positions)
        left, first, right, last = self.keep
        resolve(max(first_row * tile, first), min(last_row * tile, last), left, right, w.width, w.height, top * tile,
                (bottom - top) * tile, self.bins[OPAQUE].across, tile, len(o.positions), samples, taps, weights, *self.place, 2.0**o.exposure, o.fill,
                self.target.color, self.target.linear, o.threads or 1)  # fmt: skip

    def _outputs(self, first: int, last: int, ids: Array, depths: Array) -> None:
        camera, w = self.seen.camera, self.window
        write_outputs(self.bins[OPAQUE], self.occupied, first, last, w.width, w.height, ids, depths, self.seen.geometry, self.screen,
                      self.clipped, self.options.positions, (w.full_width, w.full_height), camera.near, camera.far, camera.yfov is None,
                      self.seen.previous, *self.place, self.outputs, self.options.threads or 1)  # fmt: skip
