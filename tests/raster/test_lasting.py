"""Many renders, several at once, in children: nothing grows, nothing breaks, nothing compiles twice."""

import gc
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import tracemalloc
import weakref
from pathlib import Path

import numpy as np
import psutil
import pytest
from scenes import UNLIT, around, flat_camera, rectangle, room

import luxel
from luxel import Camera, Light, Material, Mesh, Scene, Texture, TextureRef, jit
from luxel.raster import bin, clip, cover, layer, outputs, project, resolve, shade

NAMES = ("color", "triangle", "depth")
KERNELS = {
    "project": project._project, "find": clip._find, "clip": clip._clip, "count": bin._count, "scan": bin._scan, "fill": bin._fill,
    "cover": cover._cover, "layer": layer._layer, "outputs": outputs._outputs, "resolve": resolve._resolve, "light vertices": shade._light_vertices,
}  # fmt: skip


def bytes_of(picture):
    return b"".join(np.ascontiguousarray(array).tobytes() for array in picture.outputs().values())


def draw(seed, **options):
    return luxel.render(room(seed), around(seed), (80, 60), outputs=NAMES, **{"samples": 4, **options})


def test_hundreds_of_renders_do_not_grow():
    """What Python holds, and what the process holds, after 300 more renders of changing scenes and sizes."""
    prepared = [luxel.prepare(room(seed)) for seed in range(3)]

    def some(count):
        for k in range(count):
            luxel.render(prepared[k % 3], around(k), (40 + k % 7 * 16, 30 + k % 5 * 8), samples=(1, 4)[k % 2], outputs=NAMES,
                         filter=("box", "tent")[k % 3 == 0])  # fmt: skip
        gc.collect()

    some(60)
    tracemalloc.start()
    try:
        some(20)
        before, held = tracemalloc.get_traced_memory()[0], psutil.Process().memory_info().rss
        some(300)
        after, now = tracemalloc.get_traced_memory()[0], psutil.Process().memory_info().rss
    finally:
        tracemalloc.stop()
    assert after - before < 300 * 512  # half a kilobyte a render: an array kept would be tens of them
    assert now - held < 8 << 20


def test_threads_of_the_caller_are_each_right():
    """Four Python threads, different scenes, at once, each with worker threads of its own."""
    want = {seed: bytes_of(draw(seed)) for seed in range(4)}
    wrong = []

    def work(seed):
        for _ in range(12):
            if bytes_of(draw(seed, threads=2)) != want[seed]:
                wrong.append(seed)

    threads = [threading.Thread(target=work, args=(seed,)) for seed in want]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def in_child(code):
    code = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n{code}"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_a_render_after_fork():
    """Parent and child both go on rendering, with the worker threads that the parent had and the child lost."""
    done = in_child(
        "import os, warnings; from test_lasting import bytes_of, draw\n"
        "warnings.simplefilter('ignore', DeprecationWarning)  # Python warns of forks beside threads\n"
        "want = bytes_of(draw(1, threads=2))\n"
        "child = os.fork()\n"
        "right = all(bytes_of(draw(1, threads=2)) == want for _ in range(5))\n"
        "if child == 0: os._exit(0 if right else 1)\n"
        "print(right, os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))\n"
    )
    assert done.stdout == "True 0\n", done.stderr


def test_a_render_in_a_spawned_process():
    context = multiprocessing.get_context("spawn")
    with context.Pool(1) as pool:
        assert pool.apply(spawned, (2,)) == bytes_of(draw(2))


def spawned(seed):
    sys.path.insert(0, str(Path(__file__).parent))
    return bytes_of(draw(seed, threads=2))


def variety():
    """Scenes and options that differ in every array that may be there or not, in layouts, and in types of numbers."""
    mesh = rectangle(0, 0, 20, 20)
    read_only = Mesh(mesh.positions.copy(), mesh.triangles.copy(), texcoords=np.asfortranarray(mesh.texcoords), normals=np.eye(4, 3))
    for array in (read_only.positions, read_only.triangles, read_only.texcoords, read_only.normals):
        array.flags.writeable = False
    colored = rectangle(0, 0, 9, 9, 0.5, colors=np.ones((4, 4)))
    tangents = Mesh(mesh.positions, mesh.triangles, texcoords=mesh.texcoords, texcoords1=mesh.texcoords, tangents=np.ones((4, 4)))
    image = Texture(np.full((4, 4, 4), 200, np.uint8))
    blend, mask = Material((1, 1, 1, 0.5), alpha_mode="BLEND"), Material(alpha_mode="MASK", base_color_texture=TextureRef(0))
    yield Scene(), {}
    yield Scene.from_mesh(mesh), {"shading": "flat"}
    yield Scene.from_mesh(read_only, Material(**UNLIT)), {"samples": 4, "filter": "tent"}
    yield Scene.from_mesh(colored, blend), {"background": (1, 0, 0), "exposure": 1}
    yield Scene(meshes=[tangents], textures=[image], materials=[mask]), {"samples": 8}
    lit = Scene.from_mesh(Mesh(mesh.positions, mesh.triangles, texcoords=mesh.texcoords), mask)
    lit.textures, lit.lights = [image], [Light(), Light("spot")]
    yield lit, {"shading": "gouraud", "ssaa": 2, "threads": 2}
    yield room(1), {"previous_camera": around(), "filter": "mitchell", "tile": np.int64(32)}


def test_kernels_compile_once():
    cameras = [
        flat_camera((32, 32)), flat_camera((32, 32), near=np.float32(-1), far=np.float32(2)), around(), around(near=np.float32(0.5), far=9),
        Camera.look_at([10, -10, 0.3], [0, 0, 0], near=0.1),
    ]  # fmt: skip
    for scene, options in variety():
        for camera in cameras:
            for names in (("color",), ("linear", "depth", "normal"), ("color", "linear", *outputs.SHAPES)):
                luxel.render(scene, camera, (32, 32), outputs=names, **options)
    compiled = {name: list(kernel.signatures) for name, kernel in KERNELS.items()}
    compiled["cover"] = [kinds for kinds in compiled["cover"] if str(kinds[-1]) == "none"]  # the others count overdraw
    assert {name: len(found) for name, found in compiled.items()} == dict.fromkeys(KERNELS, 1)
    assert len(shade._shade.signatures) <= 2  # with and without textures


def test_importing_luxel_imports_no_numba():
    done = in_child("import luxel; luxel.Scene, luxel.Camera, luxel.load; print('numba' in sys.modules, 'scipy' in sys.modules)")
    assert done.stdout == "False False\n", done.stderr


def test_what_fails_in_a_helping_thread_is_told():
    """And the helper lives on; a caller that fails first is not kept waiting by helpers that have not begun."""
    main = threading.current_thread()
    both = threading.Barrier(2, timeout=60)

    def fail(queue, here):
        both.wait()
        if (threading.current_thread() is main) == here:
            raise ValueError("in here")

    for here in (False, True, False):
        with pytest.raises(ValueError, match="in here"):
            jit.run(fail, 2, here)

    def count(queue, numbers):
        while (number := next(numbers)) < 20:
            found.append(number)

    found, numbers = [], iter(range(10**6))
    jit.run(count, 5, numbers)
    assert sorted(found) == list(range(20))


def test_nobody_works_on_when_a_call_has_ended():
    """Neither if a helper fails while others work, nor if the caller is interrupted while it waits for them."""
    main, working, lock = threading.current_thread(), [], threading.Lock()
    begun = threading.Barrier(4, timeout=60)

    def work(queue):
        begun.wait()
        if threading.current_thread() is main:
            return
        with lock:
            working.append(len(working))
            first = len(working) == 1
        if first:
            raise ValueError("the first")
        time.sleep(0.3)
        working.append(-1)

    with pytest.raises(ValueError, match="the first"):
        jit.run(work, 4)
    assert working.count(-1) == 2

    def long(queue):
        if threading.current_thread() is main:
            time.sleep(0.05)
            return
        time.sleep(0.8)
        working.append("ended")

    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        jit.run(long, 2)
    assert working[-1] == "ended"


def test_tasks_that_nobody_needs_any_more_hold_nothing():
    """While the helpers are busy for another thread of the caller."""
    held, busy = [], threading.Event()
    other = threading.Thread(target=lambda: jit.run(lambda queue: busy.wait(60), jit.available_threads() + 1))
    other.start()
    try:
        for _ in range(20):
            values = np.ones(1000)
            held.append(weakref.ref(values))
            jit.run(lambda queue, values: values.sum(), 2, values)
            del values
        gc.collect()
        assert sum(one() is not None for one in held) <= 1
    finally:
        busy.set()
        other.join()
