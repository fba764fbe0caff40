import numpy as np
import pytest

from luxel.errors import InputError
from luxel.scene.colour import bytes_from_linear, linear_from_srgb, srgb_from_linear


def test_known_values():
    assert np.allclose(linear_from_srgb(np.float64([0, 0.04045, 0.5, 1])), [0, 0.0031308, 0.2140411, 1], atol=1e-6)
    assert np.allclose(srgb_from_linear([0, 0.0031308, 0.2140411, 1]), [0, 0.04045, 0.5, 1], atol=1e-5)


def test_all_bytes_survive():
    codes = np.arange(256, dtype=np.uint8)
    assert np.array_equal(bytes_from_linear(linear_from_srgb(codes)), codes)
    assert np.allclose(linear_from_srgb(codes), linear_from_srgb(codes / 255.0), atol=1e-7)


def test_monotonic_and_bounded():
    encoded = srgb_from_linear(np.linspace(0, 1, 100_001))
    assert (np.diff(encoded) >= 0).all()
    assert encoded[-1] == 1


def test_what_is_out_of_range_is_clamped():
    assert np.array_equal(srgb_from_linear([-1, 2, np.nan, np.inf, -np.inf]), [0, 1, 0, 1, 0])
    assert srgb_from_linear(np.float32(0.5)).shape == ()


def test_other_integers_are_refused():
    with pytest.raises(InputError, match="expected uint8 or floats, got int64"):
        linear_from_srgb(np.arange(3))
