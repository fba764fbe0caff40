"""Kept transport, solved on a GPU, gives the processor's lightmaps."""

import numpy as np
import pytest
from host import Host

import luxel
from luxel.cuda import relight
from luxel.cuda.relight import ResidentTransport
from luxel.errors import DeviceError, LuxelWarning
from luxel.radiosity.bake import bake
from luxel.scene.builtin import cornell_box


@pytest.fixture(scope="module", params=["even", "spots"])
def transport(request):
    if request.param == "even":
        return bake(cornell_box(), density=8, transport=True).transport
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("luxel.radiosity.spots._found", lambda *_: np.arange(3, 9))
        return bake(cornell_box(), density=8, transport=True).transport


def solver(gpu, transport):
    if gpu.name == "host":
        import light_loops

        return ResidentTransport(gpu, transport, light_loops)
    return ResidentTransport(gpu, transport)


def both(there, transport, emission, albedo, still, tolerance):
    ours = transport.solve(emission, albedo, still=still, tolerance=tolerance)
    theirs = there.gpu.host(there.solve(transport.powers(emission), transport.shining(emission), albedo, still, tolerance))
    return ours, theirs


def test_the_same_light(gpu, transport):
    """As baked, whiter, black, twice as bright, and from surfaces that were dark."""
    there, every_seventh = solver(gpu, transport), (np.arange(len(transport.emission)) % 7 == 0)[:, None]
    other = (every_seventh * np.ones((1, 3))).astype(np.float32)
    for emission, albedo, still in (
        (transport.emission, transport.albedo, 1.0), (transport.emission, np.full_like(transport.albedo, 0.9), 1.0),
        (transport.emission, np.zeros_like(transport.albedo), 1.0), (transport.emission * 2, transport.albedo, 2.0), (other, transport.albedo, 0.0),
    ):  # fmt: skip
        ours, theirs = both(there, transport, emission, albedo, still, 1e-6)
        np.testing.assert_allclose(theirs, ours, rtol=1e-4, atol=1e-5 * ours.max())
        ours, theirs = both(there, transport, emission, albedo, still, 1e-3)
        assert np.abs(theirs - ours).sum() < 5e-3 * ours.sum()


def test_darkness(gpu, transport):
    ours, theirs = both(solver(gpu, transport), transport, np.zeros_like(transport.emission), transport.albedo, 0.0, 1e-3)
    assert not ours.any()
    assert not theirs.any()


def test_memory_is_counted_before(transport, monkeypatch):
    """All of it, and not much more."""
    counted, host = [], Host(1 << 40)
    monkeypatch.setattr(host, "expect", lambda size, *_: counted.append(size))
    there = solver(host, transport)
    both(there, transport, transport.emission, transport.albedo, 1.0, 1e-3)
    assert host.peak <= counted[0] <= 1.2 * host.peak + (1 << 20)


def test_too_little_memory(transport):
    with pytest.raises(DeviceError, match="the transport"):
        ResidentTransport(Host(memory=1000), transport)


def test_auto_falls_back_and_says_so(transport, monkeypatch):
    monkeypatch.setattr(relight, "find", lambda device: Host())
    monkeypatch.setattr(relight, "gpu", lambda: Host(memory=1000))
    relight._kept.clear()
    with pytest.raises(DeviceError):
        transport.solve(device="cuda")
    with pytest.warns(LuxelWarning, match="device auto: lighting on the processor"):
        light = transport.solve(device="auto")
    np.testing.assert_array_equal(light, transport.solve())


def test_it_stays_on_a_gpu_as_long_as_the_transport_lives(real_gpu, transport):
    light = transport.solve(device="cuda", tolerance=1e-6)
    np.testing.assert_allclose(light, transport.solve(tolerance=1e-6), rtol=1e-4, atol=1e-5 * light.max())
    assert relight.resident(transport) is relight.resident(transport)
    with pytest.raises(luxel.InputError):
        transport.solve(device="gpu")
