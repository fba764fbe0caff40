"""Resolve filters against their formulas."""

import numpy as np
import pytest
from covering import PATTERNS
from scenes import UNLIT, flat_camera, flat_mesh, rectangle

import luxel
from luxel import InputError, Instance, Material, Scene
from luxel.raster import frame
from luxel.raster.resolve import FILTERS, filter_taps, resolve

SIZE = 33, 29
WIDE = [name for name in FILTERS if name != "box"]


def weight(name, x):
    """The five filters along one axis, from their definitions."""
    x = np.abs(np.asarray(x, float))
    if name == "box":
        return np.where(x <= 0.5, 1.0, 0.0)
    if name == "tent":
        return np.maximum(1 - x, 0)
    if name == "gaussian":  # exp(-2 x^2), let down so that it ends at 1.5
        return np.maximum(np.exp(-2 * x**2) - np.exp(-2 * 1.5**2), 0)
    if name == "mitchell":  # B = C = 1/3
        b = c = 1 / 3
        inner = (12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + (6 - 2 * b)
        outer = (-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + (8 * b + 24 * c)
        return np.where(x < 1, inner, np.where(x < 2, outer, 0)) / 6
    t = 2 * np.pi * (x / 3 + 0.5)  # Blackman-Harris over -1.5 .. 1.5
    window = 0.35875 - 0.48829 * np.cos(t) + 0.14128 * np.cos(2 * t) - 0.01168 * np.cos(3 * t)
    return np.where(x < 1.5, window, 0)


def draw(scene, **options):
    return luxel.render(scene, flat_camera(SIZE), SIZE, outputs=("linear",), **options).linear


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("name", FILTERS)
def test_weights_sum_to_one_and_follow_the_formula(name, pattern):
    pattern = PATTERNS[pattern]
    taps, weights = filter_taps(name, pattern)
    assert weights.dtype == np.float32
    assert abs(weights.sum(dtype=np.float64) - 1) < 1e-6
    place = taps[:, :2] + pattern[taps[:, 2]] / 256 - 0.5
    shape = weight(name, place[:, 0]) * weight(name, place[:, 1])
    if name == "box":
        shape = np.ones(len(taps))
        assert np.array_equal(taps, [[0, 0, s, 1] for s in range(len(pattern))])
    assert np.allclose(weights, shape / shape.sum(), atol=1e-7)
    assert len(np.unique(taps, axis=0)) == len(taps)
    radius = FILTERS[name][0]
    assert np.abs(place).max() <= radius
    # What the taps leave out has no weight.
    wide = np.stack(np.meshgrid(np.arange(-4, 5), np.arange(-4, 5)), -1).reshape(-1, 1, 2) + pattern / 256 - 0.5
    if name != "box":
        everything = weight(name, wide[..., 0]) * weight(name, wide[..., 1])
        assert np.isclose(np.abs(everything).sum(), np.abs(shape).sum())


@pytest.mark.parametrize("samples", [1, 2, 4, 8, 16])
@pytest.mark.parametrize("name", WIDE)
def test_a_constant_stays_what_it_is(name, samples):
    """At the borders too, where the filter hangs over the picture's edge."""
    color = (0.25, 0.5, 0.75, 1)
    scene = Scene.from_mesh(rectangle(-5, -5, 50, 50), Material(color, **UNLIT))
    assert np.abs(draw(scene, filter=name, samples=samples, tile=8) - color).max() < 1e-6
    clear = draw(Scene(), filter=name, samples=samples, background=(0.1, 0.2, 0.3, 0.5))
    assert np.allclose(clear, [0.05, 0.1, 0.15, 0.5], atol=1e-6)


@pytest.mark.parametrize("n", [1, 4])
@pytest.mark.parametrize("name", WIDE)
def test_impulse_response(name, n):
    """One lit subpixel (of n x n): the picture around it is the filter's main lobe, everywhere the same sum."""
    x, y = 16 + (n // 2) / n, 14 + (1 % n) / n
    scene = Scene.from_mesh(rectangle(x, y, x + 1 / n, y + 1 / n), Material((1, 0.5, 0, 1), **UNLIT))
    have = draw(scene, filter=name, ssaa=n, tile=16)
    columns, rows = np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5
    at = np.array([x, y]) + 0.5 / n
    grid = (np.arange(n) + 0.5) / n - 0.5
    whole = weight(name, np.add.outer(np.arange(-3, 4), grid)).sum()
    down, across = (np.maximum(weight(name, axis), 0) for axis in (rows - at[1], columns - at[0]))
    want = np.outer(down, across) / whole**2
    assert np.allclose(have[..., 3], want, atol=2e-7)
    assert np.allclose(have[..., 0], want, atol=2e-7)
    assert np.allclose(have[..., 1], want / 2, atol=2e-7)
    if name == "tent":  # a partition of unity: every sample counts the same
        assert abs(have[..., 0].sum() - 1 / n**2) < 1e-6


def filtered(colors, name, pattern, white):
    """(h, w, s, 4) premultiplied samples to (h, w, 4) by the definition, with the two limits on what negative lobes do."""
    height, width = colors.shape[:2]
    want = np.empty((height, width, 4))
    rows = (np.arange(height)[:, None] + pattern[:, 1] / 256).ravel()
    columns = (np.arange(width)[:, None] + pattern[:, 0] / 256).ravel()
    for y in range(height):
        for x in range(width):
            down, across = (weight(name, at - centre - 0.5).reshape(-1, len(pattern)) for at, centre in ((rows, y), (columns, x)))
            w = (down[:, None, :] * across[None, :, :])[..., None]
            main = (down[:, None, :] > 0) & (across[None, :, :] > 0)
            mean = (w * colors)[main].sum(0) / w[main].sum()
            most = np.append(np.maximum(white, mean[:3]), np.inf)
            value = (w * np.where(main[..., None], colors, np.minimum(colors, most))).sum((0, 1, 2)) / w.sum()
            alphas, straight = colors[main][:, 3], colors[main][:, :3] / colors[main][:, 3:]
            alpha = np.clip(value[3], alphas.min(), alphas.max())
            want[y, x] = *np.clip(value[:3], alpha * straight.min(0), alpha * straight.max(0)), alpha
    return want


def resolved(colors, name, pattern, tile, exposure=1.0):
    """Filter (h, w, s, 4) samples, h and w multiples of `tile`."""
    height, width, samples = colors.shape[:3]
    shape = height // tile, tile, width // tile, tile, samples, 4
    tiled = colors.reshape(shape).transpose(0, 2, 5, 4, 1, 3)  # tile rows, tiles, channels, samples, rows, columns
    tiled = np.ascontiguousarray(tiled).reshape(-1, 4 * samples * tile**2)
    linear = np.zeros((height, width, 4), np.float32)
    taps, weights = filter_taps(name, pattern)
    resolve(0, height, 0, width, width, height, 0, height, width // tile, tile, samples, tiled,
            taps, weights, 0, 0, exposure, np.zeros(4, np.float32), np.zeros((0, 0), np.uint32), linear, 1)  # fmt: skip
    return linear


@pytest.mark.parametrize("pattern", ["standard-1", "standard-4", "ssaa-3"])
@pytest.mark.parametrize("name", WIDE)
def test_samples_of_any_brightness_follow_the_definition(name, pattern):
    pattern, rng = PATTERNS[pattern], np.random.default_rng(1)
    colors = rng.uniform(0.1, 1, (16, 8, len(pattern), 4)).astype(np.float32)
    colors[..., :3] *= colors[..., 3:] * np.exp(rng.normal(-1, 1.5, (*colors.shape[:3], 1))).astype(np.float32)
    want = filtered(colors.astype(float), name, pattern, white=0.25) * [4, 4, 4, 1]
    assert np.allclose(resolved(colors, name, pattern, 8, exposure=4.0), want, rtol=1e-5, atol=4e-6 * colors.max())


@pytest.mark.parametrize("samples", [2, 4, 16])
def test_highlights_leave_no_dark_rings(samples):
    """A bar a hundred times as bright as white, on a grey wall: nothing is darker than the wall, nor brighter than the bar."""
    scene = Scene.from_mesh(rectangle(-5, -5, 50, 50), Material((0.3, 0.3, 0.3, 1), **UNLIT))
    bar = rectangle(12.3, 5.1, 19.6, 20.2)
    bar.positions[:, 2] += 0.5
    bar.material = 1
    scene.meshes.append(bar)
    scene.materials.append(Material((100, 100, 100, 1), **UNLIT))
    scene.instances.append(Instance(1))
    have = draw(scene, filter="mitchell", samples=samples)
    assert have[..., :3].min() == np.float32(0.3)
    assert have[..., :3].max() == 100
    assert (have[..., 3] == 1).all()
    steps = np.sign(np.diff(have[12, :, 0]))
    assert (np.diff(steps[steps != 0]) <= 0).all()  # up, and down again: no ripples


def test_highlights_at_an_outline_leave_no_dark_pixels():
    """A bright wall before nothing: its colour stays what it is, however little of a pixel it covers."""
    scene = Scene.from_mesh(rectangle(8.3, 5.1, 19.6, 20.2), Material((100, 50, 25, 1), **UNLIT))
    have = draw(scene, filter="mitchell", ssaa=2)
    covered = have[..., 3] > 0
    assert (have[covered][:, 3] < 1).any()
    assert np.allclose(have[covered][:, :3] / have[covered][:, 3:], (100, 50, 25), rtol=1e-5)


def test_a_small_highlight_is_round():
    """A highlight of a pixel's size fades in all directions: none of its neighbours falls back to the wall."""
    colors = np.full((16, 16, 4, 4), 0.3, np.float32)
    colors[..., 3] = 1
    colors[8, 8, :, :3] = 50
    have = resolved(colors, "mitchell", PATTERNS["ssaa-2"], 16)[..., 0]
    assert np.allclose(have, have.T)
    assert have.min() == np.float32(0.3)
    assert have.argmax() == 8 * 16 + 8
    assert (have[7:10, 7:10] > 0.9).all()


def test_a_ramp_stays_a_ramp():
    """Where the range does not bind, the filter is what it is: it gives linear functions back."""
    pattern = PATTERNS["ssaa-2"]
    colors = np.empty((32, 32, 4, 4), np.float32)
    colors[...] = ((np.arange(32)[:, None] + pattern[:, 0] / 256) / 32)[None, :, :, None]
    linear = resolved(colors, "mitchell", pattern, 32)
    assert np.abs(linear - ((np.arange(32) + 0.5) / 32)[None, :, None])[:, 2:-2].max() < 4e-6


@pytest.mark.parametrize("name", WIDE)
def test_borders_weigh_only_what_is_in_the_picture(name):
    """A lit first column: at the left border the filter's weights over the columns that exist sum to one."""
    scene = Scene.from_mesh(rectangle(0, -5, 1, 50), Material((1, 1, 1, 1), **UNLIT))
    have = draw(scene, filter=name)[..., 0]
    columns = np.arange(SIZE[0])
    every = weight(name, np.subtract.outer(columns, columns))
    assert np.allclose(have, (every[:, 0] / every.sum(1))[None], atol=1e-6)


@pytest.mark.parametrize("name", WIDE)
def test_tiles_threads_and_bands_make_no_seams(name, monkeypatch):
    rng = np.random.default_rng(0)
    scene = Scene.from_mesh(flat_mesh(rng.uniform(-5, 38, (60, 2)), np.arange(60)), Material((1, 1, 1, 1), **UNLIT))
    want = draw(scene, filter=name, samples=4)
    assert want[..., 0].std() > 0.1
    for tile in (8, 16, 128):
        assert np.abs(draw(scene, filter=name, samples=4, tile=tile, threads=2) - want).max() < 1e-6
    monkeypatch.setattr(frame, "_BAND_BYTES", 1)
    assert np.abs(draw(scene, filter=name, samples=4, tile=8) - want).max() < 1e-6


@pytest.mark.parametrize("name", WIDE)
def test_windows_make_no_seams(name, monkeypatch):
    rng = np.random.default_rng(0)
    scene = Scene.from_mesh(flat_mesh(rng.uniform(-5, 38, (60, 2)), np.arange(60)), Material((1, 1, 1, 1), **UNLIT))
    want = draw(scene, filter=name, samples=4, tile=8)
    monkeypatch.setattr(frame, "_WINDOW", 16)
    assert np.abs(draw(scene, filter=name, samples=4, tile=8) - want).max() < 1e-6


def test_the_box_is_the_plain_average_of_the_samples():
    scene = Scene.from_mesh(rectangle(3.4, 2.7, 20.2, 19.9), Material((1, 1, 1, 1), **UNLIT))
    for name, pattern in PATTERNS.items():
        kind, _, count = name.partition("-")
        options = {"ssaa": int(count)} if kind == "ssaa" else {"samples": int(count), "pattern": kind}
        have = draw(scene, **options)[..., 3]
        x, y = (np.arange(side)[:, None] + pattern[:, axis] / 256 for axis, side in enumerate(SIZE))
        x0, y0, x1, y1 = np.round(np.array([3.4, 2.7, 20.2, 19.9]) * 256) / 256
        inside = ((y >= y0) & (y < y1))[:, None, :] & ((x >= x0) & (x < x1))[None, :, :]
        assert np.allclose(have, inside.mean(-1), atol=1e-6)


def test_unknown_filters_are_named():
    with pytest.raises(InputError, match=r"box, tent.*got 'lanczos'"):
        filter_taps("lanczos", PATTERNS["standard-1"])
    with pytest.raises(InputError, match="filter"):
        draw(Scene(), filter="bx")
