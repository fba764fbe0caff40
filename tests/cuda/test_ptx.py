"""Every kernel goes the way from a launch to machine code for the oldest and for a current kind of GPU, without one."""

import re
import warnings

import numpy as np
import pytest
import stub
from gpu_drawing import EVERYTHING, camera, materials, plain, soup

import luxel
from luxel.cuda import bake_kernels, kernels, light_kernels, pair_kernels
from luxel.cuda.frame import draw_views
from luxel.cuda.labour import GpuLabour
from luxel.cuda.relight import ResidentTransport
from luxel.cuda.resident import Resident
from luxel.radiosity.bake import bake
from luxel.radiosity.quality import Quality
from luxel.radiosity.spots import _found as found_spots
from luxel.raster.render import Options, prepare
from luxel.scene.builtin import cornell_box

# CUDA's sine, arc tangent and logarithm of float64 are made of fused operations.
ARCS = ("sky_light", "closer_light", "exchange_plain", "exchange_hidden")
MODULES = kernels, light_kernels, bake_kernels, pair_kernels
LARGEST_ARGUMENTS = 4096  # bytes; what every driver takes


def scene(made):
    rng, picture = np.random.default_rng(0), luxel.Texture(np.full((4, 4, 4), 200, np.uint8))
    instances = [luxel.Instance(i) for i in range(3)]
    return luxel.Scene([soup(rng, 2, kind) for kind in range(3)], instances=instances, materials=made, textures=[picture, picture])


def lit_box():
    scene = cornell_box()
    scene.lights = [luxel.Light("point", intensity=20.0)]
    return scene


@pytest.fixture(scope="module")
def launched():
    """Every kernel, as it is compiled when it is first launched: by name."""
    bare = [luxel.Material(alpha_mode=mode) for mode in ("OPAQUE", "MASK", "BLEND")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("luxel.radiosity.spots._found", lambda *given: np.append(found_spots(*given), [0, 1])[-2:])
        transport = bake(cornell_box(), density=2, transport=True).transport
        found = stub.install(patch, *MODULES)
        for made, shading, options in ((bare, None, {"filter": "tent"}), (bare, "gouraud", {}), (materials(), None, {"outputs": EVERYTHING})):
            for keep in (True, False):
                resident = Resident(stub.Stub(), prepare(scene(made), shading))
                pictures = draw_views(resident, [camera(), camera(3)], (20, 10), Options(samples=2, **options), [camera(4), None], keep)
                assert [picture.size for picture in pictures] == [(20, 10)] * 2
            draw_views(resident, [camera()], (1, 1), Options(**options), [None])
        solver = ResidentTransport(stub.Stub(), transport)
        assert solver.spots
        solver.solve(transport.powers(transport.emission), None, transport.albedo, 1.0, 1.0)
        for seen, gathered, unlike in ((16, 16, 1.0), (16, 0, 1.0), (1, 1, 1.0), (1, 0, 1.0), (0, 0, 1.0)):
            patch.setattr("luxel.radiosity.bake.labour_of", lambda *_: GpuLabour(stub.Stub(), 1))
            with warnings.catch_warnings(action="ignore"):  # nothing comes back from a stub
                bake(lit_box(), density=2, sky=1.0, quality=Quality(4, 16, 1, seen, gathered, unlike, spot_points=4))
        patch.setattr("luxel.cuda.form_factors.find", lambda *_: stub.Stub())
        luxel.form_factors([cornell_box().meshes[0]] * 2, device="cuda")
        luxel.form_factors([plain(0, 1).meshes[0]] * 2, device="cuda")
        yield found


def grids():
    every = [item for module in MODULES for item in vars(module).items()]
    return sorted(name for name, value in every if not name.startswith("_") and hasattr(value, "py_func"))


def ptx(kernel, card):
    return kernel.library.get_asm_strs(card)[0]


def test_kernels_have_names_of_their_own():
    assert len(set(grids())) == len(grids())


def test_kernels_are_always_given_the_same_types(launched):
    """Whatever is drawn, and if it is one pixel, one ray, one row or column: so launches need not look at them. `stub` does, each time."""
    for module in MODULES:
        for name, value in vars(module).items():
            if name in launched and hasattr(value, "py_func"):
                assert len(value.overloads) == 1, name


@pytest.mark.parametrize("name", grids())
def test_kernel_compiles_without_fused_operations(launched, name):
    for card in stub.CARDS:
        text = ptx(launched[name], card)
        assert f".target sm_{card[0]}{card[1]}" in text
        assert text.count(".entry") == 1
        assert sum(stub.BYTES[kind] for kind in stub.parameters(text)) <= LARGEST_ARGUMENTS
        if name in ARCS:
            continue
        assert not re.findall(r"\bfma\.|\bmad\.\w*\.?f", text)
        assert not re.findall(r"\b(?:mul|add|sub)\.(?:ftz\.)?f(?:32|64)\b", text)  # without .rn, the assembler may fuse them
        assert not re.findall(r"\b(?:div|sqrt)\.(?:approx|full)|\.ftz", text)


@pytest.mark.parametrize("shape", [(1, 5), (5, 1), (1, 1), (0, 4), (4, 0), (3, 2)])
def test_arrays_are_stored_as_said_whatever_their_shape(launched, shape):
    """Row by row, also if the processor's is spread from one row or transposed; or column by column."""
    there = stub.Stub()
    for host in (np.zeros(shape), np.broadcast_to(np.zeros(shape[1]), shape), np.zeros(shape[::-1]).T):
        assert stub.typeof(there.array(host)).layout == "C"
    assert stub.typeof(there.empty(shape, np.float64)).layout == "C"
    assert stub.typeof(there.columns(shape, np.float64)).layout == "F"


def test_minimum_is_one_64_bit_operation_on_memory(launched):
    assert re.search(r"(?:atom|red)\.global\.min\.u64", ptx(launched["draw"], (9, 0)))
    assert re.search(r"(?:atom|red)\.global\.max\.u64", ptx(launched["peel"], (9, 0)))


def test_machine_code_is_made_of_it(launched):
    """By the linker that Numba uses."""
    nvjitlink = pytest.importorskip("cuda.bindings.nvjitlink", reason="cuda-bindings is not installed")
    for name in ("draw", "shade"):
        text = ptx(launched[name], (9, 0)).encode()
        linker = nvjitlink.create(2, ["-arch=sm_90", "-verbose"])
        nvjitlink.add_data(linker, nvjitlink.InputType.PTX, text, len(text), name)
        nvjitlink.complete(linker)
        log = bytearray(nvjitlink.get_info_log_size(linker))
        nvjitlink.get_info_log(linker, log)
        nvjitlink.destroy(linker)
        assert b"0 bytes spill stores" in log
