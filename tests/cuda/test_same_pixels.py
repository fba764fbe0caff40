"""What a GPU's threads draw is what the processor draws, to the last bit; the threads are run by the processor too, where there is no GPU."""

import numpy as np
import pytest
from gpu_drawing import EVERYTHING, assert_same, both, camera, plain, textured

import luxel
from luxel.cuda import frame
from luxel.raster.render import prepare

SIZE = 90, 70


def step(gpu):
    """Colours may differ by one step on a GPU, whose square roots and divisions are its own; ids and depth may not."""
    return 0 if gpu.name == "host" else 1


@pytest.mark.parametrize("seed", range(8))
def test_ids_and_depth_of_random_triangles(gpu, seed):
    """Also behind the camera, through the near plane and far beyond the guard band."""
    views = [camera(8), camera(1), camera(0), camera(0.1, near=1e-4)]
    names = ("triangle", "depth", "object", "material")
    for size in (0.3, 2, 500):
        assert_same(*both(gpu, plain(seed, 40, size), views, SIZE, outputs=names, cull=("material", "back", "none")[seed % 3]))


@pytest.mark.parametrize("samples", [1, 2, 4, 8, 16])
def test_every_output_and_number_of_samples(gpu, samples):
    scene, views = textured(1), [camera(8), camera(1)]
    assert_same(*both(gpu, scene, views, SIZE, samples=samples, outputs=EVERYTHING, previous=camera(7)), step(gpu))


def test_supersampling(gpu):
    assert_same(*both(gpu, textured(2), [camera(3)], SIZE, ssaa=3, outputs=("color", "linear")), step(gpu))


def test_opaque_pixels_over_a_background(gpu):
    scene = textured(3, (0, 1, 3))
    assert_same(*both(gpu, scene, [camera(6)], SIZE, samples=4, background=(0.1, 0.2, 0.3, 0.5), exposure=1.5), step(gpu))


@pytest.mark.parametrize("name", ["tent", "gaussian", "mitchell", "blackman-harris"])
def test_filters(gpu, name):
    assert_same(*both(gpu, textured(4), [camera(5)], SIZE, samples=4, filter=name, outputs=("color", "linear")), step(gpu))


@pytest.mark.parametrize("shading", ["flat", "gouraud", "phong", "pbr", "unlit"])
def test_shading_models(gpu, shading):
    assert_same(*both(gpu, textured(5), [camera(6), camera(2)], SIZE, shading=shading, samples=2, cull="none"), step(gpu))


def test_orthographic_cameras_and_masks(gpu):
    scene, views = textured(6, (1,), 60), [camera(3, yfov=None, height=4.0, near=0.1, far=9.0)]
    assert_same(*both(gpu, scene, views, SIZE, samples=4, outputs=("color", "depth", "triangle")), step(gpu))


def test_many_layers_of_glass(gpu):
    ours, theirs = both(gpu, textured(7, (2,), 60), [camera(4)], SIZE, samples=2)
    assert_same(ours, theirs, step(gpu))
    assert np.ptp(ours[0].color[..., 3]) > 100


@pytest.mark.parametrize("split", [(0, 8), (1, 32), (200, 16), (1 << 40, 32)])
def test_the_split_between_threads_and_warps_changes_nothing(gpu, split):
    assert_same(*both(gpu, textured(8, (0, 1, 2)), [camera(4), camera(0.5)], SIZE, split=split, outputs=("color", "triangle", "depth")), step(gpu))


def test_a_queue_that_overflows_is_drawn_again(gpu, monkeypatch):
    from luxel.cuda import resident

    monkeypatch.setattr(resident, "_ITEMS", 4)
    monkeypatch.setattr(resident, "_CANDIDATES", 3)
    assert_same(*both(gpu, textured(9, (0, 1, 2)), [camera(4), camera(0.5)], SIZE, split=(10, 8), outputs=("color", "triangle", "depth")), step(gpu))


def test_windows(gpu, monkeypatch):
    """Pictures too large for the guard band are drawn in windows."""
    monkeypatch.setattr(frame, "_WINDOW", 32)
    for options in ({"outputs": EVERYTHING}, {"samples": 4, "filter": "mitchell"}):
        ours, theirs = both(gpu, textured(10), [camera(6)], SIZE, tile=16, previous=camera(5), **options)
        assert_same(ours, theirs, step(gpu))


def test_views_that_do_not_fit_together(gpu, monkeypatch):
    monkeypatch.setattr(frame, "_BATCH_BYTES", 1)
    assert_same(*both(gpu, textured(11), [camera(z) for z in (8, 4, 1)], SIZE), step(gpu))


@pytest.mark.parametrize("options", [{"samples": 4}, {"samples": 8, "outputs": EVERYTHING}, {"filter": "tent"}, {"shading": "gouraud"}])
def test_memory_is_counted_before(monkeypatch, options):
    """All of it but what pieces of clipped triangles take, and not much more."""
    from host import Host

    from luxel.cuda.resident import Resident
    from luxel.raster.render import Options

    host, counted = Host(1 << 40), []
    resident = Resident(host, prepare(textured(1), options.pop("shading", None)))
    monkeypatch.setattr(host, "expect", lambda size, *_: counted.append(size))
    before = host.peak = host.held
    frame.draw_views(resident, [camera()], (300, 200), Options(**options), [None])
    assert host.peak - before <= counted[0] + (1 << 15) <= 1.3 * (host.peak - before)


def test_equal_depth_goes_to_the_lower_triangle(gpu):
    """The same triangles four times over, in any order."""
    rng = np.random.default_rng(12)
    mesh = plain(12, 30).meshes[0]
    order = rng.permutation(np.tile(np.arange(30), 4))
    doubled = luxel.Mesh(mesh.positions, mesh.triangles[order])
    scene = luxel.Scene(meshes=[doubled], instances=[luxel.Instance(0)])
    ours, theirs = both(gpu, scene, [camera(6), camera(0.2)], SIZE, samples=4, outputs=("triangle", "depth", "color"), cull="none")
    assert_same(ours, theirs, step(gpu))
    first = np.array([np.flatnonzero(order == t)[0] for t in order])
    assert (first[ours[0].triangle[ours[0].triangle >= 0]] == ours[0].triangle[ours[0].triangle >= 0]).all()


def test_nothing_to_draw(gpu):
    for scene in (luxel.Scene(), plain(13, 0)):
        assert_same(*both(gpu, scene, [camera(3)], (5, 4), outputs=("color", "depth", "triangle")))


def test_positions_that_are_not_finite(gpu):
    scene = plain(14)
    scene.meshes[0].positions[::7] = np.nan, np.inf, 0
    with np.errstate(all="ignore"):
        assert_same(*both(gpu, scene, [camera(5)], SIZE, outputs=("triangle", "depth")))


def test_a_scene_drawn_again_from_elsewhere(gpu):
    """Buffers keep nothing of the picture before: also not of one with other samples, size or outputs."""
    from luxel.cuda.frame import draw_views
    from luxel.cuda.resident import Resident
    from luxel.raster.render import Options, render

    prepared = prepare(textured(15))
    resident = Resident(gpu, prepared)
    for z, size, options in ((3, (40, 30), {"samples": 4}), (5, (64, 50), {"outputs": ("depth", "color")}), (1, (40, 30), {"filter": "tent"})):
        theirs = draw_views(resident, [camera(z)], size, Options(**options), [None])
        assert_same([render(prepared, camera(z), size, **options)], theirs, step(gpu))


@pytest.mark.parametrize("name", ["teapot.obj", "stanford-bunny.obj", "lionstatue.obj"])
def test_models(gpu, meshes, name):
    ours, theirs = both(gpu, luxel.load(meshes / name), [None], (160, 120), samples=4, outputs=("color", "triangle", "depth", "normal"))
    assert_same(ours, theirs, step(gpu))
