"""The Cornell box, as measured: walls that are not quite square, two blocks, one area light. In metres."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.scene.builtin.grid import merged
from luxel.scene.camera import Camera
from luxel.scene.light import Ambient, Light
from luxel.scene.material import Material
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene
from luxel.scene.transforms import look_at

RADIANCE = (17.0, 12.0, 4.0)
_WHITE, _RED, _GREEN = (0.725, 0.71, 0.68), (0.63, 0.065, 0.05), (0.14, 0.45, 0.091)
_HEIGHT = 548.8  # of the room, in millimetres as all the numbers below
_LIGHT_X, _LIGHT_Z = (213.0, 343.0), (227.0, 332.0)
_WALLS = (
    ("floor", _WHITE, ((552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2))),
    ("back", _WHITE, ((549.6, 0, 559.2), (0, 0, 559.2), (0, _HEIGHT, 559.2), (556, _HEIGHT, 559.2))),
    ("right", _GREEN, ((0, 0, 559.2), (0, 0, 0), (0, _HEIGHT, 0), (0, _HEIGHT, 559.2))),
    ("left", _RED, ((552.8, 0, 0), (549.6, 0, 559.2), (556, _HEIGHT, 559.2), (556, _HEIGHT, 0))),
)
_BLOCKS = (
    ("short block", 165.0, ((130, 65), (82, 225), (240, 272), (290, 114))),
    ("tall block", 330.0, ((423, 247), (265, 296), (314, 456), (472, 406))),
)


def cornell_box() -> Scene:
    """The box with its camera.

    The ceiling has a hole where the light is, and the blocks have no bottom, so no two surfaces coincide. The light is
    emissive (radiance 17, 12, 4); a spot light that shines as the emitter does from afar, and a weak ambient, stand in
    where light is not transported.
    """
    scene = Scene(name="cornell-box", ambient=Ambient((0.1, 0.09, 0.075), (0.3, 0.27, 0.22)))
    matte = {color: _matte(color, name) for color, name in ((_WHITE, "white"), (_RED, "red"), (_GREEN, "green"))}
    for name, color, corners in _WALLS:
        scene.add(_rectangle(corners, name), matte[color])
    scene.add(_ceiling(), matte[_WHITE])
    for name, height, base in _BLOCKS:
        scene.add(_block(base, height, name), matte[_WHITE])
    scene.add(_downward(_LIGHT_X, _LIGHT_Z, "light"), _matte((0.78, 0.78, 0.78), "light", RADIANCE))
    scene.lights.append(_spot())
    eye = np.array([0.278, 0.273, -0.8])
    scene.cameras.append(Camera.look_at(eye, (0.278, 0.273, 0), yfov=np.radians(39.3077), near=0.1, name="cornell"))
    return scene


def _matte(color: tuple[float, float, float], name: str, emissive: tuple[float, float, float] = (0, 0, 0)) -> Material:
    return Material((*color, 1.0), roughness=1.0, specular=(0, 0, 0), emissive=emissive, name=name)


def _spot() -> Light:
    """Radiance times area along the axis, and nothing sideways: Lambert's cosine law, roughly."""
    (x0, x1), (z0, z1) = _LIGHT_X, _LIGHT_Z
    area = (x1 - x0) * (z1 - z0) / 1e6
    peak = max(RADIANCE)
    at = np.array([(x0 + x1) / 2, _HEIGHT - 1, (z0 + z1) / 2]) / 1000
    return Light(
        "spot",
        tuple(c / peak for c in RADIANCE),  # type: ignore[arg-type]
        peak * area,
        look_at(at, at - [0, 1, 0], (0, 0, 1)),
        inner_cone=0.0,
        outer_cone=float(np.pi / 2),
        name="light",
    )


def _rectangle(corners: object, name: str) -> Mesh:
    """Four corners in millimetres, counter-clockwise from the front."""
    p = np.asarray(corners, np.float64) / 1000
    facing = np.cross(p[1] - p[0], p[2] - p[0])
    normals = np.broadcast_to(facing / np.linalg.norm(facing), (4, 3))
    texcoords = np.array([[0, 1], [1, 1], [1, 0], [0, 0]])
    return Mesh(p, np.array([[0, 1, 2], [0, 2, 3]]), normals, texcoords, name=name)


def _ceiling() -> Mesh:
    """Eight of nine cells: the ninth is the light's. Whole edges meet, so there are no T-junctions."""
    xs, zs = (0.0, *_LIGHT_X, 556.0), (0.0, *_LIGHT_Z, 559.2)
    cells = [(xs[i : i + 2], zs[j : j + 2]) for j in range(3) for i in range(3) if (i, j) != (1, 1)]
    return merged([_downward(x, z, "") for x, z in cells], "ceiling")


def _downward(x: tuple[float, ...], z: tuple[float, ...], name: str) -> Mesh:
    """A rectangle in the plane of the ceiling that faces down."""
    return _rectangle([(a, _HEIGHT, b) for a, b in ((x[1], z[0]), (x[1], z[1]), (x[0], z[1]), (x[0], z[0]))], name)


def _block(base: object, height: float, name: str) -> Mesh:
    """Top and four sides over a base of (x, z) corners, counter-clockwise seen from above."""
    p: Array = np.asarray(base, np.float64)

    def at(i: int, y: float) -> tuple[float, float, float]:
        return float(p[i % 4, 0]), y, float(p[i % 4, 1])

    sides = [_rectangle([at(i, 0), at(i + 1, 0), at(i + 1, height), at(i, height)], "") for i in range(4)]
    return merged([_rectangle([at(i, height) for i in range(4)], ""), *sides], name)
