import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sheets import Sheet, atlas_of, luxels_of, shown

from luxel.errors import InputError
from luxel.radiosity.edges import find_seams
from luxel.radiosity.lightmap import attach, dilate, fill, finish, pages_of, stitch
from luxel.radiosity.luxels import find_luxels
from luxel.radiosity.unwrap import unwrap
from luxel.scene import Material, Mesh, Scene

LEFT = Sheet((0, 0, 0), (1, 0, 0), (0, 0, 1), (2.3, 2.6), (10, 10))
RIGHT = Sheet((1, 0, 0), (1, 0, 0), (0, 0, 1), (17.7, 3.1), (8, 10))
ALONG = np.linspace(0.001, 0.999, 50)


def light(*sheets, of):
    """Atlas, luxels and pages with a gutter, of a function of the place."""
    atlas, luxels = atlas_of(sheets), luxels_of(sheets)
    pages, mask = pages_of(luxels, of(luxels))
    return atlas, luxels, dilate(pages, mask, 3), mask


def test_pages_hold_the_values_at_their_texels():
    luxels = luxels_of([LEFT])
    values = np.arange(2.0 * len(luxels.texel)).reshape(-1, 2)
    pages, mask = pages_of(luxels, values)
    assert pages.shape == (1, 32, 32, 2)
    assert mask.sum() == len(luxels.texel) == 11 * 11
    assert np.array_equal(pages[mask], values)
    assert not pages[~mask].any()
    assert np.array_equal(pages_of(luxels, values[:, 0])[0], pages[..., :1])
    with pytest.raises(InputError, match="values of 121 luxels"):
        pages_of(luxels, values[1:])


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), share=st.floats(0.05, 0.95))
@example(seed=16, share=0.0546875)  # a chart without a valid luxel
def test_what_is_filled_lies_between_its_charts_values(seed, share):
    luxels = luxels_of([LEFT, RIGHT])
    rng = np.random.default_rng(seed)
    values = (rng.random((len(luxels.texel), 3)) + 10 * luxels.chart[:, None]).astype(np.float32)
    valid = rng.random(len(values)) < share
    filled = fill(luxels, values, valid)
    assert np.array_equal(filled[valid], values[valid])
    for chart in (0, 1):
        own = luxels.chart == chart
        if (own & valid).any():
            assert filled[own].min() >= values[own & valid].min() - 1e-5
            assert filled[own].max() <= values[own & valid].max() + 1e-5
        else:  # from the other chart, which faces alike
            assert np.isin(filled[own], values[valid]).all()


def test_dilation_keeps_the_luxels_and_reaches_as_far_as_asked():
    luxels = luxels_of([Sheet((0, 0, 0), (1, 0, 0), (0, 0, 1), (8, 8), (4, 4))])
    pages, mask = pages_of(luxels, np.full((16, 1), 5.0))
    grown = dilate(pages, mask, 3)
    assert np.array_equal(grown[0, 5:15, 5:15], np.full((10, 10, 1), 5))
    grown[0, 5:15, 5:15] = 0
    assert not grown.any()
    assert np.array_equal(dilate(pages, mask, 0), pages)


TURNED = [
    (RIGHT, (0 * ALONG, ALONG)),  # with where the seam is on it
    (Sheet((2, 0, 1), (-1, 0, 0), (0, 0, -1), (17.2, 3.4), (8, 7)), (0 * ALONG + 1, 1 - ALONG)),
    (Sheet((1, 0, 1), (0, 0, -1), (1, 0, 0), (3.5, 17.5), (9, 5)), (1 - ALONG, 0 * ALONG)),
]


@pytest.mark.parametrize(("right", "seam"), TURNED)
def test_a_step_at_a_seam_vanishes_whatever_the_charts_turn_and_scale(right, seam):
    atlas, luxels, pages, _ = light(LEFT, right, of=lambda luxels: 1.0 + luxels.chart)
    both = stitch(atlas, luxels, pages)
    step = shown(atlas, both, 1, *seam) - shown(atlas, both, 0, 0 * ALONG + 1, ALONG)
    before = shown(atlas, pages, 1, *seam) - shown(atlas, pages, 0, 0 * ALONG + 1, ALONG)
    assert np.allclose(before, 1)
    assert np.abs(step).max() < 0.01
    assert both[pages > 0].min() >= 0.9
    assert both.max() <= 2.1


def test_texels_that_no_seam_shows_stay_as_they_are():
    atlas, luxels, pages, _ = light(LEFT, RIGHT, of=lambda luxels: np.random.default_rng(1).random((len(luxels.texel), 3)))
    both = stitch(atlas, luxels, pages)
    changed = np.argwhere((both != pages).any(-1))[:, 1:]
    uv = [mesh.texcoords1 * 32 for mesh in atlas.scene.meshes]
    to_left = np.abs(changed[:, 1] + 0.5 - uv[0][3, 0])
    to_right = np.abs(changed[:, 1] + 0.5 - uv[1][0, 0])
    assert len(changed) > 20
    assert np.minimum(to_left, to_right).max() <= 1


@settings(max_examples=30, deadline=None)
@given(
    slope=st.tuples(st.floats(-2, 2), st.floats(-2, 2)), bend=st.floats(-1, 1), shift=st.tuples(st.floats(0, 1), st.floats(0, 1)),
    texels=st.tuples(st.floats(5, 10), st.floats(5, 10)),
)
def test_smooth_light_stays_as_it_is(slope, bend, shift, texels):
    right = Sheet((1, 0, 0), (1, 0, 0), (0, 0, 1), (16 + shift[0], 3 + shift[1]), texels)

    def smooth(place):
        return 10 + slope[0] * place[:, 0] + slope[1] * place[:, 2] + bend * np.sin(2 * place[:, 0] + place[:, 2])

    atlas, luxels, pages, mask = light(LEFT, right, of=lambda luxels: smooth(luxels.position))
    both = stitch(atlas, luxels, pages)
    steepest = abs(slope[0]) + abs(slope[1]) + 3 * abs(bend)
    assert np.abs(both - pages)[mask].max() < steepest * 0.7 / min(*texels, 10) + 1e-4  # what it changes over less than a texel
    ends = np.linspace(0.1, 0.9, 30)
    truth = smooth(np.stack([1 + 0 * ends, 0 * ends, ends], 1))[:, None]
    for instance, s in ((0, 1 + 0 * ends), (1, 0 * ends)):
        assert np.abs(shown(atlas, both, instance, s, ends) - truth).max() < steepest / min(*texels, 10) + 1e-4


def test_one_long_side_meets_two_short_ones():
    upper = Sheet((1, 0, 0), (1, 0, 0), (0, 0, 0.4), (17, 3), (9, 4))
    lower = Sheet((1, 0, 0.4), (1, 0, 0), (0, 0, 0.6), (17, 13), (9, 6))
    atlas, luxels, pages, _ = light(LEFT, upper, lower, of=lambda luxels: 1.0 + luxels.chart)
    assert len(find_seams(atlas).page) == 3  # with that between the short ones
    both = stitch(atlas, luxels, pages)
    left = shown(atlas, both, 0, 0 * ALONG + 1, ALONG)
    z, inside = ALONG, np.abs(ALONG - 0.4) > 0.1  # where all three meet, bilinear samples cannot do everything
    short = shown(atlas, both, 1, 0 * z, np.minimum(z / 0.4, 1)), shown(atlas, both, 2, 0 * z, np.maximum((z - 0.4) / 0.6, 0))
    other = np.where((z < 0.4)[:, None], *short)
    assert np.abs(left - other)[inside].max() < 0.02


def test_pages_are_stitched_to_each_other():
    right = Sheet((1, 0, 0), (1, 0, 0), (0, 0, 1), (4.5, 5), (8, 10), page=1)
    atlas, luxels, pages, _ = light(LEFT, right, of=lambda luxels: 1.0 + luxels.chart)
    both = stitch(atlas, luxels, pages)
    step = shown(atlas, both, 1, 0 * ALONG, ALONG) - shown(atlas, both, 0, 0 * ALONG + 1, ALONG)
    assert np.abs(step).max() < 0.01


def wall(height, at=(20.5, 20.5)):
    return Sheet((1, height, 0), (0, 0, 1), (0, -height, 0), at, (8, 8))


@pytest.mark.parametrize(
    ("sheets", "seams"),
    [
        ((LEFT, RIGHT), 1),
        ((LEFT, wall(1.0)), 0),  # a crease
        ((LEFT, RIGHT, wall(-1.0)), 1),  # what hangs below keeps nothing apart
        ((LEFT, Sheet((1.02, 0, 0), (1, 0, 0), (0, 0, 1), (17.7, 3.1), (8, 10))), 0),  # a gap of a fifth of a texel
        ((LEFT, Sheet((1.002, 0, 0.1), (1, 0, 0), (0, 0, 0.5), (17.7, 3.1), (8, 10))), 1),  # touching, in parts
        ((LEFT, Sheet((1, 0, 1), (1, 0, 0), (0, 0, 1), (17.7, 3.1), (8, 10))), 0),  # at a corner only
    ],
)
def test_seams_are_where_a_surface_goes_on(sheets, seams):
    atlas, luxels, pages, _ = light(*sheets, of=lambda luxels: 1.0 + luxels.chart)
    assert len(find_seams(atlas).page) == seams
    assert np.array_equal(stitch(atlas, luxels, pages), pages) == (seams == 0)


def upright(x, z0=0.0, z1=1.0, y0=0.0, at=(20.5, 20.5)):
    """A partition, or a face of a wall."""
    return Sheet((x, 1, z0), (0, 0, z1 - z0), (0, y0 - 1, 0), at, (4, 4))


BACK = Sheet((1, 1, 1), (0, 0, -1), (0, -1, 0), (26.5, 26.5), (4, 4))


@pytest.mark.parametrize(
    "partition",
    [
        (wall(1.0),),  # on the seam, with its corners
        (wall(1.0), BACK),  # two quads, back to back
        (upright(1, 0.0, 0.5), upright(1, 0.5, 1.0, at=(26.5, 26.5))),  # side by side
        (upright(1, -0.05, 1.05, -0.05),),  # longer all round: it goes through the floor
        (upright(0.96), upright(1.04, at=(26.5, 26.5))),  # a wall with a thickness
        (upright(0.92), upright(1.1, at=(26.5, 26.5))),  # its faces at luxels' middles
    ],
    ids=["one", "back to back", "side by side", "through the floor", "thick", "at luxels"],
)
def test_partition_on_a_seam_keeps_light_and_shadow_apart(partition):
    atlas, luxels, pages, _ = light(LEFT, RIGHT, *partition, of=lambda luxels: 1.0 + np.minimum(luxels.chart, 2))
    both = stitch(atlas, luxels, pages)
    assert np.allclose(both, pages, atol=1e-5)  # the wall's own parts may be stitched


def test_glass_on_a_seam_keeps_nothing_apart():
    pane = replace(wall(1.0), material=Material((1, 1, 1, 0.5), alpha_mode="BLEND"))
    atlas, luxels, pages, _ = light(LEFT, RIGHT, pane, of=lambda luxels: 1.0 + luxels.chart)
    both = stitch(atlas, luxels, pages)
    assert np.abs(shown(atlas, both, 1, 0 * ALONG, ALONG) - shown(atlas, both, 0, 0 * ALONG + 1, ALONG)).max() < 0.01


def test_points_on_the_page_are_no_seams():
    """Pieces smaller than a texel have no edges there: to look for seams among many of them would take memory by the square of their number."""
    rng = np.random.default_rng(1)
    scene = Scene.from_mesh(Mesh((rng.random((800, 1, 3)) + rng.normal(size=(800, 3, 3)) * 0.01).reshape(-1, 3), np.arange(2400).reshape(-1, 3)))
    for corner in (2.0, 3.0):  # two sheets side by side, and a seam between them
        scene.add(Mesh([[corner, 0, 0], [corner + 1, 0, 0], [corner + 1, 1, 0], [corner, 1, 0]], [[0, 1, 2], [0, 2, 3]]))
    atlas = unwrap(scene, 8.0)
    tracemalloc.start()
    try:
        assert len(find_seams(atlas).page) == 1
        assert tracemalloc.get_traced_memory()[1] < 20 << 20
    finally:
        tracemalloc.stop()


def test_seams_are_sought_among_edges_of_one_direction():
    """Where thousands of loose pieces are within two texels of each other, as blades of grass are, there are too many pairs of all of them."""
    rng = np.random.default_rng(1)
    corners = 8 * rng.random((3000, 1, 3)) + rng.normal(size=(3000, 3, 3))
    scene = Scene.from_mesh(Mesh(corners.reshape(-1, 3), np.arange(9000).reshape(-1, 3)))
    for corner in (20.0, 30.0):
        scene.add(Mesh([[corner, 0, 0], [corner + 10, 0, 0], [corner + 10, 10, 0], [corner, 10, 0]], [[0, 1, 2], [0, 2, 3]]))
    scene.add(Mesh([[40, -5, 0], [50, -5, 0], [50, 5, 0], [40, 5, 0]], [[0, 1, 2], [0, 2, 3]]))  # along a half of the last one's side
    atlas = unwrap(scene, 1.0)
    tracemalloc.start()
    try:
        seams = find_seams(atlas)
        assert tracemalloc.get_traced_memory()[1] < 40 << 20
    finally:
        tracemalloc.stop()
    assert (seams.place[:, :, 0] >= 19).all(1).sum() == 2


def test_seam_inside_a_thick_wall_carries_no_light():
    sheets = (LEFT, RIGHT, upright(0.8), upright(1.2, at=(26.5, 26.5)))
    atlas, luxels = atlas_of(sheets), luxels_of(sheets)
    values, valid = (luxels.position[:, 0] < 1).astype(np.float32), np.abs(luxels.position[:, 0] - 1) > 0.19
    pages, mask = finish(atlas, luxels, values, valid, gutter=3)
    assert np.array_equal(pages, dilate(pages_of(luxels, fill(luxels, values[:, None], valid))[0], mask, 3))


def test_partition_in_parts_keeps_its_part_apart():
    upper = Sheet((1, 0, 0), (1, 0, 0), (0, 0, 0.5), (17, 3), (9, 4))
    lower = Sheet((1, 0, 0.5), (1, 0, 0), (0, 0, 0.5), (17, 13), (9, 6))
    atlas, luxels, pages, _ = light(LEFT, upper, lower, upright(1, 0.0, 0.7), of=lambda luxels: 1.0 + (luxels.chart > 0))
    both = stitch(atlas, luxels, pages)
    left = shown(atlas, both, 0, 0 * ALONG + 1, ALONG)
    right = np.where((ALONG < 0.5)[:, None], *(shown(atlas, both, i, 0 * ALONG, np.clip(2 * ALONG - i + 1, 0, 1)) for i in (1, 2)))
    assert np.allclose((right - left)[ALONG < 0.5], 1, atol=1e-4)  # a texel or more from the partition's end
    assert np.abs(right - left)[ALONG > 0.8].max() < 0.02


@pytest.mark.parametrize("outside", [True, False])
@pytest.mark.parametrize(("sides", "density"), [(8, 6), (8, 40), (48, 3), (48, 40)])
def test_seams_of_bent_surfaces_are_stitched(monkeypatch, sides, density, outside):
    angle = np.arange(sides + 1) * (2 * np.pi / sides)
    ring = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], 1)
    ring[-1] = ring[0]
    corner = np.arange(sides)
    faces = np.concatenate([np.stack([corner, corner + sides + 1, corner + 1], 1), np.stack([corner + 1, corner + sides + 1, corner + sides + 2], 1)])
    places, normals = np.concatenate([ring, ring + np.float64([0, 1, 0])]), np.tile(ring, (2, 1))
    scene = Scene()
    scene.add(Mesh(places, faces, normals) if outside else Mesh(places, faces[:, ::-1], -normals), Material())
    atlas = unwrap(scene, density)
    luxels = find_luxels(atlas)
    assert len(find_seams(atlas).page) >= 1
    pages, mask = pages_of(luxels, np.random.default_rng(3).random((len(luxels.texel), 1)))
    both = stitch(atlas, luxels, dilate(pages, mask, 4))
    monkeypatch.setattr("luxel.radiosity.seams.visible", lambda scene, origins, targets, threads: np.ones(len(origins), bool))
    assert np.array_equal(both, stitch(atlas, luxels, dilate(pages, mask, 4)))


def test_finish_is_all_of_it():
    atlas, luxels = atlas_of((LEFT, RIGHT)), luxels_of((LEFT, RIGHT))
    valid = np.arange(len(luxels.texel)) % 3 > 0
    values = np.where(valid, 1.0 + luxels.chart, -50)
    pages, mask = finish(atlas, luxels, values, valid, gutter=2)
    filled, _ = pages_of(luxels, fill(luxels, values[:, None], valid))
    assert np.array_equal(pages, stitch(atlas, luxels, dilate(filled, mask, 2)))
    assert pages.min() >= 0


def test_attached_pages_are_lightmaps_of_their_materials():
    white, red = Material(name="white"), Material((1, 0, 0, 1), name="red")
    sheets = [
        Sheet((0, 0, 0), (1, 0, 0), (0, 0, 1), (2, 2), (8, 8), page, material)
        for page, material in ((0, white), (1, white), (1, red), (1, red))
    ]
    atlas = atlas_of(sheets)
    atlas.scene.meshes[3].material = -1
    pages = np.random.default_rng(2).random((2, 32, 32, 3)).astype(np.float32)
    scene = attach(atlas, pages, occlusion=pages[..., 0])
    scene.check()
    found = [scene.materials[mesh.material] for mesh in scene.meshes]
    assert [material.name for material in found] == ["white", "white", "red", ""]
    assert len(scene.materials) == 4
    for material, sheet in zip(found, sheets, strict=True):
        assert (material.lightmap_texture.texcoord, material.lightmap_scale) == (1, 1)
        texture = scene.textures[material.lightmap_texture.texture]
        assert np.array_equal(texture.image, pages[sheet.page])
        assert (texture.filter, texture.wrap, texture.srgb) == ("bilinear", ("clamp", "clamp"), False)
        shade = scene.textures[material.occlusion_texture.texture].image
        assert np.abs(shade[..., 0] / 255 - pages[sheet.page, ..., 0]).max() <= 0.5 / 255 + 1e-6
    assert white.lightmap_texture is None
    assert [mesh.material for mesh in atlas.scene.meshes] == [0, 0, 1, -1]
    with pytest.raises(InputError, match="pages"):
        attach(atlas, pages[:1])
    atlas.scene.meshes[0].texcoords1 = None
    with pytest.raises(InputError, match="texcoords1"):
        attach(atlas, pages)
