"""Bake: from a scene to a lit scene.

    unwrap -> luxels -> those inside solids found -> elements, patches, lights (`prepare`) -> light (`lighting`) -> lightmap
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.clock import Clock
from luxel.errors import FileError, InputError, LuxelWarning
from luxel.radiosity import checkpoint as saving
from luxel.radiosity import lightmap
from luxel.radiosity.effort import kept_rows, memory_check, rays_of
from luxel.radiosity.labour import Labour
from luxel.radiosity.lighting import Lighting, Progress
from luxel.radiosity.luxels import Luxels
from luxel.radiosity.prepare import check_light, laid_out, prepare
from luxel.radiosity.quality import Quality, checked_quality
from luxel.radiosity.relight import Transport
from luxel.radiosity.solve import State, Step
from luxel.radiosity.unwrap import Atlas
from luxel.scene.scene import Scene

if TYPE_CHECKING:
    from luxel.cluster.comm import Comm

_MUCH_LOST = 0.98
"""A share of escaped light that is worth a word."""

_HARDLY = 1.5e-4
"""A share of the sky's light that is hardly any: a hall with one small window has more. A word is due."""

_SAVE_EVERY = 30.0  # seconds


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
    settings, labour = checked_quality(quality, tolerance), labour_of(threads, comm, device)
    leads, clock = labour.team.leads, Clock()
    tell = preparing if preparing and leads else _nobody
    lamps, atlas = labour.once(lambda: laid_out(scene, sky, settings, density, page, labour, clock, tell))
    prepared = prepare(atlas, settings, memory_check(settings, lamps, density, labour), labour, clock, tell)
    check_light(prepared, lamps)
    rays, problem = rays_of(settings, lamps.sky is not None), prepared.cut.problem
    rows = kept_rows(problem, settings, rays.kept, transport or layers, labour)
    labour = labour.fitting(problem, prepared.view, rays, rows)
    lighting = Lighting(prepared, lamps, settings, rays, rows, labour, progress if leads else None)
    lighting.begin()
    clock.lap("direct")
    kept_in = (Path(checkpoint), saving.fingerprint(settings, _known(lighting))) if checkpoint is not None and leads else None
    if checkpoint is not None and resume:
        lighting.state = labour.once(lambda: _resumed(kept_in, lighting.state))
    lighting.state = labour.state(problem, lighting.state)
    finished = _shoot_all(lighting, time.monotonic() + seconds if seconds is not None else None, kept_in)
    clock.lap("solve")
    if leads:
        _tell_of_loss(lighting.state)
        _tell_of_dark(lighting)
    received = lighting.settled() if finished else lighting.so_far()
    if finished and lighting.bounces_once_more:
        received = lighting.last_bounce(received)
        clock.lap("gather")
    values, direct = prepared.per_luxel(received), prepared.per_luxel(lighting.direct)
    valid = lighting.valid()
    values[~valid] = 0
    baked = Baked(atlas, prepared.luxels, values, valid, direct, lighting.state.ledger, clock.seconds, finished)
    if transport or layers:
        kept = lighting.transport()
        baked.transport = kept if transport else None
        clock.lap("transport")
        if layers:
            baked.layers = lighting.layers(kept, values)
            clock.lap("layers")
    return baked


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


def _nobody(share: float, doing: str) -> None:
    """Is told, where nobody wants to be."""


def _known(lighting: Lighting) -> list[Array]:
    """All that the light depends on but for the quality: where surfaces are, what they do to light and what hides them, and what shines."""
    prepared, lamps = lighting.prepared, lighting.lamps
    luxels, geometry = prepared.luxels, prepared.geometry
    surfaces = [geometry.positions, geometry.triangles, luxels.position, luxels.normal, luxels.area, luxels.albedo, prepared.two_sided]
    shines = [prepared.cut.problem.exitance, lighting.still, lamps.table, *(lamps.sky or ())]
    rays = prepared.rays  # which triangles hide what, and where their masks have holes
    return [*surfaces, rays.triangle, rays.mask, rays.texcoords, rays.masks, rays.cutoffs, rays.alpha, *shines]


def _resumed(keep: tuple[Path, str] | None, state: State) -> State:
    """The state that was kept, or, if there is none, the one at the start."""
    return (saving.load(*keep, state) if keep else None) or state


def _tell_of_loss(state: State) -> None:
    """Warn if much light escapes."""
    if state.escaped.sum() > _MUCH_LOST * state.emitted.sum():
        share = f"{state.escaped.sum() / state.emitted.sum():.0%} of the light meets nothing, or backs of surfaces"
        warnings.warn(f"{share}: is the scene open, or are normals inverted?", LuxelWarning, stacklevel=3)


def _tell_of_dark(lighting: Lighting) -> None:
    """Warn if there is a sky, and it and point lights light hardly anything, whatever glowing surfaces do."""
    if lighting.lamps.sky is not None:
        share = float(lighting.still.mean(dtype=np.float64)) / (np.pi * lighting.lamps.radiance)
        if share < _HARDLY:
            word = f"surfaces have {share:.2%} of the light that they would have under the open sky"
            warnings.warn(f"{word}: is the scene closed, or are normals inverted?", LuxelWarning, stacklevel=3)


def _shoot_all(lighting: Lighting, deadline: float | None, keep: tuple[Path, str] | None) -> bool:
    """Shoot to the end; returns whether it was reached. The checkpoint is written now and then, and whatever ends this between two steps."""
    saved = time.monotonic()
    try:
        for _ in lighting.steps():
            lighting.tell()
            if keep and time.monotonic() - saved > _SAVE_EVERY:
                _save(keep, lighting.state)
                saved = time.monotonic()
            if deadline is not None and lighting.labour.once(lambda: time.monotonic() > deadline):
                return False
    finally:
        if keep and lighting.state.whole:
            _save(keep, lighting.state)
    return True


def _save(keep: tuple[Path, str], state: State) -> None:
    """Keep the state; if it cannot be, that is said, and the light that is found so far is not lost for it."""
    try:
        saving.save(*keep, state)
    except FileError as error:
        warnings.warn(f"{error}: the bake goes on, and cannot be resumed from here", LuxelWarning, stacklevel=4)
