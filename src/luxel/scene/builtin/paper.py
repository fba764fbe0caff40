"""The two triangles of "Anti-aliasing of triangle rasterisation, and its parallelisation" (2021).

They are a well-known teaching scene.
"""

from __future__ import annotations

import numpy as np

from luxel.scene.camera import Camera
from luxel.scene.colour import linear_from_srgb
from luxel.scene.material import Material
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

_TRIANGLES = (
    ("large", ((2, 0, -2), (0, 2, -2), (-2, 0, -2)), (217, 238, 185)),
    ("small", ((3.5, -1, -5), (2.5, 1.5, -5), (-1, 0.5, -5)), (185, 217, 238)),
)


def two_triangles() -> Scene:
    """Two unlit triangles, one partly behind the other, with the paper's camera.

    The colours are vertex colours: the paper's sRGB bytes in linear light, so that a picture shows the bytes again.
    The eye is at (0, 0, 5) and looks down -z, 45 degrees high, from 0.1 to 50; the paper's pictures are square, of 500,
    1000 and 2000 pixels a side.
    """
    scene = Scene(name="two-triangles")
    material = Material(base_color=(1.0, 1.0, 1.0, 1.0), shading="unlit", double_sided=True, name="vertex colours")
    for name, corners, color in _TRIANGLES:
        colors = np.broadcast_to([*linear_from_srgb(np.array(color, np.uint8)), 1.0], (3, 4))
        scene.add(Mesh(np.array(corners), np.array([[0, 1, 2]]), colors=colors, name=name), material)
    scene.cameras.append(Camera.look_at((0, 0, 5), (0, 0, 4), yfov=np.radians(45.0), near=0.1, far=50.0, name="paper"))
    return scene
