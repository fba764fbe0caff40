"""The two rooms of "GPU-accelerated progressive-refinement radiosity" (2016), made anew by code: the paper gives their counts, not their files.

Closed, furnished, lit by area lights alone. Each has the paper's number of faces (quadrilaterals with four vertices each) and of patches, which
are the luxels of the lightmap that the scene brings along.
"""

from __future__ import annotations

import numpy as np

from luxel.scene.builtin import blocks as b
from luxel.scene.builtin.charted import Rectangle, add_charted
from luxel.scene.camera import Camera
from luxel.scene.material import Material
from luxel.scene.scene import Scene

SIMPLE_FACES, SIMPLE_LUXELS = 1_602, 14_445
COMPLEX_FACES, COMPLEX_LUXELS = 8_549, 86_077

_COLORS = {
    "floor": (0.42, 0.28, 0.17),
    "ceiling": (0.82, 0.82, 0.8),
    "wall": (0.74, 0.71, 0.64),
    "warm wall": (0.68, 0.33, 0.2),
    "green wall": (0.32, 0.48, 0.3),
    "wood": (0.45, 0.26, 0.12),
    "white": (0.8, 0.8, 0.78),
    "cloth": (0.35, 0.37, 0.42),
    "blue": (0.12, 0.24, 0.5),
    "red": (0.55, 0.1, 0.08),
    "metal": (0.5, 0.5, 0.52),
    "dark": (0.04, 0.04, 0.05),
    "light": (0.8, 0.8, 0.8),
}
_HEIGHT = 2.6


def room_simple() -> Scene:
    """A study with a bed: 1,602 faces, 2 area lights, 14,445 luxels."""
    camera = Camera.look_at((1.95, 1.75, 1.0), (-0.8, 0.75, -0.9), yfov=np.radians(66), near=0.05, name="door")
    return _scene("room-simple", study(), 28.0, SIMPLE_FACES, SIMPLE_LUXELS, [camera])


def room_complex() -> Scene:
    """A flat of three rooms with openings between them: 8,549 faces, 6 area lights, 86,077 luxels."""
    cameras = [
        Camera.look_at((-5.2, 1.7, 3.7), (0.6, 0.75, -1.6), yfov=np.radians(58), near=0.05, name="living room"),
        Camera.look_at((5.2, 1.7, 3.4), (1.9, 0.8, 0.6), yfov=np.radians(64), near=0.05, name="kitchen"),
        Camera.look_at((1.75, 1.7, -0.25), (4.4, 0.5, -3.6), yfov=np.radians(66), near=0.05, name="bedroom"),
    ]
    return _scene("room-complex", flat(), 30.0, COMPLEX_FACES, COMPLEX_LUXELS, cameras)


def study() -> list[Rectangle]:
    """What `room_simple` is made of."""
    x, z = 2.2, 1.8
    pieces = b.shell((-x, 0, -z), (x, _HEIGHT, z), ("wall", "warm wall", "wall", "wall"))
    for side in (-1, 1):
        pieces += b.placed(b.panel(0.6, 0.6, _HEIGHT), side * 1.1, 0.0)
    pieces += b.placed(b.bed(1.4), -1.35, 0.02 - z) + b.placed(b.picture(0.9, 0.6), -1.35, -z, y=1.7)
    pieces += b.placed(b.drawers(0.45, 0.5, 0.38, 2), -0.3, -z) + b.placed(b.lamp(0.46, 0.24), -0.3, -1.6, y=0.5)
    pieces += b.placed(b.bookcase(1.0, 1.9, 4), 0.65, -z)
    pieces += b.placed(b.table(1.3, 0.65, 0.74), 1.8, -0.35, -90)
    pieces += b.placed(b.screen(0.55, 0.34), 1.95, -0.35, -90, 0.74) + b.placed(b.chair(), 1.15, -0.3, 70)
    pieces += b.placed(b.cupboard(1.2, 2.0, 0.55, 2), 1.4, z, 180)
    pieces += b.placed(b.block((-0.6, 0, -0.55), (0.6, 0.012, 0.55), "red"), 0.0, 0.75)
    return pieces + b.placed(b.table(0.7, 0.5, 0.4), 0.0, 0.75, 0, 0.012) + b.placed(b.chair("wood", "red"), -1.55, 1.2, 120)


def flat() -> list[Rectangle]:
    """What `room_complex` is made of."""
    west, east, north, south = -5.5, 5.5, -4.0, 4.0
    pieces = b.shell((west, 0, north), (east, _HEIGHT, south), ("wall", "wall", "warm wall", "wall"))
    across = b.partition(south - north, _HEIGHT, 0.14, (4.9, 6.3, 2.1), "green wall")
    pieces += b.placed(across, 1.5, south, 90)  # along z; its front faces +x
    pieces += b.placed(b.partition(east - 1.5, _HEIGHT, 0.14, (0.5, 1.5, 2.1), "wall"), 1.5, 0.2)
    for x, z in ((-3.7, -2.0), (-0.5, -2.0), (-3.7, 2.0), (-0.5, 2.0), (3.5, -2.0), (3.5, 2.2)):
        pieces += b.placed(b.panel(0.7, 0.7, _HEIGHT), x, z)
    return pieces + _living_room(west, north) + _bedroom(east, north) + _kitchen(east, south)


def _living_room(west: float, north: float) -> list[Rectangle]:
    pieces = b.placed(b.block((-0.95, 0, -1.1), (0.95, 0.012, 1.1), "red"), -3.2, -1.75)
    pieces += b.placed(b.sofa(2.2, 3), west + 0.03, -1.75, 90) + b.placed(b.sofa(1.6, 2, "blue"), -3.1, 0.35, 180)
    pieces += b.placed(b.table(1.1, 0.6, 0.4), -3.2, -1.75, 90, 0.012) + b.placed(b.lamp(1.6), -5.15, 0.15)
    pieces += b.placed(b.drawers(1.8, 0.45, 0.42, 1), -3.2, north) + b.placed(b.screen(1.2, 0.68), -3.2, north + 0.2, y=0.45)
    for i, x in enumerate((-1.3, -0.25, 0.8)):
        pieces += b.placed(b.bookcase(1.0, 2.1, 5, 20 * i), x, north)
    pieces += b.placed(b.picture(1.2, 0.7, "blue"), west, -1.75, 90, 1.6)
    pieces += b.placed(b.table(2.0, 0.95, 0.75), -2.3, 2.5)
    for x in (-2.9, -2.3, -1.7):
        pieces += b.placed(b.chair(), x, 1.85) + b.placed(b.chair(), x, 3.15, 180)
    pieces += b.placed(b.block((-0.12, 0, -0.12), (0.12, 0.3, 0.12), "blue"), -2.3, 2.5, 30, 0.75)
    pieces += b.placed(b.bookcase(1.6, 0.9, 2, 90), west, 2.6, 90) + b.placed(b.picture(0.9, 0.9), west, 2.6, 90, 1.6)
    return pieces + b.placed(b.bookcase(0.9, 2.1, 5, 70), 0.3, 4.0, 180)


def _bedroom(east: float, north: float) -> list[Rectangle]:
    pieces = b.placed(b.bed(1.7), 3.2, north + 0.02) + b.placed(b.picture(1.1, 0.6, "blue"), 3.2, north, y=1.7)
    for x in (2.05, 4.35):
        pieces += b.placed(b.drawers(0.45, 0.5, 0.4, 2), x, north) + b.placed(b.lamp(0.5, 0.24), x, north + 0.2, y=0.5)
    pieces += b.placed(b.cupboard(2.2, 2.2, 0.6, 4), east, -2.0, -90)
    pieces += b.placed(b.block((-0.8, 0, -0.5), (0.8, 0.012, 0.5), "cloth"), 3.3, -1.2)
    return pieces + b.placed(b.drawers(0.9, 0.8, 0.42, 3, "white"), 4.2, 0.06, 180) + b.placed(b.chair("wood", "blue"), 2.0, -1.0, 35)


def _kitchen(east: float, south: float) -> list[Rectangle]:
    pieces = b.placed(b.cupboard(3.2, 0.9, 0.6, 6), 3.6, south, 180) + b.placed(b.cupboard(0.7, 2.0, 0.65, 1, "metal"), east, 0.9, -90)
    pieces += b.placed(b.cupboard(2.4, 0.7, 0.35, 4), 3.6, south, 180, 1.5)
    pieces += b.placed(b.table(1.2, 0.75, 0.75, "white"), 3.4, 1.7)
    for x in (3.15, 3.65):
        pieces += b.placed(b.chair("white", "red"), x, 1.15) + b.placed(b.chair("white", "red"), x, 2.25, 180)
    return pieces + b.placed(b.bookcase(1.0, 1.8, 4, 130), 3.85, 0.2)


def _scene(name: str, pieces: list[Rectangle], radiance: float, faces: int, luxels: int, cameras: list[Camera]) -> Scene:
    matte = {key: Material((*color, 1.0), roughness=1.0, specular=(0, 0, 0), name=key) for key, color in _COLORS.items()}
    matte["light"].emissive = (radiance, 0.92 * radiance, 0.78 * radiance)
    used = {piece.material for piece in pieces}
    scene = Scene(name=name, cameras=cameras)
    add_charted(scene, pieces, {key: material for key, material in matte.items() if key in used}, faces, luxels)
    return scene


__all__ = ["COMPLEX_FACES", "COMPLEX_LUXELS", "SIMPLE_FACES", "SIMPLE_LUXELS", "room_complex", "room_simple"]
