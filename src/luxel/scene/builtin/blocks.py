"""Furniture of blocks: what stands in the paper's rooms.

No two faces coincide: a block has no face where it stands on, hangs from or leans against a larger one, whose own face goes on behind it.
Every function gives rectangles that stand on y = 0 and face +z; those that lean against a wall have it at z = 0, others the origin in their middle.
Metres.
"""

from __future__ import annotations

import numpy as np

from luxel.scene.builtin.charted import Rectangle
from luxel.scene.transforms import rotation

Point = tuple[float, float, float]

_FACES = {  # lower left corner of a unit cube's face seen from outside, to the right, up
    "west": ((0, 0, 0), (0, 0, 1), (0, 1, 0)),
    "east": ((1, 0, 1), (0, 0, -1), (0, 1, 0)),
    "down": ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
    "up": ((0, 1, 1), (1, 0, 0), (0, 0, -1)),
    "north": ((1, 0, 0), (-1, 0, 0), (0, 1, 0)),
    "south": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
}


def block(low: Point, high: Point, material: str, without: str = "down") -> list[Rectangle]:
    """An axis-aligned block, without the named faces: west and east (-x, +x), down and up, north and south (-z, +z)."""
    origin, size = np.array(low, float), np.subtract(high, low)
    named = without.split()
    return [Rectangle(origin + size * c, size * r, size * u, material) for name, (c, r, u) in _FACES.items() if name not in named]


def placed(pieces: list[Rectangle], x: float, z: float, yaw: float = 0.0, y: float = 0.0) -> list[Rectangle]:
    """The same, turned about y (degrees, counter-clockwise from above), then moved."""
    turn = rotation((0, 1, 0), np.radians(yaw))[:3, :3]
    return [Rectangle(turn @ p.corner + (x, y, z), turn @ p.right, turn @ p.up, p.material) for p in pieces]


def shell(low: Point, high: Point, walls: tuple[str, str, str, str]) -> list[Rectangle]:
    """Floor, ceiling and walls, seen from inside; materials of the walls at -x, +x, -z and +z."""
    west, east, north, south = walls
    materials = {"west": west, "east": east, "north": north, "south": south, "down": "floor", "up": "ceiling"}
    return _inside_out([block(low, high, material, " ".join(n for n in _FACES if n != name))[0] for name, material in materials.items()])


def partition(length: float, height: float, thick: float, opening: tuple[float, float, float], material: str) -> list[Rectangle]:
    """A wall across a room, along x from 0 to `length`, with an opening from x0 to x1, so high; its front is at z = 0, its back at -thick."""
    x0, x1, top = opening
    fields = [(0.0, 0.0, x0, top), (x1, 0.0, length, top), (0.0, top, x0, height), (x0, top, x1, height), (x1, top, length, height)]
    pieces = [p for left, low, right, high in fields for p in block((left, low, -thick), (right, high, 0), material, "west east down up")]
    return pieces + _inside_out(block((x0, 0, -thick), (x1, top, 0), material, "down north south"))


def _inside_out(pieces: list[Rectangle]) -> list[Rectangle]:
    return [Rectangle(p.corner + p.right, -p.right, p.up, p.material) for p in pieces]


def panel(width: float, depth: float, height: float) -> list[Rectangle]:
    """An area light that hangs from the ceiling at `height`: a flat housing with a glowing underside."""
    x, z, low = width / 2, depth / 2, height - 0.06
    housing = block((-x, low, -z), (x, height, z), "metal", "up down")
    return housing + block((-x, low, -z), (x, height, z), "light", "west east up north south")


def table(width: float, depth: float, height: float, material: str = "wood", leg: float = 0.06, without: str = "") -> list[Rectangle]:
    """A board, without the named faces, on four legs."""
    x, z, under, inset = width / 2, depth / 2, height - 0.04, 0.05
    pieces = block((-x, under, -z), (x, height, z), material, without)
    for a in (inset - x, x - inset - leg):
        for b in (inset - z, z - inset - leg):
            pieces += block((a, 0, b), (a + leg, under, b + leg), material, "down up")
    return pieces


def chair(material: str = "wood", cushion: str = "cloth") -> list[Rectangle]:
    """A stool with a back and a cushion that fills its seat."""
    pieces = table(0.46, 0.46, 0.44, material, 0.05, "up") + block((-0.23, 0.44, -0.23), (0.23, 0.92, -0.18), material)
    return pieces + block((-0.23, 0.44, -0.18), (0.23, 0.48, 0.23), cushion, "down north")


def bookcase(width: float, height: float, boards: int, seed: int = 0) -> list[Rectangle]:
    """Two sides, a back, a plinth and boards, with books on them."""
    x, side, deep, back, thick = width / 2, 0.04, 0.3, 0.02, 0.03
    pieces = block((-x, 0, 0), (side - x, height, deep), "wood", "down north") + block((x - side, 0, 0), (x, height, deep), "wood", "down north")
    pieces += block((side - x, 0, 0), (x - side, height, back), "wood", "down west east north")
    pieces += block((side - x, 0, back), (x - side, 0.08, deep - 0.02), "wood", "down west east north")
    step = (height - 0.08) / boards
    for i in range(1, boards + 1):
        y = 0.08 + i * step
        low = (side - x, y - thick, back)
        pieces += block(low, (x - side, y, deep - 0.02), "wood", "west east north")
    for i in range(boards):
        pieces += placed(_books(width - 2 * side, step - thick, seed + 7 * i), 0, back, y=0.08 + i * step)
    return pieces


def _books(width: float, height: float, seed: int) -> list[Rectangle]:
    """A row of books with a gap somewhere; sizes by the golden ratio's multiples, which never repeat."""
    pieces: list[Rectangle] = []
    x, i = -width / 2 + 0.01, seed
    while True:
        a, b, c = (i * f % 1.0 for f in (0.6180339887, 0.7548776662, 0.5698402910))
        wide = 0.035 + 0.05 * a
        if x + wide > width / 2 - 0.01:
            return pieces
        if b > 0.15:
            pieces += block((x, 0, 0.03), (x + wide, height * (0.6 + 0.28 * b), 0.15 + 0.08 * c), ("red", "blue", "cloth", "white")[i % 4])
        x, i = x + wide + 0.008, i + 1


def cupboard(width: float, height: float, depth: float, doors: int, material: str = "white") -> list[Rectangle]:
    """A carcass with doors and handles, against a wall."""
    x, gap, thick = width / 2, 0.012, 0.02
    pieces = block((-x, 0, 0), (x, height, depth), material, "down north")
    wide = (width - gap * (doors + 1)) / doors
    for i in range(doors):
        left = -x + gap + i * (wide + gap)
        pieces += block((left, 0.06, depth), (left + wide, height - 0.02, depth + thick), material, "north")
        grip = left + (wide - 0.06 if i % 2 == 0 else 0.03)
        pieces += block((grip, height * 0.45, depth + thick), (grip + 0.03, height * 0.45 + 0.16, depth + thick + 0.03), "metal", "north")
    return pieces


def sofa(width: float, seats: int, material: str = "cloth") -> list[Rectangle]:
    """Arms, a back and a seat with cushions; 0.9 m deep, with its back at z = 0."""
    x, arm, gap = width / 2, 0.18, 0.015
    pieces = block((-x, 0, 0), (x, 0.78, 0.2), material)
    for low in (-x, x - arm):
        pieces += block((low, 0, 0.2), (low + arm, 0.6, 0.9), material, "down north")
    pieces += block((arm - x, 0, 0.2), (x - arm, 0.3, 0.86), material, "down west east north")
    wide = (width - 2 * arm - gap * (seats + 1)) / seats
    for i in range(seats):
        left = arm - x + gap + i * (wide + gap)
        pieces += block((left, 0.3, 0.215), (left + wide, 0.44, 0.85), material)
        pieces += block((left + 0.02, 0.44, 0.23), (left + wide - 0.02, 0.86, 0.36), material)
    return pieces


def bed(width: float, length: float = 2.0) -> list[Rectangle]:
    """A headboard at z = 0, a frame, a mattress, a blanket, pillows."""
    x, pillows = width / 2, 2 if width > 1.2 else 1
    pieces = block((-x - 0.03, 0, 0), (x + 0.03, 1.0, 0.06), "wood") + block((-x, 0, 0.06), (x, 0.28, length + 0.06), "wood", "down up north")
    pieces += block((-x, 0.28, 0.06), (x, 0.46, length + 0.06), "white", "down north")
    pieces += block((0.05 - x, 0.46, 0.75), (x - 0.05, 0.5, length), "blue")
    wide = (width - 0.2) / pillows
    for i in range(pillows):
        left = 0.08 - x + i * (wide + 0.04)
        pieces += block((left, 0.46, 0.13), (left + wide, 0.58, 0.53), "white")
    return pieces


def lamp(height: float, shade: float = 0.34) -> list[Rectangle]:
    """A base, a pole and a shade; it does not shine."""
    low, r = height - 0.28, shade / 2
    pole = block((-0.02, 0.03, -0.02), (0.02, low, 0.02), "metal", "down up")
    return block((-0.14, 0, -0.14), (0.14, 0.03, 0.14), "metal") + pole + block((-r, low, -r), (r, height, r), "white", "")


def picture(width: float, height: float, material: str = "red") -> list[Rectangle]:
    """A frame with a canvas on it, on a wall, with its middle at 0."""
    x, y, rim = width / 2, height / 2, 0.05
    frame = block((-x, -y, 0), (x, y, 0.025), "wood", "north")
    return frame + block((rim - x, rim - y, 0.025), (x - rim, y - rim, 0.035), material, "north")


def screen(width: float, height: float) -> list[Rectangle]:
    """A television or monitor on a foot."""
    x = width / 2
    foot = block((-0.16, 0, -0.1), (0.16, 0.02, 0.1), "metal")
    foot += block((-0.03, 0.02, -0.03), (0.03, 0.08, 0.03), "metal", "down up")
    return foot + block((-x, 0.08, -0.03), (x, 0.08 + height, 0.03), "dark", "")


def drawers(width: float, height: float, depth: float, count: int, material: str = "wood") -> list[Rectangle]:
    """A chest of drawers with handles, against a wall."""
    x, gap, step = width / 2, 0.012, (height - 0.06) / count
    pieces = block((-x, 0, 0), (x, height, depth), material, "down north")
    for i in range(count):
        low = 0.05 + i * step
        pieces += block((gap - x, low, depth), (x - gap, low + step - gap, depth + 0.02), material, "north")
        middle = low + (step - gap) / 2
        pieces += block((-0.08, middle - 0.015, depth + 0.02), (0.08, middle + 0.015, depth + 0.045), "metal", "north")
    return pieces
