"""Lighting: a scene that is ready (`prepare`), while it is being lit.

    direct light of what has no surface -> lights shoot -> elements pass light on until little is unshot -> they gather once more, finely
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from luxel.arrays import Array
from luxel.radiosity import checkpoint as saving
from luxel.radiosity import lightmap
from luxel.radiosity.effort import Rays
from luxel.radiosity.gather import Sight, View
from luxel.radiosity.labour import Labour
from luxel.radiosity.lamps import Lamps
from luxel.radiosity.luxels import part_of
from luxel.radiosity.prepare import Prepared
from luxel.radiosity.quality import Quality
from luxel.radiosity.relight import Transport, transport_of
from luxel.radiosity.solve import Rows, Source, State, ambient, complete, element_steps, light_steps, note_end, patch_steps, settled, start
from luxel.radiosity.spots import find_spots
from luxel.scene.scene import Scene

_LAYER = 1e-5
"""By how much the light of one lamp may change, of itself, in the last pass."""


@dataclass
class Progress:
    """What a bake in progress can tell: unshot share of the light, shots so far, and the picture so far.

    Attributes:
        looked: Share of the elements that have looked around for themselves, while they do.
    """

    prepared: Prepared
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
        values = p.per_luxel(self.state.received + ambient(p.cut.problem, self.state)[:, None])
        return lightmap.attach(p.atlas, lightmap.finish(p.atlas, p.luxels, values, p.valid)[0])


@dataclass
class Lighting:
    """A scene, how well it is to be lit and by whom, and its light so far.

    Attributes:
        prepared, lamps: What is lit, and by what that has no surface.
        settings, labour: How well, and by whom.
        rays: By which elements look around.
        rows: Rows of transport that are kept: of patches, of lights and of spots, at most.
        told: Hears the unshot share, and a `Progress`; or None.
        state: Of the solve; whoever reads one from a file, or keeps it elsewhere, puts it here.
    """

    prepared: Prepared
    lamps: Lamps
    settings: Quality
    rays: Rays
    rows: tuple[int, int, int]
    labour: Labour
    told: Callable[[float, Progress], None] | None

    def __post_init__(self) -> None:
        self.state = start(self.prepared.cut.problem)

    def tell(self, looked: float = 0.0) -> None:
        """Tell how far it is; `looked`: share of the elements that have looked around, while they do."""
        if self.told:
            progress = Progress(self.prepared, self.state, looked)
            self.told(progress.unshot, progress)

    @cached_property
    def view(self) -> View:
        """Where elements look; if all of them look anew in the end, groups of neighbours have directions of their own before."""
        return self.prepared.view._replace(turned=self.rays.gathered > 0)

    @cached_property
    def sight(self) -> Sight:
        """What elements see by their rays. They look when that is first asked for."""
        own = self.labour.look(self.view, self.rays.kept, self.tell)
        away, blind = (self.labour.join(part, self._elements) for part in (own.away, own.blind))
        return own._replace(away=away, blind=blind)

    @cached_property
    def spotted(self) -> Sight:
        """The same with the spots among what they see, by the light of the lights: to be asked for once these have shot."""
        return self.sight._replace(spots=find_spots(self.prepared.cut.problem, self.sight, self.state.direct, self.settings, self.labour))

    @cached_property
    def light_rows(self) -> Rows:
        """Rows of the lights."""
        return self._room(self.prepared.cut.problem.lights, self.rows[1])

    @cached_property
    def still(self) -> Array:
        """(3, n) float32 W/m2: what elements receive of what has no surface."""
        return self._shine(slice(None), True)

    @cached_property
    def sky(self) -> Array:
        """(3, n) float32 W/m2: what they receive of the sky, which there must be."""
        assert self.lamps.sky is not None
        return self.labour.join(self.labour.sky(self.view, self.sight, self.lamps.sky), self._elements)

    @cached_property
    def direct(self) -> Array:
        """(3, n) float32 W/m2: what they receive of all lights, once these have shot."""
        return self.state.direct

    @property
    def _elements(self) -> int:
        return self.prepared.cut.problem.elements.numbers.shape[1]

    def _room(self, source: Source | None, kept: int) -> Rows:
        """Where so many rows of a source are kept."""
        problem = self.prepared.cut.problem
        return Rows(0 if source is None else len(source.tree.patches), problem.own.numbers.shape[1], kept, self.labour.empty)

    def _shine(self, rows: slice, sky: bool) -> Array:
        """(3, n) float32 W/m2: what elements receive of some of the lamps without a surface, and of the sky if there is one."""
        received = self.labour.join(self.labour.shine(self.view, self.lamps.table[rows]), self._elements)
        return received + self.sky if sky and self.lamps.sky is not None else received

    def begin(self) -> None:
        """The state before the first shot."""
        self.state = start(self.prepared.cut.problem, self.still, self.labour.threads)

    def steps(self) -> Iterator[State]:
        """Shoot to the end; the state after each batch."""
        problem, state, tolerance = self.prepared.cut.problem, self.state, self.settings.tolerance
        yield from light_steps(problem, state, self.light_rows, self.labour)
        if self.settings.seen:
            yield from element_steps(problem, state, lambda: self.spotted, tolerance, self.labour)
        else:
            yield from patch_steps(problem, state, self._room(problem.patches, self.rows[0]), tolerance, self.labour)
        yield from note_end(problem, state)

    def so_far(self) -> Array:
        """(3, n) float32 W/m2: the irradiance of a bake that is cut short; what is unshot is spread evenly."""
        return self.state.received + ambient(self.prepared.cut.problem, self.state)[:, None].astype(np.float32)

    def settled(self) -> Array:
        """(3, n) float32 W/m2: the irradiance in the end, but for a last bounce."""
        return settled(self.prepared.cut.problem, self.state, self.settings.seen > 0)

    @property
    def bounces_once_more(self) -> bool:
        """Whether the quality asks for a last bounce."""
        return bool(self.rays.gathered or (self.settings.seen and self.settings.unlike < math.inf))

    def last_bounce(self, irradiance: Array) -> Array:
        """(3, n) float32 W/m2: the direct light, and what elements receive once more of the `irradiance` of all, looking as well as is asked for."""
        light = (self.prepared.cut.problem.albedo * irradiance).T.copy()
        bounce = self.labour.join(self.labour.shared(self.spotted.spots, light, self._gather), self._elements)
        return self.direct + bounce

    def _gather(self, light: Array) -> Array:
        """(3, k) float32 W/m2: what this process's elements receive of `light` (n, 3); by many rays the sky is seen better, too."""
        labour = self.labour
        if not self.rays.gathered:
            return labour.look_closer(self.view, self.spotted, light, self.settings.unlike, self.tell)
        bounce, sky = labour.gather(self.prepared.view, light, self.rays.gathered, self.lamps.sky, self.tell)
        if sky is not None:
            finer = labour.join(sky, self._elements) - self.sky
            self.direct, self.still, self.sky = self.direct + finer, self.still + finer, self.sky + finer
        return bounce

    def valid(self) -> Array:
        """(n,) bool: luxels that are not inside solids. Who is not lit and sees hardly anything, now that it has looked, is in one, too."""
        valid, blind = self.prepared.valid.copy(), self.sight.blind if self.settings.seen else None
        if blind is not None:
            cut = self.prepared.cut
            valid[cut.luxel[blind & ~cut.back & ~self.direct.any(0)]] = False
        return valid

    def transport(self) -> Transport | None:
        """What lights the scene anew, with the rows of all lights; None on processes that do not lead."""
        problem = self.prepared.cut.problem
        if problem.lights is not None:
            complete(problem, problem.lights, self.light_rows, self.labour)
        return transport_of(self.prepared.cut, self.light_rows, self.spotted, self.still, self.prepared.luxels, self.labour)

    def layers(self, kept: Transport | None, whole: Array) -> dict[str, Array]:
        """(n, 3) float32 irradiance by lamp: objects with emissive surfaces, lights of the scene, the sky; none where there is no transport.

        For the whole, (n, 3), luxels have looked closer in the last bounce than what is kept tells: each lamp has the share of it that is its own
        by that.
        """
        scene, luxels, geometry = self.prepared.atlas.scene, self.prepared.luxels, self.prepared.geometry
        layers: dict[str, Array] = {}

        def add(name: str, still: Array, emission: Array) -> None:
            if kept is None:
                return
            unique, k = name, 2
            while unique in layers:
                unique, k = f"{name} {k}", k + 1
            layers[unique] = kept.spread(still, emission, kept.albedo, _LAYER, self.labour.threads)

        nothing, dark = np.zeros((3, self._elements), np.float32), np.zeros_like(luxels.emission)
        drawn = [i for i in scene.instances if len(scene.meshes[i.mesh].triangles)]
        objects = geometry.part_object[part_of(geometry, luxels.triangle)]
        for number in np.unique(objects[luxels.emission.sum(1) > 0]):
            name = next((i.name for i in drawn if i.object == number and i.name), f"object {number}")
            add(name, nothing.copy(), np.where((objects == number)[:, None], luxels.emission, dark))
        for row, light in enumerate(scene.lights):
            add(light.name or f"light {row}", self._shine(slice(row, row + 1), False), dark)
        if self.lamps.sky is not None:
            add("sky", self._shine(slice(self.lamps.own, None), True), dark)
        sums = np.sum([np.zeros(whole.shape), *layers.values()], 0)
        share = np.divide(whole, sums, out=np.ones_like(sums), where=sums > 0)
        return {name: (layer * share).astype(np.float32) for name, layer in layers.items()}
