import pytest


def _real_gpu():
    from luxel.cuda.device import gpu
    from luxel.errors import DeviceError

    try:
        return gpu()
    except DeviceError as error:
        pytest.skip(f"no GPU: {error}")


@pytest.fixture(params=["host", "gpu"])
def gpu(request):
    """The threads run by the processor, and the real thing where there is one."""
    if request.param == "gpu":
        return _real_gpu()
    from host import Host

    return Host()


@pytest.fixture
def real_gpu():
    return _real_gpu()


@pytest.fixture
def no_gpu(monkeypatch):
    """A machine with the package, and without a GPU."""
    from luxel.cuda import device, door

    device.gpu.cache_clear()
    monkeypatch.setattr(door, "initialise", lambda: (_ for _ in ()).throw(OSError("CUDA driver library cannot be found.\nInstall it.")))
    yield
    device.gpu.cache_clear()
