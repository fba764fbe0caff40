"""Every order is the same mesh in another order; the costs are the papers'; auto is never worse than what it tried."""

import numpy as np
import pytest
import troublesome as made
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.layout import ORDERS, acmr, batch, order
from luxel.layout.adjacency import adjacency, bounded
from luxel.layout.greedy import LEFT_CELLS, OPEN_CELLS, cost_table
from luxel.layout.risk import risk_table

NO_POSITIONS = [name for name in ORDERS if name != "morton"]


def check(triangles, name, **options):
    """Order and see that it is a permutation of the triangles, each turned at most, and that the misses it states are those it has."""
    ordered = order(triangles, order=name, **options)
    assert sorted(ordered.source.tolist()) == list(range(len(triangles)))
    assert (made.canonical(ordered.triangles) == made.canonical(triangles[ordered.source])).all()
    assert (ordered.triangles.dtype, ordered.source.dtype) == (np.int32, np.int32)
    return ordered


@pytest.mark.parametrize("name", NO_POSITIONS)
@pytest.mark.parametrize("mesh", made.NAMED)
def test_it_is_the_same_mesh(name, mesh):
    check(made.NAMED[mesh], name)


@pytest.mark.parametrize("name", NO_POSITIONS)
@settings(max_examples=60, deadline=None)
@given(triangles=made.soups(), cache=st.sampled_from([3, 4, 12, 40, 10**12]))
def test_it_is_the_same_mesh_whatever_the_triangles_are(name, triangles, cache):
    ordered = check(triangles, name, cache=cache)
    assert ordered.acmr == acmr(ordered.triangles, cache)


@settings(max_examples=60, deadline=None)
@given(made.soups(), st.integers(3, 20), st.integers(1, 9), st.integers(1, 20))
def test_look_ahead_of_any_width_and_depth(triangles, cache, width, depth):
    check(triangles, "look-ahead", cache=cache, width=width, depth=depth)


@settings(max_examples=60, deadline=None)
@given(made.soups(), st.sampled_from([None, *batch.MODELS]), st.sampled_from(["fifo", "lru"]), st.integers(3, 20))
def test_auto_is_no_worse_than_the_input_nor_anything_it_tried(triangles, profile, policy, cache):
    best = check(triangles, "auto", profile=profile, policy=policy, cache=cache)
    given_ = batch.reuse(triangles, profile).acmr if profile else acmr(triangles, cache, policy)
    assert best.acmr <= given_
    assert best.acmr == min(trial.acmr for trial in best.trials)
    assert {"file", "greedy", "look-ahead"} <= {trial.order for trial in best.trials}


def test_orders_rank_as_they_should():
    mesh = made.shuffled(made.grid(60, 60))
    ranks = [order(mesh, order=name).acmr for name in ("random", "tipsify", "greedy", "look-ahead")]
    assert ranks == sorted(ranks, reverse=True)
    assert order(mesh, order="greedy").acmr < 0.64
    assert order(mesh, order="look-ahead", width=16).acmr < 0.60
    assert order(mesh, order="forsyth").acmr < 0.75


def test_a_wider_look_ahead_is_better_on_average():
    widths = [np.mean([order(made.shuffled(made.grid(40, 40), seed), order="look-ahead", width=w).acmr for seed in range(3)]) for w in (1, 4, 16)]
    assert widths == sorted(widths, reverse=True)


@settings(max_examples=60, deadline=None)
@given(made.soups(), st.sampled_from(["amd", "nvidia", batch.Model(3, 3, 1), batch.Model(32, 5, 9)]))
def test_patches_for_any_batches(triangles, model):
    check(triangles, "patches", profile=model)


def test_patches_suit_batches_of_few_triangles():
    mesh = made.shuffled(made.grid(60, 60))
    of = {name: batch.reuse(order(mesh, order=name, profile="nvidia").triangles, "nvidia").atvr for name in ("tipsify", "patches")}
    assert of["patches"] < of["tipsify"]
    least = 25 * (3600 * 2 / 32) / 61**2  # a round patch of 32 triangles has about 25 vertices
    assert least < of["patches"] < 1.15 * least


def test_a_larger_cache_misses_less():
    mesh = made.shuffled(made.grid(60, 60))
    for name in ("greedy", "look-ahead", "tipsify"):
        ratios = [order(mesh, order=name, cache=k).acmr for k in (6, 12, 24, 64, 500)]
        assert ratios == sorted(ratios, reverse=True)


def test_morton_follows_the_curve():
    columns, rows = np.meshgrid(np.arange(8), np.arange(8))
    corner = np.stack([columns.ravel(), rows.ravel()], 1)
    positions = np.concatenate([np.c_[corner + shift, np.zeros(64)] for shift in ([0, 0], [0.5, 0], [0, 0.5])])
    triangles = np.arange(64)[:, None] + np.array([0, 64, 128])
    ordered = check(triangles, "morton", positions=positions)
    visited = corner[ordered.source]
    assert (visited[:4] == [[0, 0], [1, 0], [0, 1], [1, 1]]).all()
    assert (visited[:16] < 4).all()
    assert (visited[:32, 1] < 4).all()


def test_the_papers_example():
    """(C1, C2) of four candidates, and both costs without C3: figures of the paper."""
    pairs = ((1, 2), (1, 1), (2, 1), (3, 3))
    table = cost_table("greedy-2016", (1.0, 0.5, 0.0), 12)
    improved = [table[0, c1 + c2 - 1, c2 - 1] for c1, c2 in pairs]
    assert improved == pytest.approx([1.75, 2.5, 4.5, 4 + 1 / 6], rel=1e-6)
    assert [cost - c1 / c2 for cost, (c1, c2) in zip(improved, pairs, strict=True)] == pytest.approx([1.25, 1.5, 2.5, 3 + 1 / 6], rel=1e-6)
    assert improved[3] < improved[2]


def test_c3_prefers_the_old_that_survive():
    table = cost_table("lin-yu", (0.0, 0.0, 1.0, 5.0), 12)
    one_load = table[:, 2, 1]  # two triangles, both of which need the same vertex: C1 is 1
    assert (np.diff(one_load[:12]) < 0).all()
    two_loads = table[:, 3, 1]
    assert two_loads[10] == pytest.approx(0)
    assert two_loads[11] == 5


def test_weights_change_the_order():
    mesh = made.shuffled(made.grid(30, 30))
    for name in ("lin-yu", "greedy-2016"):
        assert (order(mesh, order=name).source != order(mesh, order=name, weights=(1, 0.5, 0)).source).any()


@pytest.mark.parametrize("cache", [3, 8, 12, 100])
def test_the_risk_is_a_chance_that_grows_with_age(cache):
    risk = risk_table(cache)
    assert risk.shape == (cache, OPEN_CELLS, LEFT_CELLS)
    assert ((risk >= 0) & (risk <= 1)).all()
    assert (np.diff(risk[:, 3, 1]) >= 0).all()
    assert risk[cache - 1, 1, 0] == 1


def test_parts_and_threads_change_no_byte(monkeypatch):
    from luxel.layout import partition

    mesh = made.shuffled(made.grid(80, 80))
    whole = order(mesh, order="look-ahead")
    monkeypatch.setattr(partition, "PART", 3000)
    told = []
    one = check(mesh, "look-ahead", threads=1, progress=lambda done, count: told.append((done, count)))
    two = check(mesh, "look-ahead", threads=2)
    assert (one.source == two.source).all()
    assert (one.triangles == two.triangles).all()
    assert [done for done, _ in told] == sorted({done for done, _ in told})
    assert told[-1] == (len(mesh), len(mesh))
    assert whole.acmr < one.acmr < 1.06 * whole.acmr


def test_the_cache_carries_over_a_seam(monkeypatch):
    from luxel.layout import partition

    ribbon = made.grid(1, 4000)
    whole = order(ribbon, order="greedy")
    monkeypatch.setattr(partition, "PART", 1000)
    parts = check(ribbon, "greedy")
    assert parts.acmr == whole.acmr == 8002 / 8000  # every vertex once


def test_seams_are_drawn_again(monkeypatch):
    from luxel.layout import partition, reorder

    strip = made.grid(5, 2000)
    monkeypatch.setattr(partition, "PART", 300)
    joined = check(strip, "greedy").acmr
    monkeypatch.setattr(reorder, "join", lambda *arguments: None)
    assert joined < 0.99 * order(strip, order="greedy").acmr


@settings(max_examples=30, deadline=None)
@given(made.soups(), st.integers(2, 40), st.integers(3, 20))
def test_seams_are_never_worse_than_before(triangles, size, cache):
    from luxel.layout.gather import gather
    from luxel.layout.seams import join

    n, source = int(triangles.max()) + 1, np.random.default_rng(size).permutation(len(triangles)).astype(np.int32)
    before = gather(triangles, source, n, cache)[1]
    join(triangles, source, size, cache, cost_table("greedy", None, cache))
    assert sorted(source.tolist()) == list(range(len(triangles)))
    assert gather(triangles, source, n, cache)[1] <= before


@settings(max_examples=60, deadline=None)
@given(made.soups(), st.integers(1, 30))
def test_regions_hold_every_triangle_once(triangles, size):
    from luxel.layout.partition import Regions

    regions = Regions(triangles, adjacency(triangles, int(triangles.max()) + 1), size)
    members = [regions.members(k).tolist() for k in range(regions.count)]
    assert sorted(t for part in members for t in part) == list(range(len(triangles)))
    assert {len(part) for part in members[:-1]} <= {size}


def test_part_sizes_make_an_even_number_of_parts():
    from luxel.layout.partition import part_size

    for count in (1, 999, 1000, 1001, 5000, 871414):
        parts = -(-count // part_size(count, 1000))
        assert part_size(count, 1000) <= 1000 or count <= 1000
        assert parts == 1 or parts % 2 == 0


@settings(max_examples=60, deadline=None)
@given(made.soups(), st.integers(1, 5))
def test_hubs_are_cut_into_vertices_that_are_none(triangles, most):
    n = int(triangles.max()) + 1
    rows = adjacency(triangles, n)
    cut, cut_rows = bounded(triangles, rows, most)
    assert np.diff(cut_rows.start).max() <= max(most, 3)
    assert ((cut == triangles) | (cut >= n)).all()


def test_adjacency_lists_the_triangles_of_a_vertex():
    triangles = np.array([[0, 1, 2], [2, 1, 3], [3, 3, 0]], np.int32)
    start, rows = adjacency(triangles, 5)
    assert [rows[start[v] : start[v + 1]].tolist() for v in range(5)] == [[0, 2], [0, 1], [0, 1], [1, 2, 2], []]


def test_adjacency_by_threads_is_the_same():
    mesh = made.shuffled(made.grid(350, 300))
    assert len(mesh) > 200_000
    for one, two in zip(adjacency(mesh, 351 * 301), adjacency(mesh, 351 * 301, threads=2), strict=True):
        assert (one == two).all()


def test_seconds_widen_the_search():
    mesh = made.shuffled(made.grid(40, 40))
    order(mesh)
    short, long = order(mesh, seconds=1e-9), order(mesh, seconds=30)
    assert [trial.order for trial in short.trials] == ["file", "greedy"]
    assert long.acmr < short.acmr


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"triangles": np.zeros((0, 3), np.int32)}, "expected at least one triangle to order, got none"),
        ({"triangles": [[0, 1, 7]], "vertex_count": 7}, "triangle 0 names vertex 7 of a mesh with 7 vertices"),
        ({"triangles": [[0, 1, -1]]}, "names vertex -1"),
        ({"triangles": np.broadcast_to(np.int32(0), (1 << 30, 3))}, "fewer than 2\\^31 indices"),
        ({"cache": 2}, "cache: expected a whole number of at least 3, got 2"),
        ({"order": "best"}, "order: expected one of file, .*auto, got 'best'"),
        ({"policy": "mru"}, "policy: expected one of fifo, lru, got 'mru'"),
        ({"profile": "voodoo"}, "profile: expected one of nvidia, amd, intel, mobile, got 'voodoo'"),
        ({"order": "morton"}, "positions: expected \\(n, 3\\)"),
        ({"order": "morton", "positions": [[0, 0, 0], [1, 0, 0], [0, np.nan, 0]]}, "expected finite numbers, got .* at vertex 2"),
        ({"order": "morton", "positions": [[0, 0, 0]]}, "positions: expected \\(3, 3\\)"),
        ({"weights": (1, 2)}, "weights: expected k1, k2, k3"),
        ({"weights": (1, 2, np.inf)}, "weights: expected k1, k2, k3"),
        ({"width": 0}, "width: expected a whole number of at least 1, got 0"),
        ({"depth": 1.5}, "depth: expected a whole number"),
        ({"seconds": -1}, "seconds: expected a number above 0, got -1"),
        ({"threads": 0}, "threads"),
        ({"vertex_count": 1 << 31}, "vertex_count: expected fewer than 2\\^31"),
    ],
)
def test_bad_input_is_named(arguments, match):
    with pytest.raises(InputError, match=match):
        order(**({"triangles": [[0, 1, 2]]} | arguments))
