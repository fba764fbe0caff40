"""Every kernel is compiled for the oldest and for a current kind of GPU, without one."""

import re
from functools import cache
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from drawing import camera, materials, soup
from host import Host

import luxel
from luxel import jit
from luxel.cuda import door, kernels, light_kernels
from luxel.cuda.frame import draw_views
from luxel.cuda.relight import ResidentTransport
from luxel.cuda.resident import Resident
from luxel.radiosity.bake import bake
from luxel.raster.render import Options, prepare
from luxel.scene.builtin import cornell_box

CARDS = [(7, 5), (9, 0)]
LARGEST_ARGUMENTS = 4096  # bytes; what every driver takes


class Recorder(Host):
    """Launches nothing, and remembers with what each kernel was to be launched."""

    kernels = kernels

    def __init__(self):
        super().__init__()
        self.launched = {}
        self.layers = 1

    def launch(self, kernel, shape, *arguments):
        self.launched.setdefault(kernel.py_func.__name__, (kernel, (*shape, *arguments)))

    def host(self, array):
        """Of counts one each, so that all stages follow; and one layer of blended triangles."""
        if array.dtype == np.int64:
            return np.ones_like(array)
        if array.shape == (1,):
            self.layers -= 1
            return np.array([self.layers >= 0])
        return np.zeros_like(array)


@pytest.fixture(scope="module")
def launched():
    """Every kernel, and arguments it is launched with: by name."""
    rng, found = np.random.default_rng(0), {}
    bare = [luxel.Material(alpha_mode=mode) for mode in ("OPAQUE", "MASK", "BLEND")]
    picture = luxel.Texture(np.full((4, 4, 4), 200, np.uint8))
    for made, shading in ((bare, None), (bare, "gouraud"), (materials(), None)):
        scene = luxel.Scene([soup(rng, 2, kind) for kind in range(3)], instances=[luxel.Instance(i) for i in range(3)], materials=made,
                            textures=[picture, picture])  # fmt: skip
        recorder = Recorder()
        options = Options(samples=2, filter="tent", outputs=("color", "depth"))
        draw_views(Resident(recorder, prepare(scene, shading)), [camera()], (8, 8), options, [None])
        found.update(recorder.launched)
    recorder, transport = Recorder(), bake(cornell_box(), density=2, transport=True).transport
    solver = ResidentTransport(recorder, transport, light_kernels)
    recorder.host = lambda sums: np.eye(len(sums))[3 - sums.ndim].reshape(-1, *[1] * (sums.ndim - 1))  # groups never settle, and light does at once
    solver.solve(transport.powers(transport.emission), None, transport.albedo, 1.0, 1.0)
    return found | recorder.launched


@pytest.fixture(scope="module")
def compiled(launched):
    """Of a kernel's name and a card, its PTX."""
    return cache(lambda name, card: door.ptx(*launched[name], card))


def grids():
    both = {**vars(kernels), **vars(light_kernels)}
    return sorted(name for name, value in both.items() if not name.startswith("_") and hasattr(value, "py_func"))


@pytest.mark.parametrize("name", grids())
def test_kernel_compiles_without_fused_operations(compiled, name):
    for card in CARDS:
        text = compiled(name, card)
        assert f".target sm_{card[0]}{card[1]}" in text
        assert text.count(".entry") == 1
        assert not re.findall(r"\bfma\.|\bmad\.\w*\.?f", text)
        assert not re.findall(r"\b(?:mul|add|sub)\.(?:ftz\.)?f(?:32|64)\b", text)  # without .rn, the assembler may fuse them
        assert not re.findall(r"\b(?:div|sqrt)\.(?:approx|full)|\.ftz", text)
        assert 8 * len(re.findall(r"\.param \.", text[: text.index("{")])) <= LARGEST_ARGUMENTS


def test_minimum_is_one_64_bit_operation_on_memory(compiled):
    assert re.search(r"(?:atom|red)\.global\.min\.u64", compiled("draw", CARDS[0]))
    assert re.search(r"(?:atom|red)\.global\.max\.u64", compiled("peel", CARDS[0]))


def test_machine_code_is_made_of_it(compiled):
    """By the linker that Numba uses; without it there is nothing to test."""
    nvjitlink = pytest.importorskip("cuda.bindings.nvjitlink", reason="cuda-bindings is not installed")
    for name in ("draw", "shade"):
        text = compiled(name, (9, 0)).encode()
        linker = nvjitlink.create(2, ["-arch=sm_90", "-verbose"])
        nvjitlink.add_data(linker, nvjitlink.InputType.PTX, text, len(text), name)
        nvjitlink.complete(linker)
        log = bytearray(nvjitlink.get_info_log_size(linker))
        nvjitlink.get_info_log(linker, log)
        nvjitlink.destroy(linker)
        assert b"0 bytes spill stores" in log


def test_what_is_launched_is_compiled_the_same_way(monkeypatch):
    """By Numba's own path from a first launch to machine code, as far as it goes without a driver."""
    dispatcher, codegen = import_module("numba.cuda.dispatcher"), import_module("numba.cuda.codegen")
    monkeypatch.setattr(dispatcher._Kernel, "bind", lambda self: None)
    monkeypatch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(9, 0)))
    monkeypatch.setattr(codegen.CUDACodeLibrary, "_ensure_cc", lambda self, card: card or (9, 0))
    monkeypatch.setattr(jit, "cache_folder", lambda: "")

    def square_and_more(values):
        i = door.cuda.grid(1)
        values[i] = values[i] * values[i] + values[i]

    made = door.kernel(square_and_more).compile((door.typeof(np.zeros(3, np.float32)),))
    text = made.library.get_asm_str((9, 0))
    assert "mul.rn.f32" in text
    assert "add.rn.f32" in text
    assert not re.findall(r"\bfma\.", text)
