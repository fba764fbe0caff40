"""Diagnosis: whether lightmap coordinates serve, and what a bake with them will take. Cheap enough to look at before every bake."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.errors import InputError
from luxel.memory import free_bytes
from luxel.radiosity.luxels import two_sided_triangles
from luxel.radiosity.overlap import overlap
from luxel.radiosity.pages import draw_page, triangle_pages
from luxel.radiosity.pieces import areas
from luxel.radiosity.texture_space import Texels, area2, place_vertices
from luxel.radiosity.transport import ROW_BYTES
from luxel.raster.constants import SUBPIXEL
from luxel.raster.geometry import Geometry, flatten

if TYPE_CHECKING:
    from luxel.radiosity.unwrap import Atlas

MOST_OVERLAP, MOST_SMALL, MOST_CONTESTED, MOST_SPREAD = 0.005, 0.02, 0.1, 8.0
"""Up to which coordinates serve: shares of samples covered twice (surfaces that lie in each other overlap in any chart), of surface in charts
too small or missing, and of texels with two charts; and the ratio of the most to the least density."""

MOST_GUTTER = 4
_SLACK = 1e-4  # beyond 0..1 by rounding
_BYTES_A_LUXEL, _BYTES_A_RAY, _BYTES_A_TRIANGLE, _BYTES_AT_LEAST = 1020, 4, 400, 150 << 20
_ROWS_A_SPOT = 1.2  # of the points that spots are to have
_RAYS = 128  # of a luxel in a bake of normal quality without a sky
_SECONDS_A_TRIANGLE, _SECONDS_AT_LEAST = 1e-5, 0.1  # to lay them out
_SECONDS_A_RAY = 1.1e-8  # for each doubling of the triangles, as all that follow
_OWN, _CLOSER, _SKY = 30, 36, 64  # as many rays take what each luxel, looking closer, and the sky's edges take
_GATHERED, _SKY_GATHERED = 0.45, 0.14  # and a ray that is not kept, and the sky's edges with it
_PAIR = 0.8  # as many rays takes one between a luxel and a light that it asks for
_SCATTER, _ALONE = 0.4, 2.0  # a triangle keeps neighbours from looking at the same, as so many luxels more; at most all luxels from all of theirs
_LOOSE = 8.0  # and each side of a piece smaller than a texel from so many, where all are such: neighbours face all ways, and look closer everywhere
_WORK = float(_OWN + _RAYS + _CLOSER)  # of a bake of normal quality without a sky
_ROW = 1.6e-4, 9e-9, 1.2e-9  # seconds to draw what a patch sees and find who gets how much: at least, for each luxel, and for each triangle
_SHOT = 5e-10  # and for each luxel, to give it that
_FLAT, _BENT = 0.7, 0.25  # of the area that patches may have, they have this where all is flat; and as many of luxels, or of triangles, end one
_SHOTS = 4.0 / math.log(1e3)  # of a patch, for each e-th part of the light that is left


class Density(NamedTuple):
    """Texels per metre over the surface: least (all but 1 % have more), median, most (1 % have more)."""

    least: float
    median: float
    most: float


class Shooting(NamedTuple):
    """What shoots its light to all luxels.

    Attributes:
        lights: Points of lights.
        rays: Luxels ask by so many what of a light they see, if patches do not shoot.
        patch: Luxels along the side of a patch that shoots, where the surface is flat; 0: only lights shoot, else both do by hemicubes.
        tolerance: The unshot share of the light at which patches stop.
        kept: Bytes that rows of transport of patches may take; the others are drawn anew each time.
    """

    lights: int
    rays: int
    patch: float
    tolerance: float
    kept: int

    def seconds(self, luxels: int, triangles: int) -> float:
        """About how long it takes, on two cores."""
        if not self.patch:
            return self.lights * self.rays * luxels * float(np.log2(triangles + 2.0)) * _PAIR * _SECONDS_A_RAY
        patches = luxels / (_FLAT * self.patch**2) + _BENT * min(luxels, triangles)
        shots = patches * max(1.0, _SHOTS * math.log(1 / self.tolerance))
        again = max(0.0, 1.0 - self.kept / max(2.0 * luxels * patches, 1.0))  # share of the patches whose rows are not kept
        rows = self.lights + patches + (shots - patches) * again
        least, each, drawn = _ROW
        return rows * (least + each * luxels + drawn * triangles) + (self.lights + shots) * luxels * _SHOT


class Diagnosis(NamedTuple):
    """What is to be said of a scene's lightmap coordinates.

    Attributes:
        triangles, charts, pages, size: Of the atlas.
        reused: The file's own TEXCOORD_1 serve.
        luxels: How many there will be (holes of alpha masks included).
        sides: The same, those of two-sided surfaces counted twice.
        used: Share of the pages' texels that are luxels.
        density: Texels per metre.
        overlap: Share of what is covered that is covered twice or more often.
        outside: Triangles that reach beyond the page.
        small: Charts with less than a texel of surface.
        small_share: Share of the surface in those, or in no chart at all.
        contested: Texels in which more than one chart lies.
        gutter: Least number of free texels between two charts, counted up to MOST_GUTTER.
        bytes, seconds: What a bake will take; see `estimate`.
        free: Bytes of memory that are free; None if that cannot be told.
    """

    triangles: int
    charts: int
    pages: int
    size: tuple[int, int]
    reused: bool
    luxels: int
    sides: int
    used: float
    density: Density
    overlap: float
    outside: int
    small: int
    small_share: float
    contested: int
    gutter: int
    bytes: int
    seconds: float
    free: int | None

    @property
    def serves(self) -> bool:
        """Whether the coordinates will do for a lightmap."""
        return not self.faults()

    def faults(self) -> list[str]:
        """What makes the coordinates unfit; empty if nothing does."""
        found = []
        if self.overlap > MOST_OVERLAP:
            found.append(f"charts overlap: {self.overlap:.2%} of what they cover is covered twice")
        if self.outside:
            found.append(f"{self.outside} triangles reach beyond 0..1")
        if self.small_share > MOST_SMALL:
            found.append(f"{self.small_share:.1%} of the surface is in no chart, or in charts smaller than a texel")
        if self.contested > MOST_CONTESTED * max(self.luxels, 1):
            found.append(f"{self.contested} texels are shared by charts")
        if self.reused and self.density.most > MOST_SPREAD * self.density.least:
            found.append(f"the density varies from {self.density.least:.3g} to {self.density.most:.3g} texels per metre")
        if not self.luxels:
            found.append("there is no surface")
        return found

    def text(self) -> str:
        """A few lines for people."""
        d, (width, height) = self.density, self.size
        pages = "page" if self.pages == 1 else "pages"
        lines = [
            f"triangles    {self.triangles:,}",
            f"charts       {self.charts:,}, {'the scene has them (TEXCOORD_1)' if self.reused else 'made anew'}",
            f"lightmap     {self.pages} {pages} of {width} x {height}, {self.used:.0%} used",
            f"luxels       {self.luxels:,}",
            f"density      {d.median:.4g} texels per metre ({d.least:.4g} to {d.most:.4g})",
            f"gutter       {self.gutter if self.gutter < MOST_GUTTER else f'{MOST_GUTTER} or more'} free texels between charts",
            f"overlap      {self.overlap:.2%}, {self.contested:,} texels with two charts",
            f"small charts {self.small:,} smaller than a texel, {self.small_share:.2%} of the surface",
            f"memory       about {self.bytes / 2**20:,.0f} MiB{'' if self.free is None else f' ({self.free / 2**20:,.0f} MiB are free)'}",
            f"time         roughly {_spell(self.seconds)} on two cores",
        ]
        return "\n".join(lines + [f"fault        {fault}" for fault in self.faults()])


def diagnose(atlas: Atlas, threads: int | None = None, rays: int = _RAYS, work: float = _WORK, shooting: Shooting | None = None,
             spots: int = 0, laid: float | None = None) -> Diagnosis:  # fmt: skip
    """Look at the lightmap coordinates of a scene, and tell what a bake takes: see `estimate`.

    Args:
        laid: Seconds that the coordinates have taken, if they have just been made: a bake makes them again.
    """
    threads = jit.checked_threads(threads)
    geometry = flatten(atlas.scene, "none")
    screen, surface = place_vertices(geometry.texcoords1, atlas.size, threads), areas(geometry.positions, geometry.triangles)
    page = triangle_pages(atlas, geometry)
    two_sided = two_sided_triangles(atlas.scene, geometry)
    small, share = _small(atlas, screen, geometry, surface)
    covered = twice = luxels = sides = loose = contested = 0
    gutter = MOST_GUTTER
    for number in range(atlas.pages):
        chosen = np.flatnonzero((page == number) & (surface > 0) & (atlas.chart >= 0)).astype(np.int32)
        faces, chart = geometry.triangles[chosen], atlas.chart[chosen]
        counted = overlap(faces, screen, atlas.size, threads)
        covered, twice = covered + counted[0], twice + counted[1]
        texels = draw_page(faces, screen, chart, surface[chosen], atlas.size, threads)
        luxels, contested = luxels + len(texels.place), contested + int(np.count_nonzero(texels.loser >= 0))
        faced = 1 + two_sided[chosen[texels.triangle]]
        sides, loose = sides + int(faced.sum()), loose + int(faced[small[chart[texels.triangle]]].sum())
        gutter = min(gutter, least_gutter(texels, chart, atlas.size))
    beyond = np.abs(geometry.texcoords1 - np.float32(0.5)).max(1, initial=0) > 0.5 + _SLACK
    outside = int(np.count_nonzero(beyond[geometry.triangles].any(1) & (surface > 0)))
    charts, triangles = int(atlas.chart.max(initial=-1)) + 1, len(geometry.triangles)
    memory, seconds = estimate(sides, triangles, rays, work, shooting, spots, loose)
    if laid is not None:
        seconds += laid - triangles * _SECONDS_A_TRIANGLE
    return Diagnosis(
        triangles, charts, atlas.pages, atlas.size, atlas.reused, luxels, sides, luxels / (atlas.pages * atlas.size[0] * atlas.size[1]),
        density_of(atlas, geometry, surface), twice / max(covered, 1), outside, int(np.count_nonzero(small)), share, contested, gutter, memory,
        seconds, free_bytes(),
    )  # fmt: skip


def work_of(rays: int, gathered: int, closer: bool, sky: bool) -> float:
    """What a luxel does in a bake, in rays by which it looks around: `rays`, those `gathered` once more, those closer, and those at a sky's edges."""
    return _OWN + rays + _GATHERED * gathered + _CLOSER * closer + (_SKY + _SKY_GATHERED * gathered) * sky


def estimate(luxels: int, triangles: int, rays: int = _RAYS, work: float = _WORK, shooting: Shooting | None = None,
             spots: int = 0, loose: int = 0) -> tuple[int, float]:  # fmt: skip
    """Bytes, and seconds on two cores, that a bake will take if each luxel keeps what so many rays meet, and does so much `work_of`.

    The time is rough, within a factor of two in rooms: what a ray costs depends on what it meets.

    Args:
        shooting: What shoots, but for lights that draw hemicubes for luxels that look around: those few are in `work`.
        spots: So many points shoot what spots send on, if there are any: their rows count, their time does not.
        loose: Of the luxels, those of pieces smaller than a texel.
    """
    memory = _BYTES_AT_LEAST + luxels * (_BYTES_A_LUXEL + _BYTES_A_RAY * rays) + triangles * _BYTES_A_TRIANGLE
    memory += int(_ROWS_A_SPOT * min(2 * spots * luxels, ROW_BYTES))
    alone = max(min(_SCATTER * triangles, _ALONE * luxels), _LOOSE * loose * loose / max(luxels, 1))
    looks = (luxels + alone) * np.log2(triangles + 2.0)
    shot = 0.0 if shooting is None else shooting.seconds(luxels, triangles)
    return int(memory), float(_SECONDS_AT_LEAST + triangles * _SECONDS_A_TRIANGLE + looks * work * _SECONDS_A_RAY + shot)


def check_memory(luxels: float, triangles: int, rays: int, spots: int, density: float | None = None, here: int = 1) -> None:
    """Refuse a bake of so many luxels that is not going to fit, before time is spent on it.

    Args:
        rays, spots: As for `estimate`.
        density: Texels per metre that give so many luxels, if known: then the message names one that fits.
        here: Processes on this machine that all take as much.

    Raises:
        InputError: The machine has less memory left than `estimate` says.
    """
    free, wanted = free_bytes(), estimate(int(luxels), triangles, rays, spots=spots)[0]
    if free is None or wanted <= free // here:
        return
    free //= here
    room = free - estimate(0, triangles, rays)[0]
    fits = f"a density of {np.floor(100 * density * np.sqrt(room / (wanted - free + room))) / 100:g}" if density and room > 0 else "a lower density"
    each = f" for each of {here} ranks" if here > 1 else ""
    raise InputError(f"bake: {luxels:,.0f} luxels would take about {wanted / 1e9:.1f} GB, and {free / 1e9:.1f} GB are free{each}: {fits} would do")


def density_of(atlas: Atlas, geometry: Geometry, surface: Array) -> Density:
    """Texels per metre: square roots of texels by square metre, of the triangles, weighted by their area."""
    u, v = (geometry.texcoords1[:, k].astype(np.float64)[geometry.triangles] * atlas.size[k] for k in (0, 1))
    texels = np.abs((u[:, 1] - u[:, 0]) * (v[:, 2] - v[:, 0]) - (v[:, 1] - v[:, 0]) * (u[:, 2] - u[:, 0])) / 2
    known = (surface > 0) & (texels > 0)
    if not known.any():
        return Density(0.0, 0.0, 0.0)
    linear = np.sqrt(texels[known] / surface[known])
    order = np.argsort(linear)
    share = np.cumsum(surface[known][order])
    return Density(*(float(linear[order[np.searchsorted(share, q * share[-1])]]) for q in (0.01, 0.5, 0.99)))


def least_gutter(texels: Texels, chart: Array, size: tuple[int, int]) -> int:
    """Least number of free texels, along rows, columns and diagonals, between two charts: 0 if they touch or share texels, MOST_GUTTER at most."""
    owner = chart[texels.triangle]
    if (texels.loser >= 0).any():
        return 0
    wide = size[0] + 2 * MOST_GUTTER  # a border, so that no step leaves the page
    page = np.full((size[1] + 2 * MOST_GUTTER) * wide, -1, np.int32)
    at = (texels.place // size[0] + MOST_GUTTER) * wide + texels.place % size[0] + MOST_GUTTER
    page[at] = owner
    for free in range(MOST_GUTTER):
        reach = range(-free - 1, free + 2)
        for down, right in [(free + 1, k) for k in reach] + [(k, free + 1) for k in reach]:  # the other steps are these, from the other chart
            met = page[at + down * wide + right]
            if ((met >= 0) & (met != owner)).any():
                return free
    return MOST_GUTTER


def _small(atlas: Atlas, screen: Array, geometry: Geometry, surface: Array) -> tuple[Array, float]:
    """(charts,) bool: those with less than a texel; and the share of the surface in them or in no chart."""
    count, known = int(atlas.chart.max(initial=-1)) + 1, atlas.chart >= 0
    texels = np.bincount(atlas.chart[known], np.abs(area2(screen, geometry.triangles[known])) / (2 * SUBPIXEL**2), count)
    own = np.bincount(atlas.chart[known], surface[known], count)
    small = (texels < 1 - _SLACK) & (own > 0)
    return small, float((own[small].sum() + surface[~known].sum()) / max(surface.sum(), 1e-300))


def _spell(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.1f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
