"""Clock: seconds by stage."""

from __future__ import annotations

import time


class Clock:
    """Seconds by stage, from its making on.

    Attributes:
        seconds: Of each stage, in the order in which they ended.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """What has passed since the last call was `stage`."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self.last
        self.last = now
