"""Metrics against closed forms and properties."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.filter.metrics import difference_picture, max_difference, psnr, rmse, ssim, ssim_map

PICTURES = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).random((2, 17, 23, 3)))


def test_constant_pictures():
    a, b = np.full((20, 30), 0.25), np.full((20, 30), 0.75)
    assert rmse(a, b) == pytest.approx(0.5)
    assert psnr(a, b) == pytest.approx(20 * np.log10(2))
    assert max_difference(a, b) == pytest.approx(0.5)
    c1 = 1e-4  # no variance: only the luminance term is left
    assert ssim(a, b) == pytest.approx((2 * 0.25 * 0.75 + c1) / (0.25**2 + 0.75**2 + c1))


def test_one_pixel_off():
    a = np.zeros((10, 10, 4))
    b = a.copy()
    b[3, 4, 1] = -0.2
    assert rmse(a, b) == pytest.approx(0.2 / 20)  # sqrt(0.04 / 400)
    assert max_difference(a, b) == pytest.approx(0.2)


def test_bytes_are_zero_to_one():
    a = np.zeros((4, 4, 3), np.uint8)
    b = a.copy()
    b[0, 0, 0] = 255
    assert max_difference(a, b) == 1.0
    assert max_difference(a.astype(np.uint16), b.astype(np.uint16) * 257) == 1.0
    assert max_difference(b, a) == 1.0  # no wrap-around of unsigned numbers


def test_ssim_at_a_pixel_is_the_windowed_sum():
    rng = np.random.default_rng(5)
    a, b = rng.random((2, 11, 11))
    x = np.arange(-5, 6)
    w = np.exp(-(x[:, None] ** 2 + x**2) / (2 * 1.5**2))
    w /= w.sum()
    ma, mb = (w * a).sum(), (w * b).sum()
    va, vb, cov = (w * a * a).sum() - ma**2, (w * b * b).sum() - mb**2, (w * a * b).sum() - ma * mb
    c1, c2 = 0.01**2, 0.03**2
    expected = (2 * ma * mb + c1) * (2 * cov + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2))
    assert ssim_map(a, b)[5, 5, 0] == pytest.approx(expected, abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(PICTURES)
def test_properties(pair):
    a, b = pair
    assert rmse(a, a) == 0
    assert psnr(a, a) == np.inf
    assert ssim(a, a) == pytest.approx(1)
    for metric in (rmse, psnr, ssim, max_difference):
        assert metric(a, b) == pytest.approx(metric(b, a))
        assert metric(a[:, ::-1], b[:, ::-1]) == pytest.approx(metric(a, b))
    assert rmse(a, b) <= max_difference(a, b)
    assert -1 <= ssim(a, b) < 1
    assert rmse(3 * a, 3 * b) == pytest.approx(3 * rmse(a, b))
    assert psnr(3 * a, 3 * b, 3) == pytest.approx(psnr(a, b))
    assert ssim(3 * a, 3 * b, 3) == pytest.approx(ssim(a, b))


def test_more_noise_is_further():
    rng = np.random.default_rng(1)
    a = np.broadcast_to(np.linspace(0, 1, 64), (64, 64))
    noise = rng.normal(size=(64, 64))
    steps = [0.01, 0.03, 0.1, 0.3]
    assert np.all(np.diff([rmse(a, a + s * noise) for s in steps]) > 0)
    assert np.all(np.diff([ssim(a, a + s * noise) for s in steps]) < 0)
    shifted = a + rmse(a, a + 0.1 * noise)
    assert ssim(a, shifted) > ssim(a, a + 0.1 * noise)  # the same RMSE without hurt to the structure


def test_difference_picture():
    a = np.zeros((5, 6, 3))
    b = a.copy()
    b[1, 2] = 0.1, 0.3, 0.0
    b[2, 2] = 0.1
    picture = difference_picture(a, b)
    assert picture.shape == (5, 6, 3)
    assert picture.dtype == np.uint8
    assert picture[1, 2].tolist() == [255, 255, 255]
    assert picture[2, 2].tolist() == [255, 0, 0]
    assert picture.sum() == 4 * 255
    assert difference_picture(a, b, gain=5 / 3)[1, 2].tolist() == [255, 128, 0]
    assert not difference_picture(a, a).any()


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (np.zeros((4, 5)), np.zeros((5, 4)), "5x4 with 1 channel and 4x5 with 1 channel"),
        (np.zeros((4, 5, 3)), np.zeros((4, 5, 4)), "3 channels and 5x4 with 4 channels"),
        (np.zeros(4), np.zeros(4), r"\(h, w\) or \(h, w, c\)"),
        (np.zeros((0, 5)), np.zeros((0, 5)), "at least one pixel"),
        (np.zeros((4, 5), np.int64), np.zeros((4, 5)), "got int64"),
    ],
)
def test_wrong_pictures(a, b, message):
    for metric in (rmse, psnr, ssim, max_difference, difference_picture):
        with pytest.raises(InputError, match=message):
            metric(a, b)


def test_wrong_range_and_gain():
    a = np.zeros((4, 4))
    with pytest.raises(InputError, match="data_range"):
        psnr(a, a, 0)
    with pytest.raises(InputError, match="data_range"):
        ssim(a, a, -1)
    with pytest.raises(InputError, match="gain"):
        difference_picture(a, a, 0)
