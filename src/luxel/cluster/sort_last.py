"""Sort-last: ranks share the triangles. Each draws its own over the screen, or over its group's part of it; visibility is composited, and the owner
of a triangle shades what is seen of it, with what one process would have: the same bits.

Steps of a band of tiles (`ObjectBand.draw`): visibility of the own triangles; `composite`; claims of samples to their owners (`claims`); outputs and
colours of what is claimed, back to the rank that has the tile; layers of blended triangles (`layers`); pixels. Molnar et al. (1994), deferred shading
after Molnar, Eyles, Poulton, "PixelFlow: high-speed rendering using image composition" (1992).
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np

from luxel.arrays import Array
from luxel.cluster import claims, layers
from luxel.cluster.comm import Comm
from luxel.cluster.composite import clear, composite, merge, pack, regions
from luxel.cluster.plan import Plan, tile_costs
from luxel.cluster.sort_first import Box, boxes, glue
from luxel.memory import reusable
from luxel.raster.bin import BLEND
from luxel.raster.chunks import EVERYWHERE, Reach
from luxel.raster.constants import NOTHING
from luxel.raster.frame import NO_COLOR, NO_LINEAR, NO_SAMPLES, Band
from luxel.raster.lanes import LANES
from luxel.raster.runs import Samples
from luxel.raster.shade import Target, Tiles, shade


class Division(NamedTuple):
    """Who shares what.

    Attributes:
        world: All ranks; rank 0 gets the picture.
        group: Those that share this rank's part of the screen; each has other triangles.
        number: Of the group.
        hands: (groups,) int64: how many ranks each group has.
        offsets: (ranks of the group + 1,) int64: rank r has the triangles offsets[r] .. offsets[r + 1] - 1 of the scene.
        composition: One of `composite.COMPOSITIONS`.
    """

    world: Comm
    group: Comm
    number: int
    hands: Array
    offsets: Array
    composition: str

    @property
    def groups(self) -> int:
        """How many there are."""
        return len(self.hands)


class ObjectBand(Band):
    """A window of which each group of ranks draws a run of tiles, each rank with its own triangles."""

    def __init__(self, division: Division, plan: Plan, clocked: dict[str, float], *rest: Any) -> None:
        self.division, self.plan, self.clocked = division, plan, clocked
        self.mine, self.whole = list[Box](), list[Box]()  # rectangles that this rank has: of outputs and, unless a filter reaches farther, colours
        self.numbers = np.empty(0, np.int32)  # what the scene's share calls the triangles that are drawn; none: as they are
        super().__init__(*rest)
        modes = set().union(*division.world.gather(set(self.bins)))
        self.blended, self.keep_depth = BLEND in modes, True
        self.per_sample = self.colored and (self.apron > 0 or self.blended or self.hardware is not None)
        self.offset = int(division.offsets[division.group.rank])
        self.every = self.options.ssaa > 1 or self.hardware is not None  # each sample has a colour of its own

    def _choose(self) -> tuple[int, int]:
        o, division = self.options, self.division
        cuts = self.plan.cuts(
            lambda: tile_costs(self.seen.geometry, self.seen.view, self.window, o.tile, len(o.positions), division.world, True),
            self.window, self.across * self.down, division.hands, self.seen.view.clip_from_world,
        )  # fmt: skip
        self.began = time.perf_counter()
        return int(cuts[division.number]), int(cuts[division.number + 1])

    def _reach(self, bounds: Box) -> Reach:
        return self.plan.reach(self.seen.geometry, self.seen.view, self.window, bounds) if self.division.groups > 1 else EVERYWHERE

    def _tile_bytes(self) -> int:  # the same on all ranks, whatever materials they have
        return 4 * self.pixels * (4 + 8 * self.colored)

    def run(self, progress: Any = None) -> None:
        """Draw this group's tiles, and bring them together."""
        if self.division.world.rank == 0 and self.colored and not self.apron:  # else `_finish` writes every pixel
            self._background()
        super().run(progress)
        drawn, world = time.perf_counter(), self.division.world
        given = world.gather((self.whole if self.apron else self.mine, self.mine))
        for arrays, boxes_of in ((self.target[:2], [both[0] for both in given]), (self.outputs, [both[1] for both in given])):
            glue((array for array in arrays if array.size), boxes_of, world)
        glued = time.perf_counter()
        for name, seconds in (("busy", drawn - self.began), ("glue", glued - drawn)):
            self.clocked[name] = self.clocked.get(name, 0.0) + seconds

    def _background(self) -> None:
        """Fill the window, as `shade` fills tiles in which nothing is."""
        w, tiles = self.window, self.across * self.down
        nowhere, nothing = np.zeros(tiles, np.uint8), np.empty((tiles, 1), np.int32)
        place, samples = Tiles(0, tiles, self.across, self.options.tile, w.width, w.height, *self.place), Samples(self.options.positions, self.every)
        shade(place, nowhere, nothing, samples, self.drawn, self.look, self.target, self.options.threads or 1)

    def draw(self, first_row: int, last_row: int) -> None:
        """Draw what is chosen of the tile rows first_row .. last_row - 1."""
        across, o, w, group = self.across, self.options, self.window, self.division.group
        top, bottom = max(0, first_row - self.apron), min(self.down, last_row + self.apron)
        reach = self.apron * (across + 1)
        first, last = max(top * across, self.chosen[0] - reach), min(bottom * across, self.chosen[1] + reach)
        grid = claims.Grid(first, across, o.tile, w.width, w.height, *self.place, len(o.positions))
        drawn_ids, depths = self._visible(first, last)
        own = self.occupied[first:last]
        self.clock.lap("cover")
        blended = self._blended(first, last)
        slots = np.flatnonzero(group.summed(own.astype(np.int64) + (blended if blended is not None else 0)))
        ids = reusable(drawn_ids.shape, np.int32)
        claims.to_global(slots, grid, own, drawn_ids, self.clipped.source, self._count(), self.numbers, self.offset, ids)
        clear(slots[own[slots] == 0], ids, depths)
        sent, start = group.sent, time.perf_counter()
        self._add("merged", composite(slots, self.pixels, ids, depths, group, self.division.composition))
        self._add("composed", group.sent - sent)
        self._add("composing", time.perf_counter() - start)
        tiles = regions(slots, group.size, self.division.composition)
        mine = tiles[group.rank]
        self.clock.lap("composite")

        kept = reusable(drawn_ids.shape, np.int32)
        kept[own > 0] = NOTHING
        asked = claims.claims(mine, self.pixels, ids, self.division.offsets)
        claimed = group.exchange(asked)
        claims.keep(claimed, drawn_ids, kept)
        self.clock.lap("claim")
        if self.beside:
            self._share_outputs(first, last, grid, kept, depths, asked, claimed)
            self.clock.lap("outputs")
        if self.colored:
            rows = NO_SAMPLES  # the colours of samples, of whole rows of tiles
            if self.per_sample:
                rows = reusable(((bottom - top) * across, 4 * self.pixels), np.float32)
            colors = rows[first - top * across : last - top * across]
            self._colors(first, last, grid, kept, mine, ids, claimed, colors)
            if blended is not None:
                self._share_layers(first, last, tiles, blended, ids, depths, colors)
                self.clock.lap("blend")
            if self.per_sample:
                self._finish(first, first_row, last_row, top, bottom, tiles, rows)
                self.clock.lap("resolve")
        self.mine += self._boxes(first, mine)

    def _count(self) -> int:
        return len(self.seen.geometry.triangles)

    def _add(self, name: str, number: float) -> None:
        self.clocked[name] = self.clocked.get(name, 0.0) + number

    def _boxes(self, first: int, slots: Array) -> list[Box]:
        """The pixels of tiles, as rectangles of the picture."""
        x, y = self.place
        out = []
        for run in np.split(slots, np.flatnonzero(np.diff(slots) != 1) + 1):
            if len(run):
                begin, end = max(first + int(run[0]), self.chosen[0]), min(first + int(run[-1]) + 1, self.chosen[1])
                out += boxes(begin, end, self.across, self.options.tile, self.keep)
        return [(x + x0, y + y0, x + x1, y + y1) for x0, y0, x1, y1 in out]

    def _share_outputs(self, first: int, last: int, grid: claims.Grid, kept: Array, depths: Array, asked: list[Array], claimed: list[Array]) -> None:
        """Outputs of what is claimed, written here, go to the ranks that have the pixels."""
        self._outputs(first, last, kept, depths)
        sources, places = [claims.first_samples(runs, grid) for runs in claimed], [claims.first_samples(runs, grid) for runs in asked]
        for name, array in self.outputs._asdict().items():
            if array.size:
                values = [array[at] for at in sources]
                if name == "triangle":
                    values = [(self.numbers[part] if len(self.numbers) else part) + np.int32(self.offset) for part in values]
                got = self.division.group.exchange(values)
                for at, part in zip(places, got, strict=True):
                    array[at] = part

    def _colors(self, first: int, last: int, grid: claims.Grid, kept: Array, mine: Array, ids: Array, claimed: list[Array], colors: Array) -> None:
        """Shade what is claimed; the colours that come back become pixels, or fill `colors`, sample by sample, if it has rows."""
        count, occupied = last - first, np.zeros_like(self.occupied)
        for runs in claimed:
            occupied[first + runs[::3]] = 1
        shaded = reusable((count, 4 * self.pixels), np.float32)
        shaded[occupied[first:last] > 0] = 0.0
        self._shade(first, last, kept, Target(NO_COLOR, NO_LINEAR, shaded), occupied)
        self.clock.lap("shade")
        masks, found = claims.returned(claimed, grid, self.every, kept, shaded, self.division.group)
        if len(colors):
            colors[mine] = 0.0
        claims.place(mine, grid, ids, self.division.offsets, masks, found, float(self.look.exposure), self.options.fill, self.target.color,
                     self.target.linear, colors)  # fmt: skip
        self.clock.lap("place")

    def _blended(self, first: int, last: int) -> Array | None:
        """(tiles,) int64: where this rank has blended triangles; None if no rank has any."""
        if not self.blended or not self.colored:
            return None
        if BLEND not in self.bins:
            return np.zeros(last - first, np.int64)
        return (np.diff(self.bins[BLEND].start)[first:last] > 0).astype(np.int64)

    def _share_layers(self, first: int, last: int, tiles: list[Array], blended: Array, ids: Array, depths: Array, colors: Array) -> None:
        """Peel and shade the own blended triangles, and composite what all ranks have of them over this rank's tiles."""
        group, slots = self.division.group, np.flatnonzero(blended)
        wanted, mine = group.gather(slots), tiles[group.rank]
        under = group.exchange([pack(np.intersect1d(mine, each), self.pixels, ids, depths) for each in wanted])
        found, drawn_ids = self._peel(first, last, slots, under)
        owner = np.zeros(last - first, np.int64)
        for rank, each in enumerate(tiles):
            owner[each] = rank
        at = owner[found[:, 0] // self.pixels]
        order = np.argsort(at, kind="stable")
        ends = np.cumsum(np.bincount(at, minlength=group.size))[:-1]
        got = group.exchange(np.split(found[order], ends))
        everything = np.concatenate(got)
        far_to_near, layer = layers.layered(everything)
        numbers = np.concatenate(group.exchange(np.split(layer, np.cumsum([len(part) for part in got])[:-1])))
        shaded = self._shade_layers(first, last, slots, found[order, 0], drawn_ids[order], numbers)
        layers.lay_over(far_to_near, self.pixels, everything[:, 0], np.concatenate(group.exchange(np.split(shaded, ends))), colors)

    def _peel(self, first: int, last: int, slots: Array, under: list[Array]) -> tuple[Array, Array]:
        """All layers of the own blended triangles that are nearer than what is opaque, `under` as `pack` made it: as `layers.collect` has them."""
        shape, none = (last - first, self.pixels + LANES), np.empty((0, layers.WORDS), np.int32)
        found, drawn_ids = [none], [none[:, 0]]
        if len(slots):
            ids, depths, peeled = reusable(shape, np.int32), reusable(shape, np.float32), reusable(shape, np.int32)
            clear(slots, ids, depths)
            for words in under:
                merge(words, ids, depths)
            whole, m = self.clipped, self._count()
            ids[slots] = layers.below(ids[slots], m, self.offset, len(whole.source))
            self.clipped = whole._replace(source=np.append(whole.source, np.int32(2**31 - 1)))  # what `below` says of ids after the own
            while self._layer(BLEND, first, last, ids, depths, peeled):
                words, drawn_here = layers.collect(slots, self.pixels, peeled, depths, whole.source, m, self.offset)
                found.append(words)
                drawn_ids.append(drawn_here)
            self.clipped = whole
        return np.concatenate(found), np.concatenate(drawn_ids)

    def _shade_layers(self, first: int, last: int, slots: Array, places: Array, drawn_ids: Array, numbers: Array) -> Array:
        """(n, 4) float32: premultiplied colours of triangles at samples, each in the layer with its number."""
        out = np.empty((len(places), 4), np.float32)
        shaded, peeled = reusable((last - first, 4 * self.pixels), np.float32), reusable((last - first, self.pixels + LANES), np.int32)
        occupied = np.zeros_like(self.occupied)
        occupied[first + slots] = 1
        for number in range(int(numbers.max(initial=-1)) + 1):
            chosen = numbers == number
            row, at = np.divmod(places[chosen], self.pixels)
            peeled[slots], shaded[slots] = NOTHING, 0.0
            peeled[row, at] = drawn_ids[chosen]
            self._shade(first, last, peeled, Target(NO_COLOR, NO_LINEAR, shaded), occupied, blend=True)
            for k in range(4):
                out[chosen, k] = shaded[row, k * self.pixels + at]
        return out

    def _finish(self, first: int, first_row: int, last_row: int, top: int, bottom: int, tiles: list[Array], rows: Array) -> None:
        """From samples to pixels: of the own tiles; or all on the group's first rank, where a filter reaches beyond tiles."""
        group, across, shift = self.division.group, self.across, first - top * self.across
        if not self.apron:
            for x0, y0, x1, y1 in self._boxes(first, tiles[group.rank]):
                x, y = self.place
                self._resolve_part(y0 - y, y1 - y, x0 - x, x1 - x, top, bottom, rows)
            return
        parts = group.exchange([rows[shift + tiles[group.rank]] if rank == 0 else rows[:0] for rank in range(group.size)])
        if group.rank == 0:
            rows.fill(0.0)
            for slots, part in zip(tiles, parts, strict=True):
                rows[shift + slots] = part
            self._resolve(first_row, last_row, top, bottom, rows)
            begin, end = max(first_row * across, self.chosen[0]), min(last_row * across, self.chosen[1])
            self.whole += self._boxes(0, np.arange(begin, end))
