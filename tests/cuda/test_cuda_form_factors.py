"""Form factors on a GPU are the processor's; the threads are run by the processor too, where there is no GPU."""

import numpy as np
import pytest
from host import Host

import luxel
from luxel.cuda import form_factors as there
from luxel.cuda.form_factors import GpuPairs
from luxel.errors import DeviceError, InputError, LuxelWarning
from luxel.radiosity.form_factors import form_factors
from luxel.scene.builtin import cornell_box

ROUNDING = 1e-11
"""Logarithms and arc tangents of a GPU are its own."""


def furnished(pieces=40, seed=0):
    """Each triangle of a room is a surface; and some surfaces of two triangles."""
    rng = np.random.default_rng(seed)
    meshes = []
    for _ in range(pieces):
        place, corners = rng.uniform(-1, 1, 3), rng.normal(size=(4, 3)) * rng.choice([0.1, 0.4])
        meshes.append(luxel.Mesh((place + corners).astype(np.float32), np.array([[0, 1, 2], [1, 2, 3]][: rng.integers(1, 3)], np.int32)))
    return meshes


@pytest.fixture
def on(gpu, monkeypatch):
    """Form factors on the GPU."""

    def found(meshes, **options):
        kernels = None
        if gpu.name == "host":
            import pair_loops as kernels
        with monkeypatch.context() as patch:
            patch.setattr(there, "find", lambda *_: gpu)
            patch.setattr(there, "GpuPairs", lambda *given: GpuPairs(*given, kernels=kernels))
            return form_factors(meshes, device="cuda", **options)

    return found


def assert_same(ours, theirs, rounding=ROUNDING):
    np.testing.assert_array_equal(ours.indptr, theirs.indptr)
    np.testing.assert_array_equal(ours.indices, theirs.indices)
    np.testing.assert_allclose(theirs.data, ours.data, rtol=rounding)
    np.testing.assert_allclose(theirs.errors, ours.errors, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(theirs.areas, ours.areas)


@pytest.mark.parametrize("options", [{}, {"one_sided": True}, {"reference": True}, {"tolerance": 1e-2}])
def test_the_same_matrix(on, gpu, options):
    meshes = furnished(25 if "reference" in options else 60)
    assert_same(form_factors(meshes, **options), on(meshes, **options), 0 if gpu.name == "host" else ROUNDING)


def test_the_order_of_polygons_and_launches_changes_nothing(on, gpu, monkeypatch):
    """Few pairs in a launch, few threads for hidden ones, and rows of surfaces that are begun in one launch and finished in the next."""
    meshes = furnished(20, 3)
    meshes.insert(4, luxel.Mesh(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32)))
    with pytest.warns(LuxelWarning, match="no area"):
        ours = form_factors(meshes)
    for pairs, hidden, threads in ((40, 7, 3), (1, 1 << 18, 1 << 15), (1 << 23, 100, 128)):
        monkeypatch.setattr(there, "_PAIRS", pairs)
        monkeypatch.setattr(there, "_HIDDEN", hidden)
        monkeypatch.setattr(there, "_THREADS", threads)
        with pytest.warns(LuxelWarning, match="no area"):
            assert_same(ours, on(meshes), 0 if gpu.name == "host" else ROUNDING)


def test_more_obstacles_than_a_shaft_may_hold(on, gpu):
    """The pair is integrated part by part; one side has five corners where the other's plane cuts it."""
    rng = np.random.default_rng(5)
    ends = [np.array([(0, 0, z), (1, 0, z), (1, 1, z), (0, 1, z)], np.float32) for z in (0, 1)]
    ends[1] = (ends[1] - [0, 0, 1]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0] * 2 + [0.3, 0.3, 0.5]
    spots = [rng.uniform((0, 0, 0.1), (1, 1, 0.8)) + 0.03 * rng.normal(size=(3, 3)) for _ in range(150)]
    meshes = [luxel.Mesh(c.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]][: len(c) - 2], np.int32)) for c in (*ends, *spots)]
    assert_same(form_factors(meshes, one_sided=True), on(meshes, one_sided=True), 0 if gpu.name == "host" else ROUNDING)


def test_nothing_and_progress(on):
    assert on([]).shape == (0, 0)
    told = []
    on(furnished(17), progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1


def test_no_gpu(no_gpu, tmp_path, capsys):
    meshes = furnished(3)
    with pytest.raises(DeviceError, match="device cuda: expected an NVIDIA GPU and its driver"):
        luxel.form_factors(meshes, device="cuda")
    with pytest.warns(LuxelWarning, match="device auto: form factors on the processor: .*cannot be found") as told:
        found = luxel.form_factors(meshes, device="auto")
    assert told[0].filename == __file__
    assert_same(form_factors(meshes), found, 0)
    with pytest.raises(InputError, match="device: expected one of cpu, cuda, auto; got 'gpu'"):
        luxel.form_factors(meshes, device="gpu")


def test_too_little_memory(monkeypatch):
    meshes = furnished(3)
    monkeypatch.setattr(there, "find", lambda *_: Host(memory=1 << 20))
    with pytest.raises(DeviceError, match=r"form factors of [0-9]+ polygons"):
        form_factors(meshes, device="cuda")
    with pytest.warns(LuxelWarning, match="device auto: form factors on the processor: .*polygons") as told:
        found = form_factors(meshes, device="auto")
    assert told[0].filename == __file__
    assert_same(form_factors(meshes), found, 0)


def test_the_command_line(no_gpu, tmp_path, capsys):
    from luxel.cli import main

    luxel.save(cornell_box(), tmp_path / "room.glb")
    ask = ["form-factors", str(tmp_path / "room.glb"), "-o", str(tmp_path / "f.npz"), "--device"]
    assert main([*ask, "cuda"]) == 2
    assert "expected an NVIDIA GPU and its driver" in capsys.readouterr().err
    assert main([*ask, "gpu"]) == 2
    assert main([*ask, "auto"]) == 0
    assert "form factors on the processor" in capsys.readouterr().err
