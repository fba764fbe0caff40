"""Depth, ids, normals, positions, ... against closed forms."""

import numpy as np
import pytest
from scenes import UNLIT, around, flat_camera, flat_mesh, instance, rectangle, room

import luxel
from luxel import Camera, Material, Mesh, Scene
from luxel.raster.constants import sample_pattern
from luxel.raster.outputs import SHAPES

SIZE = 90, 70
EVERYTHING = ("color", "linear", *SHAPES)


def rays(camera, size, sample=(0.5, 0.5)):
    """Origins and directions (h, w, 3) of the rays through the pixels' samples; a direction is one metre long along the axis."""
    x, y = np.meshgrid(np.arange(size[0]) + sample[0], np.arange(size[1]) + sample[1])
    x, y = x / size[0] * 2 - 1, 1 - y / size[1] * 2
    aspect = camera.aspect or size[0] / size[1]
    turn, eye = camera.world_from_camera[:3, :3], camera.eye
    if camera.yfov is None:
        return eye + np.stack([x * camera.height / 2 * aspect, y * camera.height / 2, 0 * x], -1) @ turn.T, -turn[:, 2] + np.zeros((*x.shape, 3))
    half = np.tan(camera.yfov / 2)
    return eye + np.zeros((*x.shape, 3)), np.stack([x * half * aspect, y * half, -np.ones_like(x)], -1) @ turn.T


def slanted(seed=0, count=1):
    """Large triangles at all angles, with all attributes; front and back are drawn."""
    rng = np.random.default_rng(seed)
    n = 3 * count
    mesh = Mesh(rng.uniform(-2, 2, (n, 3)), np.arange(n).reshape(-1, 3), normals=rng.normal(size=(n, 3)), texcoords=rng.uniform(-1, 2, (n, 2)))
    return Scene.from_mesh(mesh, Material(**UNLIT))


def meet(scene, triangle, origin, way):
    """Distance (h, w) along the axis and barycentric coordinates (h, w, 3) where rays meet the plane of each pixel's triangle."""
    mesh = scene.meshes[0]
    corners = mesh.positions[mesh.triangles[np.maximum(triangle, 0)]].astype(np.float64)
    a, u, v = corners[..., 0, :], corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    normal = np.cross(u, v)
    along = ((a - origin) * normal).sum(-1) / (way * normal).sum(-1)
    q = origin + along[..., None] * way - a
    area = (normal * normal).sum(-1)
    b1, b2 = (np.cross(q, v) * normal).sum(-1) / area, (np.cross(u, q) * normal).sum(-1) / area
    return along, np.stack([1 - b1 - b2, b1, b2], -1)


CAMERAS = {
    "perspective": around(0.3, 5.0, yfov=0.9, near=0.1),
    "inside": Camera.look_at([0.1, 0.2, 0.1], [1, 0, 0.5], yfov=1.4, near=0.05),
    "orthographic": around(1.3, 5.0, yfov=None, height=4.0, near=0.0, far=10.0),
    "wide": around(0.3, 5.0, yfov=0.9, near=0.1, far=40.0, aspect=2.0),
}


def bounds(scene, camera, picture, sample):
    """Least and largest value of each output within 1/512 pixel of the sample, and where the pixel's triangle is in front all over there.

    Corners snap to within 1/512 pixel, so what a sample shows is exactly what lies so near to it (a linear-fractional function of the
    place, whose extremes are at the corners of a box).
    """
    mesh, found = scene.meshes[0], []
    corners = mesh.triangles[np.maximum(picture.triangle, 0)]
    for dx in (-1 / 511, 1 / 511):
        for dy in (-1 / 511, 1 / 511):
            along, weights = meet(scene, picture.triangle, *rays(camera, SIZE, (sample[0] + dx, sample[1] + dy)))
            values = {name: np.einsum("hwc,hwcd->hwd", weights, array[corners].astype(np.float64))
                      for name, array in (("normal", mesh.normals), ("texcoord", mesh.texcoords), ("position", mesh.positions))}  # fmt: skip
            found.append({"depth": along[..., None], "barycentric": weights, **values})
    names = found[0]
    extremes = {name: tuple(pick([f[name] for f in found], 0) for pick in (np.min, np.max)) for name in names}
    return extremes, (picture.triangle >= 0) & (extremes["depth"][0][..., 0] > 0)


@pytest.mark.parametrize("samples", [1, 8])
@pytest.mark.parametrize("name", CAMERAS)
def test_geometry_against_rays(name, samples):
    camera, drawn = CAMERAS[name], 0
    for seed in range(6):
        scene = slanted(seed, 4)
        picture = luxel.render(scene, camera, SIZE, outputs=EVERYTHING, samples=samples, tile=32)
        extremes, seen = bounds(scene, camera, picture, sample_pattern(samples)[0] / 256)
        drawn += seen.sum()
        for output in ("depth", "barycentric", "texcoord", "position"):
            (low, high), have = extremes[output], getattr(picture, output).reshape(*seen.shape, -1)
            rounding = 4e-6 * (1 + np.abs(low) + np.abs(high))
            assert (have >= low - rounding)[seen].all()
            assert (have <= high + rounding)[seen].all()
            if seen.any():
                assert np.median((high - low)[seen]) < 0.05
        low, high = extremes["normal"]
        length = np.linalg.norm(low, axis=-1, keepdims=True)
        firm = seen & ((high - low).max(-1) < 0.02 * length[..., 0])
        assert np.allclose(picture.normal[firm], (low / length)[firm], atol=0.05)
        assert np.allclose(np.linalg.norm(picture.normal[seen], axis=-1), 1, atol=1e-6)
    assert drawn > 2000


def exact_scene(z=(0, 0, 0)):
    """A triangle with corners on whole pixels of `flat_camera`, so nothing is rounded."""
    mesh = flat_mesh([[3, 2], [75, 8], [11, 66]], [[0, 2, 1]], z, normals=[[0, 0, 1], [0.6, 0, 0.8], [0, -1, 0]], texcoords=[[0, 0], [4, 1], [-1, 8]])
    return Scene.from_mesh(mesh, Material(**UNLIT))


@pytest.mark.parametrize("samples", [1, 4, 16])
def test_exact_corners_give_exact_attributes(samples):
    scene, camera = exact_scene((0.5, -0.25, 0.75)), flat_camera(SIZE)
    picture = luxel.render(scene, camera, SIZE, outputs=EVERYTHING, samples=samples)
    seen = picture.triangle == 0
    along, weights = meet(scene, picture.triangle, *rays(camera, SIZE, sample_pattern(samples)[0] / 256))
    mesh = scene.meshes[0]
    assert np.array_equal(seen, (weights > 0).all(-1)) or samples > 1  # no sample lies on an edge with one a pixel
    assert seen.sum() > 1500
    assert np.abs(picture.barycentric - weights)[seen].max() < 2e-7
    assert np.abs(picture.depth - along)[seen].max() < 1e-6
    assert np.abs(picture.texcoord - weights @ mesh.texcoords[[0, 2, 1]])[seen].max() < 2e-6
    assert np.abs(picture.position - weights @ mesh.positions[[0, 2, 1]])[seen].max() < 1e-5
    normal = weights @ mesh.normals[[0, 2, 1]]
    assert np.abs(picture.normal - normal / np.linalg.norm(normal, axis=-1, keepdims=True))[seen].max() < 1e-6


def test_perspective_is_corrected():
    """A floor in perspective whose corners fall on whole pixels: u, v against the ray's, to float32."""
    camera = Camera(yfov=np.pi / 2, near=0.5)
    size = (64, 64)
    corners = np.array([[8, 8, 2.0], [56, 8, 8.0], [56, 56, 8.0], [8, 56, 2.0]])  # pixel x, y, distance
    at = np.stack([(corners[:, 0] / 32 - 1) * corners[:, 2], (1 - corners[:, 1] / 32) * corners[:, 2], -corners[:, 2]], 1)
    scene = Scene.from_mesh(Mesh(at, [[0, 1, 2], [0, 2, 3]], texcoords=[[0, 0], [1, 0], [1, 1], [0, 1]]), Material(**UNLIT))
    picture = luxel.render(scene, camera, size, outputs=("depth", "texcoord", "barycentric", "triangle"))
    x, y = np.meshgrid(np.arange(64) + 0.5, np.arange(64) + 0.5)
    inside = (x > 8) & (x < 56) & (y > 8) & (y < 56)
    assert np.array_equal(picture.triangle >= 0, inside)
    along, weights = meet(scene, picture.triangle, *rays(camera, size))
    assert np.allclose(picture.depth[inside], along[inside], rtol=1e-6)
    assert np.allclose(picture.barycentric[inside], weights[inside], atol=1e-6)
    texcoords = np.einsum("hwc,hwcd->hwd", weights, scene.meshes[0].texcoords[scene.meshes[0].triangles[np.maximum(picture.triangle, 0)]])
    assert np.allclose(picture.texcoord[inside], texcoords[inside], atol=1e-6)
    across = 1 / (1 / 2 + (x - 8) / 48 * (1 / 8 - 1 / 2))
    assert np.allclose(picture.depth[inside], across[inside], rtol=1e-6)


def test_clipped_triangles_keep_their_attributes():
    """A floor that passes under the eye: what is clipped has the same outputs as the same floor in small triangles."""
    camera = Camera.look_at([0, 0.8, 0], [0, 0.5, -1], yfov=1.2, near=0.1, far=30.0)
    outputs = ("depth", "position", "texcoord", "normal", "barycentric", "triangle")
    corners = np.array([[-20, 0, 20], [20, 0, 20], [20, 0, -20], [-20, 0, -20]])
    scene = Scene.from_mesh(Mesh(corners, [[0, 1, 2], [0, 2, 3]], texcoords=[[0, 0], [1, 0], [1, 1], [0, 1]]), Material(**UNLIT))
    picture = luxel.render(scene, camera, SIZE, outputs=outputs)
    seen = picture.triangle >= 0
    along, _ = meet(scene, picture.triangle, *rays(camera, SIZE))
    assert seen.mean() > 0.4
    assert (along[seen] <= 30.01).all()
    slack = 0.002 * along[seen] ** 2  # a 512th of a pixel, at a grazing angle
    assert (np.abs(picture.depth - along)[seen] < slack).all()
    assert (np.abs(picture.position[..., 1])[seen] < 1e-4).all()
    origin, way = rays(camera, SIZE)
    place = origin + along[..., None] * way
    assert (np.abs(picture.position - place).max(-1)[seen] < 2 * slack).all()
    assert (np.abs(picture.texcoord - np.stack([place[..., 0] + 20, 20 - place[..., 2]], -1) / 40).max(-1)[seen] < slack / 20).all()
    assert np.allclose(picture.normal[seen], [0, 1, 0])
    assert np.allclose(picture.barycentric[seen].sum(-1), 1, atol=1e-5)
    assert picture.barycentric[seen].min() >= -1e-5


# Motion


def test_motion_of_a_shifted_camera():
    """The camera goes right: everything goes left, by focal length times shift over distance."""
    size = (80, 60)
    before, now = Camera(near=0.1), Camera(near=0.1)
    now.world_from_camera[0, 3] = 0.25
    scene = Scene.from_mesh(Mesh([[-9, -9, -3], [9, -9, -6], [0, 9, -5]], [[0, 1, 2]]), Material(**UNLIT))
    picture = luxel.render(scene, now, size, outputs=("motion", "depth", "triangle"), previous_camera=before)
    seen = picture.triangle >= 0
    focal = size[1] / 2 / np.tan(now.yfov / 2)
    assert seen.sum() > 1000
    assert np.allclose(picture.motion[..., 0][seen], -focal * 0.25 / picture.depth[seen], atol=0.004)
    assert np.allclose(picture.motion[..., 1][seen], 0, atol=0.004)
    assert (picture.motion[~seen] == 0).all()


@pytest.mark.parametrize("samples", [1, 4])
def test_motion_leads_back_to_where_a_point_was(samples):
    before, now = around(0.2), around(0.3, 4.3)
    picture = luxel.render(room(modes=False), now, SIZE, outputs=("motion", "position", "triangle"), previous_camera=before, samples=samples)
    seen = picture.triangle >= 0
    homogeneous = np.concatenate([picture.position.astype(float), np.ones((*picture.position.shape[:2], 1))], -1)
    clip = homogeneous @ before.clip_from_world(SIZE).T
    was = np.stack([(clip[..., 0] / clip[..., 3] + 1) * SIZE[0] / 2, (1 - clip[..., 1] / clip[..., 3]) * SIZE[1] / 2], -1)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    at = np.stack([x, y], -1) + sample_pattern(samples)[0] / 256
    assert np.allclose((at - was)[seen], picture.motion[seen], atol=1e-3)


def test_without_a_previous_camera_nothing_moves():
    picture = luxel.render(room(modes=False), around(), SIZE, outputs=("motion",))
    assert picture.motion.shape == (70, 90, 2)
    assert not picture.motion.any()
    still = luxel.render(room(modes=False), around(), SIZE, outputs=("motion",), previous_camera=around())
    assert np.abs(still.motion).max() < 0.004


# Ids


def test_ids_of_parts_materials_and_objects():
    scene = Scene(materials=[Material(**UNLIT), Material((1, 0, 0, 1), **UNLIT)])
    for k in range(4):
        mesh = rectangle(20 * k, 10 * k, 20 * k + 15, 10 * k + 25)
        mesh.material = (0, 1, -1, 1)[k]
        scene.meshes.append(mesh)
    scene.instances = [instance(np.eye(4), k, number) for k, number in enumerate((7, 3, 3, 0))]
    picture = luxel.render(scene, flat_camera(SIZE), SIZE, outputs=("triangle", "object", "material", "color"))
    for k in range(4):
        there = np.s_[10 * k : 10 * k + 25, 20 * k : 20 * k + 15]
        assert set(np.unique(picture.triangle[there])) == {2 * k, 2 * k + 1}
        assert (picture.object[there] == (7, 3, 3, 0)[k]).all()
        assert (picture.material[there] == (0, 1, 2, 1)[k]).all()  # the default material comes after the scene's own
    shown = picture.color[..., 3] == 255
    for name in ("triangle", "object", "material"):
        assert np.array_equal(getattr(picture, name) >= 0, shown)


def test_an_empty_mesh_between_others_has_no_ids():
    empty = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    scene = Scene(materials=[Material(**UNLIT)], meshes=[rectangle(0, 0, 9, 9), empty, rectangle(9, 9, 20, 20)])
    scene.instances = [instance(np.eye(4), k, k) for k in (1, 0, 1, 2, 1)]
    picture = luxel.render(scene, flat_camera(SIZE), SIZE, outputs=("triangle", "object"))
    assert set(np.unique(picture.triangle)) == {-1, 0, 1, 2, 3}
    assert set(np.unique(picture.object)) == {-1, 0, 2}


def test_a_picture_of_nothing():
    for scene in (Scene(), Scene.from_mesh(Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))), exact_scene()):
        camera = flat_camera(SIZE)
        camera.world_from_camera[0, 3] += 10_000
        picture = luxel.render(scene, camera, SIZE, outputs=EVERYTHING, background=(0.25, 0.5, 1.0))
        assert (picture.triangle == -1).all()
        assert np.isinf(picture.depth).all()
        assert np.allclose(picture.linear, [0.25, 0.5, 1, 1])
        for name, (shape, dtype, nothing) in SHAPES.items():
            have = getattr(picture, name)
            assert have.shape == (SIZE[1], SIZE[0], *shape)
            assert have.dtype == dtype
            assert (have == nothing).all()


def test_outputs_are_never_averaged():
    """Every pixel's values are those of its first sample: the same as a picture with that one sample alone."""
    scene, camera = room(modes=False), around()
    many = luxel.render(scene, camera, SIZE, outputs=tuple(SHAPES), samples=16)
    sx, sy = sample_pattern(16)[0] // 16
    large = luxel.render(scene, camera, (SIZE[0] * 16, SIZE[1] * 16), outputs=("triangle",)).triangle
    close = large[sy::16, sx::16]
    assert (close == many.triangle).mean() > 0.97  # centres of the finer pixels are 1/32 pixel off
    assert set(np.unique(many.material)) <= {-1, 0, 1, 2, 3}
    lengths = np.linalg.norm(many.normal, axis=-1)
    assert np.allclose(lengths[many.triangle >= 0], 1, atol=1e-5)
