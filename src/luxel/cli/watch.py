"""What a bake shows while it works: its bar, and previews."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from luxel.radiosity.lighting import Progress
    from luxel.scene import Scene

_PREVIEW_SIZE = (960, 540)
_REDRAW = 12  # a preview may take a part of the time like this
_PASSING = 0.15  # of the time: lights shoot, and light goes from luxel to luxel


class Doing:
    """A label that has how long it has been, up to when it is shown: what is told once and takes minutes does not look stuck."""

    def __init__(self, what: str) -> None:
        self.what, self.since = what, time.monotonic()

    def __str__(self) -> str:
        return f"{self.what}, {time.monotonic() - self.since:.0f} s"


def stages(report: Callable[..., None]) -> Callable[[float, str], None]:
    """What to tell what is being done before there is light; the label has how long it has been, as its share is guessed, or not known."""
    doing = Doing("")

    def told(share: float, what: str) -> None:
        nonlocal doing
        if what != doing.what:
            doing = Doing(what)
        report(share, doing)

    return told


class Watch:
    """Shows how the unshot light falls, and draws previews as often as they cost little.

    Args:
        shares: Of the time, what looking around takes, the light, and the last bounce.
        begun: Called once, and may refuse; `refused` tells that it did.
    """

    def __init__(self, report: Callable[..., None], preview: Path | None, tolerance: float, shares: tuple[float, float, float],
                 begun: Callable[[Progress], None]) -> None:  # fmt: skip
        self.report, self.preview, self.tolerance, self.shares = report, preview, tolerance, shares
        self.begun: Callable[[Progress], None] | None = begun
        self.refused = False
        self.next = 0.0
        self.done = [0.0, 0.0, 0.0]

    def __call__(self, unshot: float, state: Progress) -> None:
        """To be told by a bake."""
        if self.begun:
            begun, self.begun, self.refused = self.begun, None, True
            begun(state)
            self.refused = False
        if unshot <= self.tolerance:
            light = 1.0
        else:  # where luxels look around, it is the lights that take time
            light = 1 - unshot if self.shares[0] else math.log(min(unshot, 1.0)) / math.log(self.tolerance)
        looks = 2 if light == 1.0 else 0
        self.done[1], self.done[looks] = light, max(self.done[looks], state.looked)
        looking = f"; {'last bounce' if looks else 'looking around'} {state.looked:.0%}" if 0 < state.looked < 1 else ""
        bar = sum(share * done for share, done in zip(self.shares, self.done, strict=True))
        self.report(bar, f"{unshot:7.2%} of the light unshot{looking}")
        if self.preview is not None and time.monotonic() >= self.next:
            start = time.monotonic()
            draw(state.preview(), self.preview)
            self.next = time.monotonic() + max(1.0, _REDRAW * (time.monotonic() - start))


def shares(options: dict[str, Any]) -> tuple[float, float, float]:
    """Of the time of a bake, what looking around takes, about, what light takes that shoots and goes on, and the last bounce."""
    from luxel.radiosity.diagnosis import work_of
    from luxel.radiosity.effort import rays_of
    from luxel.radiosity.quality import QUALITIES

    settings, sky = QUALITIES[options["quality"]], options["sky"] is not None
    if not settings.seen:
        return 0.0, 1.0, 0.0
    rays = rays_of(settings, sky)
    first = work_of(rays.kept, 0, False, sky) / work_of(rays.kept, rays.gathered, settings.unlike < math.inf, sky)
    return (1 - _PASSING) * first, _PASSING, (1 - _PASSING) * (1 - first)


def draw(scene: Scene, path: Path) -> None:
    """Draw a preview."""
    from luxel import render

    render(scene, size=_PREVIEW_SIZE, samples=4, background=(0.0, 0.0, 0.0)).save(path)
