"""Framing: everything is in the picture, and no picture could be tighter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.scene import Mesh, Scene
from luxel.scene.builtin import box, cornell_box, torus
from luxel.scene.framing import MARGIN, camera_for, frame, turntable
from luxel.scene.transforms import rotation, scaling, translation

SIZES = [(1280, 720), (500, 500), (300, 900)]


def on_picture(camera, scene, size):
    """Picture coordinates -1..1 and the distance along the view of every vertex."""
    points = []
    for instance in scene.instances:
        p = scene.meshes[instance.mesh].positions.astype(float)
        points.append(p @ instance.world_from_mesh[:3, :3].T + instance.world_from_mesh[:3, 3])
    points = np.concatenate(points)
    clip = np.c_[points, np.ones(len(points))] @ camera.clip_from_world(size).T
    away = -((np.c_[points, np.ones(len(points))] @ np.linalg.inv(camera.world_from_camera).T)[:, 2])
    return clip[:, :2] / clip[:, 3:], away


def placed(mesh, matrix):
    scene = Scene()
    scene.add(mesh, world_from_mesh=matrix)
    return scene


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("yfov", [0.2, 0.7, 2.0, None])
def test_frame_is_tight(size, yfov):
    scene = placed(torus(), translation((5, -3, 40)) @ rotation((1, 2, 3), 1.0) @ scaling((1, 3, 0.5)))
    camera = frame(scene, 0.9, -0.4, yfov=yfov, size=size)
    xy, away = on_picture(camera, scene, size)
    assert (away > camera.near).all()
    reach = np.abs(xy).max(0)
    assert reach.max() <= 1 - MARGIN + 1e-6
    assert reach.max() > 0.985 * (1 - MARGIN)  # one direction fills the picture
    full = reach.argmax()
    assert xy[:, full].max() == pytest.approx(-xy[:, full].min(), rel=0.02)  # from edge to edge


@settings(max_examples=60, deadline=None)
@given(st.floats(-7, 7), st.floats(-np.pi / 2, np.pi / 2), st.floats(-6, 6), st.integers(0, 2**31))
def test_frame_holds_any_cloud(azimuth, elevation, magnitude, seed):
    rng = np.random.default_rng(seed)
    p = (rng.normal(size=(30, 3)) * 10.0**magnitude + rng.normal(size=3)).astype(np.float32)
    scene = Scene.from_mesh(Mesh(p, np.arange(30).reshape(-1, 3)))
    size = SIZES[seed % 3]
    camera = frame(scene, azimuth, elevation, size=size)
    xy, away = on_picture(camera, scene, size)
    assert (away > camera.near).all()
    assert np.abs(xy).max() <= 1 - MARGIN + 1e-5


def test_azimuth_and_elevation_name_the_direction():
    scene = Scene.from_mesh(box())
    for azimuth, elevation, towards in [
        (0, 0, (0, 0, 1)),
        (np.pi / 2, 0, (1, 0, 0)),
        (0.3, np.pi / 2, (0, 1, 0)),
        (0, -np.pi / 2, (0, -1, 0)),
    ]:
        camera = frame(scene, azimuth, elevation)
        np.testing.assert_allclose(camera.world_from_camera[:3, 2], towards, atol=1e-12)
    straight_down = frame(scene, 0.3, np.pi / 2).world_from_camera[:3, 0]
    np.testing.assert_allclose(straight_down, (np.cos(0.3), 0, -np.sin(0.3)), atol=1e-12)  # azimuth still turns it


def test_up_z_looks_from_the_front_of_a_cad_model():
    camera = frame(Scene.from_mesh(box()), 0, 0, up=(0, 0, 1))
    np.testing.assert_allclose(camera.world_from_camera[:3, :3].T, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)


def test_distance_is_from_the_middle():
    scene = placed(box(), translation((1, 2, 3)))
    camera = frame(scene, 0.4, 0.2, distance=7.0)
    np.testing.assert_allclose(np.linalg.norm(camera.eye - [1, 2, 3]), 7.0)
    inside = frame(scene, distance=0.01)
    assert 0 < inside.near < 0.01


def test_orthographic_height():
    camera = frame(Scene.from_mesh(box((1, 2, 1))), 0, 0, yfov=None, size=(100, 100), margin=0)
    assert camera.height == pytest.approx(2.0, rel=5e-3)
    assert frame(Scene.from_mesh(box()), yfov=None, height=9.0).height == 9.0


@pytest.mark.parametrize("yfov", [0.7, None])
@pytest.mark.parametrize("points", [[], [(0, 0, 0)], [(5, 6, 7)], [(0, 0, 0), (0, 0, 1)]])
def test_degenerate_scenes(points, yfov):
    p = np.array(points, np.float32).reshape(-1, 3)
    triangles = np.zeros((1 if points else 0, 3), int)
    if len(p) > 1:
        triangles[0, 2] = 1
    scene = Scene.from_mesh(Mesh(p, triangles))
    for camera in [frame(scene, 0, 0, yfov=yfov), *turntable(scene, 3, yfov=yfov)]:
        assert np.isfinite(camera.world_from_camera).all()
        xy, away = on_picture(camera, scene, (1280, 720))
        assert (away >= camera.near).all()
        assert (away <= camera.far).all()
        assert np.abs(xy).max(initial=0) < 1
    assert np.isfinite(frame(Scene()).world_from_camera).all()


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1)])
@pytest.mark.parametrize("yfov", [0.7, None])
def test_turntable_keeps_everything_in_all_views(up, yfov):
    scene = placed(box((4, 1, 0.5)), translation((3, 1, 0)) @ rotation((0, 1, 1), 0.3))
    cameras = turntable(scene, 12, 0.2, 0.5, yfov=yfov, size=(400, 300), up=up)
    assert len(cameras) == 12
    reach = []
    for camera in cameras:
        xy, away = on_picture(camera, scene, (400, 300))
        assert (away > camera.near).all()
        reach.append(np.abs(xy).max())
    assert max(reach) <= 1 - MARGIN + 1e-6
    assert max(reach) > 0.9
    middle = scene.bounds().mean(0)
    axis = np.array(up, float)
    heights = [axis @ (c.eye - middle) for c in cameras]
    distances = [np.linalg.norm(c.eye - middle) for c in cameras]
    np.testing.assert_allclose(heights, heights[0])
    np.testing.assert_allclose(distances, distances[0])
    first, second = ((c.eye - middle) - axis * (axis @ (c.eye - middle)) for c in cameras[:2])
    angle = np.arccos(first @ second / np.linalg.norm(first) / np.linalg.norm(second))
    assert angle == pytest.approx(2 * np.pi / 12)


def test_camera_for_prefers_the_scene():
    scene = cornell_box()
    assert camera_for(scene, (64, 64)) is scene.cameras[0]
    scene.cameras.clear()
    assert camera_for(scene, (64, 64)).yfov == frame(scene).yfov


@pytest.mark.parametrize(
    "wrong",
    [{"elevation": 2.0}, {"azimuth": np.nan}, {"distance": 0.0}, {"size": (0, 5)}, {"yfov": 4.0}, {"up": (0, 0, 0)}],
)
def test_wrong_values_are_named(wrong):
    with pytest.raises(InputError, match="expected"):
        frame(Scene.from_mesh(box()), **wrong)
    with pytest.raises(InputError, match="expected"):
        turntable(Scene.from_mesh(box()), 4, **wrong)


def test_turntable_needs_a_view():
    with pytest.raises(InputError, match="at least 1"):
        turntable(Scene(), 0)


def test_a_scene_is_asked_for():
    with pytest.raises(InputError, match=r"expected a Scene.*got tuple"):
        frame((np.zeros((3, 3)), [[0, 1, 2]]))
