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
from luxel.cluster.shares import Shared, share_scene
from luxel.cluster.sort_first import ScreenBand
from luxel.cluster.sort_last import ObjectBand
from luxel.cluster.streamed import StreamedBand
from luxel.errors import InputError
from luxel.raster import frame
from luxel.raster.picture import Picture
from luxel.raster.render import Options, Prepared, checked_size, prepare, render_prepared
from luxel.scene.camera import Camera
from luxel.scene.framing import camera_for

DIVISIONS = ("screen", "objects", "both")


class Renderer:
    """Draws one scene, again and again, with all ranks; each of them has one and makes the same calls.

    Args:
        scene: What `luxel.load` takes, or what `luxel.cluster.shares.share_scene` made of it.
        comm: The ranks.
        divide: "screen": each rank draws a part of the screen; "objects": each has a part of the triangles; "both": groups of ranks share the screen,
            and the ranks of a group the triangles.
        composition: How visibility is composited, where triangles are shared: "direct", "swap" or "radix"; see `luxel.cluster.composite`.
        balance: How the screen is divided: "dynamic", by cost, or "static", in parts of equal size.
        shading, cull: As of `luxel.prepare`.

    Attributes:
        ranks: After a picture, of each rank: "busy", seconds of drawing; "glue", seconds of giving its pixels away, waiting included; "sent", bytes;
            and where triangles are shared "merged", samples, "composed", bytes, and "composing", seconds of composition.

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
        self.shared = scene if isinstance(scene, Shared) else share_scene(scene, comm, divide, composition)
        self.prepared, self._looks = prepare(self.shared.scene, shading, cull), (shading, cull)

    def render(self, camera: Camera | None = None, size: tuple[int, int] = (1280, 720), *, previous_camera: Camera | None = None,
               progress: Callable[[float], None] | None = None, **options: Any) -> Picture | None:  # fmt: skip
        """Draw a picture: arguments as of `luxel.render`, `threads` of each rank (None: its share of the machine's cores).

        Returns:
            The picture on rank 0; None elsewhere.
        """
        comm, started = self.comm, time.perf_counter()
        chosen = Options(**{**options, "threads": comm.threads(options.get("threads"))})
        clocked: dict[str, float] = {"sent": -comm.sent}
        size = checked_size(size)
        camera = camera or comm.share(camera_for(self.shared.outline, size) if comm.rank == 0 else None)
        picture = render_prepared(self.prepared, camera, size, chosen, previous_camera, progress, partial(self._draw, clocked))
        clocked["sent"] += comm.sent
        self.ranks = comm.gather(clocked)
        self.plan.learn(self._busy())
        picture.seconds = {"prepare": time.perf_counter() - started - sum(picture.seconds.values()), **picture.seconds}
        return None if comm.rank else picture

    def _busy(self) -> Array:
        """(groups,) float64: seconds of drawing of each group that shares the screen, that of its slowest rank."""
        busy = np.array([each.get("busy", 0.0) for each in self.ranks])
        if self.shared.division is None:
            return busy
        groups = self.shared.division.groups
        return np.array([busy[np.arange(len(busy)) * groups // len(busy) == group].max() for group in range(groups)])

    def _draw(self, clocked: dict[str, float], prepared: Prepared, camera: Camera | None, size: tuple[int, int], options: Options,
              previous: Camera | None, progress: Callable[[float], None] | None) -> Picture:  # fmt: skip
        band: Callable[..., frame.Band] = partial(ScreenBand, self.comm, self.plan, clocked)
        if self.shared.division is not None:
            band = partial(ObjectBand, self.shared.division, self.plan, clocked)
        if self.shared.division is not None and self.shared.stream is not None:
            band = partial(StreamedBand, self.shared.stream, self._looks, self.shared.division, self.plan, clocked)
        picture = frame.draw(prepared, camera, size, options, previous, progress, band=band)
        return Picture(seconds=picture.seconds) if self.comm.rank else picture
