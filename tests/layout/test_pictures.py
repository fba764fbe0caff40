"""Pictures of an order: colours by place and by misses, in the order of the triangles, of all instances."""

import numpy as np

import luxel
from luxel import Mesh, Scene
from luxel.layout import batch, misses, order
from luxel.layout.pictures import colored, missed_of, picture, place_colors
from luxel.scene.builtin import torus

TORUS = torus(segments=24, sides=12)


def test_places_go_from_blue_to_red():
    colors = place_colors(1000)
    assert colors.shape == (1000, 3)
    assert (colors >= 0).all()
    assert (colors <= 255).all()
    assert colors[100].argmax() == 2
    assert colors[500].argmax() == 1
    assert colors[900].argmax() == 0
    assert np.abs(np.diff(colors, axis=0)).max() < 3  # no jump
    assert place_colors(0).shape == (0, 3)
    assert place_colors(1).shape == (1, 3)


def test_misses_are_those_of_each_instance():
    scene = Scene()
    scene.add(TORUS)
    scene.add(TORUS, world_from_mesh=np.diag([2.0, 2, 2, 1]))
    alone = misses(TORUS.triangles, 12)
    assert (missed_of(scene) == np.concatenate([alone, alone])).all()
    assert (missed_of(scene, profile="amd")[: len(alone)] == batch.misses(TORUS.triangles, "amd")).all()
    assert len(missed_of(Scene())) == 0


def test_each_triangle_has_its_color():
    """Seen from the front, without light: every pixel of a square has the colour of its triangle."""
    square = Mesh(np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.int32([[0, 1, 2], [0, 2, 3]]))
    made = colored(Scene.from_mesh(square), np.array([[255, 0, 0], [0, 0, 255.0]]))
    drawn = luxel.render(made, luxel.frame(made, azimuth=0, elevation=0, size=(40, 40)), (40, 40), shading="unlit").color
    assert set(map(tuple, np.unique(drawn[drawn[..., 3] > 0][:, :3], axis=0).tolist())) == {(255, 0, 0), (0, 0, 255)}
    assert tuple(drawn[30, 30, :3]) == (255, 0, 0)  # below the diagonal


def test_four_views_with_captions():
    shuffled = Mesh(TORUS.positions, np.random.default_rng(0).permutation(TORUS.triangles))
    laid = Mesh(TORUS.positions, order(shuffled.triangles, order="tipsify").triangles)
    told = []
    image = picture(*map(Scene.from_mesh, (shuffled, laid)), size=(160, 120), progress=told.append)
    assert image.shape == (300, 320, 3)
    assert image.dtype == np.uint8
    assert told == [0.25, 0.5, 0.75, 1]
    red = [(image[180:, part, 0].astype(int) - image[180:, part, 1] > 60).sum() for part in (slice(160), slice(160, None))]
    assert red[0] > 10 * (red[1] + 1)  # three misses before, few after


def test_nothing_to_see():
    image = picture(Scene(), Scene(), size=(32, 24))
    assert image.shape == (108, 64, 3)
