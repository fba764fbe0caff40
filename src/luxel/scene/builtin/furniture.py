"""Furniture made of shapes.

Each function gives pieces, (mesh, material name), that stand on y = 0 around the origin and face +z. Metres.
"""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.scene.builtin.grid import merged, surface, transformed
from luxel.scene.builtin.shapes import box, cylinder, lathe, quad, sphere, superellipsoid, torus, tube
from luxel.scene.mesh import Mesh
from luxel.scene.transforms import rotation, translation

Piece = tuple[Mesh, str]
_GAP = 0.002  # metres between things that touch: no two faces coincide


def at(mesh: Mesh, x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Mesh:
    """`mesh` rolled about z, pitched about x, turned about y (degrees), then moved."""
    turn = rotation((0, 1, 0), np.radians(yaw)) @ rotation((1, 0, 0), np.radians(pitch))
    return transformed(mesh, translation((x, y, z)) @ turn @ rotation((0, 0, 1), np.radians(roll)))


def sofa() -> list[Piece]:
    """Two seats, 2.2 m wide, 0.95 m deep."""
    body = [
        at(box((2.2, 0.24, 0.9), 0.03, texture_size=0.25), 0, 0.25, 0),
        at(box((2.16, 0.52, 0.24), 0.09, 4, texture_size=0.25), 0, 0.6, -0.31, pitch=-6),
        *(at(box((0.22, 0.5, 0.95), 0.09, 4, texture_size=0.25), side * 1.0, 0.4, 0.01) for side in (-1, 1)),
    ]
    seats = [at(_cushion(0.88, 0.2, 0.72, 0.82), side * 0.443, 0.45, 0.1) for side in (-1, 1)]
    backs = [at(_cushion(0.86, 0.22, 0.5, 0.7), side * 0.443, 0.73, -0.13, pitch=76) for side in (-1, 1)]
    leg = lathe([(0, 0), (0.018, 0), (0.03, 0.14), (0, 0.14)], 16)
    legs = [at(leg, x, _GAP, z) for x in (-0.98, 0.98) for z in (-0.36, 0.36)]
    pillow = superellipsoid((0.46, 0.17, 0.46), 0.72, 12, crown=0.0)
    return [
        (merged([*body], "sofa"), "sofa"),
        (merged(seats + backs, "sofa cushions"), "sofa"),
        (merged(legs, "sofa legs"), "dark wood"),
        (at(pillow, -0.66, 0.76, 0.08, yaw=22, pitch=64, roll=8), "gingham"),
        (at(pillow, -0.36, 0.72, 0.16, yaw=-6, pitch=58, roll=-12), "mustard"),
        (at(pillow, 0.66, 0.76, 0.09, yaw=-20, pitch=66, roll=-10), "terracotta"),
    ]


def _cushion(width: float, height: float, depth: float, squareness: float) -> Mesh:
    cushion = superellipsoid((width, height, depth), squareness, 14, crown=0.45)
    assert cushion.texcoords is not None
    cushion.texcoords *= 3.0
    return cushion


def armchair() -> list[Piece]:
    """A shell on four splayed legs, with a seat cushion."""
    angle = np.linspace(np.radians(-118), np.radians(118), 33)
    tall = 0.36 + 0.3 * np.cos(angle / 1.35) ** 2
    inner, outer, rows = [], [], np.linspace(0, 1, 9)
    for t in rows:
        bulge = 0.36 + 0.05 * np.sin(np.pi * t * 0.7)
        ring = np.stack([bulge * np.sin(angle), 0.3 + t * tall, -bulge * np.cos(angle)], -1)
        outer.append(ring)
        inner.append(ring * [0.88, 1, 0.88])
    rim = np.concatenate([outer, inner[::-1], outer[:1]])  # up the outside and down the inside: one closed sheet
    shell = surface(rim[:, ::-1], "armchair shell")
    assert shell.texcoords is not None
    shell.texcoords *= 5.0
    wall = np.stack([outer, inner])  # its two ends are open strips
    ends = [surface(wall[:, :, 0].transpose(1, 0, 2)), surface(wall[::-1, :, -1].transpose(1, 0, 2))]
    seat = at(_cushion(0.66, 0.2, 0.64, 0.6), 0, 0.37, 0.02)
    legs = [tube([(x * 0.3, 0.008, z * 0.3), (x * 0.22, 0.3, z * 0.22)], [0.012, 0.02], 12) for x in (-1, 1) for z in (-1, 1)]
    return [
        (merged([shell, *ends], "armchair"), "teal"),
        (seat, "mustard"),
        (merged(legs, "armchair legs"), "dark wood"),
    ]


def coffee_table(height: float = 0.42, radius: float = 0.48) -> list[Piece]:
    """A round top on three splayed legs, with a brass ring between them."""
    edge = [(0.6, -0.035), (0.94, -0.035), (0.985, -0.022), (1.0, -0.012), (0.985, 0.0), (0.97, 0.0)]
    top = lathe([(0, height - 0.035), *((radius * r, height + y) for r, y in edge), (0, height)], 64, name="table top")
    assert top.texcoords is not None
    top.texcoords = 0.5 + top.positions[:, [0, 2]]
    angle = 2 * np.pi * (np.arange(3) / 3 + 0.1)
    feet = [(0.4 * np.cos(a), 0.008, 0.4 * np.sin(a)) for a in angle]
    heads = [(0.25 * np.cos(a), height - 0.036, 0.25 * np.sin(a)) for a in angle]
    legs = [tube([foot, head], [0.014, 0.024], 14) for foot, head in zip(feet, heads, strict=True)]
    ring = at(torus(0.345, 0.008, 64, 10), 0, 0.16, 0)
    return [
        (top, "table wood"),
        (merged(legs, "table legs"), "dark wood"),
        (ring, "brass"),
    ]


def vase_with_twigs(seed: int = 4) -> list[Piece]:
    """A glazed vase with bent twigs and round blossoms, 0.55 m high."""
    y = np.linspace(0, 1, 17)
    belly = 0.035 + 0.055 * np.sin(np.pi * np.clip(y * 1.15, 0, 1)) ** 1.3 + 0.012 * y**6
    outside = np.stack([belly, 0.24 * y], 1)
    inside = np.stack([belly[::-1] - 0.006, 0.24 * y[::-1] + 0.004 * (1 - y[::-1])], 1)[:-1]
    vase = lathe(np.concatenate([[(0, 0)], outside, inside[:10], [(0, inside[9, 1])]]), 48, name="vase")
    rng = np.random.default_rng(seed)
    twigs, blossoms = [], []
    for k in range(7):
        turn = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / 7
        lean, tall = rng.uniform(0.06, 0.16), rng.uniform(0.2, 0.34)
        t = np.linspace(0, 1, 9)
        away = 0.01 + lean * t**1.6
        curve = np.stack([away * np.cos(turn), 0.14 + tall * t, away * np.sin(turn)], 1)
        twigs.append(tube(curve, 0.003 - 0.0018 * t, 6))
        for s in (0.55, 0.7, 0.84, 1.0):
            point = [np.interp(s, t, curve[:, i]) for i in range(3)] + rng.normal(0, 0.006, 3)
            blossoms.append(at(sphere(rng.uniform(0.009, 0.016), 12), *point))
    return [(vase, "glaze"), (merged(twigs, "twigs"), "twig"), (merged(blossoms, "blossoms"), "blossom")]


def fruit_bowl(seed: int = 2) -> list[Piece]:
    """A turned bowl with oranges, apples and a lemon."""
    r = np.linspace(0, 1, 12)
    outside = np.stack([0.05 + 0.11 * r**0.8, 0.012 + 0.075 * r**1.8], 1)
    inside = np.stack([outside[::-1, 0] - 0.007, outside[::-1, 1] + 0.006], 1)
    bowl = lathe(np.concatenate([[(0, 0), (0.05, 0)], outside, inside, [(0, inside[-1, 1])]]), 48, name="bowl")
    t = np.linspace(0, np.pi, 17)
    dip = 0.042 * np.sin(t) * (1 + 0.25 * np.cos(t) ** 2)
    profile = np.stack([dip, -0.037 * np.cos(t) * (1 - 0.32 * np.exp(-((dip / 0.02) ** 2)))], 1)
    profile[[0, -1], 0] = 0
    apple = lathe(profile, 24, np.pi, "apple")
    orange, lemon = sphere(0.04, 24), superellipsoid((0.085, 0.058, 0.058), 0.0, 8)
    rng = np.random.default_rng(seed)
    spots = [(0.06 * np.cos(a), 0.068, 0.06 * np.sin(a)) for a in 2 * np.pi * np.arange(5) / 5]
    kinds = [(orange, "orange"), (apple, "apple"), (orange, "orange"), (apple, "green apple"), (lemon, "lemon")]
    fruit = [(at(mesh, *spot, yaw=rng.uniform(0, 360), pitch=rng.uniform(-25, 25)), name) for (mesh, name), spot in zip(kinds, spots, strict=True)]
    return [(bowl, "dark wood"), *fruit, (at(apple, 0.005, 0.118, 0.0, pitch=14), "apple")]


def glass_vase() -> list[Piece]:
    """A thin tall glass, blended, with water."""
    y = np.linspace(0, 1, 13)
    r = 0.04 + 0.014 * y**3 - 0.008 * np.sin(np.pi * y)
    outside = np.stack([r, 0.26 * y], 1)
    inside = np.stack([r[::-1] - 0.003, 0.012 + 0.248 * y[::-1]], 1)
    return [(lathe(np.concatenate([[(0, 0)], outside, inside, [(0, 0.012)]]), 40, name="glass"), "glass")]


def floor_lamp() -> list[Piece]:
    """A brass stand with a conical shade that shines, 1.6 m high; the bulb is at 1.42 m."""
    base = lathe([(0, _GAP), (0.15, _GAP), (0.155, 0.012), (0.15, 0.02), (0.03, 0.03), (0.012, 0.05), (0, 0.05)], 48)
    pole = at(cylinder(0.011, 1.3, 20), 0, 0.7, 0)
    wall = [(0.24, 1.27), (0.15, 1.6), (0.145, 1.6), (0.235, 1.27), (0.24, 1.27)]
    shade = lathe(wall, 64, name="lamp shade")
    bulb = at(sphere(0.035, 24), 0, 1.42, 0)
    return [(merged([base, pole], "lamp"), "brass"), (shade, "shade"), (bulb, "bulb")]


def bookshelf(width: float = 1.0, height: float = 2.05, depth: float = 0.3, seed: int = 8) -> list[Piece]:
    """Six boards high, filled with books and a few things."""
    side = box((0.03, height, depth), 0.003, 1, texture_size=0.6)
    boards = np.linspace(0.09, height - 0.02, 6)
    board = box((width - 0.062, 0.025, depth - 0.02), 0.003, 1, texture_size=0.6)
    back = box((width - 0.062, height - 0.1, 0.01), texture_size=0.6)
    frame = [at(side, s * (width - 0.03) / 2, height / 2 + _GAP, 0) for s in (-1, 1)]
    frame += [at(board, 0, y, 0) for y in boards]
    frame.append(at(back, 0, height / 2 + 0.03, -depth / 2 + 0.006))
    rng = np.random.default_rng(seed)
    books, half = [], width / 2 - 0.04
    for number, y in enumerate(boards[:-1]):
        room = boards[number + 1] - y - 0.03
        stretch = [(-half, half), (-half, half * 0.1), (-half * 0.25, half), (-half, half * 0.45), (-half * 0.4, half)][number]
        books += _row_of_books(stretch, y + 0.0145, room, rng)
    things = [
        (at(torus(0.075, 0.022, 48, 20), 0.27, boards[1] + 0.114, 0.02, yaw=25, pitch=90), "steel"),
        (at(sphere(0.07, 40), -0.33, boards[2] + 0.086, 0.02), "brass"),
        *((at(mesh, 0.34, boards[3] + 0.016, 0.0), name) for mesh, name in glass_vase()[:1]),
        (at(superellipsoid((0.16, 0.13, 0.16), 0.35, 10), -0.35, boards[4] + 0.079, 0.0), "glaze"),
    ]
    return [(merged(frame, "bookshelf"), "shelf wood"), (merged(books, "books"), "books"), *things]


_SPINES = (
    *((0.42, 0.06, 0.05), (0.05, 0.12, 0.25), (0.55, 0.42, 0.2), (0.06, 0.2, 0.14), (0.6, 0.55, 0.45)),
    *((0.12, 0.1, 0.1), (0.65, 0.25, 0.08), (0.15, 0.3, 0.4), (0.35, 0.12, 0.2), (0.7, 0.62, 0.35)),
)


def _row_of_books(stretch: tuple[float, float], y: float, room: float, rng: np.random.Generator) -> list[Mesh]:
    books: list[Mesh] = []
    x, end = stretch
    while True:
        thick, tall, deep = rng.uniform(0.018, 0.05), room * rng.uniform(0.68, 0.95), rng.uniform(0.17, 0.22)
        if x + thick > end:
            return books
        book = at(box((thick, tall, deep), 0.003, 1), x + thick / 2, y + tall / 2, 0.12 - deep / 2)
        color = np.clip(np.array(_SPINES[rng.integers(len(_SPINES))]) * rng.uniform(0.75, 1.2), 0, 1)
        book.colors = np.broadcast_to(np.array([*color, 1], np.float32), (len(book.positions), 4)).copy()
        books.append(book)
        x += thick + 0.0015


def plant(leaves: int = 54, seed: int = 6) -> list[Piece]:
    """A pot with a bush of bent leaves, cut out of quads by their alpha."""
    pot = lathe([(0, _GAP), (0.13, _GAP), (0.18, 0.3), (0.19, 0.3), (0.19, 0.33), (0.165, 0.33), (0.155, 0.27), (0, 0.27)], 48)
    soil = lathe([(0.156, 0.275), (0.1, 0.285), (0, 0.29)], 32)
    rng = np.random.default_rng(seed)
    blades, stalks = [], []
    for k in range(leaves):
        turn, rise = 2.399963 * k, k / leaves  # the golden angle spreads them
        tall, reach = 0.35 + 0.75 * rise + rng.uniform(-0.05, 0.05), (0.26 - 0.14 * rise) * rng.uniform(0.8, 1.2)
        t = np.linspace(0, 1, 7)
        out = np.array([np.cos(turn), 0, np.sin(turn)])
        stalk = out * (0.02 + reach * t[:, None] ** 1.5) + np.array([0, 1, 0]) * (0.27 + tall * t[:, None] ** 0.8)
        stalks.append(tube(stalk, 0.005 - 0.002 * t, 6))
        blades.append(_blade(stalk[-1], out, rng.uniform(0.2, 0.27), rng.uniform(0.11, 0.15), 0.5 + 0.7 * rise))
    return [
        (pot, "terracotta pot"),
        (soil, "soil"),
        (merged(stalks, "stalks"), "stalk"),
        (merged(blades, "leaves"), "leaf"),
    ]


def _blade(start: Array, out: Array, length: float, width: float, lift: float) -> Mesh:
    """A leaf from `start` outwards that rises and then hangs, folded a little along its vein."""
    t, s = np.linspace(0, 1, 7)[:, None], np.array([-0.5, -0.25, 0.0, 0.25, 0.5])[None, :]
    side = np.cross([0, 1, 0], out)
    along, fall = length * t * np.cos(0.5 * lift), length * (lift * 0.6 * t - 0.9 * t**2)
    up = fall + 0.35 * width * np.abs(s)
    points = start + along[..., None] * out + (width * s)[..., None] * side + up[..., None] * np.array([0, 1, 0])
    return surface(points[:, ::-1])


def curtain(width: float, height: float, folds: int = 7) -> list[Piece]:
    """A cloth in waves that are deeper towards the hem; it hangs in the xy plane."""
    u, v = np.meshgrid(np.linspace(0, 1, 16 * folds + 1), np.linspace(0, 1, 13))
    depth = 0.04 + 0.015 * (1 - v)
    wave = 2 * np.pi * folds * u + 0.5 * np.sin(3 * v + 5 * u)
    x = width * (u - 0.5) * (1 + 0.08 * (1 - v)) + 0.004 * np.sin(2 * wave)
    return [(surface(np.stack([x, height * v, depth * np.sin(wave)], -1), "curtain"), "curtain")]


def picture(width: float = 1.2, height: float = 0.8) -> list[Piece]:
    """A framed painting that hangs in the xy plane, centred, its back at z = 0."""
    bar = 0.05
    across, upright = box((width + 2 * bar, bar, 0.035), 0.008), box((bar, height, 0.033), 0.008)
    frame = [at(across, 0, s * (height + bar) / 2, 0.02) for s in (-1, 1)]
    frame += [at(upright, s * (width + bar) / 2, 0, 0.02) for s in (-1, 1)]
    return [(merged(frame, "picture frame"), "gilt"), (at(quad(width, height, "painting"), 0, 0, 0.018), "painting")]


def pouf() -> list[Piece]:
    """A round knitted seat."""
    t = np.linspace(0, np.pi, 41)
    radius = 0.27 * np.sin(t) ** 0.55 * (1 + 0.012 * np.cos(14 * t))
    profile = np.stack([radius, 0.19 - 0.185 * np.sign(np.cos(t)) * np.abs(np.cos(t)) ** 0.8], 1)
    profile[[0, -1], 0] = 0
    mesh = lathe(profile, 64, np.pi, "pouf")
    assert mesh.texcoords is not None
    mesh.texcoords *= [12, 4]
    return [(mesh, "wool")]
