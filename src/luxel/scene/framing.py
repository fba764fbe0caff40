"""Cameras that show a whole scene: framed tightly from a direction, and all around it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.scene.camera import Camera
from luxel.scene.checks import number, numbers
from luxel.scene.scene import Scene
from luxel.scene.transforms import mapped, rotation, translation

AZIMUTH = float(np.radians(30.0))
ELEVATION = float(np.radians(20.0))
YFOV = float(np.radians(40.0))
MARGIN = 0.05  # of the half picture, left free on each side
_CHUNK = 1 << 19  # points at a time: a mesh of millions is never copied whole


def camera_for(scene: Scene, size: tuple[int, int]) -> Camera:
    """The scene's first camera, or one framed for a picture of `size` (width, height) when it has none."""
    return scene.cameras[0] if scene.cameras else frame(scene, size=size)


def frame(
    scene: Scene,
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    distance: float | None = None,
    yfov: float | None = YFOV,
    size: tuple[int, int] = (1280, 720),
    *,
    height: float | None = None,
    up: object = (0.0, 1.0, 0.0),
    margin: float = MARGIN,
) -> Camera:
    """A camera that looks at the scene from a direction and fits it.

    Seen from that direction every vertex is inside the picture and no camera can be nearer: the fit is exact, by the
    four planes of the frustum, and not by a bounding sphere. An empty scene is framed as one of radius 1 at the origin.

    Args:
        scene: What to show.
        azimuth: Radians around `up`, counter-clockwise from above; 0 looks from +z (with `up` +z: from -y).
        elevation: Radians above the horizon, -pi/2 .. pi/2.
        distance: Metres from the middle of the scene's bounds, at which the camera then looks; None fits the scene.
        yfov: Radians of vertical field of view; None makes an orthographic camera.
        size: Width and height of the picture; its shape matters.
        height: Metres that an orthographic picture is high; None fits the scene.
        up: (3,) what is up in the scene.
        margin: Part of the picture left free on each side, 0 <= margin < 1.

    Raises:
        InputError: It is no Scene, or an angle, the distance, the size, the margin or a length is no number or out of range.
    """
    _check(scene, azimuth, elevation, distance, size, margin)
    turn = _upright(up) @ rotation((0, 1, 0), azimuth) @ rotation((1, 0, 0), -elevation)
    points = _points(scene, turn[:3, :3])
    slope = _slope(yfov, size, margin)
    eye, depth, tall = _fit(points, slope, yfov is None)
    if distance is not None:
        middle = scene.bounds().mean(0) @ turn[:3, :3]
        eye = middle + np.array([0.0, 0.0, distance])
    return _camera(turn, eye, depth, yfov, height or tall)


def turntable(
    scene: Scene,
    count: int,
    azimuth: float = AZIMUTH,
    elevation: float = ELEVATION,
    distance: float | None = None,
    yfov: float | None = YFOV,
    size: tuple[int, int] = (1280, 720),
    *,
    height: float | None = None,
    up: object = (0.0, 1.0, 0.0),
    margin: float = MARGIN,
) -> list[Camera]:
    """`count` cameras evenly around the scene, the first at `azimuth`; arguments as for `frame`.

    All keep one height and one distance from the upright axis through the middle of the bounds, at which whatever the
    scene sweeps while it turns is in the picture: it neither jumps nor swells from one to the next.

    Raises:
        InputError: As of `frame`, or the count is no whole number of at least 1.
    """
    if not isinstance(count, (int, np.integer)) or count < 1:
        raise InputError(f"turntable: expected a whole number of views, at least 1, got {count!r}")
    _check(scene, azimuth, elevation, distance, size, margin)
    stand = _upright(up)
    middle = scene.bounds().mean(0) @ stand[:3, :3]
    tilt = rotation((1, 0, 0), -elevation)
    swept = [ring @ tilt[:3, :3] for ring in _swept(scene, stand[:3, :3], middle)]
    eye, depth, tall = _fit(swept, _slope(yfov, size, margin), yfov is None)
    if distance is not None:
        eye = np.array([0.0, 0.0, distance])
    angles = azimuth + 2 * np.pi * np.arange(count) / count
    turns = [stand @ translation(middle) @ rotation((0, 1, 0), angle) @ tilt for angle in angles]
    return [_camera(turn, eye, depth, yfov, height or tall) for turn in turns]


def _check(scene: Scene, azimuth: float, elevation: float, distance: float | None, size: tuple[int, int], margin: float) -> None:
    if not isinstance(scene, Scene):
        raise InputError(f"scene: expected a Scene, as luxel.load gives, got {type(scene).__name__}")
    number(azimuth, "azimuth")
    number(elevation, "elevation")
    if not abs(elevation) <= np.pi / 2 + 1e-9:
        raise InputError(f"elevation: expected radians of -pi/2 .. pi/2, got {elevation}")
    if distance is not None:
        number(distance, "distance", above=0)
    numbers(size, 2, "size")
    if min(size) < 1:
        raise InputError(f"size: expected width and height of at least 1, got {size}")
    number(margin, "margin")
    if not 0 <= margin < 1:
        raise InputError(f"margin: expected 0 <= margin < 1, got {margin}")


def _upright(up: object) -> Array:
    """(4, 4): the shortest turn that takes +y to `up`."""
    to = checked(up, (3,), np.float64, "up")
    length = np.linalg.norm(to)
    if not (np.isfinite(length) and length > 0):
        raise InputError(f"up: expected a finite vector that is not zero, got {to}")
    to = to / length
    axis = np.cross((0.0, 1.0, 0.0), to)
    if np.linalg.norm(axis) < 1e-12:
        axis = np.array([1.0, 0.0, 0.0])
    return rotation(axis, float(np.arctan2(np.linalg.norm(np.cross((0.0, 1.0, 0.0), to)), to[1])))


def _slope(yfov: float | None, size: tuple[int, int], margin: float) -> Array:
    """(2,): how far right and up the picture reaches at distance 1, less the margin."""
    if yfov is not None and not 0 < yfov < np.pi:
        raise InputError(f"yfov: expected radians between 0 and pi, got {yfov}")
    tall = 1.0 if yfov is None else np.tan(yfov / 2)
    return np.array([tall * size[0] / size[1], tall]) * (1 - margin)


def _points(scene: Scene, axes: Array) -> Iterator[Array]:
    """The scene's vertices along the columns of `axes`, (k, 3) at a time."""
    for instance in scene.instances:
        mesh = scene.meshes[instance.mesh]
        if not len(mesh.triangles):
            continue
        assert instance.world_from_mesh is not None
        linear = instance.world_from_mesh[:3, :3].T @ axes
        offset = instance.world_from_mesh[:3, 3] @ axes
        for start in range(0, len(mesh.positions), _CHUNK):
            points = mapped(mesh.positions[start : start + _CHUNK], linear) + offset
            if not np.isfinite(points.sum()):
                points = points[np.isfinite(points).all(1)]
            yield points


def _swept(scene: Scene, axes: Array, middle: Array, bins: int = 256, around: int = 48) -> list[Array]:
    """Points around the solid that the scene sweeps when it turns about the upright axis through `middle`."""
    chunks = [p - middle for p in _points(scene, axes)]
    if not sum(map(len, chunks)):
        return []
    low = min(p[:, 1].min() for p in chunks if len(p))
    high = max(p[:, 1].max() for p in chunks if len(p))
    radius = np.full(bins, -1.0)
    for p in chunks:
        row = np.minimum(bins * (p[:, 1] - low) / max(high - low, 1e-300), bins - 1).astype(int)
        np.maximum.at(radius, row, np.hypot(p[:, 0], p[:, 2]))
    edges = np.linspace(low, high, bins + 1)
    used = radius >= 0
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    wide = radius[used] / np.cos(np.pi / around)  # a polygon around the circle, not in it
    x, z = np.outer(wide, np.cos(angle)), np.outer(wide, np.sin(angle))
    return [
        np.stack([x, np.broadcast_to(y[used, None], x.shape), z], -1).reshape(-1, 3) for y in (edges[:-1], edges[1:])
    ]


def _fit(parts: Iterable[Array], slope: Array, parallel: bool) -> tuple[Array, tuple[float, float], float]:
    """The nearest eye from which all points are in the picture.

    A frustum's side plane through the eye c holds all points when x + s z <= c_x + s c_z; two opposite sides give the
    least c_z and, at half way, c_x. The taller of the two demands wins.

    Args:
        parts: (k, 3) points along right, up and back.
        slope: (2,) of the sides.
        parallel: The sides are parallel: `slope` then is only the shape of the picture.

    Returns:
        The eye (3,), the range of the points along z, and the height of an orthographic picture.
    """
    lean = np.zeros(2) if parallel else slope
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    least, most = low[:2], high[:2]
    for p in parts:
        if len(p):
            low, high = np.minimum(low, p.min(0)), np.maximum(high, p.max(0))
            least = np.minimum(least, (p[:, :2] - lean * p[:, 2:]).min(0))
            most = np.maximum(most, (p[:, :2] + lean * p[:, 2:]).max(0))
    if not np.isfinite(low).all():  # nothing to show: as if it were a ball of radius 1
        low, high, least, most = np.full(3, -1.0), np.full(3, 1.0), -1 - lean, 1 + lean
    extent = (high - low).max()
    pad = 1e-3 * extent if extent > 0 else max(1e-3 * np.abs(high).max(), 1.0)  # a lone point has some size too
    rear, front = low[2] - pad, high[2] + pad
    least, most = least - pad, most + pad
    half = ((most - least) / (2 * slope)).max()
    back = front + max(front - rear, half) if parallel else max(half, front)
    return np.array([*(most + least) / 2, back]), (front, rear), float(2 * half)


def _camera(turn: Array, eye: Array, depth: tuple[float, float], yfov: float | None, height: float) -> Camera:
    """The camera at `eye` in the axes of `turn`; near is half way to the nearest point, or close to the eye."""
    pose = turn @ translation(eye)
    nearest, farthest = eye[2] - depth[0], eye[2] - depth[1]
    if yfov is None:
        return Camera(pose, yfov=None, height=height, near=min(0.0, nearest), far=max(2 * farthest, nearest + height))
    return Camera(pose, yfov=yfov, near=float(max(0.5 * nearest, 1e-4 * max(abs(farthest), abs(nearest)))))
