"""Finding a GPU, and saying why there is none; memory; handing arrays over."""

import ctypes
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from gpu_drawing import camera, plain
from host import Host

import luxel
from luxel.cuda import device, door, shared
from luxel.cuda.frame import draw_views
from luxel.cuda.resident import Resident
from luxel.errors import DeviceError, InputError, LuxelWarning
from luxel.raster.render import Options, prepare

SIZE = 16, 12


def test_no_gpu_says_what_is_missing(no_gpu):
    with pytest.raises(DeviceError, match=r"^device cuda: expected an NVIDIA GPU and its driver; CUDA driver library cannot be found\.$"):
        luxel.render(plain(0), camera(), SIZE, device="cuda")


def test_auto_falls_back_and_says_so(no_gpu):
    with pytest.warns(LuxelWarning, match="device auto: drawing on the processor: .*cannot be found"):
        picture = luxel.render(plain(0), camera(), SIZE, device="auto")
    np.testing.assert_array_equal(picture.color, luxel.render(plain(0), camera(), SIZE).color)


def test_unknown_device():
    with pytest.raises(InputError, match="device: expected one of cpu, cuda, auto; got 'gpu'"):
        luxel.render(plain(0), camera(), SIZE, device="gpu")


def test_an_old_card_is_refused(monkeypatch):
    device.gpu.cache_clear()
    monkeypatch.setattr(door, "initialise", lambda: SimpleNamespace(name=b"Tesla K80", compute_capability=(3, 7), id=0))
    with pytest.raises(DeviceError, match=r"compute capability 7\.5 or more; Tesla K80 has 3\.7"):
        device.find("cuda")
    device.gpu.cache_clear()


def test_the_package_is_named_where_it_is_missing():
    code = (
        "import importlib.util as u; f = u.find_spec; u.find_spec = lambda name, *a: None if name == 'numba_cuda' else f(name, *a)\n"
        "import luxel, numpy as np\n"
        "scene = luxel.Scene([luxel.Mesh(np.zeros((3, 3), 'f4'), np.zeros((1, 3), 'i4'))], instances=[luxel.Instance(0)])\n"
        "try: luxel.prepare(scene, device='cuda')\n"
        "except luxel.ExtraMissingError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "drawing on a GPU needs the package numba-cuda: pip install 'luxel[cuda]'\n"


def test_the_processor_is_drawn_on_without_the_package():
    code = "import luxel, sys; from luxel.raster import render; print('numba.cuda' in sys.modules, 'luxel.cuda' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False False\n"


def test_too_little_memory_for_the_scene_or_the_picture():
    with pytest.raises(DeviceError, match="the scene"):
        Resident(Host(memory=100), prepare(plain(0)))
    resident = Resident(Host(memory=20_000_000), prepare(plain(0)))
    with pytest.raises(DeviceError, match="a picture of 3000x2000 with 16 samples"):
        draw_views(resident, [camera()], (3000, 2000), Options(samples=16), [None])


def test_auto_draws_on_the_processor_what_does_not_fit():
    from luxel.cuda.render import draw

    prepared = prepare(plain(0))
    prepared = prepared._replace(resident=Resident(Host(memory=1_000_000), prepared, fallback=True))
    with pytest.warns(LuxelWarning, match="a picture of 400x300"):
        picture = draw(prepared, camera(), (400, 300), Options(), None, None)
    np.testing.assert_array_equal(picture.color, luxel.render(plain(0), camera(), (400, 300)).color)


def test_sizes_in_messages():
    gpu = device.Gpu.__new__(device.Gpu)
    gpu.name, gpu._simulated = "GTX", True
    with pytest.raises(DeviceError, match=r"a picture needs 8\.6 GB of memory, 4\.3 GB are free on GTX"):
        gpu.expect(1 << 33, "a picture")


def test_what_only_the_processor_does():
    with pytest.raises(InputError, match="shading hardware"):
        Resident(Host(), prepare(plain(0), "hardware"))
    with pytest.raises(InputError, match="on_device: the scene is drawn on the processor"):
        luxel.render(plain(0), camera(), SIZE, on_device=True)


def test_dlpack_lends_memory_and_gets_it_back():
    owner = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    array = shared.DeviceArray(owner.ctypes.data, owner.shape, owner.dtype, owner.copy, (shared.CPU, 0))
    before = len(shared._lent)
    taken = np.from_dlpack(array)
    np.testing.assert_array_equal(taken, owner)
    assert taken.ctypes.data == owner.ctypes.data
    assert len(shared._lent) == before + 1
    del taken
    assert len(shared._lent) == before
    array.__dlpack__()  # nobody takes it
    assert len(shared._lent) == before
    with pytest.raises(BufferError):
        array.__dlpack__(copy=True)


@pytest.mark.parametrize("dtype", ["uint8", "int32", "float32"])
def test_dlpack_describes_the_array(dtype):
    owner = np.zeros((5, 4), dtype)
    array = shared.DeviceArray(owner.ctypes.data, owner.shape, owner.dtype, owner.copy)
    capsule = array.__dlpack__()
    tensor = ctypes.cast(shared._pointer(id(capsule), b"dltensor"), ctypes.POINTER(shared._Managed)).contents.tensor
    assert array.__dlpack_device__() == (2, 0) == (tensor.device.kind, tensor.device.number)
    assert (tensor.data, tensor.ndim, tuple(tensor.shape[:2]), tuple(tensor.strides[:2])) == (owner.ctypes.data, 2, (5, 4), (4, 1))
    assert (tensor.dtype.bits, tensor.dtype.lanes) == (8 * owner.itemsize, 1)
    assert array.__cuda_array_interface__["data"] == (owner.ctypes.data, False)
    assert array.__cuda_array_interface__["typestr"] == owner.dtype.str
    assert (array.ndim, array.size, array.nbytes) == (2, 20, owner.nbytes)


def test_a_picture_left_on_the_device_is_saved(tmp_path):
    ours = luxel.render(plain(0), camera(), SIZE, outputs=("color", "depth"))
    arrays = {name: shared.DeviceArray(a.ctypes.data, a.shape, a.dtype, a.copy, (shared.CPU, 0)) for name, a in ours.outputs().items()}
    theirs = luxel.Picture(**arrays)
    assert theirs.size == SIZE
    for name in ("a.png", "a.npz"):
        ours.save(tmp_path / name)
        theirs.save(tmp_path / f"b_{name}")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b_a.png").read_bytes()
    np.testing.assert_array_equal(np.load(tmp_path / "b_a.npz")["depth"], ours.depth)


def test_small_grids_are_no_reason_to_warn():
    """As Numba does once for each size; its setting is as it was afterwards."""
    kernels = pytest.importorskip("luxel.cuda.kernels")
    config = door._numba("config")
    before = config.CUDA_LOW_OCCUPANCY_WARNINGS
    assert door.configured(kernels.fill_keys, (3, 1), (17, 1)).griddim == (3, 1, 1)
    assert before == config.CUDA_LOW_OCCUPANCY_WARNINGS


def test_the_command_line(no_gpu, tmp_path, capsys):
    from luxel.cli import main

    luxel.save(plain(0), tmp_path / "a.ply")
    draw = ["render", str(tmp_path / "a.ply"), "-o", str(tmp_path / "a.png"), "--size", "8", "--device"]
    assert main([*draw, "cuda"]) == 2
    assert "expected an NVIDIA GPU and its driver" in capsys.readouterr().err
    assert not (tmp_path / "a.png").exists()
    assert main([*draw, "gpu"]) == 2
    assert main([*draw, "auto"]) == 0
    assert "drawing on the processor" in capsys.readouterr().err
    assert (tmp_path / "a.png").exists()
