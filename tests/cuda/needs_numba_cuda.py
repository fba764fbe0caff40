"""Imported first by what needs numba-cuda: its tests are skipped where it is not installed."""

import pytest

numba_cuda = pytest.importorskip("numba_cuda", reason="numba-cuda is not installed: extra cuda")
