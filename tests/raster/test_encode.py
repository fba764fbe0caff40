import numpy as np
import pytest

from luxel import jit
from luxel.raster.channels import BATCH, FRAGMENTS, OA, OB, OG, OR
from luxel.raster.encode import encode, linear_to_srgb, srgb_code, srgb_to_linear, unit_code


@jit.kernel
def codes(values, srgb, units):
    for i in range(len(values)):
        srgb[i] = srgb_code(values[i])
        units[i] = unit_code(values[i])


@jit.kernel
def encode_batch(g, n, exposure, out):
    encode(g, n, exposure, out)


def coded(values):
    srgb, units = np.zeros(len(values), np.int32), np.zeros(len(values), np.int32)
    codes(values.astype(np.float32), srgb, units)
    return srgb, units


def test_every_code_survives_the_round_trip():
    every = np.arange(256)
    assert np.array_equal(coded(srgb_to_linear(every / 255))[0], every)
    assert np.array_equal(coded(every / 255)[1], every)


def test_rounding_is_exact_on_both_sides_of_every_threshold():
    # The 255 values of light whose code is k + 0.5, in float64, and the nearest float32 below and above: nothing is closer.
    exact = srgb_to_linear((np.arange(255) + 0.5) / 255)
    near = exact.astype(np.float32)
    above = np.where(near.astype(np.float64) < exact, np.nextafter(near, np.float32(2)), near)
    below = np.nextafter(above, np.float32(0))
    assert np.array_equal(coded(above)[0], np.arange(255) + 1)
    assert np.array_equal(coded(below)[0], np.arange(255))


def test_random_light_is_rounded_correctly():
    rng = np.random.default_rng(1)
    light = np.concatenate([rng.random(2000), 2.0 ** rng.uniform(-20, 0, 2000)]).astype(np.float32)
    assert np.array_equal(coded(light)[0], np.floor(linear_to_srgb(light) * 255 + 0.5))


@pytest.mark.parametrize(("value", "code"), [(np.nan, 0), (-np.inf, 0), (-1, 0), (0, 0), (1e-30, 0), (1, 255), (7, 255), (np.inf, 255)])
def test_what_is_out_of_range_is_clamped(value, code):
    srgb, units = coded(np.array([value], np.float32))
    assert srgb[0] == units[0] == code


def test_pixels_are_bytes_red_green_blue_alpha():
    g, out = np.zeros(BATCH, np.float32), np.zeros(FRAGMENTS, np.uint32)
    for channel, code in ((OR, 10), (OG, 100), (OB, 200)):
        g[channel : channel + 3] = srgb_to_linear(code / 255) / 2
    g[OA : OA + 3] = np.array([0, 0.5, 1]) + 0.001
    encode_batch(g, 3, np.float32(2), out)
    assert out[:3].astype("<u4").view(np.uint8).reshape(3, 4).tolist() == [[10, 100, 200, a] for a in (0, 128, 255)]
    assert not out[3:].any()
