"""Pictures through the simulated circuit: what `render(scene, shading="hardware")` draws with the model, drawn with the circuit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.fixed import SUBPIXEL_LOG2
from luxel.hardware.float24 import ONE
from luxel.hardware.rtl.area import CORNERS
from luxel.hardware.rtl.barycentric import COLORS
from luxel.hardware.rtl.cxx import Drawn, Program
from luxel.hardware.rtl.simulate import run
from luxel.hardware.rtl.whole import COORDINATE_BITS, Interpolator
from luxel.hardware.scan import scan
from luxel.hardware.synthesis import tools

Compiling = Callable[[], object] | None
SIMULATORS = ("cxx", "amaranth")
WIDE_BITS = 26
"""Of coordinates as far out as the rasteriser's guard band; the circuit has fewer by default."""


def simulator(name: str = "auto") -> str:
    """Which to use: "cxx" (fast) where there is a C++ compiler, else "amaranth".

    Raises:
        InputError: No such simulator.
    """
    if name == "auto":
        return SIMULATORS[0] if tools.available("c++") and tools.available("yosys") else SIMULATORS[1]
    if name not in SIMULATORS:
        raise InputError(f"simulator: expected auto, {', '.join(SIMULATORS)}; got {name}")
    return name


def _check_size(width: int, height: int) -> None:
    if max(width, height) > 1 << COORDINATE_BITS - 1 - SUBPIXEL_LOG2:
        raise InputError(f"size: expected at most {1 << COORDINATE_BITS - 1 - SUBPIXEL_LOG2} pixels a side, got {width} x {height}")


def draw(corners: Array, colors: Array, width: int, height: int, using: str = "auto", compiling: Compiling = None) -> Drawn:
    """Send triangles through the circuit.

    Args:
        corners: (m, 3, 2) integers, x and y in 1/256 pixel.
        colors: (m, 3, 3) uint32, float24 words: of each corner, three channels.
        width, height: Of the picture, pixels.
        using: A simulator.
        compiling: Called before it is compiled, which happens once.

    Raises:
        InputError: The picture is too large.
    """
    _check_size(width, height)
    reach = 1 << COORDINATE_BITS - 1
    bits = COORDINATE_BITS if not corners.size or (corners.min() >= -reach and corners.max() < reach) else WIDE_BITS
    if simulator(using) == "cxx":
        return Program(bits, compiling).draw(corners, colors, width, height)
    count = sum(len(scan(each, width, height).x) for each in corners)
    columns = {key: corners[:, k // 2, k % 2] for k, key in enumerate(CORNERS)} | {key: colors[:, k // 3, k % 3] for k, key in enumerate(COLORS)}
    found = run(Interpolator(bits), columns, count, right=width - 1, bottom=height - 1)
    fields, last = found.fields, found.fields["last"]
    words = np.stack([fields[channel] for channel in "rgb"], 1).astype(np.uint32)
    clocks = (int(found.clocks[0]), int(found.clocks[-1]) + 1) if count else (0, 0)
    return Drawn(np.cumsum(last) - last, fields["x"], fields["y"], words, *clocks)


class _Circuit:
    """In the model's place (`luxel.hardware.interpolator.shade`): on a first drawing it notes the triangles, on a second it knows their fragments."""

    def __init__(self, blend: bool) -> None:
        self.blend = blend
        self.known: dict[bytes, int] = {}
        self.corners: list[Array] = []
        self.colors: list[Array] = []
        self.places = np.zeros(0, np.int64)
        self.words = np.zeros((0, 4), np.uint32)
        self.size = (0, 0)

    def __call__(self, corners: Array, colors: Array, x: Array, y: Array, triangle: Array) -> Array:
        numbers = np.array([self._number(*each) for each in zip(corners, colors)], np.int64)
        if not self.size[0]:
            return np.zeros((len(x), colors.shape[2]), np.uint32)
        width, height = self.size
        place = (numbers[triangle] * height + (y >> SUBPIXEL_LOG2)) * width + (x >> SUBPIXEL_LOG2)
        return self.words[np.searchsorted(self.places, place)]

    def _number(self, corners: Array, colors: Array) -> int:
        key = corners.tobytes() + colors.tobytes()
        if key not in self.known:
            self.known[key] = len(self.known)
            self.corners.append(corners)
            self.colors.append(colors)
        return self.known[key]

    def draw(self, width: int, height: int, using: str, compiling: Compiling) -> Drawn:
        """All triangles noted; a second time for alpha, if that counts."""
        self.size = width, height
        corners = np.array(self.corners, np.int64).reshape(-1, 3, 2)
        colors = np.array(self.colors, np.uint32).reshape(-1, 3, 4)
        found = draw(corners, colors[..., :3], width, height, using, compiling)
        alpha = np.full(len(found.x), ONE, np.uint32)
        if self.blend:
            alpha = draw(corners, np.repeat(colors[..., 3:], 3, -1), width, height, using).colors[:, 0]
        places = (found.triangle * height + found.y) * width + found.x
        order = np.argsort(places)
        self.places, self.words = places[order], np.concatenate([found.colors, alpha[:, None]], 1)[order]
        return found


def render(scene: Any, camera: Any = None, size: tuple[int, int] = (320, 240), using: str = "auto", compiling: Compiling = None,
           **options: Any) -> tuple[Any, Drawn]:  # fmt: skip
    """A scene through the circuit: the bytes of `luxel.render(scene, camera, size, shading="hardware")`.

    The rasteriser says which triangles are seen; those are sent, whole, and of their fragments those are kept that are seen.

    Args:
        scene, camera, size: As in `luxel.render`; up to 4096 pixels a side.
        using: A simulator.
        compiling: Called before it is compiled, which happens once.
        options: More of `luxel.render`'s; one sample a pixel.

    Returns:
        The picture, and what the circuit made.
    """
    from luxel.raster.render import prepare
    from luxel.raster.render import render as rasterise

    _check_size(*size)
    prepared = prepare(scene, "hardware", options.pop("cull", "material"))
    circuit = _Circuit(any(material.alpha_mode == "BLEND" for material in prepared.scene.materials))
    prepared = prepared._replace(hardware=circuit)
    rasterise(prepared, camera, size, threads=1, **options)
    found = circuit.draw(*size, using, compiling)
    return rasterise(prepared, camera, size, **options), found
