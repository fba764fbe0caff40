"""The paper's two rooms: their counts, and that nothing in them leaks, coincides or overlaps."""

import numpy as np
import pytest

from luxel.errors import InputError
from luxel.radiosity.luxels import find_luxels
from luxel.radiosity.rays import Occluders
from luxel.radiosity.unwrap import unwrap
from luxel.scene.builtin import SCENES, blocks, charted, paper_rooms

ROOMS = {"room-simple": (paper_rooms.study, 1_602, 14_445, 2), "room-complex": (paper_rooms.flat, 8_549, 86_077, 6)}
_NEAR = 1e-5  # metres


@pytest.fixture(scope="module", params=ROOMS)
def room(request):
    scene = SCENES[request.param]()
    atlas = unwrap(scene)
    return request.param, scene, atlas, find_luxels(atlas)


def test_counts_are_the_papers(room):
    name, scene, atlas, luxels = room
    _, faces, count, lights = ROOMS[name]
    assert scene.triangle_count == 2 * faces
    assert sum(len(mesh.positions) for mesh in scene.meshes) == 4 * faces
    assert len(luxels.area) == count
    assert (atlas.reused, atlas.pages) == (True, 1)
    glowing = [material.name for material in scene.materials if any(material.emissive)]
    assert glowing == ["light"]
    charts = atlas.chart[np.concatenate([np.full(len(m.triangles), scene.materials[m.material].name == "light") for m in scene.meshes])]
    assert len(np.unique(charts)) == lights
    assert not scene.lights
    assert scene.ambient is None


def test_luxels_are_whole_and_nearly_square(room):
    _, scene, _, luxels = room
    assert luxels.coverage.min() > 1 - 1e-6
    assert not len(luxels.contested)
    surface = sum(float(np.linalg.norm(np.cross(r.right, r.up))) for r in ROOMS[scene.name][0]())
    assert luxels.area.sum(dtype=float) == pytest.approx(surface, rel=1e-5)
    side = np.sqrt(luxels.area)  # metres; slender legs and edges have smaller ones
    alike = np.abs(side / np.median(side) - 1) < 0.12
    assert luxels.area[alike].sum() > 0.9 * luxels.area.sum()


def test_nothing_escapes(room):
    _, scene, atlas, luxels = room
    rng = np.random.default_rng(1)
    chosen = rng.integers(0, len(luxels.area), 20_000)
    ways = rng.normal(size=(len(chosen), 3))
    ways *= np.sign((ways * luxels.normal[chosen]).sum(1))[:, None] / np.linalg.norm(ways, axis=1)[:, None]
    start = luxels.position[chosen] + 1e-3 * luxels.normal[chosen]
    assert not Occluders.of_scene(atlas.scene).visible(start, start + 50.0 * ways, 2).any()
    low, high = scene.bounds()
    for camera in scene.cameras:
        assert (low < camera.eye).all()
        assert (camera.eye < high).all()


@pytest.mark.parametrize("name", ROOMS)
def test_no_face_coincides_with_another_or_cuts_it(name):
    assert not clashes(ROOMS[name][0]())


def test_clashes_are_found():
    block = blocks.block((0, 0, 0), (1, 1, 1), "wood")
    assert not clashes(block + blocks.block((1, 0, 0), (2, 1, 1), "wood", "west"))
    assert clashes(block + blocks.block((0.2, 1, 0.2), (0.8, 2, 0.8), "wood", ""))  # its underside lies on the first's top
    assert clashes(block + blocks.placed(block, 0.5, 0.5, 30, 0.5))


def clashes(pieces):
    """Pairs of rectangles that overlap in one plane, or of which an edge of one goes through the other."""
    corner, right, up = (np.array([getattr(p, name) for p in pieces]) for name in ("corner", "right", "up"))
    corners = np.stack([corner, corner + right, corner + right + up, corner + up], 1)
    wide, tall = np.linalg.norm(right, axis=1), np.linalg.norm(up, axis=1)
    frames = np.stack([right / wide[:, None], up / tall[:, None], np.cross(right / wide[:, None], up / tall[:, None])], 1)
    found = []
    for i in range(len(pieces)):
        x, y, z = np.moveaxis((corners - corner[i]) @ frames[i].T, -1, 0)
        flat = np.flatnonzero((np.abs(z) < _NEAR).all(1))
        found += [(i, j) for j in flat if j != i and _overlap(corners[i], corners[j], [*frames[i, :2], *frames[j, :2]])]
        for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)):
            through = np.flatnonzero((z[:, a] * z[:, b] < 0) & (np.minimum(np.abs(z[:, a]), np.abs(z[:, b])) > _NEAR))
            t = z[through, a] / (z[through, a] - z[through, b])
            at = [v[through, a] + t * (v[through, b] - v[through, a]) for v in (x, y)]
            inside = (at[0] > _NEAR) & (at[0] < wide[i] - _NEAR) & (at[1] > _NEAR) & (at[1] < tall[i] - _NEAR)
            found += [(i, j) for j in through[inside]]
    return found


def _overlap(one, other, axes):
    """Of convex shapes in a plane: no axis separates them."""
    return all((one @ axis).max() > (other @ axis).min() + _NEAR and (other @ axis).max() > (one @ axis).min() + _NEAR for axis in axes)


@pytest.mark.parametrize("total", [6, 7, 50, 1_001])
def test_even_cuts_meet_the_total(total):
    sides = np.array([[4, 3], [4, 3], [3, 1], [2, 0.1], [1, 1], [0.05, 0.05]])
    cells = charted.even_cuts(sides, total)
    assert cells.prod(1).sum() == total
    assert cells.min() >= 1


def test_even_cuts_that_cannot_be():
    with pytest.raises(InputError, match="2 rectangles"):
        charted.even_cuts(np.ones((2, 2)), 1)
