"""Cameras: what cannot be one is named, and a look along `up` has a picture too."""

import numpy as np
import pytest

from luxel.errors import InputError
from luxel.scene import Camera
from luxel.scene.builtin import box
from luxel.scene.framing import frame
from luxel.scene.scene import Scene


@pytest.mark.parametrize(
    "wrong",
    [
        {"world_from_camera": np.zeros((4, 4))},
        {"world_from_camera": np.full((4, 4), np.nan)},
        {"aspect": 0.0},
        {"aspect": -1.0},
        {"aspect": np.nan},
        {"near": np.nan},
        {"near": 0.0},
        {"yfov": 4.0},
        {"yfov": None, "far": 3.0, "near": -np.inf},
        {"yfov": None, "far": 3.0, "height": np.inf},
        {"yfov": None},
    ],
)
def test_wrong_cameras_are_named(wrong):
    with pytest.raises(InputError, match="expected"):
        Camera(**wrong)


@pytest.mark.parametrize("direction", [(0, 1, 0), (0, -1, 0), (1, 0, 0), (0, 0, -1), (1, 1, 1), (-1, 1, -1)])
def test_a_look_along_up_is_a_rotation(direction):
    matrix = Camera.look_at(direction, (0, 0, 0), up=direction).world_from_camera[:3, :3]
    np.testing.assert_allclose(matrix.T @ matrix, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1)


def test_a_look_straight_down_is_that_of_a_framed_camera():
    framed = frame(Scene.from_mesh(box()), azimuth=0.0, elevation=np.pi / 2)
    placed = Camera.look_at((0, 5, 0), (0, 0, 0))
    np.testing.assert_allclose(placed.world_from_camera[:3, :3], framed.world_from_camera[:3, :3], atol=1e-12)
