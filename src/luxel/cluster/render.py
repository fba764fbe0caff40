"""Render with many ranks: the same bytes as one process gives.

    from luxel.cluster.comm import world
    from luxel.cluster.render import Renderer
    comm = world()
    with comm.guard():
        renderer = Renderer("model.ply", comm, divide="screen")
        picture = renderer.render(size=(1920, 1080), samples=4)   # a Picture on rank 0, None elsewhere
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cluster.comm import Comm
from luxel.cluster.composite import COMPOSITIONS
from luxel.cluster.plan import BALANCES, Plan
from luxel.cluster.shares import offsets, sliced, with_all_attributes
from luxel.cluster.sort_first import ScreenBand
from luxel.cluster.sort_last import ObjectBand, Team
from luxel.errors import InputError
from luxel.io import load
from luxel.raster import frame
from luxel.raster.picture import Picture
from luxel.raster.render import Options, Prepared, checked_size, prepare, render_prepared
from luxel.scene.camera import Camera
from luxel.scene.scene import Scene

DIVISIONS = ("screen", "objects", "both")


def group_count(size: int) -> int:
    """How many groups share the screen when both are shared: about the root of the number of ranks."""
    return max(1, round(size**0.5))


class Renderer:
    """Draws one scene, again and again, with all ranks; each of them has one and makes the same calls.

    Args:
        scene: As of `luxel.render`; for "screen" every rank has all of it.
        comm: The ranks.
        divide: "screen": each rank draws a part of the screen; "objects": each has a part of the triangles; "both": groups of ranks share the screen,
            and the ranks of a group the triangles.
        composition: How visibility is composited, where triangles are shared: "direct", "swap" or "radix"; see `luxel.cluster.composite`.
        balance: How the screen is divided: "dynamic", by cost, or "static", in parts of equal size.
        shading, cull: As of `luxel.prepare`.

    Attributes:
        ranks: After a picture, of each rank: "busy", seconds of drawing; "glue", seconds of giving its pixels away, waiting included; "sent", bytes.

    Raises:
        InputError: As of `luxel.prepare`, or no such division or balance.
    """

    def __init__(self, scene: Any, comm: Comm, divide: str = "screen", composition: str = "swap", balance: str = "dynamic",
                 shading: str | None = None, cull: str = "material") -> None:  # fmt: skip
        for name, value, known in (("divide", divide, DIVISIONS), ("composition", composition, COMPOSITIONS), ("balance", balance, BALANCES)):
            if value not in known:
                raise InputError(f"{name}: expected one of {', '.join(known)}; got {value!r}")
        self.comm, self.divide, self.plan = comm, divide, Plan(balance)
        self.ranks: list[dict[str, float]] = []
        self.team: Team | None = None
        if divide != "screen":
            scene = self._share(scene, composition)
        self.prepared = scene if isinstance(scene, Prepared) else prepare(scene, shading, cull)

    def _share(self, scene: Any, composition: str) -> Scene:
        """This rank's part of the scene."""
        comm = self.comm
        groups = 1 if self.divide == "objects" else group_count(comm.size)
        number = comm.rank * groups // comm.size
        group = comm.part(number)
        whole = load(scene)
        share = sliced(whole, *group.share_out(whole.triangle_count)[group.rank])
        with_all_attributes(share, comm)
        self.team = Team(comm, group, number, groups, offsets(share, group), composition)
        return share

    def render(self, camera: Camera | None = None, size: tuple[int, int] = (1280, 720), *, previous_camera: Camera | None = None,
               progress: Callable[[float], None] | None = None, **options: Any) -> Picture | None:  # fmt: skip
        """Draw a picture: arguments as of `luxel.render`, `threads` of each rank (None: its share of the machine's cores).

        Returns:
            The picture on rank 0; None elsewhere.
        """
        comm, started = self.comm, time.perf_counter()
        chosen = Options(**{**options, "threads": comm.threads(options.get("threads"))})
        clocked: dict[str, float] = {"sent": -comm.sent}
        draw = partial(self._draw, clocked)
        picture = render_prepared(self.prepared, camera, checked_size(size), chosen, previous_camera, progress, draw)
        clocked["sent"] += comm.sent
        self.ranks = comm.gather(clocked)
        self.plan.learn(self._busy())
        picture.seconds = {"prepare": time.perf_counter() - started - sum(picture.seconds.values()), **picture.seconds}
        return None if comm.rank else picture

    def _busy(self) -> Array:
        """(groups,) float64: seconds of drawing of each group that shares the screen, that of its slowest rank."""
        busy = np.array([each.get("busy", 0.0) for each in self.ranks])
        if self.team is None:
            return busy
        return np.array([part.max() for part in np.split(busy, np.flatnonzero(np.diff(np.arange(len(busy)) * self.team.groups // len(busy))) + 1)])

    def _draw(self, clocked: dict[str, float], prepared: Prepared, camera: Camera | None, size: tuple[int, int], options: Options,
              previous: Camera | None, progress: Callable[[float], None] | None) -> Picture:  # fmt: skip
        band: Callable[..., frame.Band] = partial(ScreenBand, self.comm, self.plan, clocked)
        if self.team is not None:
            band = partial(ObjectBand, self.team, self.plan, clocked)
        picture = frame.draw(prepared, camera, size, options, previous, progress, band=band)
        return Picture(seconds=picture.seconds) if self.comm.rank else picture
