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
