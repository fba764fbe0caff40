"""Baking on a GPU gives the processor's light; the threads are run by the processor too, where there is no GPU."""

from itertools import pairwise
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from host import Host

import luxel
from luxel.cuda import labour as gpu_labour
from luxel.cuda import memory
from luxel.cuda.labour import GpuLabour
from luxel.cuda.shooter import _rounds
from luxel.cuda.threads.choose import Batch
from luxel.cuda.threads.settle import PARTS, SUMS
from luxel.errors import DeviceError, InputError, LuxelWarning
from luxel.radiosity.bake import bake
from luxel.radiosity.labour import Labour
from luxel.radiosity.quality import QUALITIES, Quality
from luxel.scene.builtin import cornell_box

SOME = 1e-4
"""Share of the rays, at most, that meet something else: through cracks, and where two surfaces are equally far away, it depends on which rays are
traced together."""

ONE_LUXEL, ALL_LUXELS = 2e-2, 1e-4
"""Of the mean irradiance: how far a single luxel may be off for it, and all of them on the average."""


def labour_on(gpu, threads=1):
    if gpu.name == "host":
        import bake_loops

        return GpuLabour(gpu, threads, kernels=bake_loops)
    return GpuLabour(gpu, threads)


@pytest.fixture
def on(gpu, monkeypatch):
    """Bake on the GPU."""

    def baked(scene, **options):
        with monkeypatch.context() as patch:
            patch.setattr("luxel.radiosity.bake.labour_of", lambda *_: labour_on(gpu))
            return bake(scene, **options)

    return baked


def box(lights=True):
    scene = cornell_box()
    if lights:
        lamp = np.eye(4)
        lamp[:3, 3] = 1.5, 2.5, 2.0
        scene.lights = [luxel.Light("point", intensity=2.0, world_from_light=lamp), luxel.Light("directional", intensity=0.3)]
    return scene


def masked(scene):
    """The same with a surface full of holes, and two-sided ones."""
    rng = np.random.default_rng(0)
    image = np.full((16, 16, 4), 200, np.uint8)
    image[..., 3] = rng.integers(0, 2, (16, 16)) * 255
    for k, mesh in enumerate(scene.meshes):
        made = scene.materials[mesh.material]
        made.double_sided = k % 2 == 0
    corners = np.array([[0.5, 1.4, 0.5], [2, 1.4, 0.5], [2, 1.4, 2.5], [0.5, 1.4, 2.5]], np.float32)
    uv = np.array([[0, 0], [2, 0], [2, 2], [0, 2]], np.float32)
    scene.textures.append(luxel.Texture(image))
    ref = luxel.TextureRef(len(scene.textures) - 1)
    scene.materials.append(luxel.Material(base_color_texture=ref, alpha_mode="MASK", alpha_cutoff=0.5, double_sided=True))
    mesh = luxel.Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), texcoords=uv, material=len(scene.materials) - 1)
    scene.meshes.append(mesh)
    scene.instances.append(luxel.Instance(len(scene.meshes) - 1))
    return scene


def assert_same_light(ours, theirs):
    mean = ours.irradiance.mean()
    for one, other in ((ours.irradiance, theirs.irradiance), (ours.direct, theirs.direct)):
        difference = np.abs(one - other)
        assert difference.max() < ONE_LUXEL * mean
        assert difference.mean() < ALL_LUXELS * mean
    assert len(ours.ledger) == len(theirs.ledger)
    for one, other in zip(ours.ledger, theirs.ledger, strict=True):
        np.testing.assert_allclose(other.absorbed + other.escaped + other.unshot, other.emitted, rtol=1e-6)
        np.testing.assert_allclose(np.array(other[1:]), np.array(one[1:]), rtol=1e-4, atol=1e-4 * one.emitted.max())


@pytest.mark.parametrize(
    ("quality", "options"),
    [("draft", {}), ("final", {"sky": (0.5, 0.7, 1.0)}), ("normal", {}), ("progressive", {}), (Quality(16, 32, 4, 32, 64, exact=True), {})],
    ids=["draft", "sky_and_gathered", "closer", "progressive", "by_rays"],
)  # fmt: skip
def test_the_same_light(on, quality, options):
    options = {"quality": quality, "density": 12, **options}
    assert_same_light(bake(box(), **options), on(box(), **options))


@pytest.mark.parametrize("quality", ["draft", "normal", "final"])
def test_what_comes_off_spots(on, quality):
    scene, beam = box(lights=False), np.diag([-1.0, 1.0, -1.0, 1.0])  # towards the back
    beam[:3, 3] = 0.28, 0.25, 0.2
    scene.lights = [luxel.Light("spot", intensity=20.0, world_from_light=beam, outer_cone=0.15)]
    options = {"quality": quality, "density": 30}
    ours, theirs = bake(scene, transport=True, **options), on(scene, transport=True, **options)
    assert_same_light(ours, theirs)
    assert len(ours.transport.spot_element)
    for name in ("spot_element", "spot_area", "spot_starts", "spot_touched"):
        np.testing.assert_array_equal(getattr(theirs.transport, name), getattr(ours.transport, name))
    np.testing.assert_allclose(theirs.transport.spot_rows, ours.transport.spot_rows, atol=1)


def test_holes_two_sides_and_a_picture_of_the_sky(on):
    sky = np.random.default_rng(1).uniform(0, 2, (8, 16, 3)).astype(np.float32)
    sky[2, 3] = 100.0  # a sun
    options = {"quality": "draft", "density": 8, "sky": sky}
    assert_same_light(bake(masked(box()), **options), on(masked(box()), **options))


def test_what_is_seen(gpu, monkeypatch):
    """Step by step: all but few hits, and hemicubes and rows to the byte."""

    class Both(Labour):
        found: ClassVar = []

        def look(self, view, rays, told):
            self.there = labour_on(gpu)
            ours, theirs = super().look(view, rays, told), self.there.look(view, rays, told)
            hits = gpu.host(theirs.hits)
            assert (hits != ours.hits).sum() <= SOME * hits.size
            np.testing.assert_allclose(gpu.host(theirs.away), ours.away, atol=2 / rays * view.numbers[9].max())
            self.found.append("look")
            return ours

        def see(self, occluders, who, resolution, near):
            self.there = labour_on(gpu)
            drawn, theirs = super().see(occluders, who, resolution, near), self.there.see(occluders, who, resolution, near)
            self.cubes, count = theirs.seen, drawn.seen.start[-1]
            np.testing.assert_array_equal(gpu.host(self.cubes.ids), drawn.seen.ids[:count])
            np.testing.assert_array_equal(gpu.host(self.cubes.depth), drawn.seen.depth[:count])
            np.testing.assert_allclose(theirs.escaped, drawn.escaped, atol=1e-9)
            np.testing.assert_array_equal(theirs.escaped > 0, drawn.escaped > 0)
            self.found.append("see")
            return drawn

        def fill_rows(self, elements, tree, source, who, seen, occluders, rays, slots, rows):
            sums = super().fill_rows(elements, tree, source, who, seen, occluders, rays, slots, rows)
            there = gpu.empty(rows.shape, np.uint16)
            np.testing.assert_array_equal(self.there.fill_rows(elements, tree, source, who, self.cubes, occluders, rays, slots, there), sums)
            np.testing.assert_array_equal(gpu.host(there)[slots], rows[slots])
            self.found.append("fill_rows")
            return sums

    monkeypatch.setattr("luxel.radiosity.bake.labour_of", lambda *_: Both(1))
    for scene in (box(), masked(box(False))):
        bake(scene, quality=Quality(40, 64, 4, 64, 0), density=10)
    assert {"look", "see", "fill_rows"} <= set(Both.found)


@pytest.mark.parametrize("lanes", [1, 32])
def test_hemicubes_by_threads_and_by_warps(gpu, lanes, monkeypatch):
    """The threads of a warp share a triangle's pixels, and the picture is the same."""
    from luxel.radiosity.hemicube import frames_of
    from luxel.radiosity.transport import Occluders, Shooters

    monkeypatch.setattr(gpu_labour, "_FEW_TRIANGLES", 0 if lanes == 1 else 1 << 20)
    rng = np.random.default_rng(2)
    positions = rng.normal(size=(3, 200)).astype(np.float32)
    triangles = rng.integers(0, 200, (150, 3)).astype(np.int32)
    occluders = Occluders(positions, triangles, np.zeros((150, 4), np.float32), np.ones(150, bool), None)
    normals = rng.normal(size=(6, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    who = Shooters(np.arange(6, dtype=np.int32), rng.normal(size=(6, 3)).astype(np.float32), frames_of(normals))
    ours, theirs = Labour(1).see(occluders, who, 64, 1e-3), labour_on(gpu).see(occluders, who, 64, 1e-3)
    count = ours.seen.start[-1]
    np.testing.assert_array_equal(gpu.host(theirs.seen.ids), ours.seen.ids[:count])
    np.testing.assert_array_equal(gpu.host(theirs.seen.depth), ours.seen.depth[:count])


def test_kept_transport_and_layers(on):
    ours, theirs = (run(box(), quality="draft", density=8, transport=True, layers=True, sky=0.5) for run in (bake, on))
    assert (ours.transport.hits != theirs.transport.hits).sum() <= SOME * ours.transport.hits.size
    np.testing.assert_array_equal(theirs.transport.rows, ours.transport.rows)
    assert theirs.layers.keys() == ours.layers.keys()
    for name, layer in ours.layers.items():
        np.testing.assert_allclose(theirs.layers[name], layer, atol=ONE_LUXEL * ours.irradiance.mean())


def test_more_rays_than_rows_of_a_grid(on, monkeypatch):
    whole = on(box(), quality="final", density=5)
    monkeypatch.setattr(gpu_labour, "_MOST_ROWS", 7)
    np.testing.assert_array_equal(on(box(), quality="final", density=5).irradiance, whole.irradiance)


class Stop(Exception):
    pass


def test_an_interrupted_bake_goes_on_there_and_here(on, tmp_path):
    options = {"quality": "draft", "density": 10, "checkpoint": tmp_path / "state"}
    whole = on(box(), **{**options, "checkpoint": None})

    def stop(unshot, progress):
        assert progress.preview() is not None
        if len(progress.state.ledger) == 4:
            raise Stop

    for run in (bake, on):
        with pytest.raises(Stop):
            on(box(), progress=stop, **options)
        rest = run(box(), resume=True, **options)
        assert len(rest.ledger) == len(whole.ledger)
        np.testing.assert_allclose(rest.irradiance, whole.irradiance, rtol=1e-4, atol=ONE_LUXEL * whole.irradiance.mean())


def test_an_interrupt_while_light_is_passed_on_leaves_the_state_before(gpu, monkeypatch):
    """Ctrl-C is heard where the processor waits for the GPU: the ledger holds then."""
    seen = []

    class Interrupted(GpuLabour):
        def state(self, problem, state):
            made, fetch = super().state(problem, state), self.gpu.host
            seen.append(made)

            def host(array):
                if len(made.ledger) == 3 and array is made._sums:
                    raise KeyboardInterrupt
                return fetch(array)

            monkeypatch.setattr(self.gpu, "host", host)
            return made

    monkeypatch.setattr("luxel.radiosity.bake.labour_of", lambda *_: Interrupted(gpu, 1, kernels=labour_on(gpu).kernels))
    with pytest.raises(KeyboardInterrupt):
        bake(box(), quality="draft", density=8)
    monkeypatch.undo()
    (state,), area = seen, seen[0].gpu.host(seen[0]._numbers)[9].astype(float)
    np.testing.assert_allclose((state.unshot * area).sum(1), state.ledger[-1].unshot, rtol=1e-5)
    np.testing.assert_allclose(state.absorbed + state.escaped + state.left, state.emitted, rtol=1e-6)


def test_no_gpu(no_gpu):
    with pytest.raises(DeviceError, match="device cuda: expected an NVIDIA GPU and its driver"):
        bake(box(), quality="draft", density=4, device="cuda")
    with pytest.warns(LuxelWarning, match="device auto: baking on the processor: .*cannot be found"):
        baked = bake(box(), quality="draft", density=4, device="auto")
    np.testing.assert_array_equal(baked.irradiance, bake(box(), quality="draft", density=4).irradiance)
    with pytest.raises(InputError, match="device: expected one of cpu, cuda, auto; got 'gpu'"):
        bake(box(), device="gpu")


def test_too_little_memory(monkeypatch):
    small = Host(memory=1000)
    monkeypatch.setattr(gpu_labour, "find", lambda *_: small)
    with pytest.raises(DeviceError, match=r"a bake of [0-9]+ elements"):
        bake(box(), quality="draft", density=4, device="cuda")
    with pytest.warns(LuxelWarning, match="device auto: baking on the processor: a bake of"):
        baked = bake(box(), quality="draft", density=4, device="auto")
    np.testing.assert_array_equal(baked.irradiance, bake(box(), quality="draft", density=4).irradiance)


@pytest.mark.parametrize(
    ("quality", "options"),
    [("draft", {}), ("final", {"sky": 0.5}), ("progressive", {}), ("draft", {"transport": True}), (Quality(16, 128, 0, 512, 16), {"sky": 0.5})],
)
def test_memory_is_counted_before(monkeypatch, quality, options):
    """All of it, and not much more: with what was counted the bake goes through, and with a byte less it does not begin. Spots are not known yet."""
    quality = QUALITIES.get(quality, quality)
    found = {}
    for spot_points in (0, 64):
        found[spot_points] = counted_and_taken(monkeypatch, quality._replace(spot_points=spot_points), options)
    assert found[0][0] <= 1.6 * found[0][1]
    assert found[64][0] < found[0][0] + 200e6


def counted_and_taken(monkeypatch, quality, options):
    counted, hosts = [], []

    def needed(*given):
        counted.append(memory.needed(*given))
        return counted[-1]

    def host(size):
        hosts.append(Host(size))
        return labour_on(hosts[-1])

    monkeypatch.setattr(gpu_labour, "memory", SimpleNamespace(needed=needed, at_once=memory.at_once, RAYS_AT_ONCE=memory.RAYS_AT_ONCE))
    monkeypatch.setattr(memory, "OWN", 0)
    for size in (1 << 40, None, None):
        limit = size or counted[0] - len(hosts) + 1
        monkeypatch.setattr("luxel.radiosity.bake.labour_of", lambda *_, limit=limit: host(limit))
        if len(hosts) < 2:
            bake(box(lights=False), quality=quality, density=12, **options)
            assert hosts[-1].peak <= counted[0]
        else:
            with pytest.raises(DeviceError, match="a bake of"):
                bake(box(lights=False), quality=quality, density=12, **options)
    return counted[0], hosts[0].peak


@pytest.mark.parametrize(("patches", "most"), [(1, 1), (7, 1), (40, 2), (511, 31), (513, 32), (5000, 128), (70000, 128)])
def test_the_brightest(gpu, patches, most):
    """In one round or more; equally bright ones by number, and none that is dark."""
    kernels, rng = labour_on(gpu).kernels, np.random.default_rng(patches)
    power = rng.choice([0.0, 0.25, 1.0, 7.0], (patches, 3)) * rng.choice([0, 1], (patches, 1), p=[0.2, 0.8])
    power[:patches // 2] *= rng.uniform(0, 1, (patches // 2, 1))
    counts = _rounds(patches, most)
    assert counts[-1] == most
    bright, candidates = gpu.empty((patches,), np.float64), gpu.empty((patches,), np.int32)
    gpu.launch(kernels.find_bright, (patches, 1), gpu.array(power), bright, candidates)
    for count in counts:
        winners = gpu.empty((count,), np.int32)
        gpu.launch(kernels.clear_winners, (count, 1), winners)
        gpu.launch(kernels.pick, (len(candidates), 1), bright, candidates, most, winners)
        candidates = winners
    kinds = ((most,), np.int32), ((most,), np.int64), ((most, 3), np.float32), ((most, 3), np.float64)
    batch = Batch(*(gpu.empty(*kind) for kind in kinds))
    gpu.launch(kernels.line_up, (most, 1), candidates, batch)
    total = power.sum(1)
    wanted = np.sort(np.argsort(-total, kind="stable")[:most])
    wanted = wanted[total[wanted] > 0]
    chosen = gpu.host(batch.chosen)
    np.testing.assert_array_equal(chosen[: len(wanted)], wanted)
    assert (chosen[len(wanted) :] == -1).all()


def test_rows_that_are_not_kept_are_filled_again(on, monkeypatch):
    """Of a bake whose rows do not all fit."""
    monkeypatch.setattr("luxel.radiosity.effort.ROW_BYTES", 1 << 18)
    options = {"quality": Quality(2, 16, 0, 0, 0, tolerance=0.01, patch=24, resolution=32), "density": 10}
    assert_same_light(bake(box(), **options), on(box(), **options))


def test_nothing_is_copied_for_a_shot_but_sums(monkeypatch):
    """What the processor hears of a batch of shots, and what it sends, does not depend on the scene."""
    heard, sent, seen = [], [], []

    class Ears(Host):
        def host(self, array):
            heard.append(array.nbytes)
            return super().host(array)

        def array(self, host):
            sent.append(host.nbytes)
            return super().array(host)

    class Spied(GpuLabour):
        def state(self, problem, state):
            seen.append(super().state(problem, state))
            return seen[0]

    monkeypatch.setattr("luxel.radiosity.bake.labour_of", lambda *_: Spied(Ears(), 1, kernels=labour_on(Ears()).kernels))
    marks = []
    bake(box(), quality="progressive", density=8, progress=lambda *_: marks.append((len(heard), len(sent))))
    assert len(marks) > 4
    for (before, sent_before), (after, sent_after) in pairwise(marks[2:]):
        assert heard[before:after] == [8 * SUMS * PARTS]
        assert sent_after == sent_before


def test_ranks_do_not_share_a_gpu():
    class Two:
        size = 2

    with pytest.raises(InputError, match="ranks of MPI bake on processors"):
        bake(box(), device="cuda", comm=Two())
