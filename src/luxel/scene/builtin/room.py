"""The demo: a furnished living room by a window, all made by code. Closed, in metres, fit for baking."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from luxel.scene.builtin import furniture as f
from luxel.scene.builtin.finishes import finishes
from luxel.scene.builtin.furniture import Piece, at
from luxel.scene.builtin.grid import merged, quads
from luxel.scene.builtin.shapes import box, cylinder, lathe, sphere
from luxel.scene.camera import Camera
from luxel.scene.light import Ambient, Light
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene
from luxel.scene.transforms import look_at

WIDTH, HEIGHT, DEPTH = 6.0, 2.8, 5.0
_X, _Z = WIDTH / 2, DEPTH / 2
_SILL, _LINTEL, _WINDOW, _REVEAL = 0.75, 2.3, (-1.35, 0.65), 0.14  # the window is in the wall at -x
_LAMP = (0.78, -2.02)
_TABLE = (-0.72, -0.42)
GLOW = {"daylight": 16.0, "shade": 4.0, "bulb": 4.0}
"""By material: how much more it shines into the room than a picture can show of it, whose white is far below a window's."""


def to_bake(scene: Scene) -> Scene:
    """A scene made by code, to be baked: without the lights that stand in for what glows where nothing is baked, and with what glows as bright as it
    is. The ambient stays: a bake takes no light from it, and metals mirror it. The scene that is given is not changed."""
    materials = [replace(material) for material in scene.materials]
    for material in materials:
        red, green, blue = (GLOW.get(material.name, 1.0) * channel for channel in material.emissive)
        material.emissive = red, green, blue
    return replace(scene, materials=materials, lights=[])


def room() -> Scene:
    """A living room: window, curtains, sofa, armchair, table, lamp, bookshelf, plant, rug; two cameras.

    Its lights, and how bright things glow, are for pictures without a bake; `to_bake` gives those for one.
    """
    footprints = [
        (-0.75, -1.85, 2.15, 0.85, 0.08),  # sofa
        (-2.05, 0.55, 0.5, 0.5, 0.2),  # armchair
        (*_TABLE, 0.3, 0.3, 0.5),
        (0.42, 0.5, 0.34, 0.34, 0.02),  # pouf
        (*_LAMP, 0.2, 0.2, 0.0),
        (1.98, -2.33, 1.0, 0.3, 0.0),  # bookshelf
        (-2.44, -1.96, 0.2, 0.2, 0.0),  # plant
    ]
    materials, textures = finishes((WIDTH, DEPTH), footprints)
    scene = Scene(name="room", textures=textures, ambient=Ambient((0.56, 0.56, 0.58), (0.36, 0.31, 0.26)))
    for name, pieces in _things().items():
        number = 1 + max((instance.object for instance in scene.instances), default=-1)
        for mesh, material in pieces:
            instance = scene.add(mesh, materials[material], name=mesh.name or name)
            instance.object = number
    scene.lights += _lights()
    scene.cameras += [
        Camera.look_at((2.5, 1.48, 2.3), (-0.3, 0.82, -0.95), yfov=np.radians(50), near=0.05, name="corner"),
        Camera.look_at((-2.2, 1.6, 2.2), (0.9, 0.8, -1.2), yfov=np.radians(52), near=0.05, name="window side"),
    ]
    return scene


def _things() -> dict[str, list[Piece]]:
    """What stands where; each entry is one object."""
    table_top = 0.42 + 0.002
    x, z = _TABLE
    return {
        **_shell(),
        "window": _window(),
        "curtain left": _placed(f.curtain(0.62, 2.36), -2.82, 0.03, 0.95, 90),
        "curtain right": _placed(f.curtain(0.62, 2.36), -2.82, 0.03, -1.65, 90),
        "curtain rod": _rod(),
        "skirting": _skirting(),
        "rug": [(at(box((2.9, 0.012, 1.95), 0.004, 1, name="rug"), -0.62, 0.008, -0.5), "rug")],
        "sofa": _placed(f.sofa(), -0.75, 0, -1.85),
        "armchair": _placed(f.armchair(), -2.05, 0, 0.55, 68),
        "table": _placed(f.coffee_table(), x, 0.014, z),
        "vase": _placed(f.vase_with_twigs(), x - 0.14, table_top + 0.014, z - 0.16),
        "fruit bowl": _placed(f.fruit_bowl(), x + 0.17, table_top + 0.014, z + 0.08, 40),
        "glass": _placed(f.glass_vase(), x - 0.2, table_top + 0.014, z + 0.16),
        "pouf": _placed(f.pouf(), 0.42, 0.016, 0.5),
        "lamp": _placed(f.floor_lamp(), _LAMP[0], 0, _LAMP[1]),
        "bookshelf": _placed(f.bookshelf(), 1.98, 0, -2.335),
        "plant": _placed(f.plant(), -2.44, 0, -1.96),
        "picture": _placed(f.picture(), -0.75, 1.72, -_Z + 0.003),
        "mirror": _mirror(),
        "door": _door(),
    }


def _placed(pieces: list[Piece], x: float, y: float, z: float, yaw: float = 0.0) -> list[Piece]:
    return [(at(mesh, x, y, z, yaw), material) for mesh, material in pieces]


def _panel(corner: object, right: object, up: object, us: object = (0, 1), vs: object = (0, 1), name: str = "") -> Mesh:
    """A rectangle from its lower left corner, cut at fractions; of three cells each way the middle is open."""
    u, v = np.meshgrid(np.asarray(us, float), np.asarray(vs, float))
    points = np.asarray(corner) + u[..., None] * np.asarray(right) + v[..., None] * np.asarray(up)
    facing = np.cross(right, up)  # type: ignore[call-overload]
    rows, columns = u.shape
    cells = quads(rows, columns).reshape(rows - 1, columns - 1, 2, 3)
    if (rows, columns) == (4, 4):
        keep = np.ones((3, 3), bool)
        keep[1, 1] = False
        cells = cells[keep]
    normals = np.broadcast_to(facing / np.linalg.norm(facing), (u.size, 3))
    texcoords = np.stack([u, 1 - v], -1).reshape(-1, 2)
    return Mesh(points.reshape(-1, 3), cells.reshape(-1, 3), normals, texcoords, name=name)


def _shell() -> dict[str, list[Piece]]:
    """Floor, ceiling and walls, seen from inside; the left wall is open where the window is."""
    w, h, d = (WIDTH, 0, 0), (0, HEIGHT, 0), (0, 0, DEPTH)
    back, front = (0, 0, -DEPTH), (-WIDTH, 0, 0)
    first, last = ((_Z - z) / DEPTH for z in _WINDOW[::-1])
    hole = {"us": (0, first, last, 1), "vs": (0, _SILL / HEIGHT, _LINTEL / HEIGHT, 1)}
    steps = {"us": np.linspace(0, 1, 13), "vs": np.linspace(0, 1, 11)}
    return {
        "floor": [(_panel((-_X, 0, _Z), w, back, **steps, name="floor"), "floor")],  # type: ignore[arg-type]
        "ceiling": [(_panel((-_X, HEIGHT, -_Z), w, d, name="ceiling"), "ceiling")],
        "back wall": [(_panel((-_X, 0, -_Z), w, h, name="back wall"), "accent wall")],
        "front wall": [(_panel((_X, 0, _Z), front, h, name="front wall"), "wall")],
        "left wall": [(_panel((-_X, 0, _Z), back, h, **hole, name="left wall"), "wall")],  # type: ignore[arg-type]
        "right wall": [(_panel((_X, 0, -_Z), d, h, name="right wall"), "wall")],
    }


def _window() -> list[Piece]:
    """The reveal, a wooden frame with two bars, and the daylight behind it."""
    (z0, z1), x = _WINDOW, -_X
    wide, tall, middle = z1 - z0, _LINTEL - _SILL, (z0 + z1) / 2
    into, along, up = (_REVEAL, 0, 0), (0, 0, -wide), (0, tall, 0)
    reveal = [
        _panel((x - _REVEAL, _SILL, z1), into, along),
        _panel((x - _REVEAL, _LINTEL, z0), into, (0, 0, wide)),
        _panel((x - _REVEAL, _SILL, z0), into, up),
        _panel((x, _SILL, z1), (-_REVEAL, 0, 0), up),
    ]
    bar, deep = 0.05, 0.04
    at_x = x - _REVEAL + 0.045
    bars = [at(box((deep, bar, wide - 0.004), 0.006, 1), at_x, y, middle) for y in (_SILL + 0.028, _LINTEL - 0.028)]
    posts = (z0 + 0.028, middle, z1 - 0.028)
    bars += [at(box((deep - 0.004, tall - 0.1, bar), 0.006, 1), at_x, _SILL + tall / 2, z) for z in posts]
    bars += [at(box((deep - 0.008, 0.03, wide / 2 - 0.06), 0.005, 1), at_x, 1.82, middle + s * wide / 4) for s in (-1, 1)]
    sill = at(box((0.24, 0.035, wide + 0.06), 0.01), x + 0.015, _SILL - 0.03, middle)
    daylight = _panel((x - _REVEAL, _SILL, z1), along, up, name="daylight")
    frame = merged([*bars, sill], "window frame")
    return [(merged(reveal, "reveal"), "ceiling"), (frame, "white paint"), (daylight, "daylight")]


def _rod() -> list[Piece]:
    middle = sum(_WINDOW) / 2
    bar = at(cylinder(0.013, 3.5, 20), -2.82, 2.43, middle, pitch=90)
    knobs = [at(sphere(0.03, 20), -2.82, 2.43, middle + s * 1.77) for s in (-1, 1)]
    holder = [at(cylinder(0.008, 0.15, 12), -2.91, 2.43, middle + s * 1.5, yaw=90, pitch=90) for s in (-1, 1)]
    return [(merged([bar, *knobs, *holder], "curtain rod"), "brass")]


def _skirting() -> list[Piece]:
    tall, thick, gap = 0.09, 0.016, 0.002
    y = tall / 2 + gap
    along = box((WIDTH - 2 * thick - 0.01, tall, thick), 0.004, 1)
    across = box((thick, tall, DEPTH - 0.006), 0.004, 1)
    inset = thick / 2 + gap
    boards = [at(along, 0, y, s * (_Z - inset)) for s in (-1, 1)] + [at(across, s * (_X - inset), y, 0) for s in (-1, 1)]
    return [(merged(boards, "skirting"), "white paint")]


def _mirror() -> list[Piece]:
    """A round mirror of polished steel on the right wall."""
    disc = lathe([(0, 0.012), (0.36, 0.012), (0.36, 0.02), (0, 0.02)], 64, name="mirror")
    rim = lathe([(0.36, 0.004), (0.4, 0.004), (0.405, 0.02), (0.4, 0.035), (0.365, 0.035), (0.355, 0.02), (0.36, 0.004)], 64)
    rim.name = "mirror rim"
    return [(at(disc, _X, 1.55, -0.3, roll=90), "steel"), (at(rim, _X, 1.55, -0.3, roll=90), "gilt")]


def _door() -> list[Piece]:
    """On the front wall, behind the first camera."""
    slab = at(box((0.9, 2.05, 0.04), 0.006, 1), 1.6, 1.035, _Z - 0.025)
    panels = [at(box((0.62, tall, 0.02), 0.01), 1.6, y, _Z - 0.045) for tall, y in ((0.72, 0.55), (0.85, 1.48))]
    posts = [at(box((0.09, 2.16, 0.06), 0.008, 1), 1.6 + s * 0.5, 1.085, _Z - 0.033) for s in (-1, 1)]
    head = at(box((1.1, 0.09, 0.062), 0.008, 1), 1.6, 2.215, _Z - 0.034)
    knob = at(sphere(0.03, 24), 1.24, 1.02, _Z - 0.1)
    stem = at(cylinder(0.01, 0.06, 16), 1.24, 1.02, _Z - 0.07, pitch=90)
    return [(merged([slab, *panels, *posts, head], "door"), "white paint"), (merged([knob, stem], "knob"), "brass")]


def _lights() -> list[Light]:
    """Where light is not transported: the window as a wide spot, the lamp up and down, and the walls' answer."""
    middle = sum(_WINDOW) / 2
    window = look_at((-_X - 0.6, 1.9, middle), (0.4, 0.5, middle))
    lamp = (_LAMP[0], 1.42, _LAMP[1])
    return [
        Light("spot", (1.0, 0.98, 0.94), 42.0, window, inner_cone=0.3, outer_cone=1.25, name="window"),
        Light("point", (1.0, 0.66, 0.36), 1.3, look_at(lamp, (0, 1.42, 0)), range=5.0, name="lamp"),
        Light("point", (1.0, 0.95, 0.88), 2.6, look_at((1.3, 1.8, 1.7), (0, 0, 0)), range=9.0, name="fill"),
    ]


__all__ = ["room", "to_bake"]
