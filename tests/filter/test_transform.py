"""Transforms: the direct sum of the paper against NumPy's FFT, at any size; the fast ones against it too."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.filter.transform import dft2, dft2_rows, fft2, fftfreq2, idft2, ifft2, irfft2, rfft2

SIDES = st.sampled_from([1, 2, 3, 4, 5, 7, 8, 11, 13, 16, 17])
LONG = st.sampled_from([1, 2, 3, 16, 31, 64, 97, 100, 127, 128, 210])
SEEDS = st.integers(0, 2**32 - 1)


def plane(seed, height, width, kind):
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.1, 10, (height, width))
    return (values + 1j * rng.uniform(0.1, 10, (height, width)) if np.dtype(kind).kind == "c" else values).astype(kind)


@settings(max_examples=40, deadline=None)
@given(SEEDS, SIDES, SIDES, st.sampled_from(["f4", "f8", "c8", "c16"]), st.integers(1, 3))
def test_the_direct_sum_is_the_transform(seed, height, width, kind, threads):
    f = plane(seed, height, width, kind)
    single = f.dtype in (np.float32, np.complex64)
    expected = np.fft.fft2(f)
    tolerance = (3e-7 if single else 1e-15) * np.abs(f).sum() + (1e-5 if single else 1e-12)
    spectrum = dft2(f, threads)
    assert spectrum.dtype == (np.complex64 if single else np.complex128)
    assert np.abs(spectrum - expected).max() <= tolerance
    back = idft2(spectrum, threads)
    assert np.abs(back - f).max() <= (1e-4 if single else 1e-12)


def test_the_papers_check():
    """Forward and inverse of random values in 0.1 .. 10 come back within 1e-2; in single precision too."""
    for side in (8, 16):
        for kind in ("f4", "f8"):
            f = plane(side, side, side, kind)
            assert np.abs(idft2(dft2(f)) - f).max() < 1e-2


def test_threads_change_nothing():
    f = plane(3, 9, 14, "f4")
    assert dft2(f, 1).tobytes() == dft2(f, 2).tobytes() == dft2(f, 5).tobytes()


def test_rows_are_those_of_the_whole():
    f = plane(4, 10, 7, "f8")
    assert np.array_equal(np.concatenate([dft2_rows(f, 0, 3), dft2_rows(f, 3, 3), dft2_rows(f, 3, 10)]), dft2(f))
    assert np.array_equal(dft2_rows(f, 2, 5, inverse=True), idft2(f)[2:5])
    with pytest.raises(InputError, match=r"rows: expected 0 <= first <= last <= 10, got 5 .. 11"):
        dft2_rows(f, 5, 11)


@settings(max_examples=60, deadline=None)
@given(SEEDS, LONG, LONG, st.sampled_from(["f4", "f8", "u1"]), st.sampled_from([None, 1, 2]))
def test_fast_transforms_of_any_length(seed, height, width, kind, threads):
    f = plane(seed, height, width, kind)
    expected = np.fft.fft2(f.astype(float))
    near = (2e-6 if kind == "f4" else 1e-14) * np.abs(f.astype(float)).sum()
    assert np.abs(fft2(f, threads) - expected).max() <= near
    half = rfft2(f, threads)
    assert np.abs(half - expected[:, : width // 2 + 1]).max() <= near
    small = 1e-4 if kind == "f4" else 1e-11
    assert np.abs(ifft2(fft2(f, threads), threads, overwrite=True) - f).max() <= small
    assert np.abs(irfft2(half, (height, width), threads) - f).max() <= small
    if kind == "f4":
        assert half.dtype == np.complex64


def test_planes_are_transformed_apart():
    f = np.stack([plane(1, 6, 10, "f8"), plane(2, 6, 10, "f8")])
    assert np.allclose(rfft2(f)[1], np.fft.rfft2(f[1]))


def test_energy_is_kept():
    f = plane(5, 30, 41, "f8")
    assert np.sum(np.abs(fft2(f)) ** 2) / f.size == pytest.approx(np.sum(f**2), rel=1e-13)  # Parseval


def test_frequencies():
    fy, fx = fftfreq2(4, 5)
    assert fy.shape == (4, 1)
    assert fx.shape == (1, 5)
    wave = np.cos(2 * np.pi * 0.25 * np.arange(4))[:, None] * np.ones(5)
    peak = np.unravel_index(np.abs(fft2(wave)).argmax(), (4, 5))
    assert abs(fy[peak[0], 0]) == 0.25
    assert fftfreq2(4, 5, real=True)[1].shape == (1, 3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: dft2(np.zeros((3, 3, 3))), r"one plane \(h, w\), got \(3, 3, 3\)"),
        (lambda: fft2(np.zeros((0, 4))), r"at least one pixel, got \(0, 4\)"),
        (lambda: fft2(np.zeros(4)), r"got \(4,\) float64"),
        (lambda: fft2(np.array([["a"]])), "expected numbers"),
        (lambda: rfft2(np.zeros((2, 2), complex)), "real numbers, got complex128"),
        (lambda: irfft2(np.zeros((4, 4), complex), (4, 5)), "has a spectrum of 4 x 3"),
        (lambda: dft2(np.zeros((2, 2)), threads=0), "threads"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(InputError, match=message):
        call()
