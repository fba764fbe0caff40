"""Labour: the heavy work of a bake, and who does it.

Everything heavy asks the same of many items that need nothing of each other: rays from every element (or luxel, before there are elements), what each
receives from a row of shooters, what each shooter sees. So items are dealt out. What is small (received and unshot light, patches, the ledger)
everybody has, and everybody comes by the same sums in the same order to the same decisions; so the same bytes come out, whoever did what:

    mine = labour.mine(n)                          # which of n items are this process's
    whole = labour.join(kernel(values[mine]), n)   # what everybody has found, everywhere

A `Team` says which items are whose: here one process, all of them; with ranks of MPI each its own (`luxel.cluster.team`). A `Labour` is what works on
this process's items: here threads of the processor. Another, as a GPU's, overrides the steps that end in "(k, ...) of this process's elements",
and may keep what only they use (`Sight.hits`, the rows) where it likes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from luxel.arrays import Array
from luxel.radiosity import gather
from luxel.radiosity.closer import gather_closer
from luxel.radiosity.direct import shine
from luxel.radiosity.gather import Sight, Spots, View
from luxel.radiosity.hemicube import ItemBuffers, room_for, see_into
from luxel.radiosity.patches import Tree
from luxel.radiosity.sky import Even, shine_sky
from luxel.radiosity.transport import BLOCK, Elements, Occluders, Shooters, Visibility, escapes, fill_rows, receive

if TYPE_CHECKING:
    from luxel.radiosity.effort import Rays
    from luxel.radiosity.solve import Problem, State

T = TypeVar("T")


class Drawn(NamedTuple):
    """What s shooters see, and `escaped` (s, 2) float64: what of their light nobody receives (`transport.escapes`)."""

    seen: ItemBuffers
    escaped: Array


class Team:
    """Who there is: one process alone.

    Attributes:
        leads: This process speaks and writes.
        size: Number of processes.
        here: How many of them share this machine's memory.
    """

    leads, size, here = True, 1, 1

    def mine(self, n: int, grain: int = BLOCK) -> Any:
        """Which of n items are this process's, in order, as an index: groups of `grain` that follow each other stay together."""
        return slice(None)

    def join(self, part: Array, n: int, grain: int = BLOCK) -> Array:
        """(..., n), the same everywhere: of everybody's part (..., k), of the items of `mine`."""
        return part

    def collect(self, part: Array, n: int, grain: int = BLOCK) -> Array | None:
        """(n, ...) where the process leads, None elsewhere: of everybody's part (k, ...)."""
        return part

    def once(self, work: Callable[[], T]) -> T:
        """What `work` gives where the process leads, everywhere."""
        return work()

    def drawn(self, seen: ItemBuffers, draw: Callable[[int, int], Array]) -> Array:
        """Have in `seen`, everywhere, what s shooters see, of which `draw(first, last)` draws some; returns what it tells of each, (s, 2) float64."""
        return draw(0, len(seen.resolution))


class Labour:
    """Work on this process's items by threads of the processor.

    Args:
        threads: How many.
        team: Whose items are whose.
    """

    def __init__(self, threads: int, team: Team | None = None) -> None:
        self.threads, self.team = threads, team or Team()
        self.mine, self.join, self.once = self.team.mine, self.team.join, self.team.once

    def each(self, n: int, work: Callable[[Any], Array]) -> Array:
        """(..., n), the same everywhere: of `work(which)`, (..., k) for an index of k of n items."""
        return self.join(work(self.mine(n)), n)

    def fitting(self, problem: Problem, view: View, rays: Rays, rows: tuple[int, int, int]) -> Labour:
        """Who does it, if it has to fit in memory: the rays of each element, and rows that are kept of patches, of lights and of spots."""
        return self

    def state(self, problem: Problem, state: State) -> State:
        """The state of a solve, kept where this works on it."""
        return state

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """An array for what only this works on."""
        return np.empty(shape, dtype)

    def fetch(self, kept: Any) -> Array:
        """Such an array, or `Sight.hits`, as NumPy's."""
        return np.asarray(kept)

    def see(self, occluders: Occluders, who: Shooters, resolution: int, near: float) -> Drawn:
        """What shooters see; `resolution` and `near` as in `hemicube.see`."""
        seen = room_for(np.full(len(who.node), resolution, np.int64), near)

        def draw(first: int, last: int) -> Array:
            some, centers = seen.part(first, last), who.centers[first:last]
            see_into(some, occluders.positions, occluders.triangles, centers, who.frames[first:last], self.threads)
            return escapes(centers, some, occluders, self.threads)

        return Drawn(seen, self.team.drawn(seen, draw))

    def fill_rows(self, elements: Elements, tree: Tree, source: Array, who: Shooters, seen: ItemBuffers, occluders: Occluders, rays: Visibility,
                  slots: Array, rows: Array) -> Array:  # fmt: skip
        """`transport.fill_rows`; rows (slots, k) of this process's elements."""
        return fill_rows(elements, tree, source, who, seen, occluders, rays, slots, rows, self.threads)

    def receive(self, rows: Array, touched: Array, slots: Array, powers: Array) -> Array:
        """(3, k) float32: what shooters give by `transport.receive` to this process's elements."""
        received = np.zeros((3, rows.shape[1]), np.float32)
        receive(rows, touched, slots, powers, received, self.threads)
        return received

    def shine(self, view: View, table: Array) -> Array:
        """(3, k) float32, W/m2: what lights of a `direct.light_table` give to this process's elements, those of `view`."""
        return shine(view.scene, view.numbers, table, view.reach, self.threads)

    def sky(self, view: View, sight: Sight, sky: Even) -> Array:
        """(3, k) float32, W/m2: what a sky gives to this process's elements."""
        return shine_sky(view, sight.hits, sky, self.threads)

    def look(self, view: View, rays: int, told: Callable[[float], None]) -> Sight:
        """What this process's elements see by so many rays; `told` hears which share of them has looked."""
        return gather.see_around(view, rays, self.threads, told)

    def bounce(self, sight: Sight, light: Array) -> Array:
        """(3, k) float32, W/m2: what this process's elements receive of the radiosity of all, `light` (n, 3) float32, through what they see."""
        return self.shared(sight.spots, light, lambda rest: gather.gather(sight.hits, gather.padded(rest), self.threads))

    def shared(self, spots: Spots | None, light: Array, gathered: Callable[[Array], Array]) -> Array:
        """(3, k) float32, W/m2: what this process's elements receive of `light` (n, 3): of spots by rows, and what of the rest is `gathered`."""
        if spots is None:
            return gathered(light)
        rest, powers = spots.apart(light)
        return gathered(rest) + self.fetch(self.receive(spots.rows, spots.touched, np.arange(len(powers)), powers))

    def brightness_around(self, sight: Sight, own: Elements, elements: Elements, irradiance: Array) -> Array:
        """(k,) float64 W/m2: how bright it is where this process's elements are seen, by the irradiance (n,) of all (`gather.lit_around`)."""
        return gather.brightness_around(sight.hits, own.numbers, elements.numbers, irradiance, self.threads)

    def look_closer(self, view: View, sight: Sight, light: Array, unlike: float, told: Callable[[float], None]) -> Array:
        """(3, k) float32: the same, with more rays where what they bring is unlike (`closer`)."""
        return gather_closer(view, sight.hits, light, unlike, self.threads, told)

    def gather(self, view: View, light: Array, rays: int, sky: Even | None, told: Callable[[float], None]) -> tuple[Array, Array | None]:
        """(3, k) float32 each: the mean over what other rays meet, so many of each element, of which nothing is kept; and what these see of a sky."""
        result, known = np.empty((2, 3, view.numbers.shape[1]), np.float32), gather.padded(light)
        for some, hits in view.look_anew(rays, self.threads):
            result[0, :, some] = gather.gather(hits, known, self.threads)
            if sky is not None:
                result[1, :, some] = shine_sky(view.part(some), hits, sky, self.threads)
            told(some.stop / result.shape[2])
        return result[0], None if sky is None else result[1]
