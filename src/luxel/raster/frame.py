"""Frame: one view of a prepared scene, window by window and band by band.

The picture is drawn in windows no larger than the guard band allows, and each window in bands of tile rows whose per-sample buffers stay
under a fixed size, so memory does not grow with the number of samples.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.clock import Clock
from luxel.errors import InputError
from luxel.memory import reusable
from luxel.raster import modelled, warm
from luxel.raster.bin import BLEND, MASK, NO_CLIPPED, OPAQUE, bin_triangles
from luxel.raster.chunks import EVERYWHERE, Reach
from luxel.raster.clip import clip
from luxel.raster.constants import MAX_SIZE
from luxel.raster.cover import cover
from luxel.raster.fragments import NEEDS_POSITION, Eye, drawn
from luxel.raster.geometry import Geometry
from luxel.raster.lanes import LANES
from luxel.raster.lighting import LightTable, pack_lights
from luxel.raster.materials import GOURAUD, NEEDS_VIEW
from luxel.raster.outputs import Outputs, write_outputs
from luxel.raster.picture import Picture
from luxel.raster.project import View, Window, project
from luxel.raster.resolve import filter_taps, resolve
from luxel.raster.runs import Samples
from luxel.raster.shade import Look, Target, Tiles, light_vertices, shade
from luxel.scene.camera import Camera
from luxel.scene.framing import camera_for

if TYPE_CHECKING:
    from luxel.raster.render import Options, Prepared

_WINDOW = MAX_SIZE // 2
_BAND_BYTES = 96 << 20
NO_IDS = np.empty((0, 1), np.int32)
NO_COLOR, NO_LINEAR, NO_SAMPLES = np.empty((0, 0), np.uint32), np.empty((0, 0, 4), np.float32), np.empty((0, 0), np.float32)


class Seen(NamedTuple):
    """A camera with everything that a draw needs of it."""

    camera: Camera
    view: View
    eye: Eye
    lights: LightTable
    geometry: Geometry
    features: int
    previous: Array | None


def see(prepared: Prepared, camera: Camera | None, size: tuple[int, int], previous: Camera | None, threads: int) -> Seen:
    """What a draw of a picture of `size` needs of a camera; None takes the scene's own.

    Raises:
        InputError: `camera` or `previous` is no Camera.
    """
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
    return Seen(camera, View(camera.clip_from_world(size), least_depth), eye, lights, geometry, features, motion)


def draw(prepared: Prepared, camera: Camera | None, size: tuple[int, int], options: Options, previous: Camera | None,
         progress: Callable[[float], None] | None, rows: tuple[int, int] | None = None, band: type[Band] | Callable[..., Band] | None = None,
         ) -> Picture:  # fmt: skip
    """Draw the pixel rows `rows` (all if None) of a picture; `band` makes what draws a window, in place of `Band`."""
    clock = Clock()
    width, height = size
    first, last = rows or (0, height)
    assert options.threads is not None
    seen = see(prepared, camera, size, previous, options.threads)
    names = set(options.outputs)
    target = Target(
        reusable((last - first, width), np.uint32) if "color" in names else NO_COLOR,
        reusable((last - first, width, 4), np.float32) if "linear" in names else NO_LINEAR,
        NO_SAMPLES,
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
        (band or Band)(prepared, seen, window, keep, (left, top - first), options, target, outputs, clock).run(told)
    fields = {name: array for name, array in outputs._asdict().items() if array.size}
    if "motion" in names and previous is None:
        fields["motion"] = np.zeros((last - first, width, 2), np.float32)
    if "color" in names:
        fields["color"] = target.color.view(np.uint8).reshape(last - first, width, 4)
    if "linear" in names:
        fields["linear"] = target.linear
    return Picture(**fields, seconds=clock.seconds)


def _warm_up(prepared: Prepared, seen: Seen, options: Options, target: Target) -> None:
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


def _look(prepared: Prepared, seen: Seen, options: Options) -> Look:
    return Look(prepared.materials, seen.lights, seen.eye, seen.features, np.float32(2.0**options.exposure), options.fill)


class Band:
    """Draws bands of a window's tile rows, one after the other in the same buffers.

    Attributes:
        chosen: First tile that is drawn, and the last one's successor, in the window's numbering; all of them here.
    """

    def __init__(self, prepared: Prepared, seen: Seen, window: Window, keep: tuple[int, int, int, int], place: tuple[int, int],
                 options: Options, target: Target, outputs: Outputs, clock: Clock) -> None:  # fmt: skip
        self.prepared, self.seen, self.window, self.keep, self.place, self.options = prepared, seen, window, keep, place, options
        self.target, self.outputs, self.clock = target, outputs, clock
        self.materials, self.hardware, self.look = prepared.materials, prepared.hardware, _look(prepared, seen, options)
        self.across, self.down = -(-window.width // options.tile), -(-window.height // options.tile)
        self.colored = len(target.color) > 0 or len(target.linear) > 0
        self.beside = any(array.size for array in outputs)
        self.apron = 0 if options.filter == "box" else 1
        self.pixels = len(options.positions) * options.tile**2
        self.chosen = self._choose()
        self._bin()
        self.per_sample = self.colored and (options.filter != "box" or BLEND in self.bins or self.hardware is not None)
        self.keep_depth = self.beside or len(self.bins) > 1
        occupied = sum((np.diff(b.start) > 0).astype(np.uint8) for mode, b in self.bins.items() if mode != BLEND)
        self.occupied = np.minimum(occupied, 1).astype(np.uint8)
        self.tiles_at_once = max(1, _BAND_BYTES // self._tile_bytes())

    @property
    def at_once(self) -> bool:
        """Each tile is covered and shaded at once, as nobody else wants to know what is visible."""
        return self.colored and not self.keep_depth and self.hardware is None

    def _choose(self) -> tuple[int, int]:
        return 0, self.across * self.down

    def _tile_bytes(self) -> int:
        return 4 * self.pixels * (1 + self.keep_depth + 2 * (BLEND in self.bins) + 4 * self.per_sample)

    def _bin(self) -> None:
        """Project, clip, and sort into tiles what may touch the chosen ones."""
        geometry, threads, window, o = self.seen.geometry, self.options.threads or 1, self.window, self.options
        bounds = self._bounds()
        wanted = self._reach(bounds)
        self.screen, unsafe = project(geometry.positions, self.seen.view, window, threads, wanted.blocks)
        self.clock.lap("project")
        self.clipped = NO_CLIPPED
        if unsafe:
            self.clipped = clip(geometry.positions, geometry.triangles, self.screen, self.seen.view, window, threads, wanted.chunks)
        self.clock.lap("clip")
        modes = set(geometry.parts.alpha_mode.tolist()) | {OPAQUE}
        self.bins = {
            mode: bin_triangles(geometry.triangles, self.screen, self.clipped, geometry.parts, mode, o.positions, window, o.tile, threads, bounds,
                                wanted.chunks)
            for mode in modes
        }  # fmt: skip
        self.drawn = drawn(geometry, self.screen, self.clipped)
        self.clock.lap("bin")

    def _reach(self, bounds: tuple[int, int, int, int]) -> Reach:
        """What may touch these pixels."""
        return EVERYWHERE

    def _bounds(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom in pixels of what the chosen tiles need."""
        o, w = self.options, self.window
        first, last = self.chosen[0] // self.across, (self.chosen[1] - 1) // self.across
        left, right = 0, w.width
        if first == last and not self.apron:
            left, right = self.chosen[0] % self.across * o.tile, min(w.width, ((self.chosen[1] - 1) % self.across + 1) * o.tile)
        return left, max(0, first - self.apron) * o.tile, right, min(w.height, (last + 1 + self.apron) * o.tile)

    def run(self, progress: Callable[[float], None] | None = None) -> None:
        """Draw the chosen tiles."""
        begin, end = self.chosen[0] // self.across, -(-self.chosen[1] // self.across)
        rows = max(1, self.tiles_at_once // self.across)
        for first in range(begin, end if self.chosen[0] < self.chosen[1] else begin, rows):
            self.draw(first, min(end, first + rows))
            if progress:
                progress(min(1.0, (first + rows - begin) / (end - begin)))

    def draw(self, first_row: int, last_row: int) -> None:
        """Draw what is chosen of the tile rows first_row .. last_row - 1."""
        across, reach = self.across, self.apron * (self.across + 1)
        top, bottom = max(0, first_row - self.apron), min(self.down, last_row + self.apron)
        first, last = max(top * across, self.chosen[0] - reach), min(bottom * across, self.chosen[1] + reach)
        ids, depths = (NO_IDS, NO_IDS) if self.at_once else self._visible(first, last)
        if not self.at_once:
            self.clock.lap("cover")
        if self.beside:
            self._outputs(first, last, ids, depths)
            self.clock.lap("outputs")
        if not self.colored:
            return
        target, samples = self.target, NO_SAMPLES
        if self.per_sample:
            samples = reusable(((bottom - top) * across, 4 * self.pixels), np.float32)
            samples.fill(0.0)
            target = Target(NO_COLOR, NO_LINEAR, samples[first - top * across : last - top * across])
        self._shade(first, last, ids, target, self.occupied)
        self.clock.lap("shade")
        if self.per_sample:
            if BLEND in self.bins:
                self._blend(first, last, ids, depths, target)
                self.clock.lap("blend")
            self._resolve(first_row, last_row, top, bottom, samples)
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
        tiles = Tiles(first, last, self.across, o.tile, w.width, w.height, *self.place)
        bins = self.bins[OPAQUE] if self.at_once else None
        shade(tiles, occupied, ids, Samples(o.positions, o.ssaa > 1), self.drawn, self.look, target, o.threads or 1, bins)

    def _blend(self, first: int, last: int, ids: Array, depths: Array, target: Target) -> None:
        peeled = reusable(ids.shape, np.int32)
        occupied = (np.diff(self.bins[BLEND].start) > 0).astype(np.uint8)
        while self._layer(BLEND, first, last, ids, depths, peeled):
            self._shade(first, last, peeled, target, occupied, blend=True)

    def _resolve(self, first_row: int, last_row: int, top: int, bottom: int, samples: Array) -> None:
        """Write the pixels of tile rows first_row .. last_row - 1; `samples` are those of the rows top .. bottom - 1."""
        left, first, right, last = self.keep
        tile = self.options.tile
        self._resolve_part(max(first_row * tile, first), min(last_row * tile, last), left, right, top, bottom, samples)

    def _resolve_part(self, first: int, last: int, left: int, right: int, top: int, bottom: int, samples: Array) -> None:
        o, w, tile = self.options, self.window, self.options.tile
        taps, weights = filter_taps(o.filter, o.positions)
        resolve(first, last, left, right, w.width, w.height, top * tile, (bottom - top) * tile, self.across, tile, len(o.positions), samples, taps,
                weights, *self.place, 2.0**o.exposure, o.fill, self.target.color, self.target.linear, o.threads or 1)  # fmt: skip

    def _outputs(self, first: int, last: int, ids: Array, depths: Array) -> None:
        camera, w = self.seen.camera, self.window
        write_outputs(self.bins[OPAQUE], self.occupied, first, last, w.width, w.height, ids, depths, self.seen.geometry, self.screen,
                      self.clipped, self.options.positions, (w.full_width, w.full_height), camera.near, camera.far, camera.yfov is None,
                      self.seen.previous, *self.place, self.outputs, self.options.threads or 1)  # fmt: skip
