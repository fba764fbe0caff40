"""Scan conversion over blocks: luxel's coverage, every fragment once and in order, edge functions exact."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.hardware.scan import BLOCK, blocks, edges, scan
from luxel.raster.bin import NO_CLIPPED, OPAQUE, Parts, bin_triangles
from luxel.raster.constants import GUARD_HIGH, GUARD_LOW, sample_pattern
from luxel.raster.cover import cover
from luxel.raster.lanes import LANES
from luxel.raster.project import Window
from luxel.raster.reference import covers, cross

WIDTH, HEIGHT = 29, 27  # no multiples of a block
COORDINATE = st.integers(-5 * 256, 34 * 256) | st.sampled_from([128 + 256 * k for k in range(-3, 32)])
CORNERS = st.lists(st.tuples(COORDINATE, COORDINATE), min_size=3, max_size=3)


def drawn(corners):
    """(height, width) bool, of a triangle, by the rasteriser's kernels."""
    screen = np.zeros((3, 4), np.int32)
    screen[:, :2] = corners
    screen.view(np.float32)[:, 2] = 0.5
    triangles = np.array([[0, 1, 2]], np.int32)
    parts = Parts(np.array([0, 1], np.int32), np.array([OPAQUE], np.int32), np.array([False], np.int32))
    window = Window(0, 0, WIDTH, HEIGHT, WIDTH, HEIGHT)
    bins = bin_triangles(triangles, screen, NO_CLIPPED, parts, OPAQUE, sample_pattern(1), window, 64, 1)
    ids, depths = np.empty((1, 64 * 64 + LANES), np.int32), np.empty((1, 64 * 64 + LANES), np.float32)
    cover(bins, triangles, screen, NO_CLIPPED, sample_pattern(1), WIDTH, HEIGHT, 0, 1, ids, depths, 1, True)
    return ids[0, : 64 * 64].reshape(64, 64)[:HEIGHT, :WIDTH] >= 0


def mask(x, y):
    found = np.zeros((HEIGHT, WIDTH), int)
    np.add.at(found, (y, x), 1)
    return found


@given(CORNERS)
@settings(deadline=None)
def test_coverage_is_the_rasterisers(corners):
    found = scan(np.array(corners), WIDTH, HEIGHT)
    assert np.array_equal(mask(found.x, found.y), drawn(corners))


def test_coverage_is_the_rasterisers_for_many_triangles():
    rng = np.random.default_rng(3)
    for low, high in ((-2000, 9000), (1000, 1600), (-(1 << 18), 1 << 18)):
        for corners in rng.integers(low, high, (150, 3, 2)):
            found = scan(corners, WIDTH, HEIGHT)
            assert np.array_equal(mask(found.x, found.y), drawn(corners))


@given(CORNERS)
@settings(deadline=None)
def test_order_and_edge_functions(corners):
    found = scan(np.array(corners), WIDTH, HEIGHT)
    place = list(zip((found.y // BLOCK).tolist(), (found.x // BLOCK).tolist(), found.y.tolist(), found.x.tolist(), strict=True))
    assert place == sorted(set(place))
    a, b, c = corners
    sign = 1 if cross(a, b, c) > 0 else -1
    for x, y, values in zip(found.x.tolist(), found.y.tolist(), found.edges.tolist(), strict=True):
        p = 256 * x + 128, 256 * y + 128
        assert covers(corners, p)
        assert values == [sign * cross(b, c, p), sign * cross(c, a, p), sign * cross(a, b, p)]
        assert min(values) >= 0
        assert sum(values) == abs(cross(a, b, c)) == edges(np.array(corners)).area


@given(CORNERS)
@settings(deadline=None)
def test_blocks_are_rejected_and_accepted_rightly(corners):
    tried = blocks(np.array(corners), WIDTH, HEIGHT)
    whole = scan(np.array(corners), 8 * BLOCK, 8 * BLOCK)
    count = np.zeros((8, 8), int)
    np.add.at(count, (whole.y // BLOCK, whole.x // BLOCK), 1)
    seen = set()
    for x, y, rejected, accepted in zip(*(part.tolist() for part in tried), strict=True):
        seen.add((x, y))
        assert not (rejected and count[y, x])
        assert accepted == (count[y, x] == BLOCK * BLOCK)
    held = {(int(x), int(y)) for y, x in zip(*np.nonzero(count), strict=True) if x * BLOCK < WIDTH and y * BLOCK < HEIGHT}
    assert held <= seen


def test_two_triangles_share_an_edge_without_gap_or_overlap():
    rng = np.random.default_rng(4)
    for _ in range(300):
        a, b, c, d = rng.integers(-500, 8000, (4, 2))
        if (cross(a, b, c) > 0) == (cross(a, b, d) > 0):
            continue
        both = [scan(np.array(t), WIDTH, HEIGHT) for t in ([a, b, c], [b, a, d])]
        assert mask(np.concatenate([f.x for f in both]), np.concatenate([f.y for f in both])).max(initial=0) <= 1


def test_degenerate_and_distant_triangles_have_no_fragments():
    for corners in ([[0, 0], [2560, 2560], [5120, 5120]], [[5, 5]] * 3, [[-900, 0], [-100, 50], [-500, 800]], [[0, 9000], [99, 9000], [0, 9900]]):
        found = scan(np.array(corners), WIDTH, HEIGHT)
        assert len(found.x) == len(found.y) == len(found.edges) == 0
    assert len(blocks(np.array([[0, 0], [2560, 2560], [5120, 5120]]), WIDTH, HEIGHT).x) == 0


def test_the_whole_guard_band_is_exact():
    corners = np.array([[GUARD_LOW, GUARD_LOW], [GUARD_HIGH, GUARD_LOW + 1], [GUARD_LOW, GUARD_HIGH]])
    e = edges(corners)
    a, b, c = corners.tolist()
    assert int(e.area) == abs(cross(a, b, c))
    for x, y in ((128, 128), (GUARD_HIGH, GUARD_LOW), (GUARD_LOW, GUARD_HIGH)):
        sign = 1 if e.flipped else -1  # seen from behind, corners go clockwise where y points up, and not where it points down
        assert e.at(np.array(x), np.array(y)).tolist() == [sign * cross(p, q, (x, y)) for p, q in ((b, c), (c, a), (a, b))]


def test_a_large_triangle():
    found = scan(np.array([[0, 0], [2 * 700 * 256, 0], [0, 2 * 700 * 256]]), 700, 700)
    assert len(found.x) == 700 * 700
    assert (np.diff(found.y // BLOCK * 10**6 + found.x // BLOCK) >= 0).all()


def test_what_is_refused():
    with pytest.raises(InputError, match="corners: expected"):
        scan(np.zeros((2, 3, 2), int), 9, 9)
    with pytest.raises(InputError, match=r"expected -8388608 \.\. 16777216"):
        edges(np.array([[0, 0], [1 << 25, 0], [0, 5]]))
    with pytest.raises(InputError, match="corners: expected"):
        edges(np.zeros((3, 3), int))
    with pytest.raises(InputError, match="corners: expected"):
        edges(np.zeros((3, 2)))
