"""Visibility: against a plain double-precision test, against Embree, at shared edges, on bad triangles, through holes."""

import math

import numpy as np
import pytest

from luxel import jit
from luxel.errors import InputError
from luxel.radiosity.bvh import build
from luxel.radiosity.occlusion import occluded, prepare
from luxel.radiosity.rays import EmbreeOccluders, Occluders
from luxel.scene import Instance, Material, Mesh, Scene, Texture, TextureRef


def soup(rng, m, size=0.3):
    """Random triangles in the unit cube."""
    corners = (rng.random((m, 1, 3)) + size * (rng.random((m, 3, 3)) - 0.5)).astype(np.float32)
    return corners.reshape(-1, 3), np.arange(3 * m, dtype=np.int32).reshape(-1, 3)


def plain(positions, triangles, origins, targets):
    """Which segments cross a triangle, all with all, and how clear the case is (the least margin of what decides)."""
    c = positions[triangles].astype(np.float64)[None]
    o, d = origins[:, None], (targets - origins)[:, None]
    a, b, g = (c[:, :, k] - o for k in range(3))
    normal = np.cross(b - a, g - a)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    here, there = -(normal * a).sum(-1), -(normal * (a - d)).sum(-1)
    sides = np.stack([(d * np.cross(p, q)).sum(-1) for p, q in ((a, b), (b, g), (g, a))])
    inside = (sides > 0).all(0) | (sides < 0).all(0)
    clear = np.minimum(np.abs(sides).min((0, 2)), np.minimum(np.abs(here), np.abs(there)).min(1))
    return (inside & (here * there < 0)).any(1), clear


def test_it_is_what_every_triangle_says():
    rng = np.random.default_rng(3)
    positions, triangles = soup(rng, 200)
    origins, targets = rng.random((3000, 3)), rng.random((3000, 3))
    hidden, clear = plain(positions, triangles, origins, targets)
    seen = Occluders(positions, triangles).visible(origins, targets, 1)
    sure = clear > 1e-6
    assert sure.mean() > 0.9
    assert np.array_equal(seen[sure], ~hidden[sure])


def test_threads_direction_and_order_change_nothing():
    rng = np.random.default_rng(4)
    positions, triangles = soup(rng, 3000, 0.1)
    origins, targets = rng.random((5000, 3)), rng.random((5000, 3))
    occluders = Occluders(positions, triangles)
    seen = occluders.visible(origins, targets, 1)
    assert 0.05 < seen.mean() < 0.95
    assert np.array_equal(seen, occluders.visible(origins, targets, 3))
    assert np.array_equal(seen, occluders.visible(targets, origins))
    assert np.array_equal(seen, Occluders(positions, triangles[::-1]).visible(origins, targets))
    assert occluders.visible(origins[0], targets).shape == (5000,)
    assert occluders.visible(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


def test_embree_agrees():
    pytest.importorskip("embreex", reason="Embree's binding is not installed")
    rng = np.random.default_rng(5)
    positions, triangles = soup(rng, 17000, 0.05)
    origins, targets = rng.random((20000, 3)), rng.random((20000, 3))
    ours = Occluders(positions, triangles).visible(origins, targets)
    theirs = EmbreeOccluders(positions, triangles).visible(origins, targets, offset=0)
    assert np.mean(ours != theirs) < 2e-4  # single precision at borders
    assert np.array_equal(theirs, EmbreeOccluders(positions, triangles).visible(origins, targets, 1, offset=0))


def closed_surface(n):
    """A bumpy ball of 2 n^2 triangles whose neighbours share vertices."""
    theta, phi = np.linspace(0, np.pi, n + 1), np.linspace(0, 2 * np.pi, n, endpoint=False)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    radius = 1 + 0.2 * np.sin(5 * t) * np.sin(3 * p)
    points = (radius * np.array([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)])).reshape(3, -1).T.astype(np.float32)
    points[:n], points[-n:] = points[0], points[-1]
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    a, b, c, d = i * n + j, (i + 1) * n + j, (i + 1) * n + (j + 1) % n, i * n + (j + 1) % n
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)


def test_closed_surfaces_do_not_leak_at_edges_and_corners():
    """Segments from inside to outside exactly through vertices and through points of edges."""
    points, triangles = closed_surface(40)  # with needle and zero-area triangles at the poles
    rng = np.random.default_rng(6)
    k = rng.integers(0, len(triangles), 20000)
    weight = rng.random((len(k), 1)) * (rng.random((len(k), 1)) < 0.7)
    a, b = (points[triangles[k, c]].astype(np.float64) for c in (0, 1))
    through = a + weight * (b - a)
    occluders = Occluders(points, triangles)
    inside = np.tile([[0.01, 0.02, -0.03]], (len(k), 1))
    assert not occluders.visible(inside, inside + 3 * (through - inside)).any()
    grid = np.stack(np.meshgrid(*[np.arange(17.0)] * 2), -1).reshape(-1, 2).astype(np.float32)
    flat = np.concatenate([grid, np.full((len(grid), 1), 2, np.float32)], 1)
    i, j = (c.ravel() for c in np.meshgrid(np.arange(16), np.arange(16)))
    at = 17 * j + i
    faces = np.concatenate([np.stack([at, at + 1, at + 18], 1), np.stack([at, at + 18, at + 17], 1)])
    inner = rng.integers(1, 16, (2000, 2)) + rng.choice([0.0, 0.5], (2000, 2))
    ends = np.concatenate([inner, np.full((2000, 1), 2.0)], 1)
    ways = rng.normal((0, 0, 4), size=(2000, 3))
    assert not Occluders(flat, faces).visible(ends - ways, ends + ways).any()


def test_a_surface_does_not_hide_what_lies_on_it():
    points, triangles = closed_surface(30)
    rng = np.random.default_rng(7)
    k = rng.integers(60, len(triangles) // 2 - 60, 5000)
    weights = rng.dirichlet((1, 1, 1), len(k))[..., None]
    on = (points[triangles[k]].astype(np.float64) * weights).sum(1).astype(np.float32)  # rounded to either side
    a, b, c = (points[triangles[k, i]].astype(np.float64) for i in range(3))
    normal = np.cross(b - a, c - a)
    outward = normal * np.sign((normal * on).sum(1, keepdims=True))
    away = on + 1e-3 * outward / np.linalg.norm(outward, axis=1, keepdims=True)
    assert Occluders(points, triangles).visible(on, away).all()
    floor = np.array([[0.1, 0.7, 0.3], [9, 0.71, 0.3], [9, 0.72, 8], [0.1, 0.71, 8]], np.float32)
    cut = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    ends = (floor[cut[0]] * rng.dirichlet((1, 1, 1), 1000)[..., None]).sum(1)
    assert Occluders(floor, cut).visible(ends[:500], ends[500:] + np.array([0, 1e-4, 0])).all()  # grazing


def test_bad_triangles_hide_nothing_and_break_nothing():
    positions, triangles = soup(np.random.default_rng(8), 20)
    good = Occluders(positions, triangles)
    bad = np.concatenate([positions, [[np.nan] * 3, [np.inf, 0, 0], [0.5] * 3, [0.6] * 3, [0.7] * 3]]).astype(np.float32)
    extra = np.array([[60, 1, 2], [61, 3, 4], [62, 62, 62], [62, 63, 64], [5, 5, 6]], np.int32)
    rng = np.random.default_rng(9)
    origins, targets = rng.random((500, 3)), rng.random((500, 3))
    assert np.array_equal(good.visible(origins, targets), Occluders(bad, np.concatenate([triangles, extra])).visible(origins, targets))
    assert Occluders(np.zeros((0, 3)), np.zeros((0, 3), np.int32)).visible(origins, targets).all()
    assert good.visible(origins, origins).all()
    same = np.tile(triangles[:1], (200, 1))  # one place, many times
    hidden, clear = plain(positions, triangles[:1], origins, targets)
    assert np.array_equal(Occluders(positions, same).visible(origins, targets)[clear > 1e-6], ~hidden[clear > 1e-6])
    with pytest.raises(InputError, match=r"vertices 0 \.\. 59"):
        Occluders(positions, extra)


def test_skipped_triangles_and_kernels():
    wall = np.array([[-1, -1, 1], [2, -1, 1], [-1, 2, 1]], np.float32)
    scene = prepare(wall, np.array([[0, 1, 2]], np.int32))
    assert occluded(scene, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, -1, -1)
    assert not occluded(scene, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0, -1)
    assert not occluded(scene, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, -1, 0)
    assert not occluded(scene, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, -1, -1)
    seen = Occluders(wall, [[0, 1, 2]]).visible([[0, 0, 0]] * 2, [[0, 0, 2]] * 2, skip=np.array([[0, -1], [-1, -1]]))
    assert seen.tolist() == [True, False]

    @jit.kernel
    def count(scene, ends):
        hidden = 0
        for i in range(len(ends)):
            hidden += occluded(scene, 0.0, 0.0, 0.0, ends[i, 0], ends[i, 1], 2.0, -1, -1)
        return hidden

    assert count(scene, np.array([[0.0, 0.0], [0.1, 0.2], [9.0, 9.0]])) == 2


def test_masked_surfaces_cast_their_holes():
    alpha = np.zeros((4, 4, 4), np.uint8)
    alpha[..., 3] = np.kron([[255, 0], [0, 255]], np.ones((2, 2)))
    square = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], np.float32)
    coordinates = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    leaf = Material(alpha_mode="MASK", base_color_texture=TextureRef(0, scale=(1, 1)), base_color=(1, 1, 1, 1))
    mesh = Mesh(square, [[0, 1, 2], [0, 2, 3]], texcoords=coordinates, material=0)

    def seen(material, filtering="nearest"):
        scene = Scene(meshes=[mesh], instances=[Instance(0)], materials=[material], textures=[Texture(alpha, filter=filtering)])
        places = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]])
        ends = np.concatenate([places, np.full((4, 1), 2.0)], 1)
        return Occluders.of_scene(scene).visible(ends * (1, 1, 0), ends).tolist()

    assert seen(leaf) == seen(leaf, "bilinear") == [False, True, True, False]
    leaf.alpha_mode = "OPAQUE"
    assert seen(leaf) == [False] * 4
    leaf.alpha_mode = "MASK"
    leaf.base_color_texture = TextureRef(0, offset=(0.5, 0), scale=(1, 1))  # repeats
    assert seen(leaf) == [True, False, False, True]
    leaf.base_color_texture = TextureRef(0, rotation=math.pi / 2)
    turned = seen(leaf)
    leaf.base_color_texture = None
    assert seen(leaf) == [False] * 4
    leaf.base_color = (1, 1, 1, 0.25)
    assert seen(leaf) == [True] * 4
    assert turned == [True, False, False, True]


def test_the_hierarchy_holds_everything_once():
    rng = np.random.default_rng(10)
    low = rng.normal(size=(5000, 3)).astype(np.float32) * np.float32(10.0) ** rng.integers(-30, 30, (5000, 1)).astype(np.float32)
    high = low + np.abs(low) * np.float32(0.1)
    boxes = build(low, high)
    assert sorted(boxes.order) == list(range(5000))
    leaves = boxes.link[boxes.link[:, 1] > 0, 1]
    assert np.array_equal(np.cumsum(np.r_[0, leaves & 7])[:-1], leaves >> 3)
    for node, (skip, leaf) in enumerate(boxes.link):
        inside = boxes.link[node:skip, 1]
        first = (inside[inside > 0] >> 3).min()
        items = boxes.order[first : first + (inside & 7).sum()]
        assert (low[items] >= boxes.box[node, :3]).all()
        assert (high[items] <= boxes.box[node, 3:]).all()
        assert node < skip <= len(boxes.link)
        if leaf:
            assert skip == node + 1


