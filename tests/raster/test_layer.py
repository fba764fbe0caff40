"""Masked and blended triangles: exact holes, exact compositing in depth order, sample by sample."""

import numpy as np
import pytest
from scenes import UNLIT, around, flat_camera, flat_mesh, rectangle, room

import luxel
from luxel import Material, Mesh, Scene, Texture, TextureRef
from luxel.raster import frame
from luxel.raster.constants import sample_pattern
from luxel.raster.reference import covers

SIZE = 40, 30


def draw(scene, size=SIZE, outputs=("linear",), **options):
    return luxel.render(scene, flat_camera(size), size, outputs=outputs, **options)


def flat_triangles(rng, count, low=-6, high=46):
    """corners (count, 3, 2) in whole 1/256 pixels (as pixels), colours (count, 4), depths (count,) all different."""
    corners = rng.integers(low * 256, high * 256, (count, 3, 2)) / 256
    return corners, np.append(rng.random((count, 3)), rng.uniform(0.2, 0.9, (count, 1)), 1), (rng.permutation(count) + 1) / (count + 2)


def blended(corners, colors, z, mode="BLEND"):
    """One mesh with vertex colours, in the order given."""
    mesh = flat_mesh(np.reshape(corners, (-1, 2)), np.arange(3 * len(corners)), np.repeat(z, 3), colors=np.repeat(colors, 3, 0))
    return Scene.from_mesh(mesh, Material((1, 1, 1, 1), alpha_mode=mode, **UNLIT))


def composite(corners, colors, z, pattern, under=None, size=SIZE):
    """(h, w, 4) premultiplied: an over-operator in double precision at every sample, farthest first, then the average."""
    width, height = size
    result = np.zeros((len(pattern), height, width, 4)) if under is None else np.broadcast_to(under, (len(pattern), height, width, 4)).copy()
    for k in np.argsort(z, kind="stable"):
        fixed = np.round(corners[k] * 256).astype(int).tolist()
        source = np.append(colors[k, :3] * colors[k, 3], colors[k, 3])
        for s, y, x in np.ndindex(len(pattern), height, width):
            if covers(fixed, (x * 256 + int(pattern[s, 0]), y * 256 + int(pattern[s, 1]))):
                result[s, y, x] = source + (1 - colors[k, 3]) * result[s, y, x]
    return result.mean(0)


# Blend


@pytest.mark.parametrize(("samples", "count"), [(1, 14), (4, 5), (16, 2)])
def test_blended_triangles_composite_in_depth_order(samples, count):
    rng = np.random.default_rng(samples)
    corners, colors, z = flat_triangles(rng, count)
    want = composite(corners, colors, z, sample_pattern(samples))
    have = draw(blended(corners, colors, z), samples=samples).linear
    assert want[..., 3].max() > 0.6
    assert np.abs(have - want).max() < 1e-6


@pytest.mark.parametrize("samples", [1, 4])
def test_any_order_of_triangles_gives_the_same(samples):
    rng = np.random.default_rng(2)
    corners, colors, z = flat_triangles(rng, 40)
    want = draw(blended(corners, colors, z), samples=samples).linear
    for _ in range(3):
        order = rng.permutation(40)
        have = draw(blended(corners[order], colors[order], z[order]), samples=samples, tile=8, threads=2).linear
        assert np.abs(have - want).max() < 1e-6


def test_crossing_triangles_are_sorted_at_every_sample():
    """Two planes that pass through each other: no order of triangles is right, the order at each pixel is."""
    left, right = (1.0, 0, 0, 0.5), (0, 0, 1.0, 0.5)
    scene = Scene()
    for slope, color in ((0.8, left), (-0.8, right)):
        mesh = flat_mesh([[0, 0], [40, 0], [40, 30], [0, 30]], [[0, 3, 2], [0, 2, 1]], [-slope, slope, slope, -slope])
        scene.add(mesh, Material(color, alpha_mode="BLEND", **UNLIT))
    have = draw(scene).linear
    assert np.allclose(have[:, 21:], [0.5, 0, 0.25, 0.75], atol=1e-6)  # red rises to the right
    assert np.allclose(have[:, :19], [0.25, 0, 0.5, 0.75], atol=1e-6)


@pytest.mark.parametrize("samples", [1, 8])
def test_blended_over_opaque_hides_behind_it(samples):
    rng = np.random.default_rng(4)
    corners, colors, z = flat_triangles(rng, 6)
    wall = 0.5 * (z[2] + z[3])
    scene = blended(corners, colors, z)
    scene.add(rectangle(10, 5, 30, 25, wall), Material((0.1, 0.7, 0.2, 1), **UNLIT))
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    inside = (x >= 10) & (x < 30) & (y >= 5) & (y < 25)
    pattern = sample_pattern(samples)
    free = composite(corners, colors, z, pattern)
    near = z > wall
    walled = composite(corners[near], colors[near], z[near], pattern, [0.1, 0.7, 0.2, 1])
    have = draw(scene, samples=samples, outputs=("linear", "triangle", "depth"))
    assert np.abs(have.linear - np.where(inside[..., None], walled, free)).max() < 1e-6
    assert np.array_equal(have.triangle >= 0, inside)  # ids and depth come from what is opaque
    assert np.isinf(have.depth[~inside]).all()


def test_equally_near_layers_lie_in_the_order_of_their_ids():
    """The lower id on top."""
    whole = np.array([[0, 0], [0, 60], [80, 0]])
    colors = np.array([[1, 0, 0, 0.5], [0, 1, 0, 0.5], [0, 0, 1, 0.5]])
    have = draw(blended([whole] * 3, colors, [0.25] * 3)).linear
    assert np.allclose(have[2, 2], [0.5, 0.25, 0.125, 0.875])
    # A blended layer at the depth of an opaque one shows if its id is lower.
    for first, want in ((True, [0.5, 0.5, 0, 1]), (False, [0, 1, 0, 1])):
        scene = Scene()
        pair = [((1, 0, 0, 0.5), "BLEND"), ((0, 1, 0, 1), "OPAQUE")]
        for color, mode in pair if first else pair[::-1]:
            scene.add(flat_mesh(whole, [[0, 1, 2]], 0.25), Material(color, alpha_mode=mode, **UNLIT))
        assert np.allclose(draw(scene).linear[2, 2], want)


def test_many_layers():
    """Sixty sheets, all seen: as many passes."""
    count, alpha = 60, 0.05
    rng = np.random.default_rng(0)
    scene = Scene()
    shades = rng.random(count)
    for k in rng.permutation(count):
        scene.add(rectangle(0, 0, 8, 8, k / count), Material((shades[k], 0, 0, alpha), alpha_mode="BLEND", **UNLIT))
    want = sum(alpha * shades[k] * (1 - alpha) ** (count - 1 - k) for k in range(count))
    have = draw(scene, (8, 8)).linear
    assert np.allclose(have[..., 0], want, atol=1e-6)
    assert np.allclose(have[..., 3], 1 - (1 - alpha) ** count, atol=1e-6)


def test_invisible_and_whole_layers():
    scene = Scene()
    scene.add(rectangle(0, 0, 20, 30, 0.5), Material((1, 0, 0, 0), alpha_mode="BLEND", **UNLIT))
    scene.add(rectangle(0, 0, 40, 30, 0.2), Material((0, 1, 0, 1), alpha_mode="BLEND", **UNLIT))
    scene.add(rectangle(0, 0, 40, 30, 0.1), Material((0, 0, 1, 0.5), alpha_mode="BLEND", **UNLIT))
    assert np.allclose(draw(scene).linear, [0, 1, 0, 1])


def test_blending_in_windows_and_bands(monkeypatch):
    scene, camera = room(1), around()
    want = luxel.render(scene, camera, (60, 50), samples=4, outputs=("linear",)).linear
    monkeypatch.setattr(frame, "_BAND_BYTES", 1)
    monkeypatch.setattr(frame, "_WINDOW", 32)
    have = luxel.render(scene, camera, (60, 50), samples=4, outputs=("linear",), tile=16).linear
    assert np.abs(have - want).max() < 1e-4


# Mask


def checks(cells, mode="MASK", cutoff=0.5, low=0, texels=1):
    """A material whose alpha is a chequerboard of cells x cells over the texture, sampled at the nearest texel."""
    image = np.full((cells * texels, cells * texels, 4), 255, np.uint8)
    cell = np.indices(image.shape[:2]).sum(0) if texels == 1 else (np.indices(image.shape[:2]) // texels).sum(0)
    image[..., 3] = np.where(cell % 2 == 0, 255, low)
    material = Material((1, 1, 1, 1), base_color_texture=TextureRef(0), alpha_mode=mode, alpha_cutoff=cutoff, **UNLIT)
    return material, Texture(image, filter="nearest")


@pytest.mark.parametrize("samples", [1, 4, 16])
def test_masked_cells_have_the_area_of_their_samples(samples):
    """Cells of 2.5 x 3.75 pixels, no border of which meets a sample: every sample tests its own alpha."""
    material, texture = checks(8)
    x0, y0 = 10 + 1 / 32, -1 / 32
    scene = Scene.from_mesh(rectangle(x0, y0, x0 + 20, y0 + 30), material)
    scene.textures.append(texture)
    have = draw(scene, samples=samples).linear[..., 3]
    pattern = sample_pattern(samples) / 256
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    sx, sy = x[..., None] + pattern[:, 0] - x0, y[..., None] + pattern[:, 1] - y0
    cell = np.floor(sx / 2.5) + np.floor(sy / 3.75)
    want = ((cell % 2 == 0) & (sx >= 0) & (sx < 20) & (sy < 30)).mean(-1)
    assert np.allclose(have, want, atol=1e-6)
    assert 0.2 < have.mean() < 0.3


def test_through_the_holes_one_sees_what_is_behind():
    material, texture = checks(2)
    scene = Scene.from_mesh(rectangle(0, 0, 40, 30, 0.5), material)
    scene.textures.append(texture)
    scene.add(rectangle(0, 0, 40, 30, 0.0), Material((1, 0, 0, 1), **UNLIT))
    scene.add(rectangle(0, 0, 40, 30, 0.8), checks(2, cutoff=1.5)[0])  # no alpha reaches it: not there
    have = draw(scene, outputs=("linear", "material", "depth", "object"))
    white = np.zeros(SIZE[::-1], bool)
    white[:15, :20] = white[15:, 20:] = True
    assert np.array_equal(have.linear[..., 1] == 1, white)
    assert np.array_equal(have.material, np.where(white, 0, 1))
    assert np.array_equal(have.object, np.where(white, 0, 1))
    assert np.allclose(have.depth, np.where(white, -0.5, 0.0), atol=1e-6)  # metres from the camera's place


@pytest.mark.parametrize(("cutoff", "alpha", "there"), [(0.5, 128, True), (0.5, 127, False), (0.0, 0, True), (1.0, 255, True), (1.0, 254, False)])
def test_alpha_that_reaches_the_cutoff_is_there(cutoff, alpha, there):
    image = np.full((1, 1, 4), alpha, np.uint8)
    scene = Scene.from_mesh(rectangle(0, 0, 9, 9), Material(base_color_texture=TextureRef(0), alpha_mode="MASK", alpha_cutoff=cutoff, **UNLIT))
    scene.textures.append(Texture(image))
    have = draw(scene, (9, 9)).linear[..., 3]
    assert (have == there).all()  # and whole: MASK knows no half-transparency


def test_vertex_alpha_masks_too():
    mesh = flat_mesh([[0, 0], [40, 0], [40, 30], [0, 30]], [[0, 3, 2], [0, 2, 1]], colors=[[1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 0]])
    have = draw(Scene.from_mesh(mesh, Material((1, 1, 1, 1), alpha_mode="MASK", alpha_cutoff=0.26, **UNLIT))).linear[..., 3]
    assert np.array_equal(have[7] > 0, (np.arange(40) + 0.5) / 40 >= 0.26)


def test_a_mask_in_perspective_through_the_near_plane():
    """A chequered floor under the eye, clipped: cells where rays meet them."""
    material, texture = checks(8)
    corners = np.array([[-4, 0, 4], [4, 0, 4], [4, 0, -4], [-4, 0, -4]])
    scene = Scene.from_mesh(Mesh(corners, [[0, 1, 2], [0, 2, 3]], texcoords=[[0, 0], [1, 0], [1, 1], [0, 1]]), material)
    scene.textures.append(texture)
    camera = luxel.Camera.look_at([0, 1, 0], [0, 0.2, -1.5], yfov=1.0, near=0.3)
    size = (80, 60)
    have = luxel.render(scene, camera, size, outputs=("linear", "position")).linear[..., 3]
    material.alpha_mode = "OPAQUE"
    place = luxel.render(scene, camera, size, outputs=("position",)).position.astype(float)
    floor = (np.abs(place).max(-1) > 0) & (np.abs(np.abs(place[..., [0, 2]] % 1) - 0.5).max(-1) < 0.48)
    cell = np.floor(place[..., 0] + 4) + np.floor(4 - place[..., 2])
    assert floor.sum() > 1500
    assert np.array_equal(have[floor] == 1, cell[floor] % 2 == 0)


def test_masked_invariance():
    scene, camera = room(3), around()
    names = ("triangle", "depth", "linear")
    want = luxel.render(scene, camera, (70, 60), samples=4, outputs=names)
    for tile, threads in ((8, 1), (32, 2), (128, 3)):
        have = luxel.render(scene, camera, (70, 60), samples=4, outputs=names, tile=tile, threads=threads)
        assert np.array_equal(have.triangle, want.triangle)
        assert np.array_equal(have.depth.view(np.int32), want.depth.view(np.int32))
        assert np.abs(have.linear - want.linear).max() < 1e-4
