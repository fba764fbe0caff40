import math

import numpy as np
import pytest
from fragments import batch, evaluate_and_light, hemisphere, rgb, shade, unit
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel import jit
from luxel.raster.arithmetic import exp2, log2
from luxel.raster.lighting import environment, pack_lights, reflection
from luxel.raster.materials import pack_materials
from luxel.scene.camera import Camera
from luxel.scene.light import Ambient, Light
from luxel.scene.material import Material
from luxel.scene.scene import Scene
from luxel.scene.transforms import look_at

MATT = Material(alpha_mode="BLEND", base_color=(0.5, 0.25, 1.0, 0.75), specular=(0, 0, 0))


@jit.kernel
def powers(x, logs, y, exps):
    for i in range(len(x)):
        logs[i] = log2(x[i])
    for i in range(len(y)):
        exps[i] = exp2(y[i])


@jit.kernel
def lobes(n, l, v, roughness, out):
    for i in range(len(l)):
        lobe, fresnel = reflection(n[0], n[1], n[2], l[i, 0], l[i, 1], l[i, 2], v[i, 0], v[i, 1], v[i, 2], roughness)
        out[i, 0] = lobe
        out[i, 1] = fresnel


@jit.kernel
def environments(nv, roughness, out):
    for i in range(len(nv)):
        out[i, 0], out[i, 1] = environment(nv[i], roughness)


def lobe_of(n, l, v, roughness):
    out = np.zeros((len(l), 2), np.float32)
    lobes(np.asarray(n, np.float32), l.astype(np.float32), v.astype(np.float32), np.float32(roughness), out)
    return out.astype(np.float64).T


def from_above(kind="directional", height=1.0, **rest):
    return Light(kind, world_from_light=look_at((0, 0, height), (0, 0, 0)), **rest)


def test_powers_are_within_the_documented_errors():
    rng = np.random.default_rng(0)
    x = np.concatenate([2 ** rng.uniform(-100, 100, 3000), 1 + rng.uniform(-1e-3, 1e-3, 500), [1]]).astype(np.float32)
    y = np.concatenate([rng.uniform(-126, 126, 3000), np.arange(-126.0, 128), [-1e9, 1e9]]).astype(np.float32)
    logs, exps = np.zeros(len(x), np.float32), np.zeros(len(y), np.float32)
    powers(x, logs, y, exps)
    exact = np.log2(x.astype(np.float64))
    assert (np.abs(logs - exact) <= 3 * np.spacing(np.maximum(np.abs(exact), 1e-30).astype(np.float32))).all()
    assert np.allclose(exps, np.exp2(np.clip(y.astype(np.float64), -126, 127)), rtol=1.5e-7, atol=0)
    assert logs[-1] == 0
    assert np.array_equal(exps[3000:-2], np.exp2(np.arange(-126.0, 128)))  # whole powers are exact


def test_lambert():
    normals = unit(np.random.default_rng(0).normal(size=(9, 3)))
    shown = shade([MATT], [from_above(color=(1, 0.5, 0.25), intensity=2)], normal=7 * normals)
    expected = np.maximum(normals[:, 2:], 0) * np.array([0.5, 0.25, 1]) * np.array([1, 0.5, 0.25]) * 2 / np.pi
    assert np.allclose(shown[:, :3], expected, atol=1e-6)
    assert (shown[:, 3] == np.float32(0.75)).all()


def test_white_surface_that_faces_a_light_of_pi_shows_one():
    shown = shade([Material(base_color=(1, 1, 1, 1), specular=(0, 0, 0))], [from_above()])
    assert np.allclose(shown, 1, atol=1e-6)


def test_several_lights_add_up():
    lights = [Light(world_from_light=look_at(p, (0, 0, 0)), intensity=i) for p, i in (((1, 0, 1), 1), ((0, 2, 1), 2), ((0, 0, 3), 3))]
    for shading in ("phong", "pbr"):
        together = shade([Material()], lights, shading=shading)
        assert np.allclose(together[:, :3], sum(shade([Material()], [light], shading=shading)[:, :3] for light in lights), atol=1e-6)


def test_point_light_falls_off_with_the_square_and_ends_at_its_range():
    heights = np.array([0.5, 1, 2, 3.9, 4, 9])
    positions = np.stack([0 * heights, 0 * heights, -heights], 1)
    light = Light("point", intensity=np.pi, range=4)
    shown = shade([MATT], [light], normal=[[0, 0, 1]], position=positions)[:, 2]
    assert np.allclose(shown, np.maximum(1 - (heights / 4) ** 4, 0) / heights**2, atol=1e-6)
    assert (shown[4:] == 0).all()
    endless = shade([MATT], [Light("point", intensity=np.pi)], position=positions)[:, 2]
    assert np.allclose(endless, heights**-2.0, rtol=1e-6)


def test_spot_light_is_full_inside_and_dark_outside_its_cones():
    angles = np.radians([0, 14.9, 20, 25, 30.1, 80])
    positions = np.stack([np.tan(angles), 0 * angles, 0 * angles], 1)
    light = from_above("spot", intensity=np.pi, inner_cone=np.radians(15), outer_cone=np.radians(30))
    shown = shade([MATT], [light], position=positions)[:, 2]
    inner, outer = np.cos(np.radians([15, 30]))
    cone = np.clip((np.cos(angles) - outer) / (inner - outer), 0, 1) ** 2
    assert np.allclose(shown, cone * np.cos(angles) ** 3, atol=1e-5)
    assert shown[1] > 0.89
    assert (shown[4:] == 0).all()


def test_blinn_phong_is_its_formula():
    l, v, exponent = unit((1, 2, 3)), unit((-2, 1, 4)), 30.0
    material = Material(base_color=(0.2, 0.4, 0.6, 1), specular=(0.5, 0.3, 0.1), shininess=exponent)
    shown = shade([material], [Light(world_from_light=look_at(l, (0, 0, 0)), intensity=2)], view=[v])[0, :3]
    highlight = (exponent + 8) / (8 * np.pi) * unit(l + v)[2] ** exponent
    expected = 2 * l[2] * (np.array([0.2, 0.4, 0.6]) / np.pi + np.array([0.5, 0.3, 0.1]) * highlight)
    assert np.allclose(shown, expected, rtol=1e-5)


@pytest.mark.parametrize(("metallic", "roughness"), [(0, 0.3), (1, 0.5), (0.4, 1)])
def test_metallic_roughness_is_its_formula(metallic, roughness):
    base, l, v = np.array([0.9, 0.5, 0.1]), unit((1, 2, 3)), unit((-2, 1, 4))
    material = Material(base_color=(*base, 1), metallic=metallic, roughness=roughness, shading="pbr")
    shown = shade([material], [Light(world_from_light=look_at(l, (0, 0, 0)), intensity=2)], view=[v])[0, :3]
    h, square = unit(l + v), roughness**4
    f0 = 0.04 * (1 - metallic) + base * metallic
    fresnel = f0 + (1 - f0) * (1 - v @ h) ** 5
    spread = square / (np.pi * (h[2] ** 2 * (square - 1) + 1) ** 2)
    visible = 0.5 / (l[2] * np.sqrt(v[2] ** 2 * (1 - square) + square) + v[2] * np.sqrt(l[2] ** 2 * (1 - square) + square))
    expected = 2 * l[2] * ((1 - fresnel) * base * (1 - metallic) / np.pi + fresnel * spread * visible)
    assert np.allclose(shown, expected, rtol=1e-5)


directions = st.tuples(*[st.floats(-1, 1, width=32)] * 2, st.floats(0.015625, 1, width=32)).map(unit)


@settings(deadline=None, max_examples=60)
@given(directions, directions, st.floats(0.125, 1, width=32))
def test_the_lobe_is_reciprocal_and_never_negative(l, v, roughness):
    there, back = (lobe_of((0, 0, 1), a[None], b[None], roughness) for a, b in ((l, v), (v, l)))
    assert np.allclose(there, back, rtol=1e-3, atol=1e-6)
    assert (there >= 0).all()


@pytest.mark.parametrize("roughness", [0.1, 0.6, 1.0])
def test_white_furnace_of_lights(roughness):
    # A white metal under light from all around reflects no more than it gets, nearly all when smooth, and when it is rough what
    # follows from D = 1 / pi and V = 1 / (2 (n.l + n.v)): the integral of x / (x + n.v) over x = 0 .. 1.
    for cosine in (0.3, 0.7, 1.0):
        view = np.array([math.sqrt(1 - cosine**2), 0, cosine])
        half = half_vectors(roughness)
        l = 2 * (half @ view)[:, None] * half - view
        half, l = half[l[:, 2] > 1e-3], l[l[:, 2] > 1e-3]
        lobe, _ = lobe_of((0, 0, 1), l, np.broadcast_to(view, l.shape), roughness)
        # dl = 4 (v.h) dh; the half vectors were drawn with density D (n.h).
        square = roughness**4
        density = half[:, 2] * square / (np.pi * (half[:, 2] ** 2 * (square - 1) + 1) ** 2)
        albedo = (lobe * l[:, 2] * 4 * (half @ view) / density).sum() / SAMPLES
        assert albedo <= 1.01
        if roughness == 0.1:
            assert albedo > 0.99
        if roughness == 1.0:
            assert albedo == pytest.approx(1 - cosine * math.log(1 + 1 / cosine), rel=0.02)


SAMPLES = 400 if jit.DISABLED else 4000


def half_vectors(roughness):
    """Normals of microfacets, distributed as GGX has them, from a low-discrepancy sequence."""
    u = (np.arange(SAMPLES) + 0.5) / SAMPLES
    phi = 2 * np.pi * (np.arange(SAMPLES) * 0.6180339887498949 % 1)
    z = np.sqrt((1 - u) / (1 + (roughness**4 - 1) * u))
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], 1)


def test_white_dielectric_under_white_sky_shows_one():
    views = hemisphere(50)
    for roughness in (0.1, 0.5, 1.0):
        material = Material(base_color=(1, 1, 1, 1), roughness=roughness, shading="pbr")
        shown = shade([material], ambient=Ambient((1, 1, 1), (1, 1, 1)), view=views)
        assert np.allclose(shown, 1, atol=1e-5)


def test_white_metal_under_white_sky_keeps_energy():
    nv, out = np.linspace(0.05, 1, 20).astype(np.float32), np.zeros((20, 2), np.float32)
    for roughness in (0.1, 0.5, 1.0):
        environments(nv, np.float32(roughness), out)
        assert (out.sum(1) <= 1.001).all()
        assert (out.sum(1) > 1 - 0.6 * roughness).all()


def test_ambient_goes_from_ground_to_sky():
    normals = unit([(0, -1, 0), (1, 0, 0), (0, 1, 0)])
    shown = shade([Material(base_color=(1, 1, 1, 1), specular=(0, 0, 0))], ambient=Ambient((1, 0.5, 0), (0, 0.5, 1)), normal=normals)
    assert np.allclose(shown[:, :3], [(0, 0.5, 1), (0.5, 0.5, 0.5), (1, 0.5, 0)], atol=1e-6)


def test_emission_is_added_and_unlit_shows_its_colour():
    lit = Material(base_color=(0, 0, 0, 1), specular=(0, 0, 0), emissive=(3, 2, 1))
    unlit = Material(base_color=(0.1, 0.2, 0.3, 0.4), shading="unlit", alpha_mode="BLEND")
    shown = shade([lit, unlit], [from_above()], index=[0, 1, 0, -1], normal=[[0, 0, 1]] * 4)
    assert np.allclose(shown[:3], [(3, 2, 1, 1), (0.1, 0.2, 0.3, 0.4), (3, 2, 1, 1)])
    assert 0.8 < shown[3, 0] < 1  # the default material: 0.8 with a faint highlight


def test_mixed_batches_are_what_each_material_gives_alone():
    materials = [MATT, Material(roughness=0.3), Material(metallic=0.5, shading="pbr"), Material(shading="unlit"), Material(emissive=(1, 0, 0))]
    index = np.random.default_rng(3).integers(-1, 5, 200)
    rows = {"normal": hemisphere(200, 1), "view": hemisphere(200, 2)}
    lights, ambient = [from_above(), Light("point", world_from_light=look_at((2, 1, 3), (0, 0, 0)))], Ambient((0.2, 0.3, 0.4))
    mixed = shade(materials, lights, ambient, index=index, **rows)
    for k in range(-1, 5):
        alone = shade(materials, lights, ambient, index=k, **rows)
        assert np.array_equal(mixed[index == k], alone[index == k])


def test_tiny_or_missing_normals_and_views_give_numbers():
    for shading in ("phong", "pbr"):
        shown = shade([Material()], [from_above(), Light("point")], Ambient((1, 1, 1)), shading, normal=[[0, 0, 0], [0, 0, -1]], view=[[0, 0, 1]])
        assert np.isfinite(shown).all()
        assert (shown >= 0).all()


def test_a_scene_without_light_brings_its_own():
    camera = Camera.look_at((3, 4, 5), (0, 0, 0))
    table = pack_lights(Scene(), camera)
    assert len(table.lights) == 1
    towards = table.lights[0, :3]
    assert towards @ unit((3, 4, 5)) > 0.8
    assert not table.punctual
    for scene in (Scene(ambient=Ambient()), Scene(lights=[Light("point")])):
        assert len(pack_lights(scene, camera).lights) == len(scene.lights)
    assert pack_lights(Scene(lights=[Light("point")]), camera).punctual == 1


def test_gouraud_light_at_the_vertices_is_what_the_fragments_show():
    scene = Scene(materials=[Material(base_color=(0.5, 0.6, 0.7, 0.8), emissive=(0.1, 0, 0))], lights=[from_above()])
    lights, index = pack_lights(scene, Camera()), np.zeros(256, np.int32)
    g, n = batch(normal=hemisphere(5))
    evaluate_and_light(g, index, n, pack_materials(scene, "gouraud", vertices=True), lights)
    at_vertices = rgb(g, n).copy()
    assert np.allclose(at_vertices, shade(scene.materials, scene.lights, shading="phong", normal=hemisphere(5))[:, :3])
    evaluate_and_light(g, index, n, pack_materials(scene, "gouraud"), lights)
    assert np.array_equal(rgb(g, n), at_vertices)
