"""The grids of `luxel.cuda.threads.light` and `spots`: one thread an element, a group, or a share of a sum; strips along the second axis."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from luxel.cuda.grids import kernels
from luxel.cuda.primitives import again
from luxel.cuda.threads import light as light_source
from luxel.cuda.threads import spots as spots_source


def bodies(again: Callable[[str], Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a thread does: lines and grids, as `luxel.cuda.grids.kernels` has them."""
    light, spots = again(light_source.__name__), again(spots_source.__name__)
    lines = {
        "receive": light.receive_element, "send": light.send_element, "pass_on": light.pass_on, "sum_changes": light.sum_changes,
        "scatter": light.scatter, "begin_groups": light.begin_group, "square": light.square, "multiply": light.multiply, "measure": light.measure,
        "step": light.step, "turn": light.turn, "send_groups": light.send_group, "spread_groups": light.spread_group,
        "power_of_spots": spots.power_of, "darken_spots": spots.hide,
    }  # fmt: skip
    return lines, {"exchange": light.exchange_strip}


globals().update(kernels(__name__, *bodies(again)))  # each is an attribute of this module
