import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laid import laid_out, rectangle

import luxel
from luxel import InputError, Instance, LuxelWarning, Material, Mesh, Scene, Texture, TextureRef
from luxel.radiosity import packing, pieces
from luxel.radiosity.diagnosis import diagnose, estimate
from luxel.radiosity.effort import effort
from luxel.radiosity.luxels import find_luxels, surface_areas
from luxel.radiosity.quality import QUALITIES
from luxel.radiosity.unwrap import unwrap
from luxel.raster.geometry import flatten
from luxel.scene.builtin import SCENES, box, icosphere, quad
from luxel.scene.transforms import look_at

pytest.importorskip("xatlas", reason="the extra 'bake' is not installed")


def densities(atlas):
    """Texels per metre of every triangle along the directions in which it has most and least, and its area."""
    geometry = flatten(atlas.scene, "none")
    a, b, c = (geometry.positions[geometry.triangles[:, k]].astype(float) for k in range(3))
    u, v, w = (geometry.texcoords1[geometry.triangles[:, k]].astype(float) * atlas.size for k in range(3))
    area = surface_areas(geometry)
    good = area > 1e-9
    edges, texels = np.stack([b - a, c - a], 2)[good], np.stack([v - u, w - u], 2)[good]
    tangent = np.linalg.qr(edges)[0]
    stretch = texels @ np.linalg.inv(np.swapaxes(tangent, 1, 2) @ edges)
    return np.linalg.svd(stretch, compute_uv=False), area[good]


def check_sound(atlas, gutter=2):
    found = diagnose(atlas)
    assert not found.overlap
    assert not found.outside
    assert not found.contested
    assert found.gutter >= min(gutter, 4)
    for mesh in atlas.scene.meshes:
        assert mesh.texcoords1.min() >= 0
        assert mesh.texcoords1.max() <= 1
    assert len(atlas.chart) == atlas.scene.triangle_count
    assert len(atlas.instance_page) == len(atlas.scene.instances) == len(atlas.scene.meshes)
    assert atlas.instance_page.max(initial=0) < atlas.pages
    return found


def test_the_density_is_exact_whatever_scale_turn_and_mirror():
    scene = Scene(meshes=[box((1, 2, 3))])
    turned = look_at((1, 2, 3), (0, 0.5, 0.2))
    scene.instances = [
        Instance(0), Instance(0, np.diag([2.0, 2, 2, 1])), Instance(0, np.diag([-1.0, 0.5, 3, 1])), Instance(0, turned @ np.diag([1, 1, -0.7, 1])),
    ]  # fmt: skip
    atlas = unwrap(scene, 7.3)
    check_sound(atlas)
    stretch, _ = densities(atlas)
    assert np.allclose(stretch, 7.3, rtol=2e-4)


def test_density_by_material():
    scene = Scene()
    scene.add(quad(), Material(name="floor"))
    scene.add(quad(), Material(name="wall"))
    scene.add(quad(), Material(name="other"))
    atlas = unwrap(scene, {"floor": 20, "wall": 5.5, "": 9})
    stretch, _ = densities(atlas)
    assert np.allclose(stretch, np.repeat([20, 5.5, 9], 2)[:, None], rtol=1e-4)
    with pytest.raises(InputError, match="no material is called 'roof'"):
        unwrap(scene, {"roof": 3, "": 1})
    with pytest.raises(InputError, match="none for material 'other'"):
        unwrap(scene, {"floor": 3, "wall": 1})


def test_faces_of_whole_texels_start_at_texels_corners():
    luxels = find_luxels(unwrap(Scene.from_mesh(box((1, 2, 3))), 4.0))
    assert len(luxels.area) == 2 * (4 * 8 + 4 * 12 + 8 * 12)
    assert np.array_equal(luxels.coverage, np.ones(len(luxels.area)))


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10**6), gutter=st.integers(0, 4), density=st.floats(10, 60))
def test_charts_keep_apart(seed, gutter, density):
    rng = np.random.default_rng(seed)
    scene = Scene(meshes=[box((0.4, 0.3, 1)), icosphere(0.5, 2), Mesh(rng.random((60, 3)), rng.permutation(60).reshape(20, 3))])
    for i in range(5):
        matrix = np.eye(4)
        matrix[:3, :3] = rng.normal(size=(3, 3))
        scene.instances.append(Instance(i % 3, matrix, i))
    atlas = unwrap(scene, density, 512, gutter)
    found = diagnose(atlas)
    assert not found.contested
    assert not found.outside
    assert found.gutter >= gutter
    stretch, area = densities(atlas)
    known = 2 * area * density**2 > 1
    assert np.average(stretch[known].mean(1), weights=area[known]) == pytest.approx(density, rel=0.1)


def test_a_scene_looks_the_same_when_unwrapped():
    scene = SCENES["room"]()
    atlas = unwrap(scene, 30.0, 256)
    assert atlas.pages > 1
    assert atlas.size == (256, 256)
    assert len(atlas.scene.instances) > len(scene.instances)  # some are on several pages
    camera = scene.cameras[0]
    before, after = (luxel.render(s, camera, size=(160, 120), outputs=("linear",)).linear for s in (scene, atlas.scene))
    assert (np.abs(before - after).max(2) > 1e-5).mean() < 1e-3  # where surfaces touch, the order of triangles decides
    assert {i.object for i in atlas.scene.instances} == {i.object for i in scene.instances}


def test_one_page_is_as_large_as_it_needs():
    atlas = unwrap(Scene.from_mesh(quad(2, 1)), 10.0)
    assert atlas.pages == 1
    assert sorted(atlas.size) == [12, 20]


def test_the_same_bytes_again():
    one, two = (unwrap(SCENES["room"](), 10.0) for _ in range(2))
    assert one.chart.tobytes() == two.chart.tobytes()
    for a, b in zip(one.scene.meshes, two.scene.meshes, strict=True):
        assert a.texcoords1.tobytes() == b.texcoords1.tobytes()
        assert a.triangles.tobytes() == b.triangles.tobytes()


def test_a_chart_too_large_for_a_page_is_made_to_fit():
    scene = Scene.from_mesh(quad(100, 40))
    with pytest.warns(LuxelWarning, match=r"1 chart does not fit on a page of 256 texels: down to 2\.5. texels per metre where 10 were asked for"):
        atlas = unwrap(scene, 10.0, 256)
    check_sound(atlas)
    stretch, _ = densities(atlas)
    assert atlas.pages == 1
    assert np.allclose(stretch, stretch[0, 0], rtol=2e-3)
    assert 2.4 < stretch[0, 0] < 2.56
    assert diagnose(atlas).density.median == pytest.approx(2.55, rel=0.02)


def soup(n, size, seed=0):
    rng = np.random.default_rng(seed)
    corners = rng.random((n, 1, 3)) * 10 + rng.normal(size=(n, 3, 3)) * size
    return Mesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))


def test_pieces_smaller_than_a_texel_get_one_each():
    scene = Scene.from_mesh(soup(30_000, 0.01))
    scene.add(quad(4, 4))
    atlas = unwrap(scene, 8.0)
    found = check_sound(atlas)
    luxels, geometry = find_luxels(atlas), flatten(atlas.scene, "none")
    surface = surface_areas(geometry)
    assert len(luxels.area) == found.luxels == 32 * 32 + np.count_nonzero(surface[:30_000])
    assert found.small == found.charts - 1
    assert np.allclose(np.bincount(luxels.chart, luxels.area), np.bincount(atlas.chart, surface), rtol=1e-5)


def test_too_many_pieces_to_chart_are_told(monkeypatch):
    monkeypatch.setattr(pieces, "MOST_CHARTED", 50)
    with pytest.warns(LuxelWarning, match="150 separate pieces smaller than .* texels get one luxel each"):
        atlas = unwrap(Scene.from_mesh(soup(200, 0.3)), 20.0)
    check_sound(atlas)
    luxels = find_luxels(atlas)
    counts = np.sort(np.bincount(luxels.chart))
    assert (counts[:150] == 1).all()
    assert (counts[150:] > 20).all()


def test_very_many_tiny_pieces_are_told():
    """And laid out in as much room as they need, a texel and its gutter each."""
    count = pieces.MOST_CHARTED + 5_000
    with pytest.warns(LuxelWarning, match="45,000 separate pieces are smaller than a texel: each gets one luxel, whatever the density"):
        atlas = unwrap(Scene.from_mesh(soup(count, 0.001)), 8.0, page=256)
    found = check_sound(atlas)
    assert found.charts == found.luxels == found.small == count
    assert atlas.pages == -(-count // (258 // 3) ** 2)
    assert "45,000 smaller than a texel, 100.00% of the surface" in found.text()


def test_triangles_without_an_area_go_with_their_neighbours():
    mesh = quad(1, 1)
    corners = np.concatenate([mesh.positions, [[0, 0.5, 0], [np.nan, 0, 0], [0.25, 0.5, 1e-9]]])
    lines = [[2, 3, 4], [0, 0, 1], [0, 5, 1], [2, 4, 6]]
    scene = Scene.from_mesh(Mesh(corners, np.concatenate([mesh.triangles, lines]), normals=np.tile([0, 0, 1.0], (7, 1))))
    atlas = unwrap(scene, 8.0)
    assert np.array_equal(atlas.chart, np.zeros(6))
    assert diagnose(atlas).luxels == len(find_luxels(atlas).area) == 64
    assert np.isfinite(atlas.scene.meshes[0].texcoords1).all()


def test_a_scene_without_any_area():
    scene = Scene.from_mesh(Mesh(np.zeros((3, 3)), [[0, 1, 2]]))
    scene.instances.append(Instance(0, np.diag([0.0, 0, 0, 1])))
    atlas = unwrap(scene)
    assert not len(find_luxels(atlas).area)
    assert diagnose(atlas).faults()[-1] == "there is no surface"
    assert unwrap(Scene()).pages == 1


def test_own_coordinates_serve():
    scene = laid_out([rectangle(2, 2, 20, 8), rectangle(2, 12, 20, 8, z=1)], (32, 32)).scene
    atlas = unwrap(scene, None, 32)
    assert atlas.reused
    assert atlas.size == (32, 32)
    assert atlas.pages == 1
    assert atlas.chart.tolist() == [0, 0, 1, 1]
    assert len(find_luxels(atlas).area) == 2 * 160
    wide = unwrap(laid_out([rectangle(2, 2, 40, 8), rectangle(2, 12, 40, 8, z=1)], (64, 24)).scene, 4.0, 128)
    assert wide.reused
    assert wide.size == (128, 48)
    fine = unwrap(scene, 16.0, 200)  # would take a page of 256 x 256
    assert not fine.reused
    assert np.allclose(densities(fine)[0], 16)
    assert not unwrap(scene, reuse=False).reused


def test_meshes_that_overlap_each_other_get_pages():
    scene = laid_out([rectangle(2, 2, 20, 8), rectangle(2, 2, 20, 9, z=1), rectangle(2, 14, 20, 9, z=2)], (32, 32)).scene
    atlas = unwrap(scene, page=32)
    assert atlas.reused
    assert atlas.instance_page.tolist() == [0, 1, 0]
    assert atlas.pages == 2
    assert len(find_luxels(atlas).area) == 160 + 180 + 180


@pytest.mark.parametrize("bad", [
    [rectangle(2, 2, 20, 8), rectangle(2, 8, 20, 8, z=1)],  # overlap in one mesh
    [rectangle(20, 2, 20, 8)],  # beyond 0..1
    [rectangle(2, 2, 20, 8), rectangle(2, 14, 0.001, 0.001, metres=20000)],  # hardly any texel for all of a wall
    [rectangle(2, 2, 20, 8), rectangle(2, 14, 2, 2, metres=10)],  # densities that differ too much
])  # fmt: skip
def test_own_coordinates_that_do_not_serve_are_made_anew(bad):
    parts = [(positions, np.array(triangles) + 4 * i, texels) for i, (positions, triangles, texels, *_) in enumerate(bad)]
    joined = (*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)), 0)
    atlas = unwrap(laid_out([joined], (32, 32)).scene, page=64)
    assert not atlas.reused
    check_sound(atlas)


def test_textures_on_the_second_coordinates_keep_their_place():
    picture = np.zeros((8, 8, 3), np.uint8)
    picture[:4] = 255
    scene = Scene(textures=[Texture(picture)], materials=[Material((1, 1, 1, 1), base_color_texture=TextureRef(0, 1), shading="unlit")])
    mesh = quad(2, 2)
    scene.add(Mesh(mesh.positions, mesh.triangles, mesh.normals, texcoords1=mesh.texcoords * 3, material=0))
    atlas = unwrap(scene, 4.0)
    camera = luxel.Camera.look_at((0, 0, 3), (0, 0, 0))
    before, after = (luxel.render(s, camera, size=(32, 32)).color for s in (scene, atlas.scene))
    assert np.array_equal(before, after)
    assert atlas.scene.materials[0].base_color_texture.texcoord == 0
    assert scene.materials[0].base_color_texture.texcoord == 1
    scene.materials[0].emissive_texture = TextureRef(0, 0)
    with pytest.warns(LuxelWarning, match="base color texture uses TEXCOORD_1"):
        atlas = unwrap(scene, 4.0)
    assert atlas.scene.materials[0].base_color_texture is None


@pytest.mark.parametrize(("arguments", "message"), [
    ({"density": 0}, r"density: expected texels per metre above 0 and below 1e\+09, got 0"),
    ({"density": {"": float("nan")}}, "density: expected texels"),
    ({"page": 8}, "page: expected a whole number of texels in 16 .. 16384, got 8"),
    ({"page": 100.0}, "page: expected"),
    ({"gutter": -1}, "gutter: expected"),
])  # fmt: skip
def test_wrong_arguments(arguments, message):
    with pytest.raises(InputError, match=message):
        unwrap(Scene.from_mesh(quad()), **arguments)


def test_overlap_is_measured():
    found = diagnose(laid_out([rectangle(0, 0, 10, 10), rectangle(5, 0, 10, 10, chart=1)], (70, 70)))
    assert found.overlap == pytest.approx(1 / 3)
    assert found.contested == 50
    assert found.gutter == 0
    assert found.faults()[0] == "charts overlap: 33.33% of what they cover is covered twice"


@pytest.mark.parametrize(("apart", "gutter"), [(0, 0), (1, 1), (1.5, 1), (3, 3), (40, 4)])
def test_gutters_are_measured(apart, gutter):
    found = diagnose(laid_out([rectangle(0, 0, 10, 10), rectangle(10 + apart, 3, 10, 10, chart=1)], (70, 70)))
    assert found.gutter == gutter
    assert not found.overlap


def test_a_diagnosis_reads_well():
    text = diagnose(unwrap(SCENES["cornell-box"](), 64.0)).text()
    assert "density      64 texels per metre (64 to 64)" in text
    assert "overlap      0.00%, 0 texels with two charts" in text
    assert "fault" not in text
    beyond = diagnose(laid_out([rectangle(-4, 0, 10, 10)], (16, 16)))
    assert beyond.outside == 2
    assert "fault        2 triangles reach beyond 0..1" in beyond.text()
    scene = SCENES["cornell-box"]()
    one_sided = diagnose(unwrap(scene, 64.0))
    for material in scene.materials:
        material.double_sided = True
    assert diagnose(unwrap(scene, 64.0)).sides == 2 * one_sided.sides == 2 * one_sided.luxels
    small, large = estimate(10_000, 100), estimate(1_000_000, 100)
    assert small[0] < large[0] < 2 << 30
    assert small[1] < large[1]


@pytest.mark.parametrize(("luxels", "triangles", "dark", "sky"), [
    (28_288, 46, (0.28, 0.29, 0.97), (0.82, 1.3, 6.4)),  # Cornell box, 120 luxels a metre
    (309_168, 46, (2.6, 4.1, 10.8), (7.6, 12.1, 58.0)),  # and 400
    (14_445, 3_204, (0.20, 0.28, 0.89), (0.22, 0.36, 1.8)),  # room-simple
    (29_503, 82_692, (2.0, 3.5, 7.1), (2.4, 4.4, 12.2)),  # the demo's room
])  # fmt: skip
def test_the_time_of_a_bake_is_told_roughly(luxels, triangles, dark, sky):
    """Within a factor of two without a sky, of three under one, as nobody knows how much of it is seen: nothing in room-simple, much in a box that
    is open in front. As measured on two cores: processor time by two, of draft, normal and final."""
    for quality, took, under in zip(("draft", "normal", "final"), dark, sky, strict=True):
        said, below = (estimate(luxels, triangles, *effort(QUALITIES[quality], there, True))[1] for there in (False, True))
        assert took / 2 < said < took * 2, quality
        assert under / 3 < below < under * 3, quality


@pytest.mark.parametrize(("quality", "luxels", "triangles", "sky", "glows", "seconds"), [
    ("progressive", 12_407, 46, False, True, 0.17),  # Cornell box, 80 luxels a metre
    ("progressive", 75_615, 46, False, True, 3.2),  # and 200
    ("progressive", 42_589, 3_204, False, True, 1.4),  # room-simple
    ("progressive", 28_355, 17_098, False, True, 1.7),  # room-complex
    ("progressive", 100_238, 17_098, False, True, 9.8),
    ("progressive", 11_497, 69_451, True, False, 2.5),  # a bunny under a sky
    ("progressive", 12_941, 69_453, False, True, 1.1),  # and below a lamp
    ("reference", 7_006, 46, False, True, 6.0),
    ("reference", 3_280, 46, True, True, 7.3),
    ("reference", 6_086, 3_204, False, True, 11.3),
    ("reference", 6_086, 3_204, True, True, 8.6),
    ("reference", 1_304, 69_453, False, True, 2.7),
    ("reference", 1_563, 69_451, True, False, 5.5),
])  # fmt: skip
def test_the_time_of_shooters_is_told_as_roughly(quality, luxels, triangles, sky, glows, seconds):
    """As measured on two cores, without the layout, which a dry run has just made: processor time by two."""
    said = estimate(luxels, triangles, *effort(QUALITIES[quality], sky, glows))[1]
    assert seconds / 2.5 < said < seconds * 2.5


@pytest.mark.parametrize(("luxels", "triangles", "loose", "seconds"), [(124_600, 20_012, 40_000, 2.8), (284_600, 100_012, 200_000, 25.0)])
def test_the_time_of_tiny_pieces_is_told_as_roughly(luxels, triangles, loose, seconds):
    """As measured on two cores: processor time by two. Confetti in a room, as a draft."""
    said = estimate(luxels, triangles, *effort(QUALITIES["draft"], False, False), loose)[1]
    assert seconds / 2.5 < said < seconds * 2.5


def test_tiny_pieces_take_longer_than_as_many_luxels_of_walls():
    scene = Scene.from_mesh(soup(1000, 0.01))
    found = diagnose(unwrap(scene, 8.0))
    assert found.small == found.luxels == found.sides == 1000
    assert found.seconds == pytest.approx(estimate(1000, 1000, loose=1000)[1])
    assert found.seconds > 1.2 * estimate(1000, 1000)[1]


def test_a_dry_run_has_just_seen_how_long_the_layout_takes():
    atlas = unwrap(SCENES["cornell-box"](), 10.0)
    assert diagnose(atlas, laid=100.0).seconds == pytest.approx(100.0 + diagnose(atlas, laid=0.0).seconds)


def test_real_scenes(meshes):
    for name in ("CornellBox-Original.obj", "living_room.glb"):
        atlas = unwrap(luxel.load(meshes / "scenes" / name), page=512)
        found = diagnose(atlas)
        assert found.serves
        geometry = flatten(atlas.scene, "none")
        luxels = find_luxels(atlas)
        assert luxels.area.sum(dtype=np.float64) == pytest.approx(surface_areas(geometry).sum(), rel=1e-6)


def test_each_process_makes_the_same():
    """Not beside one made in this process: xatlas crashes, once in a while."""
    scene, seen = SCENES["cornell-box"](), []
    there = unwrap(scene, 10.0, progress=seen.append)
    again = unwrap(scene, 10.0)
    assert again.chart.tobytes() == there.chart.tobytes()
    assert all(a.texcoords1.tobytes() == b.texcoords1.tobytes() for a, b in zip(again.scene.meshes, there.scene.meshes, strict=True))
    assert all(0 < share < 1 for share in seen)
    assert seen == sorted(seen)


def test_a_process_that_crashes_is_started_anew(monkeypatch):
    work, calls = packing._elsewhere, []

    def crash(*args):
        calls.append(len(calls))
        if len(calls) < packing.TRIES:
            raise packing._CrashedError("ended with -11")
        return work(*args)

    monkeypatch.setattr(packing, "_elsewhere", crash)
    assert len(unwrap(SCENES["cornell-box"](), 10.0).chart)
    assert len(calls) == packing.TRIES
    monkeypatch.setattr(packing, "TRIES", 9)
    calls.clear()
    monkeypatch.setattr(packing, "_elsewhere", lambda *args: calls.append(1) or (_ for _ in ()).throw(packing._CrashedError("ended with -11")))
    with pytest.raises(luxel.LuxelError, match="ended with -11"):
        unwrap(SCENES["cornell-box"](), 10.0)
    assert len(calls) == 9


def test_the_end_of_the_other_process_is_told():
    corners, faces = np.zeros((3, 3), np.float32), np.array([[0, 1, 7]], np.uint32)
    with pytest.raises(luxel.LuxelError, match=r"xatlas, which makes lightmap coordinates, ended with 1: .*[Oo]ut of range"):
        packing.pack([packing.Sheet(corners, faces, corners)], packing.Wishes(64, 1, 100.0, 1.0))


def test_an_atlas_that_is_given_is_used(monkeypatch):
    """An empty one counts as false; another would be taken down when it is done with, for which xatlas may wait for ever."""
    xatlas, made = pytest.importorskip("xatlas"), []
    given = xatlas.Atlas()
    monkeypatch.setattr(xatlas, "Atlas", lambda: made.append(1))
    corners = np.array([[0, 0, 0], [8, 0, 0], [0, 8, 0]], np.float32)
    sheet = packing.Sheet(corners, np.array([[0, 1, 2]], np.uint32), np.tile(np.float32([0, 0, 1]), (3, 1)))
    flat = packing._pack([sheet], packing.Wishes(64, 2, 4096.0, 0.5), given)
    assert not made
    assert len(given) == len(flat) == 1
