"""Coverage and depth against the slow oracle, in bytes, and the same bytes however the work is cut up."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from covering import PATTERNS, draw, random_triangles
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.raster.constants import GUARD_HIGH, GUARD_LOW
from luxel.raster.joint import WIDEST
from luxel.raster.reference import Plane, covers, reference_cover
from luxel.raster.setup import SMALL

ONE = PATTERNS["standard-1"]
SIZE = np.array([21, 17])  # pixels, odd: tiles at the right and lower borders are partly filled


def same(have, want):
    return all(np.array_equal(a.view(np.int32), b.view(np.int32)) for a, b in zip(have, want, strict=True))


def agree(corners, depths, pattern=ONE, size=SIZE, **how):
    width, height = (int(side) for side in size)
    have = draw(corners, depths, pattern, width, height, **how)
    assert same(have, reference_cover(corners, depths, pattern, width, height, how.get("cull", False)))
    return have[0]


def around(rng, count, radius):
    """Triangles whose corners lie up to `radius` (1/256 pixel) from a random place in the picture."""
    place = rng.integers(0, SIZE * 256, (count, 1, 2))
    return place + rng.integers(-radius, radius, (count, 3, 2), endpoint=True), rng.random((count, 3), np.float32)


# Against the oracle


@pytest.mark.parametrize("name", [name for name in PATTERNS if name != "ssaa-8"])
@pytest.mark.parametrize("cull", [False, True])
def test_random_triangles(name, cull):
    rng = np.random.default_rng(len(name))
    ids = agree(*random_triangles(rng, 40, -256 * 4, 256 * (SIZE + 4)), PATTERNS[name], cull=cull, tile=16)
    assert len(np.unique(ids)) > 10


@pytest.mark.parametrize("radius", [3, 40, 128, 256, 700])
def test_triangles_of_a_pixel_and_less(radius):
    rng = np.random.default_rng(radius)
    hit = 0
    for _ in range(6):
        hit += (agree(*around(rng, 300, radius)) >= 0).sum()
    agree(*around(rng, 200, radius), PATTERNS["standard-16"], tile=8)
    assert radius < 40 or hit > 0


@pytest.mark.parametrize("step", [256, 128, 64, 32, 16])
def test_corners_and_edges_on_samples(step):
    """Corners at multiples of a fraction of a pixel: every third sample lies on an edge or a corner."""
    rng = np.random.default_rng(step)
    on_edge = 0
    for pattern in (ONE, PATTERNS["standard-16"], PATTERNS["grid-4"]):
        for _ in range(4):
            corners, depths = random_triangles(rng, 12, 0, SIZE * 256 // step)
            corners = corners * step + (128 if step == 256 else 0)
            ids = agree(corners, depths, pattern)
            on_edge += (ids >= 0).sum()
    assert on_edge > 500


@pytest.mark.parametrize("axis", [0, 1])
def test_slivers(axis):
    """Triangles across the picture that are 1/256 of a pixel thin, or have corners on one line but for that."""
    rng = np.random.default_rng(axis)
    for length in (1 << 9, 1 << 13, 1 << 20):
        start = rng.integers(0, SIZE * 256, (60, 2))
        way = rng.integers(-length, length, (60, 2))
        middle = start + way * rng.integers(1, 8, (60, 1)) // 8
        middle[:, axis] += rng.integers(-1, 2, 60)
        corners = np.clip(np.stack([start, start + way, middle], 1), GUARD_LOW, GUARD_HIGH)
        agree(corners, rng.random((60, 3), np.float32))
        agree(corners, rng.random((60, 3), np.float32), PATTERNS["standard-4"], tile=8)


def test_at_the_guard_band():
    """Corners at the largest coordinates: edge functions of 2^51 must still be exact at the picture's samples."""
    rng = np.random.default_rng(5)
    limits = np.array([GUARD_LOW, GUARD_LOW + 1, GUARD_HIGH - 1, GUARD_HIGH, 0, 128, 21 * 256])
    visible = 0
    for _ in range(20):
        corners = rng.choice(limits, (12, 3, 2))
        corners[:4, 0] = rng.integers(0, SIZE * 256, (4, 2))  # some with a corner in the picture
        ids = agree(corners, rng.random((12, 3), np.float32), PATTERNS["standard-2"], tile=8)
        visible += len(np.unique(ids)) - 1
    assert visible > 40


def test_guard_band_from_the_farthest_pixels():
    """The lower right end of the largest window."""
    rng = np.random.default_rng(6)
    triangles = rng.choice([GUARD_LOW, GUARD_HIGH, 32760 * 256 + 77], (8, 3, 2))
    triangles[:, 0] = rng.integers(32764 * 256, 32768 * 256, (8, 2))
    depths = rng.random((8, 3), np.float32)
    width, height = 32768, 8
    corners = triangles - [0, 32760 * 256]  # as tall as wide would be too slow for the oracle: the end of a row, then of a column
    corners[..., 1] = np.clip(corners[..., 1], GUARD_LOW, GUARD_HIGH)
    ids, depth = draw(corners, depths, ONE, width, height)
    want_ids, want_depths = reference_cover(corners - [32760 * 256, 0], depths, ONE, 8, height)
    assert np.array_equal(ids[..., -8:], want_ids)
    assert same((depth[..., -8:].copy(),), (want_depths,))
    turned = corners[..., ::-1]
    ids, depth = draw(turned, depths, ONE, 8, width)
    want_ids, want_depths = reference_cover(turned - [0, 32760 * 256], depths, ONE, 8, 8)
    assert np.array_equal(ids[:, -8:], want_ids)
    assert same((depth[:, -8:].copy(),), (want_depths,))


def test_span_ends_that_are_nearly_whole():
    """Shallow edges whose 1 / a is rounded so that e / a falls just short of a whole pixel: one time in `a` it matters."""
    rng = np.random.default_rng(7)
    for a in (49, 98, 103, 107, 161, 187, 197):
        x = rng.integers(0, 5000, (a, 2))
        y = 128 - np.arange(a)
        for rest in (-3000, 3000):
            corners = np.stack([np.stack([x[:, 0], y], 1), np.stack([x[:, 1] + 9000, y + a], 1), np.stack([x[:, 0] + 4000, y + rest], 1)], 1)
            corners = np.concatenate([corners, corners * [-1, 1] + [60 * 256, 0]])
            depths = np.repeat(rng.permutation(len(corners)).astype(np.float32) / len(corners), 3).reshape(-1, 3)
            for part in np.array_split(np.arange(len(corners)), 8):
                agree(corners[part], depths[part], size=(60, 1))


@pytest.mark.parametrize("extra", [-1, 0, 1])
def test_on_both_sides_of_the_loops_limits(extra):
    """Boxes as wide and as high as the loops change at, and as high as can be."""
    rng = np.random.default_rng(extra + 1)
    tall, edge = GUARD_HIGH, SMALL * 256
    for wide, high in ((edge + extra, 15 * 256), (edge, edge + extra), (edge + extra, edge + extra), (edge, tall), (777, tall)):
        corners = rng.integers(0, [wide, high], (12, 3, 2), endpoint=True)
        corners[:, 0] = 0
        corners[:, 1] = wide, high
        corners[:6, :, 0] = wide - corners[:6, :, 0]
        corners[..., 1] -= rng.integers(0, max(1, high - 15 * 256), (12, 1))
        agree(corners + 60, rng.random((12, 3), np.float32), size=(41, 13), tile=32)
    for _ in range(20):  # edges as tall as can be
        corners = np.stack([rng.integers(0, SMALL * 256, (6, 3)), rng.choice([GUARD_LOW, GUARD_HIGH], (6, 3))], 2)
        agree(corners, rng.random((6, 3), np.float32), size=(33, 3))


@pytest.mark.parametrize("extra", [-1, 0, 1])
@pytest.mark.parametrize(("name", "tile"), [("standard-4", 64), ("grid-4", 32), ("standard-8", 64), ("standard-16", 16), ("standard-4", 128)])
def test_on_both_sides_of_the_limit_for_four_samples_at_once(name, tile, extra):
    """Boxes as wide and as high as are drawn at four samples at once, and the smallest that are, wherever they lie in a tile."""
    rng = np.random.default_rng(extra + 1)
    edge = WIDEST * 256
    for wide, high in ((edge + extra, 9 * 256), (700, edge + extra), (edge, edge + extra), (300 + extra, 280)):
        corners = rng.integers(0, [wide, high], (8, 3, 2), endpoint=True)
        corners[:, 0] = 0
        corners[:, 1] = wide, high
        corners[:4, :, 0] = wide - corners[:4, :, 0]
        corners += rng.integers(-edge // 2, [130 * 256 - edge // 2, 0], (8, 1, 2))
        corners[..., 1] += high // 3
        agree(corners, rng.random((8, 3), np.float32), PATTERNS[name], size=(101, 9), tile=tile)


def test_wide_and_tall_pictures():
    rng = np.random.default_rng(8)
    for size in ((1, 1), (1, 300), (300, 1), (129, 3), (3, 129), (64, 64), (65, 63)):
        corners, depths = random_triangles(rng, 12, -2000, np.array(size) * 256 + 2000)
        agree(corners, depths, PATTERNS["standard-2"] if min(size) > 1 else PATTERNS["standard-8"], size)


def test_supersampling_patterns_with_64_samples():
    rng = np.random.default_rng(9)
    agree(*around(rng, 60, 500), PATTERNS["ssaa-8"], tile=8)


coordinate = st.one_of(
    st.integers(-600, 21 * 256 + 600),
    st.integers(-4, 45).map(lambda k: 128 * k),
    st.integers(GUARD_LOW, GUARD_HIGH),
    st.sampled_from([GUARD_LOW, GUARD_HIGH]),
)
depth = st.one_of(st.floats(0, 1, width=32), st.sampled_from([np.float32(0), np.float32(0.5), np.float32(1)]))
triangle = st.tuples(st.tuples(*[st.tuples(coordinate, coordinate)] * 3), st.tuples(depth, depth, depth))


@settings(deadline=None, max_examples=150, derandomize=True)
@given(st.lists(triangle, min_size=1, max_size=6), st.sampled_from(sorted(set(PATTERNS) - {"ssaa-8", "ssaa-4", "standard-16"})), st.booleans())
def test_any_triangles(triangles, name, cull):
    corners, depths = np.array([t[0] for t in triangles]), np.array([t[1] for t in triangles], np.float32)
    agree(corners, depths, PATTERNS[name], (14, 11), cull=cull, tile=8)


# Ties, far plane, degenerate


def test_equal_depths_go_to_the_lower_id():
    rng = np.random.default_rng(10)
    corners, _ = random_triangles(rng, 30, 0, SIZE * 256)
    ids = agree(corners, np.full((30, 3), 0.25, np.float32), PATTERNS["standard-4"])
    again = agree(np.concatenate([corners, corners]), np.full((60, 3), 0.25, np.float32), PATTERNS["standard-4"])
    assert np.array_equal(ids, again)


def test_depths_of_zero_and_one_are_drawn():
    corners = np.array([[[0, 0], [0, 5000], [5000, 0]]])
    for depth in (0.0, 1.0):
        assert (agree(corners, np.full((1, 3), depth, np.float32)) == 0).any()


def test_triangles_without_area_cover_nothing():
    lines = [[0, 0], [2560, 2560], [1280, 1280]], [[128, 0], [128, 9999], [128, 640]], [[0, 128], [900, 128], [0, 128]]
    corners = np.array([*lines, [[128, 128]] * 3])
    for pattern in PATTERNS.values():
        assert (draw(corners, np.ones((4, 3), np.float32), pattern, 21, 17)[0] == -1).all()


def test_top_and_left_edges_own_their_samples():
    """A square of two pixels by two between pixel centres: of the nine centres on it, the four at the top left."""
    a, b, c, d = (128, 128), (128, 640), (640, 640), (640, 128)
    for square in ([(a, b, c), (a, c, d)], [(a, b, d), (b, c, d)], [(c, b, a), (a, d, c)]):
        ids = draw(np.array(square), np.ones((2, 3), np.float32), ONE, 4, 4)[0][0]
        assert np.array_equal(ids >= 0, np.pad(np.ones((2, 2), bool), (0, 2)))


def test_oracle_knows_the_rule():
    """The oracle itself: a diamond around a pixel centre, whose top left edges belong to it, and what surrounds it."""
    assert covers([(0, 0), (0, 512), (512, 0)], (128, 128))
    assert covers([(128, 128), (0, 512), (512, 512)], (128, 128)) is False  # a corner between a left and a right edge
    assert covers([(128, 128), (128, 512), (512, 128)], (128, 128))  # between a left and a top edge
    assert not covers([(0, 256), (256, 0), (256, 256)][::-1], (256, 100))  # on a right edge
    assert covers([(0, 256), (256, 0), (256, 256)], (128, 128))  # on a left edge
    assert not covers([(0, 256), (256, 0), (0, 0)], (128, 128))  # on the same edge from the other side


# The same bytes, however the work is cut up


def many(count=3000, size=(200, 150)):
    rng = np.random.default_rng(11)
    small, depths = around(rng, count, 1500)
    small = small * (np.array(size) // SIZE)
    large, more = random_triangles(rng, 60, -9999, np.array(size) * 256 + 9999)
    return np.concatenate([small, large]), np.concatenate([depths, more])


@pytest.mark.parametrize("name", ["standard-1", "standard-8", "ssaa-3"])
def test_any_tile_and_any_threads(name):
    corners, depths = many()
    want = draw(corners, depths, PATTERNS[name], 200, 150)
    assert len(np.unique(want[0])) > 200
    for tile in (8, 16, 32, 64, 128):
        for threads in (1, 2, 3):
            assert same(draw(corners, depths, PATTERNS[name], 200, 150, tile, threads), want)


@pytest.mark.parametrize("name", ["standard-1", "standard-4"])
def test_any_order(name):
    corners, depths = many()
    ids, nearest = draw(corners, depths, PATTERNS[name], 200, 150)
    for seed in range(4):
        order = np.random.default_rng(seed).permutation(len(corners))
        other, depth = draw(corners[order], depths[order], PATTERNS[name], 200, 150, tile=32, threads=2)
        assert np.array_equal(depth.view(np.int32), nearest.view(np.int32))
        back = np.append(order, -1)[other]
        differ = back != ids
        assert differ.mean() < 1e-3  # only where two triangles share a depth exactly
        assert all(equally_near(corners, depths, PATTERNS[name], at, back[at], ids[at]) for at in zip(*np.nonzero(differ), strict=True))


def equally_near(corners, depths, pattern, at, one, other):
    place = at[2] * 256 + int(pattern[at[0], 0]), at[1] * 256 + int(pattern[at[0], 1])
    planes = [Plane(corners[t].tolist(), depths[t]) for t in (one, other)]
    return planes[0].at(place) == planes[1].at(place)


@pytest.mark.parametrize("corner", [0, 1, 2])
def test_coverage_does_not_depend_on_the_first_corner_or_the_winding(corner):
    corners, _ = many(800)
    depths = np.repeat(np.random.default_rng(3).permutation(len(corners)).astype(np.float32) / len(corners), 3).reshape(-1, 3)
    want = draw(corners, depths, PATTERNS["standard-4"], 200, 150)
    turned = np.roll(corners, corner, 1)
    assert same(draw(turned, depths, PATTERNS["standard-4"], 200, 150), want)
    assert same(draw(turned[:, ::-1], depths, PATTERNS["standard-4"], 200, 150), want)


# The arithmetic in plain Python


def test_without_compiled_kernels():
    code = (
        "import numpy as np; from covering import PATTERNS, draw, random_triangles; from luxel import jit; assert jit.DISABLED;"
        "from luxel.raster.reference import reference_cover; rng = np.random.default_rng(2);"
        "corners, depths = random_triangles(rng, 25, -500, [14 * 256, 9 * 256]);"
        "wide = random_triangles(rng, 10, -40000, 40000); corners = np.concatenate([corners, wide[0]]); depths = np.concatenate([depths, wide[1]]);\n"
        "for name in ('standard-1', 'standard-4', 'ssaa-3'):\n"
        "    have = draw(corners, depths, PATTERNS[name], 13, 9, tile=8, threads=2)\n"
        "    want = reference_cover(corners, depths, PATTERNS[name], 13, 9)\n"
        "    print(all(np.array_equal(a.view(np.int32), b.view(np.int32)) for a, b in zip(have, want)), len(np.unique(have[0])))\n"
    )
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.split("\n")[:3]
    assert all(line.startswith("True") and int(line.split()[1]) > 5 for line in lines), done.stdout
