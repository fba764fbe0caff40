"""Low-pass filters: every way of convolving against the plain sum, and what any low-pass filter must keep."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage, signal

import luxel.filter
from luxel.errors import InputError
from luxel.filter import lowpass
from luxel.filter.borders import BORDERS
from luxel.scene.colour import linear_from_srgb

SIDES = st.sampled_from([1, 2, 3, 5, 8, 17, 31, 64, 67])
TAPS = st.sampled_from([1, 2, 3, 4, 5, 7, 9, 16, 23])
SEEDS = st.integers(0, 2**32 - 1)
KINDS = st.sampled_from([np.float32, np.float64])
PAD = {"mirror": "symmetric", "clamp": "edge", "wrap": "wrap", "constant": "constant"}
SCIPY = {"mirror": "reflect", "clamp": "nearest", "wrap": "wrap", "constant": "constant"}


def plain(image, kernel, border, value=0.0):
    """The definition: extend, then sum, in float64."""
    (kh, kw), f = kernel.shape, image.astype(float)
    widths = [(kh - 1 - (kh - 1) // 2, (kh - 1) // 2), (kw - 1 - (kw - 1) // 2, (kw - 1) // 2), (0, 0)]
    wide = np.pad(f, widths, PAD[border], **({"constant_values": value} if border == "constant" else {}))
    return signal.convolve(wide, np.asarray(kernel, float)[..., None], mode="valid", method="direct")


def near(kind, kernel):
    """Rounding of pixels up to 1: that of a sum grows with the root of its terms (the reference in float64 rounds as well)."""
    return np.finfo(kind).eps * max(4.0, np.sqrt(kernel.size) / 2) * max(1.0, np.abs(kernel).sum())


@settings(max_examples=150, deadline=None)
@given(SEEDS, SIDES, SIDES, st.integers(1, 4), TAPS, TAPS, st.sampled_from(BORDERS), KINDS, st.sampled_from(["direct", "tiles", "fft", "auto"]),
       st.integers(1, 3))  # fmt: skip
def test_any_kernel_is_the_plain_sum(seed, height, width, channels, kh, kw, border, kind, method, threads):
    rng = np.random.default_rng(seed)
    image = rng.random((height, width, channels)).astype(kind)
    kernel = rng.normal(size=(kh, kw)) * (rng.random((kh, kw)) < 0.8)
    out = lowpass(image, kernel=kernel, border=border, value=0.7, method=method, threads=threads)
    assert out.dtype == kind
    assert out.shape == image.shape
    assert np.abs(out - plain(image, kernel, border, 0.7)).max() <= near(kind, kernel)


@settings(max_examples=60, deadline=None)
@given(SEEDS, SIDES, SIDES, st.integers(1, 4), TAPS, TAPS, st.sampled_from(BORDERS), KINDS)
def test_products_are_separable(seed, height, width, channels, kh, kw, border, kind):
    rng = np.random.default_rng(seed)
    image = rng.random((height, width, channels)).astype(kind)
    kernel = rng.random((kh, 1)) * rng.random(kw)
    out = lowpass(image, kernel=kernel, border=border, value=0.7, method="separable")
    assert np.abs(out - plain(image, kernel, border, 0.7)).max() <= near(kind, kernel)


@settings(max_examples=60, deadline=None)
@given(SEEDS, SIDES, SIDES, st.floats(0.3, 12), st.sampled_from(BORDERS), st.sampled_from(["separable", "tiles", "fft", "dct", "auto"]))
def test_gaussian_is_scipys(seed, height, width, sigma, border, method):
    image = np.random.default_rng(seed).random((height, width, 2))
    expected = ndimage.gaussian_filter(image, sigma, mode=SCIPY[border], cval=0.25, axes=(0, 1))
    out = lowpass(image, gaussian=sigma, border=border, value=0.25, method=method)
    assert np.abs(out - expected).max() < 1e-13


@pytest.mark.parametrize("shape", [(300, 200, 3), (130, 701, 1), (257, 258, 4)])
def test_wide_rows_and_long_kernels(shape):
    """Several blocks, strips, bands and tiles, and more taps than are summed in place."""
    rng = np.random.default_rng(7)
    image = rng.random(shape).astype(np.float32)
    for kernel in (rng.random((41, 1)) * rng.random((1, 37)), rng.random((9, 12)), rng.random((40, 61))):
        kernel /= kernel.sum()
        expected = plain(image, kernel, "mirror")
        for method in ("separable", "direct", "tiles", "fft", "auto"):
            if method == "separable" and np.linalg.matrix_rank(kernel) > 1:
                continue
            rounding = 5e-8 * np.sqrt(kernel.size if method in ("direct", "auto") else 100)  # of as many sums in float32
            assert np.abs(lowpass(image, kernel=kernel, method=method) - expected).max() < rounding, method


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.sampled_from([32, 64, 128]), st.integers(1, 31), st.integers(1, 31), st.integers(1, 3))
def test_no_seams(seed, size, kh, kw, channels):
    """Whatever the tiles, each pixel is that of one transform of the whole."""
    from luxel.filter import cost

    rng = np.random.default_rng(seed)
    image, kernel = rng.random((150, 170, channels)).astype(np.float32), rng.random((kh, kw))
    kernel /= kernel.sum()
    whole = lowpass(image.astype(float), kernel=kernel, method="fft")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cost, "_PAIR", {size: 1.0})
        patch.setattr(cost, "SIZES", (size,))
        assert np.abs(lowpass(image, kernel=kernel, method="tiles") - whole).max() < 1e-6


FILTERS = [{"gaussian": 0.8}, {"gaussian": 6.0}, {"ideal": 0.2}, {"butterworth": (0.15, 4)}, {"kernel": np.full((5, 3), 1 / 15)}]


@pytest.mark.parametrize("options", FILTERS)
@pytest.mark.parametrize("border", ["mirror", "clamp", "wrap"])
def test_constants_stay(options, border):
    for kind in (np.float32, np.float64):
        image = np.full((33, 47, 3), 0.625, kind)
        assert np.abs(lowpass(image, border=border, **options) - 0.625).max() <= 3 * np.finfo(kind).eps
    for kind in (np.uint8, np.uint16):
        image = np.full((33, 47, 4), 0.7 * np.iinfo(kind).max, kind)
        assert np.array_equal(lowpass(image, border=border, **options), image)


@pytest.mark.parametrize("options", FILTERS)
@pytest.mark.parametrize("border", ["mirror", "wrap"])
def test_the_mean_is_kept_and_energy_only_lost(options, border):
    image = np.random.default_rng(2).random((60, 71, 3))
    out = lowpass(image, border=border, **options)
    assert out.mean((0, 1)) == pytest.approx(image.mean((0, 1)), rel=1e-12)
    lost = (image - image.mean((0, 1))) ** 2
    assert 0 < ((out - out.mean((0, 1))) ** 2).sum() < lost.sum()


def test_energy_is_that_of_the_transfer_function():
    """Parseval: with a border that wraps, each frequency is scaled by the filter and nothing else."""
    rng = np.random.default_rng(3)
    image = rng.random((48, 60))
    f = np.hypot(np.fft.fftfreq(48)[:, None], np.fft.fftfreq(60))
    for options, factor in (({"ideal": 0.2}, f <= 0.2), ({"butterworth": (0.1, 3)}, 1 / np.sqrt(1 + (f / 0.1) ** 6))):
        out = lowpass(image, border="wrap", **options)
        assert np.sum(out**2) == pytest.approx(np.sum(np.abs(np.fft.fft2(image) * factor) ** 2) / image.size, rel=1e-12)


def test_mirrored_borders_are_those_of_the_mirrored_picture():
    """A filter with mirrored borders is the filter of the picture and its mirror images, which wrap."""
    image = np.random.default_rng(4).random((21, 34, 2))
    doubled = np.concatenate([image, image[::-1]])
    doubled = np.concatenate([doubled, doubled[:, ::-1]], 1)
    for options in ({"ideal": 0.22}, {"butterworth": (0.2, 2)}, {"gaussian": 3.0}):
        assert np.abs(lowpass(image, **options) - lowpass(doubled, border="wrap", **options)[:21, :34]).max() < 1e-13


def test_far_borders_agree():
    """Where a clamped and a mirrored border look alike, the filters give the same."""
    image = np.full((64, 64), 0.5)
    image[28:36, 28:36] = np.random.default_rng(5).random((8, 8))
    for options in ({"butterworth": (0.25, 4)}, {"gaussian": 2.0}):
        mirror, clamp = (lowpass(image, border=b, **options) for b in ("mirror", "clamp"))
        constant = lowpass(image, border="constant", value=0.5, **options)
        assert np.abs(mirror - clamp).max() < 1e-4
        assert np.abs(clamp - constant).max() < 1e-12


def test_what_is_beyond_the_cutoff_goes():
    x = np.arange(128)
    low, high = np.cos(2 * np.pi * x * 8 / 128), np.cos(2 * np.pi * x * 40 / 128)
    image = np.broadcast_to(0.5 + 0.2 * low + 0.2 * high, (64, 128))
    out = lowpass(image, ideal=0.2, border="wrap")
    assert np.abs(out - np.broadcast_to(0.5 + 0.2 * low, image.shape)).max() < 1e-13
    half = lowpass(np.broadcast_to(0.5 + 0.2 * low, image.shape), butterworth=(8 / 128, 3), border="wrap")
    assert np.abs(half - (0.5 + 0.2 * low / np.sqrt(2))).max() < 1e-13


def test_linear_light_and_premultiplied_alpha():
    """An opaque red and a transparent green pixel mix to half-transparent red; two greys to the mean of their light."""
    image = np.zeros((1, 2, 4), np.uint8)
    image[0, 0], image[0, 1] = (255, 0, 0, 255), (0, 255, 0, 0)
    mixed = lowpass(image, kernel=np.array([[0.5, 0.5]]), border="wrap")
    assert mixed.tolist() == [[[255, 0, 0, 128]] * 2]
    grey = np.array([[0, 255]], np.uint8)
    assert lowpass(grey, kernel=np.array([[0.5, 0.5]]), border="wrap").tolist() == [[188, 188]]
    assert lowpass(grey, kernel=np.array([[0.5, 0.5]]), border="wrap", encoded=False).tolist() == [[128, 128]]
    two = np.array([[[200, 255], [10, 0]]], np.uint8)
    assert lowpass(two, kernel=np.array([[0.5, 0.5]]), border="wrap")[0, 0].tolist() == [200, 128]


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_integers_go_through_unchanged(kind):
    codes = np.arange(np.iinfo(kind).max + 1, dtype=kind).reshape(16, -1)
    for channels in (1, 2, 3, 4):
        image = np.repeat(codes[..., None], channels, 2)
        if channels in (2, 4):
            image[..., -1] = np.iinfo(kind).max
        for encoded in (None, False):
            assert np.array_equal(lowpass(image, kernel=[[1.0]], encoded=encoded), image)


def test_integers_are_decoded_filtered_and_encoded():
    image = np.random.default_rng(6).integers(0, 256, (40, 50, 3), dtype=np.uint8)
    light = lowpass(linear_from_srgb(image).astype(float), gaussian=1.5)
    wide = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    assert np.abs(lowpass(image, gaussian=1.5) - 255 * wide).max() < 0.501
    sixteen = lowpass(image.astype(np.uint16) * 257, gaussian=1.5)
    assert np.abs(sixteen - 65535 * wide).max() < 0.6


def test_shapes_and_small_pictures():
    assert lowpass(np.ones((3, 4)), gaussian=1).shape == (3, 4)
    assert lowpass(np.ones((3, 4, 1), np.float16), gaussian=1).dtype == np.float16
    one = np.array([[[0.25, 0.5]]])
    for border in ("mirror", "clamp", "wrap"):
        for options in FILTERS:
            assert np.abs(lowpass(one, border=border, **options) - one).max() < 1e-15
    assert np.abs(lowpass(np.ones((2, 3)), kernel=np.full((9, 11), 1 / 99), border="mirror") - 1).max() < 1e-14  # larger than the picture
    tall = np.random.default_rng(8).random((3, 5, 3))
    kernel = np.random.default_rng(9).random((40, 70))
    for method in ("direct", "tiles", "fft"):
        assert np.abs(lowpass(tall, kernel=kernel, method=method) - plain(tall, kernel, "mirror")).max() < 1e-11
    view = np.random.default_rng(1).random((20, 30, 3)).astype(np.float32)
    assert np.array_equal(lowpass(view[::2, ::-1], gaussian=1), lowpass(view[::2, ::-1].copy(), gaussian=1))
    frozen = view.copy()
    frozen.setflags(write=False)
    assert np.array_equal(lowpass(frozen, gaussian=1), lowpass(view, gaussian=1))
    assert np.array_equal(frozen, view)


@pytest.mark.parametrize("method", ["separable", "direct", "tiles", "fft", "dct"])
@pytest.mark.parametrize("channels", [1, 3])
def test_the_picture_is_left_alone(method, channels):
    for kind in (np.float32, np.float64):
        image = np.random.default_rng(1).random((30, 40, channels)).astype(kind)
        kept = image.copy()
        for border in BORDERS:
            lowpass(image, gaussian=1.5, border=border, method=method)
            assert np.array_equal(image, kept)


def test_pictures_as_kernels_are_scaled():
    image = np.random.default_rng(1).random((20, 30))
    kernel = np.random.default_rng(2).integers(0, 255, (3, 5))
    assert np.allclose(lowpass(image, kernel=kernel), lowpass(image, kernel=kernel / kernel.sum()))
    assert np.allclose(lowpass(image, kernel=kernel[..., None]), lowpass(image, kernel=kernel))


def test_the_same_bytes_for_any_number_of_threads():
    rng = np.random.default_rng(11)
    image, kernel = rng.random((100, 90, 3)).astype(np.float32), rng.random((7, 9))
    for method in ("direct", "tiles"):
        assert lowpass(image, kernel=kernel, method=method, threads=1).tobytes() == lowpass(image, kernel=kernel, method=method, threads=3).tobytes()
    one, three = (lowpass(image, gaussian=12.0, method="separable", threads=n) for n in (1, 3))
    assert one.tobytes() == three.tobytes()


def test_plain_python_gives_the_same(tmp_path):
    """With NUMBA_DISABLE_JIT the vector instructions are NumPy's."""
    code = """
import sys, numpy as np
from luxel.filter import dft2, lowpass
rng = np.random.default_rng(1)
image, kernel = rng.random((20, 30, 3)), rng.random((5, 7))
found = {method: lowpass(image, kernel=kernel, method=method) for method in ("direct", "tiles")}
found |= {"separable": lowpass(image, kernel=kernel[:, :1] * kernel[:1], method="separable"), "dft": dft2(image[:5, :6, 0])}
found |= {"bytes": lowpass((255 * image).astype(np.uint8), gaussian=1.0), "words": lowpass((65535 * image).astype(np.uint16), gaussian=1.0)}
np.savez(sys.argv[1], **found)
"""
    for name, switch in (("plain", "1"), ("compiled", "0")):
        subprocess.run([sys.executable, "-c", code, tmp_path / name], check=True, env={**os.environ, "NUMBA_DISABLE_JIT": switch})
    with np.load(tmp_path / "plain.npz") as plain_python, np.load(tmp_path / "compiled.npz") as compiled:
        for name in compiled:
            assert np.abs(plain_python[name].astype(complex) - compiled[name]).max() < (1.1 if name == "words" else 1e-12), name


def test_the_function_is_not_hidden_by_a_module():
    """Whatever was imported before."""
    code = "import luxel.filter.filters, luxel.filter.transform; from luxel.filter import lowpass, dft2; assert callable(lowpass) and callable(dft2)"
    subprocess.run([sys.executable, "-c", code], check=True)
    names = {path.stem for path in Path(luxel.filter.__file__).parent.glob("*.py")}
    assert not names & set(luxel.filter.__all__)


BAD = np.full((4, 5, 3), 0.5)
NAN = BAD.copy()
NAN[2, 3, 1] = np.nan


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (np.zeros((0, 4)), {"gaussian": 1}, r"at least one pixel, got \(0, 4\)"),
        (np.zeros((4, 4, 16)), {"gaussian": 1}, r"\(h, w, 1..4\) with at least one pixel, got \(4, 4, 16\)"),
        (np.zeros((4, 4), int), {"gaussian": 1}, "uint8, uint16, float16, float32 or float64, got int64"),
        (np.zeros((4, 4), complex), {"gaussian": 1}, "got complex128"),
        ([[1.0], [1.0, 2.0]], {"gaussian": 1}, "ragged"),
        (NAN, {"gaussian": 1}, "got nan at row 2, column 3, channel 1"),
        (NAN, {"kernel": np.random.default_rng(1).random((3, 3)), "method": "tiles"}, "got nan at row 2, column 3"),
        (NAN, {"kernel": np.random.default_rng(1).random((3, 3)), "method": "direct"}, "got nan at row 2, column 3"),
        (NAN, {"kernel": np.random.default_rng(1).random((3, 3)), "method": "fft"}, "got nan at row 2, column 3"),
        (NAN, {"ideal": 0.2}, "got nan at row 2, column 3"),
        (np.where(np.isnan(NAN), -np.inf, NAN), {"gaussian": 1}, "got -inf at row 2"),
        (BAD, {}, "expected one of gaussian, butterworth, ideal and kernel, got none"),
        (BAD, {"gaussian": 1, "ideal": 0.2}, "got gaussian and ideal"),
        (BAD, {"gaussian": 0}, "standard deviation above 0"),
        (BAD, {"gaussian": float("nan")}, "standard deviation above 0"),
        (BAD, {"gaussian": "2"}, "standard deviation above 0"),
        (BAD, {"ideal": 2.0}, "cycles per pixel above 0"),
        (BAD, {"ideal": -0.1}, "cycles per pixel above 0"),
        (BAD, {"butterworth": 0.2}, r"expected \(cutoff, order\), got 0.2"),
        (BAD, {"butterworth": (0.2, 0)}, "order: expected a number above 0"),
        (BAD, {"kernel": np.zeros((0, 3))}, r"kernel: expected numbers \(kh, kw\)"),
        (BAD, {"kernel": [[np.nan]]}, "kernel: expected finite numbers"),
        (BAD, {"kernel": np.zeros((2, 2), int)}, "sums to 0 or less"),
        (BAD, {"gaussian": 1, "border": "reflect"}, "border: expected one of mirror, clamp, wrap, constant; got 'reflect'"),
        (BAD, {"gaussian": 1, "method": "magic"}, "method: expected auto or one of"),
        (BAD, {"ideal": 0.2, "method": "direct"}, "direct cannot apply this filter"),
        (BAD, {"gaussian": 1, "value": np.inf}, "value: expected a finite number"),
        (BAD, {"gaussian": 1, "encoded": True}, "encoded: floats are taken as linear"),
        (BAD, {"gaussian": 1, "threads": 0}, "threads"),
    ],
)
def test_bad_input(image, options, message):
    with pytest.raises(InputError, match=message), np.errstate(invalid="ignore"):
        lowpass(image, **options)
