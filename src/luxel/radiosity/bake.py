"""Bake: from a scene to a lit scene.

    unwrap -> luxels -> those inside solids found -> elements, patches, lights -> direct light of what has no surface
           -> lights shoot -> elements pass light on until little is unshot -> they gather once more, finely -> lightmap
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.clock import Clock
from luxel.errors import DarkError, FileError, InputError, LuxelWarning
from luxel.radiosity import checkpoint as saving
from luxel.radiosity import lightmap
from luxel.radiosity.diagnosis import Shooters, check_memory, work_of
from luxel.radiosity.elements import QUALITIES, Cut, Quality, cut, frames_of_texels
from luxel.radiosity.gather import Lookup, Sight, View, element_pages, texel_maps
from luxel.radiosity.hemicube import RESOLUTIONS
from luxel.radiosity.inside import free_places, seen_backs
from luxel.radiosity.labour import Labour
from luxel.radiosity.lamps import Lamps, lamps_of
from luxel.radiosity.luxels import Luxels, find_luxels, part_of, two_sided_triangles
from luxel.radiosity.occlusion import Occlusion
from luxel.radiosity.pages import triangle_pages
from luxel.radiosity.rays import obstacles, scene_masks
from luxel.radiosity.relight import Transport, transport_of
from luxel.radiosity.solve import Problem, Rows, Source, State, Step, ambient, complete, element_steps, light_steps, patch_steps, settled, start
from luxel.radiosity.spots import find_spots, spot_rows
from luxel.radiosity.transport import ROW_BYTES
from luxel.radiosity.unwrap import Atlas, expected_luxels, unwrap
from luxel.raster.geometry import Geometry, flatten
from luxel.scene.normals import with_normals
from luxel.scene.scene import Scene

if TYPE_CHECKING:
    from luxel.cluster.comm import Comm

_MOST_KEPT = 8 << 30
"""A transport may be so large."""

_SEEN = 128
"""Rays by which elements look around for a transport that is kept, where they do not for the bake."""

_LAYER = 1e-5
"""By how much the light of one lamp may change, of itself, in the last pass."""

_MOST_BACKS = 0.5
"""A luxel that sees more backs than this is inside a solid."""

_FEW_VALID, _MUCH_LOST = 0.5, 0.98
"""Shares of valid luxels and of escaped light that are worth a word."""

_SAVE_EVERY = 30.0  # seconds

_LAYING = "laying out the lightmap"


@dataclass
class Baked:
    """A scene with its light.

    Attributes:
        atlas: Where every luxel lies.
        luxels: n of them.
        irradiance: (n, 3) float32: E on the front of each luxel, W/m2; 0 where not `valid`.
        valid: (n,) bool: False inside solids.
        direct: (n, 3) float32: what came from the lights without a bounce.
        ledger: A `Step` a batch of shots.
        seconds: By stage.
        finished: The unshot light is below the tolerance.
        layers: What is asked for of parts of the light, (n, 3) float32 each.
        transport: To light the scene anew, if asked for.
    """

    atlas: Atlas
    luxels: Luxels
    irradiance: Array
    valid: Array
    direct: Array
    ledger: list[Step]
    seconds: dict[str, float]
    finished: bool
    layers: dict[str, Array] = field(default_factory=dict)
    transport: Transport | None = None

    @cached_property
    def pages(self) -> Array:
        """(p, h, w, 3) float32: the lightmap, filled, with gutters, and without steps at seams; W/m2."""
        return lightmap.finish(self.atlas, self.luxels, self.irradiance, self.valid)[0]

    @property
    def scene(self) -> Scene:
        """The atlas's scene with the lightmap."""
        return lightmap.attach(self.atlas, self.pages)


@dataclass
class _Prepared:
    """A scene ready to be solved."""

    atlas: Atlas
    luxels: Luxels
    geometry: Geometry
    valid: Array
    cut: Cut
    rays: Occlusion
    two_sided: Array
    reach: float

    @cached_property
    def view(self) -> View:
        """Where this process's elements look."""
        pages = element_pages(self.luxels, self.cut.luxel, self.cut.back)
        lookup = Lookup(texel_maps(self.geometry, self.atlas.size), triangle_pages(self.atlas, self.geometry), self.two_sided, pages)
        return View(self.rays, self.cut.problem.own.numbers, lookup, self.reach)


@dataclass
class Progress:
    """What a bake in progress can tell: unshot share of the light, shots so far, and the picture so far.

    Attributes:
        looked: Share of the elements that have looked around for themselves, while they do.
    """

    prepared: _Prepared
    state: State
    looked: float = 0.0

    @property
    def unshot(self) -> float:
        """Of the emitted light, 0..1."""
        return self.state.ledger[-1].unshot_fraction if self.state.ledger else 1.0

    @property
    def sizes(self) -> tuple[int, int]:
        """Texels of all pages, and bytes of the state in a checkpoint."""
        (width, height), pages = self.prepared.atlas.size, self.prepared.atlas.pages
        return width * height * pages, saving.size(self.state)

    def preview(self) -> Scene:
        """The scene as lit so far, with an ambient term for what is unshot."""
        p = self.prepared
        values = _per_luxel(p, self.state.received + ambient(p.cut.problem, self.state)[:, None])
        return lightmap.attach(p.atlas, lightmap.finish(p.atlas, p.luxels, values, p.valid)[0])


def bake(scene: Any, *, quality: str | Quality = "normal", density: float | None = None, page: int = 1024, sky: Any = None,
         tolerance: float | None = None, seconds: float | None = None, threads: int | None = None,
         progress: Callable[[float, Progress], None] | None = None, checkpoint: str | Path | None = None, resume: bool = False,
         transport: bool = False, layers: bool = False, comm: Comm | None = None, device: str = "cpu",
         preparing: Callable[[float, str], None] | None = None) -> Baked:  # fmt: skip
    """Light a scene: diffuse light between all its surfaces, as a lightmap.

    What shines: emissive materials (their radiance), point, spot and directional lights, and the sky.

    Ranks of MPI share the work if all of them call this, with the same arguments, inside of `comm.guard()`. Rank 0 reads the scene, tells of progress
    and keeps the checkpoint; the result is on all of them, but for transport and layers, which are on rank 0.

    Args:
        scene: A Scene, or anything `luxel.load` takes.
        quality: "draft", "normal", "final", or a `Quality`.
        density: Luxels per metre; None: chosen from the scene's size.
        page: Side of a lightmap page, texels.
        sky: Radiance, W/(m2 sr): a number, (3,), or an equirectangular (h, w, 3) picture; None: no sky.
        tolerance: Share of the emitted light that may stay unshot; it is spread as the last bounce was. None: the quality's.
        seconds: Stop shooting after so long, whatever is unshot.
        threads: None: all cores this process may use, or a rank's part of them. The result does not depend on it.
        progress: Called after each batch of shots with the unshot share and a `Progress`.
        checkpoint: A file that keeps the state, every half minute and when the bake is interrupted.
        resume: Go on from `checkpoint` if it is there.
        transport: Also keep the transport, to light the scene anew (`Transport`): four bytes for each ray of a luxel, two for each point of
            lights and spots.
        layers: Also the light of each lamp by itself, and of the sky.
        comm: `luxel.cluster.comm.world()`, or some of its ranks. The result does not depend on it.
        device: "cpu"; "cuda": a GPU does what is done for every element; or "auto": a GPU if one can be used and has the memory. The light is the
            same but for rounding.
        preparing: Called before there is light, with what is being done, and the share of it that is probably done.

    Raises:
        DarkError: Nothing shines.
        InputError: There is no surface, or a value cannot be worked with; the checkpoint is of another bake; so many luxels do not fit in the
            memory that is free.
        DeviceError: Device "cuda", and there is no GPU, no driver, too old a card, or too little memory on it.
        ExtraMissingError: The scene needs texture coordinates and xatlas is not installed.
    """
    settings = _quality(quality, tolerance)
    labour = labour_of(threads, comm, device)
    progress = progress if labour.team.leads else None
    clock, tell = Clock(), preparing if preparing and labour.team.leads else _nobody
    lamps, atlas = labour.once(lambda: _laid_out(scene, sky, settings, density, page, labour, clock, tell))
    rays = rays_of(settings, lamps.sky is not None)
    prepared = _prepare(atlas, settings, _fits(settings, lamps, density, labour), labour, clock, tell)
    problem, n = prepared.cut.problem, prepared.cut.problem.elements.numbers.shape[1]
    _check_light(prepared, lamps)
    keep = transport or layers
    counts = _kept_rows(problem, settings, rays, keep, labour)
    labour = labour.fitting(problem, prepared.view, (rays, settings.gathered), counts)
    light_rows = _rows(problem, problem.lights, counts[1], labour)
    state = start(problem)

    def told(looked: float) -> None:
        if progress:
            progress(state.ledger[-1].unshot_fraction if state.ledger else 1.0, Progress(prepared, state, looked))

    @cache
    def sight() -> Sight:
        own = labour.look(prepared.view, rays, told)
        return own._replace(away=labour.join(own.away, n))

    @cache
    def whole_sight() -> Sight:  # once the lights have shot
        return sight()._replace(spots=find_spots(problem, sight(), state.direct, settings, labour))

    still = labour.join(lamps.shine(prepared.view, sight, slice(None), True, labour), n)
    state = start(problem, still, labour.threads)
    clock.lap("direct")
    keeps = checkpoint is not None and labour.team.leads
    key = saving.fingerprint(settings, _known(prepared, lamps, still)) if keeps else ""
    if checkpoint and resume:
        state = labour.once(lambda: saving.load(Path(checkpoint), key, state) or state)
    state = labour.state(problem, state)
    deadline = time.monotonic() + seconds if seconds is not None else None
    if settings.seen:
        bounces = element_steps(problem, state, whole_sight, settings.tolerance, labour)
    else:
        bounces = patch_steps(problem, state, _rows(problem, problem.patches, counts[0], labour), settings.tolerance, labour)
    shooting = chain(light_steps(problem, state, light_rows, labour), bounces)
    kept_in = (Path(checkpoint), key) if checkpoint and keeps else None
    finished = _shoot_all(shooting, prepared, state, deadline, progress, kept_in, labour)
    clock.lap("solve")
    if labour.team.leads:
        _tell_of_loss(state)
    received = settled(problem, state, settings.seen > 0) if finished else state.received + ambient(problem, state)[:, None].astype(np.float32)
    if finished and (settings.gathered or (settings.seen and settings.unlike < math.inf)):
        received = state.direct + _last_bounce(prepared, whole_sight, (problem.albedo * received).T.copy(), settings, labour, told)
        clock.lap("gather")
    values, direct = _per_luxel(prepared, received), _per_luxel(prepared, state.direct)
    baked = Baked(prepared.atlas, prepared.luxels, values, prepared.valid, direct, state.ledger, clock.seconds, finished)
    if keep:
        kept = _kept(prepared, light_rows, whole_sight(), still, labour)
        baked.transport = kept if transport else None
        clock.lap("transport")
        if layers:
            baked.layers = _layers(prepared, kept, lamps, sight, values, labour)
            clock.lap("layers")
    return baked


def _known(prepared: _Prepared, lamps: Lamps, still: Array) -> list[Array]:
    """All that the light depends on but for the quality: where surfaces are, what they do to light and what hides them, and what shines."""
    luxels, geometry = prepared.luxels, prepared.geometry
    surfaces = [geometry.positions, geometry.triangles, luxels.position, luxels.normal, luxels.area, luxels.albedo, prepared.two_sided]
    shines = [prepared.cut.problem.exitance, still, lamps.table, np.zeros(0) if lamps.sky is None else lamps.sky]
    rays = prepared.rays  # which triangles hide what, and where their masks have holes
    return [*surfaces, rays.triangle, rays.mask, rays.texcoords, rays.masks, rays.cutoffs, rays.alpha, *shines]


def _check_light(prepared: _Prepared, lamps: Lamps) -> None:
    """Refuse a scene in which nothing shines after all."""
    if prepared.cut.problem.lights is None and not len(lamps.table) and lamps.sky is None:
        hidden = "all that is emissive lies in solids, or the normals about it are inverted"
        dark = "what is emissive has no surface, or its pictures are black"
        raise DarkError(f"bake: nothing shines: {hidden if prepared.luxels.emission.any() else dark}")


def _tell_of_loss(state: State) -> None:
    """Warn if much light escapes."""
    if state.escaped.sum() > _MUCH_LOST * state.emitted.sum():
        share = f"{state.escaped.sum() / state.emitted.sum():.0%} of the light meets nothing, or backs of surfaces"
        warnings.warn(f"{share}: is the scene open, or are normals inverted?", LuxelWarning, stacklevel=3)


def _kept(prepared: _Prepared, lights: Rows, sight: Sight, still: Array, labour: Labour) -> Transport | None:
    """What lights the scene anew, with the rows of all lights."""
    problem = prepared.cut.problem
    if problem.lights is not None:
        complete(problem, problem.lights, lights, labour)
    return transport_of(prepared.cut, lights, sight, still, prepared.luxels, labour)


def _last_bounce(prepared: _Prepared, sight: Callable[[], Sight], light: Array, settings: Quality, labour: Labour,
                 told: Callable[[float], None]) -> Array:  # fmt: skip
    """(3, n) float32: what elements receive of the radiosity of all, `light` (n, 3), as well as the quality asks."""
    view, seen = prepared.view, sight()

    def gathered(light: Array) -> Array:
        if settings.gathered:
            return labour.gather(view, light, settings.gathered, told)
        return labour.look_closer(view, seen, light, settings.unlike, told)

    return labour.join(labour.shared(seen.spots, light, gathered), len(light))


def labour_of(threads: int | None, comm: Comm | None, device: str = "cpu") -> Labour:
    """Who does the heavy work."""
    if device != "cpu" and comm is not None and comm.size > 1:
        raise InputError(f"device: ranks of MPI bake on processors, expected cpu, got {device!r}")
    if device != "cpu":
        from luxel.cuda.labour import labour_on

        return labour_on(device, jit.checked_threads(threads))
    if comm is None or comm.size == 1:
        return Labour(jit.checked_threads(threads))
    from luxel.cluster.team import Ranks

    each = comm.threads(threads)
    return Labour(each, Ranks(comm, each))


def rays_of(settings: Quality, sky: bool) -> int:
    """By how many rays each element looks around."""
    return (settings.seen or _SEEN) * (2 if sky else 1)


def effort(settings: Quality, sky: bool, glows: bool) -> tuple[int, float, Shooters | None, int]:
    """What `diagnosis.estimate` asks for: rays that are kept, the work of a luxel, what shoots, and points of spots; of a scene with or without a
    sky, and whether any surface glows."""
    looks = settings.seen > 0
    rays = rays_of(settings, sky)
    work = work_of(rays if looks or sky else 0, settings.gathered, looks and settings.unlike < math.inf, sky)
    if looks and not settings.exact:
        return rays, work, None, settings.spot_points
    lights = settings.light_points if glows else 0
    shooters = Shooters(lights, settings.rays, 0.0 if looks else settings.patch, settings.tolerance, ROW_BYTES)
    return rays, work, shooters, settings.spot_points


def _fits(settings: Quality, lamps: Lamps, density: float | None, labour: Labour) -> Callable[[float, int], None]:
    """Refuses so many luxels, of so many triangles, if they do not fit in memory."""
    rays, ranks = rays_of(settings, lamps.sky is not None), labour.team.size
    return partial(check_memory, rays=rays // ranks, spots=settings.spot_points // ranks, density=density, here=labour.team.here)


def _kept_rows(problem: Problem, settings: Quality, rays: int, keep: bool, labour: Labour) -> tuple[int, int, int]:
    """How many rows are kept: of the patches what fits, if they shoot; of the lights all if they must be; of spots, at most."""
    n, patches = problem.elements.numbers.shape[1], len(problem.patches.tree.patches)
    lights = 0 if problem.lights is None else len(problem.lights.tree.patches)
    spots = 3 * spot_rows(n, settings) // 2
    wanted = 2 * n * (lights + spots) + 4 * n * rays
    if keep and wanted > _MOST_KEPT:
        raise InputError(f"transport: {wanted / 1e9:.1f} GB for {lights} lights and {n} luxels, at most {_MOST_KEPT / 1e9:.0f} GB: bake coarser")
    return 0 if settings.seen else min(patches, labour.team.size * ROW_BYTES // (2 * n)), lights if keep else 0, spots


def _rows(problem: Problem, source: Source | None, kept: int, labour: Labour) -> Rows:
    """Where so many rows of a source are kept."""
    return Rows(0 if source is None else len(source.tree.patches), problem.own.numbers.shape[1], kept, labour.empty)


def _layers(prepared: _Prepared, kept: Transport | None, lamps: Lamps, sight: Callable[[], Sight], whole: Array,
            labour: Labour) -> dict[str, Array]:  # fmt: skip
    """(n, 3) float32 irradiance by lamp: objects with emissive surfaces, lights of the scene, the sky; none where there is no transport.

    For the whole, luxels have looked closer in the last bounce than what is kept tells: each lamp has the share of it that is its own by that.
    """
    scene, luxels = prepared.atlas.scene, prepared.luxels
    layers: dict[str, Array] = {}

    def add(name: str, still: Array, emission: Array) -> None:
        if kept is None:
            return
        unique, k = name, 2
        while unique in layers:
            unique, k = f"{name} {k}", k + 1
        layers[unique] = kept.spread(still, emission, kept.albedo, _LAYER, labour.threads)

    def shine(rows: slice, sky: bool) -> Array:
        return labour.join(lamps.shine(prepared.view, sight, rows, sky, labour), n)

    n = prepared.cut.problem.elements.numbers.shape[1]
    nothing, dark = np.zeros((3, n), np.float32), np.zeros_like(luxels.emission)
    drawn = [i for i in scene.instances if len(scene.meshes[i.mesh].triangles)]
    objects = prepared.geometry.part_object[part_of(prepared.geometry, luxels.triangle)]
    for number in np.unique(objects[luxels.emission.sum(1) > 0]):
        name = next((i.name for i in drawn if i.object == number and i.name), f"object {number}")
        add(name, nothing.copy(), np.where((objects == number)[:, None], luxels.emission, dark))
    for row, light in enumerate(scene.lights):
        add(light.name or f"light {row}", shine(slice(row, row + 1), False), dark)
    if lamps.sky is not None:
        add("sky", shine(slice(lamps.own, None), True), dark)
    sums = np.sum([np.zeros(whole.shape), *layers.values()], 0)
    share = np.divide(whole, sums, out=np.ones_like(sums), where=sums > 0)
    return {name: (layer * share).astype(np.float32) for name, layer in layers.items()}


def _quality(quality: str | Quality, tolerance: float | None) -> Quality:
    if not isinstance(quality, Quality):
        if quality not in QUALITIES:
            raise InputError(f"quality: expected {', '.join(QUALITIES)}; got {quality!r}")
        quality = QUALITIES[quality]
    if tolerance is not None:
        if not 0 < tolerance <= 1:
            raise InputError(f"tolerance: expected a share between 0 and 1, got {tolerance!r}")
        quality = quality._replace(tolerance=float(tolerance))
    for name in ("light_resolution", "resolution"):
        if not 2 <= getattr(quality, name) <= RESOLUTIONS[-1] or getattr(quality, name) % 2:
            raise InputError(f"quality: expected an even {name} from 2 to {RESOLUTIONS[-1]}, got {getattr(quality, name)!r}")
    if quality.seen < 0 or quality.seen & (quality.seen - 1):
        raise InputError(f"quality: expected a power of two as the number of rays that elements see by, or 0, got {quality.seen!r}")
    return quality


def _loaded(scene: Any) -> Scene:
    from luxel.io import load
    from luxel.io.build import finite_mesh

    if isinstance(scene, Scene):
        return replace(scene, meshes=[finite_mesh(mesh.name or f"mesh {number}", mesh) for number, mesh in enumerate(scene.meshes)])
    return load(scene)


def _nobody(share: float, doing: str) -> None:
    """Is told, where nobody wants to be."""


def _laid_out(scene: Any, sky: Any, settings: Quality, density: float | None, page: int, labour: Labour, clock: Clock,
              tell: Callable[[float, str], None]) -> tuple[Lamps, Atlas]:  # fmt: skip
    tell(0.0, "reading")
    scene = _loaded(scene)
    scene = replace(scene, meshes=[mesh if mesh.normals is not None else with_normals(mesh) for mesh in scene.meshes])  # smooth, but for creases
    clock.lap("load")
    lamps = lamps_of(scene, sky)
    if density is not None:
        _fits(settings, lamps, density, labour)(expected_luxels(scene, density), 0)
    tell(0.0, _LAYING)
    atlas = unwrap(scene, density, page, threads=labour.threads, progress=lambda share: tell(share, _LAYING))
    clock.lap("unwrap")
    return lamps, atlas


def _prepare(atlas: Atlas, settings: Quality, fits: Callable[[float, int], None], labour: Labour, clock: Clock,
             tell: Callable[[float, str], None]) -> _Prepared:  # fmt: skip
    tell(0.0, "finding luxels")
    luxels = find_luxels(atlas, labour.threads)
    if not len(luxels.area):
        raise InputError("bake: the scene has no surface")
    fits(len(luxels.area) + int(luxels.two_sided.sum()), len(atlas.chart))
    clock.lap("luxels")
    geometry = flatten(atlas.scene, "none")
    two_sided = two_sided_triangles(atlas.scene, geometry)
    masks = scene_masks(atlas.scene, geometry)
    rays = obstacles(geometry, masks)
    finite = geometry.positions[np.isfinite(geometry.positions).all(1)]
    reach = 2.0 * float(np.linalg.norm(np.ptp(finite, axis=0)))
    sides = frames_of_texels(atlas, geometry, luxels)
    tell(0.0, "finding luxels in solids")
    valid = _move_out(luxels, sides, rays, two_sided, reach, labour)
    if labour.team.leads and valid.mean() < _FEW_VALID:
        share = f"{1 - valid.mean():.0%} of the luxels see hardly anything but backs of surfaces"
        warnings.warn(f"{share}: are normals inverted? They stay dark", LuxelWarning, stacklevel=3)
    clock.lap("inside")
    tell(0.0, "cutting patches")
    pieces = cut(luxels, sides, geometry, atlas.chart, valid, two_sided, masks, rays, settings, labour)
    clock.lap("patches")
    return _Prepared(atlas, luxels, geometry, valid, pieces, rays, two_sided, reach)


def _move_out(luxels: Luxels, sides: tuple[Array, Array], rays: Occlusion, two_sided: Array, reach: float, labour: Labour) -> Array:
    """Which luxels are not inside solids, (n,) bool; what is inside in part is changed to the rest of it."""

    def backs(some: Any) -> Array:
        which = order[some]
        return seen_backs(rays, two_sided, luxels.position[which], luxels.face_normal[which], reach, labour.threads)

    def free(some: Any) -> Array:
        which = hidden[some]
        u, v = (side[which] for side in sides)
        place, share = free_places(rays, two_sided, luxels.position[which], luxels.face_normal[which], u, v, reach, labour.threads)
        return np.concatenate([place.T, share[None]])

    order = np.argsort(luxels.chart, kind="stable")  # neighbours together
    valid = luxels.two_sided.copy()
    valid[order] |= labour.each(len(order), backs) <= _MOST_BACKS
    hidden = order[~valid[order]]
    if len(hidden):
        *place, share = labour.each(len(hidden), free)
        kept = share > 0
        valid[hidden], moved = kept, hidden[kept]
        luxels.position[moved] = np.stack(place, 1)[kept]
        luxels.area[moved] *= share[kept]
        for side in sides:
            side[moved] *= np.sqrt(share[kept])[:, None]
    return valid


def _per_luxel(prepared: _Prepared, values: Array) -> Array:
    """(n, 3) float32 per luxel of (3, elements): of their fronts."""
    front = np.flatnonzero(~prepared.cut.back)
    result = np.zeros((len(prepared.luxels.area), 3), np.float32)
    result[prepared.cut.luxel.take(front)] = values[:, front].T
    return result


def _shoot_all(shooting: Iterator[State], prepared: _Prepared, state: State, deadline: float | None,
               progress: Callable[[float, Progress], None] | None, keep: tuple[Path, str] | None, labour: Labour) -> bool:  # fmt: skip
    """Shoot to the end; returns whether it was reached. The checkpoint is written now and then, and whatever ends this between two steps."""
    saved = time.monotonic()
    try:
        for _ in shooting:
            if progress:
                progress(state.ledger[-1].unshot_fraction, Progress(prepared, state))
            if keep and time.monotonic() - saved > _SAVE_EVERY:
                _save(keep, state)
                saved = time.monotonic()
            if deadline is not None and labour.once(lambda: time.monotonic() > deadline):
                return False
    finally:
        if keep and state.whole:
            _save(keep, state)
    return True


def _save(keep: tuple[Path, str], state: State) -> None:
    """Keep the state; if it cannot be, that is said, and the light that is found so far is not lost for it."""
    try:
        saving.save(*keep, state)
    except FileError as error:
        warnings.warn(f"{error}: the bake goes on, and cannot be resumed from here", LuxelWarning, stacklevel=4)
