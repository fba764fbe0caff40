"""What judges anti-aliasing: exact references against closed forms, test pictures against theirs, transfer functions against what made them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import luxel
from luxel.errors import InputError
from luxel.filter import lowpass
from luxel.filter.antialias import decimate, weights
from luxel.filter.coverage import exact_picture, on_screen, visible_areas
from luxel.filter.metrics import edge_pixels, edge_rmse, rmse
from luxel.filter.mtf import edge_mtf, zone_mtf
from luxel.filter.patterns import checkerboard, slanted_edge, zone_frequency, zone_plate
from luxel.filter.transfer import butterworth, gaussian, gaussian_taps, response, sigma_of
from luxel.scene.builtin.paper import two_triangles

POINTS = st.tuples(st.floats(-3, 11), st.floats(-3, 9))
SEEDS = st.integers(0, 2**32 - 1)
TRIANGLES = st.tuples(POINTS, POINTS, POINTS)


def area(t):
    (ax, ay), (bx, by), (cx, cy) = t
    return abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) / 2


def sampled(triangles, size, n):
    """(h, w, m): how many of n x n samples of each pixel show which triangle, the first that covers them."""
    x, y = (np.arange(size[0] * n) + 0.5) / n, (np.arange(size[1] * n) + 0.5) / n
    free = np.ones((len(y), len(x)), bool)
    out = np.zeros((size[1], size[0], len(triangles)))
    for k, t in enumerate(np.asarray(triangles, float)):
        if area(t) == 0:
            continue
        sides = [(b[0] - a[0]) * (y[:, None] - a[1]) - (b[1] - a[1]) * (x - a[0]) for a, b in zip(t, np.roll(t, -1, 0))]
        inside = np.all([s >= 0 for s in sides], 0) | np.all([s <= 0 for s in sides], 0)
        out[..., k] = (inside & free).reshape(size[1], n, size[0], n).mean((1, 3))
        free &= ~inside
    return out


@settings(max_examples=60, deadline=None)
@given(st.lists(TRIANGLES, min_size=1, max_size=4))
def test_areas_are_those_of_many_samples(triangles):
    areas, edges = visible_areas(triangles, (8, 6))
    assert areas.min() >= 0
    assert areas.sum(-1).max() <= 1 + 1e-9
    assert np.abs(areas - sampled(triangles, (8, 6), 64)).max() < 0.06  # each edge crosses at most 2 of 64 samples a row
    assert not edges[(areas > 1 - 1e-13).any(-1)].any()
    assert not edges[~(areas > 0).any(-1)].any()


@settings(max_examples=60, deadline=None)
@given(st.tuples(*[st.tuples(st.floats(0, 8), st.floats(0, 6))] * 3))
def test_areas_add_up_to_the_triangles(triangle):
    assert visible_areas([triangle], (8, 6))[0].sum() == pytest.approx(area(triangle), abs=1e-9)


def test_areas_by_hand():
    square = [(0, 0), (2, 0), (0, 2)], [(2, 0), (2, 2), (0, 2)]
    areas, edges = visible_areas(square, (2, 2))
    assert areas.tolist() == [[[1, 0], [0.5, 0.5]], [[0.5, 0.5], [0, 1]]]
    assert edges.tolist() == [[False, True], [True, False]]
    behind, _ = visible_areas([[(0, 0), (1, 0), (0, 1)], [(-9, -9), (20, -9), (-9, 20)]], (2, 1))
    assert behind.tolist() == [[[0.5, 0.5], [0, 1]]]
    picture, _ = exact_picture(square[:1], [[1.0, 0.5]], [0.0, 1.0], (2, 2))
    assert picture[0, 1].tolist() == [0.5, 0.75]
    with pytest.raises(InputError, match="finite corners"):
        visible_areas([[(0, 0), (1, np.nan), (0, 1)]], (2, 2))


def test_the_rasteriser_converges_to_the_exact_picture():
    """The paper's scene: the more samples, the nearer; 64 samples are within what their number allows."""
    scene, size = two_triangles(), (120, 120)
    corners, colors = np.array([mesh.positions for mesh in scene.meshes]), [mesh.colors[0] for mesh in scene.meshes]
    places, _ = on_screen(corners, scene.cameras[0], size)
    exact, edges = exact_picture(places, colors, [0, 0, 0, 0], size)
    assert 200 < edges.sum() < 900

    def error(**options):
        picture = luxel.render(scene, size=size, outputs="linear", **options).linear
        assert np.abs(picture - exact)[~edges].max() < 2e-6
        return edge_rmse(picture, exact, edges)

    errors = [error(samples=1), error(samples=4), error(samples=16), error(ssaa=8)]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 0.1
    assert errors[3] < 0.02


def test_points_behind_the_camera_are_refused():
    camera = luxel.Camera.look_at((0, 0, 5), (0, 0, 0))
    place, distance = on_screen([[0, 0, 0]], camera, (100, 60))
    assert place[0] == pytest.approx([50, 30])
    assert distance[0] == pytest.approx(5)
    with pytest.raises(InputError, match="behind it"):
        on_screen([[0, 0, 6]], camera, (100, 60))


def test_edge_rmse():
    reference = np.zeros((10, 10))
    reference[:, 5:] = 1
    other = reference.copy()
    other[:, 5] = 0.5
    assert edge_pixels(reference).sum() == 20
    assert edge_rmse(reference, reference) == 0
    assert edge_rmse(other, reference) == pytest.approx(0.5 / np.sqrt(2))
    assert edge_rmse(other, reference) > rmse(other, reference)
    only = np.zeros((10, 10), bool)
    only[3, 5] = True
    assert edge_rmse(other, reference, only) == pytest.approx(0.5)
    with pytest.raises(InputError, match="at least one edge pixel"):
        edge_rmse(other, np.zeros((10, 10)))
    with pytest.raises(InputError, match=r"edges: expected \(10, 10\) bool, got \(10,\) bool"):
        edge_rmse(other, reference, np.ones(10, bool))


@pytest.mark.parametrize("degrees", [-8.0, 0.0, 5.0, 26.6, 45.0, 80.0])
def test_slanted_edges_are_areas(degrees):
    """Against the areas of a large triangle whose edge it is."""
    size, angle = 24, np.radians(degrees)
    normal, along = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    middle = np.array([size / 2, size / 2])
    triangle = [middle + 500 * along, middle - 500 * along, middle + 900 * normal]
    assert np.abs(slanted_edge(size, degrees) - visible_areas([triangle], (size, size))[0][..., 0]).max() < 1e-9


def test_finer_patterns_are_the_same_patterns():
    fine = slanted_edge(30, 7.0, rate=4).reshape(30, 4, 30, 4).mean((1, 3))
    assert np.abs(fine - slanted_edge(30, 7.0)).max() < 1e-12
    assert zone_plate(31, 0.4)[15, 15] == 1
    assert np.abs(zone_plate(32, 0.4, rate=3)[1::3, 1::3] - zone_plate(32, 0.4)).max() < 1e-12
    assert checkerboard(8, 2).tolist()[0] == [0, 0, 1, 1, 0, 0, 1, 1]
    assert checkerboard(8, 2).mean() == 0.5
    f = zone_frequency(64)
    assert f[32, 63] == pytest.approx(0.5 * 31.5 / 32, rel=1e-3)
    with pytest.raises(InputError, match="at least 1"):
        zone_plate(0)


@pytest.mark.parametrize("degrees", [4.0, 8.0, -6.0])
def test_the_mtf_of_an_edge_is_what_filtered_it(degrees):
    """An edge by areas has the transfer function of a pixel's square; a Gaussian multiplies it by its own."""
    edge = slanted_edge(200, degrees)
    f, kept = edge_mtf(edge, degrees)
    assert (f[0], kept[0]) == (0, pytest.approx(1))
    angle = np.radians(degrees)
    pixel = np.sinc(f * np.cos(angle)) * np.sinc(f * np.sin(angle))
    assert np.abs(kept - pixel).max() < 0.01
    for sigma in (0.6, 1.2):
        _, soft = edge_mtf(lowpass(edge, gaussian=sigma, border="clamp"), degrees)
        taps = gaussian_taps(sigma)
        assert np.abs(soft - pixel * response(taps, f * np.cos(angle)) * response(taps, f * np.sin(angle))).max() < 0.01


def test_transfer_functions():
    f = np.linspace(0, 0.5, 50)
    assert np.abs(response(gaussian_taps(2.5), f) - gaussian(f, 0, 2.5)).max() < 1e-4
    assert gaussian(0.1, 0, sigma_of(0.1)) == pytest.approx(np.sqrt(0.5))
    assert butterworth(0.1, 0, 0.1, 7) == pytest.approx(np.sqrt(0.5))
    assert butterworth(0.06, 0.08, 0.1, 7) == pytest.approx(np.sqrt(0.5))
    assert gaussian_taps(1.0).sum() == pytest.approx(1)


def test_the_mtf_of_a_zone_plate_is_what_filtered_it():
    plate = zone_plate(400)
    f, kept, other = zone_mtf(plate)
    assert np.abs(kept - 1).max() < 1e-12
    assert other.max() < 1e-12
    f, kept, other = zone_mtf(lowpass(plate, butterworth=(0.25, 4), border="clamp"))
    inner = f < 0.45
    assert np.abs(kept - butterworth(f, 0, 0.25, 4))[inner].max() < 0.03
    assert other[inner].max() < 0.05


def test_decimation_removes_what_pixels_cannot_show():
    """A zone plate up to 1 cycle per pixel: plain sampling and averages bring circles back from beyond 0.5, decimation in frequency does not."""
    size, rate, finest = 256, 4, 1.0
    fine = zone_plate(size, finest, rate)
    x = np.abs(np.arange(size) + 0.5 - size / 2)
    beyond = 2 * finest * np.maximum(x[:, None], x) / size > 0.6  # along one of the axes: a square of pixels shows a square of frequencies
    box = fine.reshape(size, rate, size, rate).mean((1, 3))
    out = decimate(fine, rate)
    left = [np.std(p[beyond]) for p in (zone_plate(size, finest), box, out)]
    assert left[2] < left[1] / 3
    assert left[1] < left[0] / 3
    inside = zone_frequency(size, finest) < 0.2
    assert np.abs(out - zone_plate(size, finest))[inside].max() < 0.05
    assert out.shape == (size, size)


@pytest.mark.parametrize("rate", [1, 2, 3, 4, 8])
@pytest.mark.parametrize(("cutoff", "order"), [(0.4, 4), (0.25, 2), (0.5, 12)])
def test_decimation_is_a_butterworth_filter_and_sampling(rate, cutoff, order):
    """Cosines that the mirror continues come out as cosines at the pixels' centres, times the filter's factor; those beyond the Nyquist
    frequency turned round."""
    taps = weights(rate, cutoff, order)
    at = (np.arange(len(taps)) - (len(taps) - 1) / 2) / rate
    turns = -1 if rate % 2 == 0 else 1  # the nearest fine samples lie half a step beside a pixel's centre

    def fine(f):
        """The response as its samples have it."""
        return sum(turns**j * butterworth(f - j * rate, 0, cutoff, order) for j in range(-16 // rate, 16 // rate + 1))

    n = 48
    for k in (0, 5, 20, 40, 70):
        if k >= n * rate:
            continue
        factor = taps @ np.cos(np.pi * k / n * at)
        assert factor == pytest.approx(fine(k / (2 * n)) / fine(0), abs=1e-3)
        wave, seen = (np.cos(np.pi * k * (np.arange(count) + 0.5) / count) for count in (n * rate, n))
        for turned in (lambda p: p, np.transpose):
            out = turned(decimate(turned(np.broadcast_to(wave, (3 * rate, n * rate)).copy()), rate, cutoff, order))
            assert np.abs(out - np.clip(factor * seen, wave.min(), wave.max())).max() < 1e-12


@settings(deadline=None)
@given(SEEDS, st.integers(1, 5), st.integers(1, 9), st.integers(1, 40), st.integers(1, 4), st.sampled_from(["f2", "f4", "f8"]), st.integers(1, 3))
def test_decimation_is_the_plain_sum(seed, rate, height, width, channels, kind, threads):
    """Of the mirrored picture, kept between its least and its largest; whatever the size, also where the weights reach beyond the picture."""
    image = np.random.default_rng(seed).random((height * rate, width * rate, channels)).astype(kind)
    taps = weights(rate)
    reach = (len(taps) - rate) // 2
    wide = np.pad(image.astype(np.float64), ((reach, reach), (reach, reach), (0, 0)), "symmetric")
    rows = sum(t * wide[k : k + height * rate : rate] for k, t in enumerate(taps))
    sums = sum(t * rows[:, k : k + width * rate : rate] for k, t in enumerate(taps))
    out = decimate(image, rate, threads=threads)
    assert out.dtype == image.dtype
    assert np.abs(out - np.clip(sums, image.min((0, 1)), image.max((0, 1)))).max() < {"f2": 1e-3, "f4": 2e-6, "f8": 1e-13}[kind]


def test_decimation_keeps_constants_places_and_ranges():
    for rate in (1, 2, 3):
        flat = np.full((12 * rate, 20 * rate, 4), 0.3, np.float32)
        out = decimate(flat, rate)
        assert out.shape == (12, 20, 4)
        assert out.dtype == np.float32
        assert np.abs(out - 0.3).max() < 1e-6
    edge = slanted_edge(64, 5.0, rate=4)
    far = np.abs(np.arange(64) - 31.5)[None] - 3 > 5  # the line moves by 3 pixels
    flat = np.where(far, decimate(0.1 + 0.8 * edge, 4) - np.round(0.1 + 0.8 * slanted_edge(64, 5.0), 1), 0)
    assert np.abs(flat).max() < 0.003  # no ripples
    step = np.zeros((64, 64))
    step[:, 31:] = 1
    out = decimate(step, 2, cutoff=0.5, order=50)
    assert (out.min(), out.max()) == (0, 1)
    image = np.random.default_rng(1).random((40, 60, 3)).astype(np.float32)
    kept = image.copy()
    assert decimate(image, 2).mean() == pytest.approx(image.mean(), rel=1e-3)
    assert np.array_equal(image, kept)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: decimate(np.zeros((5, 4)), 2), "multiple of 2, got 4 x 5"),
        (lambda: decimate(np.zeros((4, 4)), 0), "rate: expected a whole number"),
        (lambda: decimate(np.zeros((4, 4), np.uint8), 2), "linear light in floats, got uint8"),
        (lambda: decimate(np.full((4, 4), np.nan), 2), "finite numbers"),
        (lambda: decimate(np.zeros((4, 4)), 2, cutoff=0), "cutoff"),
        (lambda: edge_mtf(np.zeros((64, 64)), 5.0), "both sides are alike"),
        (lambda: edge_mtf(np.zeros((64, 64)), 0.0), "1.2 to 26 degrees"),
        (lambda: edge_mtf(np.zeros((4, 4)), 5.0), "at least 16"),
        (lambda: edge_mtf(np.zeros((160, 17)), 5.0), "too narrow"),
        (lambda: edge_mtf(slanted_edge(20, 1.5), 1.5), "too few rows"),
        (lambda: zone_mtf(np.zeros((20, 30))), "expected"),
    ],
)
def test_bad_input(call, message):
    with pytest.raises(InputError, match=message):
        call()
