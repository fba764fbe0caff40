import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session", autouse=True)
def interruptible() -> None:
    """What a shell starts in the background ignores interrupts, and so would the processes that tests interrupt."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def strict_floats() -> Iterator[None]:
    """NumPy raises on division by zero, overflow and NaN; gradual underflow is no fault."""
    with np.errstate(all="raise", under="ignore"):
        yield


@pytest.fixture(scope="session")
def meshes() -> Path:
    """The folder of real models, or a skip."""
    root = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("LUXEL_MESHES", root.parent / "shared" / "meshes"))
    if not folder.is_dir():
        pytest.skip(f"no real models: LUXEL_MESHES names no folder ({folder})")
    return folder
