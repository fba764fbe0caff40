"""Binning: every tile's list holds what may touch it, in order, whatever the chunks."""

import numpy as np
import pytest
from covering import PATTERNS, screen_of
from pipeline import drawn, view_of

from luxel.raster.bin import BLEND, MASK, NO_CLIPPED, OPAQUE, Clipped, Parts, bin_triangles
from luxel.raster.clip import clip
from luxel.raster.project import Window, project
from luxel.raster.reference import samples_of
from luxel.scene.camera import Camera

SIZE = 75, 41
ONE = PATTERNS["standard-1"]


def everything(count, mode=OPAQUE, cull=False):
    return Parts(np.array([0, count], np.int32), np.array([mode], np.int32), np.array([cull], np.int32))


def bins_of(corners, pattern=ONE, tile=16, threads=1, parts=None, mode=OPAQUE, clipped=NO_CLIPPED):
    triangles, screen = screen_of(corners, np.ones((len(corners), 3), np.float32))
    return bin_triangles(triangles, screen, clipped, parts or everything(len(corners)), mode, pattern, Window(0, 0, *SIZE, *SIZE), tile, threads)


def lists(bins):
    return [bins.triangles[a:b].tolist() for a, b in zip(bins.start[:-1], bins.start[1:], strict=True)]


def some(count=300, spread=1500, seed=0):
    rng = np.random.default_rng(seed)
    return rng.integers(-500, np.array(SIZE) * 256 + 500, (count, 1, 2)) + rng.integers(-spread, spread, (count, 3, 2))


@pytest.mark.parametrize("name", ["standard-1", "standard-4", "standard-16"])
@pytest.mark.parametrize("tile", [8, 16, 64])
def test_a_tile_lists_all_triangles_with_a_sample_in_it(name, tile):
    corners = some(120)
    bins = bins_of(corners, PATTERNS[name], tile)
    have = lists(bins)
    assert (bins.across, bins.down) == (-(-SIZE[0] // tile), -(-SIZE[1] // tile))
    assert len(have) == bins.across * bins.down
    for t, triangle in enumerate(corners.tolist()):
        for _, y, x in samples_of(triangle, PATTERNS[name], *SIZE):
            assert t in have[y // tile * bins.across + x // tile]
    assert all(sorted(set(ids)) == ids for ids in have)


def touches(triangle, tile, bins):
    low, high = triangle.min(0) / 256, triangle.max(0) / 256
    corner = np.array([tile % bins.across, tile // bins.across]) * bins.tile
    return (high >= corner).all() and (low <= corner + bins.tile).all()


def test_a_tile_lists_only_triangles_whose_box_overlaps_it():
    corners = some(400)
    bins = bins_of(corners, tile=8)
    assert all(touches(corners[t], k, bins) for k, ids in enumerate(lists(bins)) for t in ids)


@pytest.mark.parametrize("count", [1, 1023, 1024, 1025, 9000])
def test_threads_and_chunks_change_nothing(count):
    corners = some(count)
    want = bins_of(corners)
    for threads in (2, 3, 7):
        have = bins_of(corners, threads=threads)
        assert np.array_equal(have.start, want.start)
        assert np.array_equal(have.triangles, want.triangles)


def test_parts_are_told_apart_by_mode_and_culling():
    corners = some(3000)
    starts = np.array([0, 10, 11, 1400, 2999, 3000], np.int32)
    modes, culls = np.array([OPAQUE, BLEND, MASK, BLEND, OPAQUE], np.int32), np.array([0, 1, 1, 0, 1], np.int32)
    part = np.repeat(np.arange(5), np.diff(starts))
    (x0, y0), (x1, y1), (x2, y2) = np.moveaxis(corners, 0, -1)
    area = (x2 - x0) * (y1 - y0) - (x1 - x0) * (y2 - y0)
    shown = set(bins_of(corners).triangles.tolist())
    for mode in (OPAQUE, MASK, BLEND):
        for threads in (1, 2):
            have = set(bins_of(corners, parts=Parts(starts, modes, culls), mode=mode, threads=threads).triangles.tolist())
            kept = (modes[part] == mode) & ((area > 0) | ((culls[part] == 0) & (area < 0)))
            assert have == shown & set(np.nonzero(kept)[0].tolist())


@pytest.mark.parametrize("threads", [1, 3])
def test_clipped_pieces_take_the_place_of_their_source(threads):
    rng = np.random.default_rng(3)
    positions = rng.normal(size=(9000, 3)).astype(np.float32)
    triangles = np.arange(9000, dtype=np.int32).reshape(-1, 3)
    camera = Camera.look_at([0, 0, 0], [0, 0, -1], near=0.2)
    view, window = view_of(camera, SIZE), Window(0, 0, *SIZE, *SIZE)
    screen, _ = project(positions, view, window, 1)
    clipped = clip(positions, triangles, screen, view, window, 1)
    bins = bin_triangles(triangles, screen, clipped, everything(3000), OPAQUE, ONE, window, 16, threads)
    source = np.append(np.arange(3000), clipped.source)
    found = drawn(positions, triangles, camera, SIZE)
    assert set(source[bins.triangles]) <= set(found.source)
    assert (bins.triangles >= 3000).any()
    for ids in lists(bins):
        assert (np.diff(source[ids]) >= 0).all()
        assert len(set(ids)) == len(ids)
    alone = lists(bins_of(found.corners))
    names = [int(t) for t in found.source[: len(found.source) - len(clipped.source)]] + [3000 + k for k in range(len(clipped.source))]
    assert [sorted(names[t] for t in ids) for ids in alone] == [sorted(ids) for ids in lists(bins)]


def test_nothing_to_bin():
    empty = Clipped(*(array.copy() for array in NO_CLIPPED))
    nothing = Parts(np.zeros(1, np.int32), np.zeros(0, np.int32), np.zeros(0, np.int32))
    bins = bins_of(np.zeros((0, 3, 2), np.int64), parts=nothing, clipped=empty, threads=2)
    assert bins.start.tolist() == [0] * (bins.across * bins.down + 1)
    assert len(bins.triangles) == 0
