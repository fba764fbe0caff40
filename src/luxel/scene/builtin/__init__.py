"""Shapes and scenes made by code, with NumPy alone.

>>> sorted(SCENES)
['bumpy-sphere', 'cornell-box', 'room', 'room-complex', 'room-simple', 'two-triangles']
"""

from __future__ import annotations

from collections.abc import Callable

from luxel.scene.builtin.bumpy import bumpy_sphere, bumpy_sphere_scene
from luxel.scene.builtin.cornell import cornell_box
from luxel.scene.builtin.grid import merged, surface, transformed
from luxel.scene.builtin.paper import two_triangles
from luxel.scene.builtin.paper_rooms import room_complex, room_simple
from luxel.scene.builtin.room import room, to_bake
from luxel.scene.builtin.shapes import (
    box,
    cone,
    cylinder,
    icosphere,
    lathe,
    plane,
    quad,
    sphere,
    superellipsoid,
    torus,
    tube,
)
from luxel.scene.scene import Scene

SCENES: dict[str, Callable[[], Scene]] = {
    "bumpy-sphere": bumpy_sphere_scene,
    "cornell-box": cornell_box,
    "room": room,
    "room-complex": room_complex,
    "room-simple": room_simple,
    "two-triangles": two_triangles,
}

__all__ = [
    "SCENES",
    "box",
    "bumpy_sphere",
    "bumpy_sphere_scene",
    "cone",
    "cornell_box",
    "cylinder",
    "icosphere",
    "lathe",
    "merged",
    "plane",
    "quad",
    "room",
    "room_complex",
    "room_simple",
    "sphere",
    "superellipsoid",
    "surface",
    "to_bake",
    "torus",
    "transformed",
    "tube",
    "two_triangles",
]
