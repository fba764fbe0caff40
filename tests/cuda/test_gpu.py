"""On a real GPU only: more of the same comparisons, at real sizes, and what only a GPU can show."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from gpu_drawing import EVERYTHING, assert_same, both, camera, plain, textured

import luxel
from luxel.cuda.frame import draw_views
from luxel.cuda.resident import Resident
from luxel.raster.render import Options, prepare
from luxel.scene.builtin import SCENES

pytestmark = pytest.mark.usefixtures("real_gpu")


def test_thousands_of_random_scenes(real_gpu):
    """Ids and depth: 100 scenes, each from 20 places."""
    rng = np.random.default_rng(0)
    for seed in range(100):
        views = [camera(z, near=near) for z, near in zip(rng.uniform(0, 9, 20), 10 ** rng.uniform(-4, 0, 20))]
        options = {"samples": int(rng.choice([1, 2, 4, 8, 16])), "outputs": ("triangle", "depth", "object")}
        size, cull = tuple(rng.integers(1, 300, 2).tolist()), ("material", "none")[seed % 2]
        assert_same(*both(real_gpu, plain(seed, 200, float(10 ** rng.uniform(-1, 3))), views, size, cull=cull, **options))


@pytest.mark.parametrize("seed", range(20))
def test_materials_and_light(real_gpu, seed):
    options = {"samples": (1, 4)[seed % 2], "filter": ("box", "mitchell")[seed // 2 % 2], "outputs": EVERYTHING}
    assert_same(*both(real_gpu, textured(seed, count=200), [camera(8), camera(1)], (640, 360), previous=camera(7), **options), step=1)


def test_all_models(real_gpu, meshes):
    names = sorted(path for path in meshes.rglob("*") if path.suffix in (".obj", ".ply", ".off", ".stl", ".glb", ".gltf"))
    assert names
    for path in names:
        scene = luxel.load(path)
        for samples in (1, 4):
            assert_same(*both(real_gpu, scene, [None], (1920, 1080), samples=samples, outputs=("color", "triangle", "depth")), step=1)


def test_a_thousand_views_at_once(real_gpu):
    scene, views = plain(1, 300), [camera(z) for z in np.linspace(1, 20, 1000)]
    ours, theirs = both(real_gpu, scene, views, (64, 64), outputs=("color", "triangle", "depth"))
    assert_same(ours, theirs, step=1)


@pytest.mark.parametrize("library", ["cupy", "torch", "jax"])
def test_arrays_are_handed_over_without_a_copy(real_gpu, library):
    picture = luxel.render(plain(2), camera(), (64, 48), device="cuda", on_device=True, outputs=("color", "depth", "triangle"))
    other = pytest.importorskip(library, reason=f"{library} is not installed")
    if library == "torch" and not other.cuda.is_available():
        pytest.skip("torch has no CUDA")
    taken = {"cupy": lambda a: other.from_dlpack(a), "torch": lambda a: other.from_dlpack(a), "jax": lambda a: other.dlpack.from_dlpack(a)}[library]
    for array in picture.outputs().values():
        there = taken(array)
        host = there.get() if library == "cupy" else there.cpu().numpy() if library == "torch" else np.asarray(there)
        np.testing.assert_array_equal(host, np.asarray(array))
        if library == "cupy":
            assert other.asarray(array).data.ptr == array.pointer
        if library == "torch":
            assert there.data_ptr() == array.pointer


def test_pictures_left_on_the_device_are_not_drawn_over(real_gpu):
    prepared = luxel.prepare(plain(3), device="cuda")
    first = luxel.render(prepared, camera(8), (64, 48), on_device=True)
    kept = np.asarray(first.color)
    luxel.render(prepared, camera(1), (64, 48), on_device=True)
    luxel.render(prepared, camera(2), (64, 48))
    np.testing.assert_array_equal(np.asarray(first.color), kept)


def test_memory_is_given_back(real_gpu):
    prepared = prepare(textured(4))
    resident = Resident(real_gpu, prepared)
    for _ in range(20):
        draw_views(resident, [camera()], (640, 480), Options(samples=4), [None], keep=True)
    real_gpu.wait()
    before = real_gpu.free_memory()
    for _ in range(500):
        draw_views(resident, [camera()], (640, 480), Options(samples=4), [None], keep=True)
    real_gpu.wait()
    assert before - real_gpu.free_memory() < 64 << 20


def test_threads_draw_one_after_the_other(real_gpu):
    prepared = luxel.prepare(textured(5), device="cuda")
    wanted = [np.asarray(luxel.render(prepared, camera(z), (100, 80)).color) for z in (2, 4, 8)]
    with ThreadPoolExecutor(6) as pool:
        drawn = list(pool.map(lambda k: luxel.render(prepared, camera((2, 4, 8)[k % 3]), (100, 80)).color, range(60)))
    for k, color in enumerate(drawn):
        np.testing.assert_array_equal(color, wanted[k % 3])


@pytest.mark.parametrize("name", ["cornell-box", "room-simple", "room-complex", "room"])
@pytest.mark.parametrize("quality", ["draft", "normal", "final", "progressive"])
def test_bakes(real_gpu, name, quality):
    """Beside the processor's; what one ray may do to a luxel is said in test_cuda_bake."""
    made = SCENES[name]
    options = {"quality": quality, "sky": 0.5 if name == "room" else None}
    ours, theirs = (luxel.bake(made(), device=device, **options) for device in ("cpu", "cuda"))
    difference, mean = np.abs(ours.irradiance - theirs.irradiance), ours.irradiance.mean()
    assert difference.mean() < 1e-4 * mean
    assert (difference > 2e-2 * mean).any(1).mean() < 1e-4
    last = theirs.ledger[-1]
    np.testing.assert_allclose(last.absorbed + last.escaped + last.unshot, last.emitted, rtol=1e-6)


def test_a_bake_is_the_same_each_time(real_gpu):
    """Sums do not depend on when threads run."""
    one, other = (luxel.bake(SCENES["room-simple"](), device="cuda", sky=0.2).irradiance for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_ten_thousand_frames_without_a_leak(real_gpu):
    prepared = prepare(plain(6))
    resident = Resident(real_gpu, prepared)
    for count in (200, 10_000):
        real_gpu.wait()
        before = real_gpu.free_memory()
        for i in range(count):
            draw_views(resident, [camera()], (64, 48), Options(), [None], keep=i % 2 == 0)
    real_gpu.wait()
    assert before - real_gpu.free_memory() < 16 << 20
