"""Simulators: equal, digit for digit, to an explicit queue and to meshoptimizer's analyser."""

import meshopt_peer as peer
import numpy as np
import pytest
import troublesome as made
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.layout import acmr, atvr, batch, misses

needs_peer = pytest.mark.skipif(peer.LIBRARY is None, reason="meshoptimizer is not installed")


@settings(deadline=None)  # the first example compiles
@given(made.soups(), st.integers(3, 50), st.sampled_from(["fifo", "lru"]))
def test_misses_are_those_of_a_queue(triangles, cache, policy):
    assert misses(triangles, cache, policy).tolist() == made.queue_misses(triangles, cache, policy)


@settings(deadline=None)
@given(made.soups(), st.integers(3, 40), st.sampled_from([0, 3, 5, 32]), st.sampled_from([0, 1, 7, 32]))
def test_batches_are_those_of_a_queue_that_is_emptied(triangles, cache, warp, group):
    model = batch.Model(cache, warp, group)
    missed, batches = made.queue_batches(triangles, cache, warp, group)
    reuse = batch.reuse(triangles, model)
    assert batch.misses(triangles, model).tolist() == missed
    assert (reuse.transformed, reuse.batches) == (sum(missed), batches)


@needs_peer
@settings(deadline=None)
@given(made.soups(), st.integers(3, 40), st.sampled_from([0, 3, 32, 64]), st.sampled_from([0, 1, 32, 128]))
def test_models_equal_meshoptimizer(triangles, cache, warp, group):
    n = int(triangles.max()) + 1
    theirs, ours = peer.analyze_cache(triangles, n, cache, warp, group), batch.reuse(triangles, batch.Model(cache, warp, group), n)
    assert (theirs.transformed, theirs.warps) == (ours.transformed, ours.batches)
    assert (theirs.acmr, theirs.atvr) == (np.float32(ours.acmr), np.float32(ours.atvr))


@needs_peer
@pytest.mark.parametrize("name", batch.MODELS)
def test_named_models_equal_meshoptimizer_on_a_mesh(name):
    triangles, model = made.shuffled(made.grid(60, 60)), batch.MODELS[name]
    theirs, ours = peer.analyze_cache(triangles, 3721, *model), batch.reuse(triangles, name)
    assert (theirs.transformed, theirs.warps) == (ours.transformed, ours.batches)


@needs_peer
@pytest.mark.parametrize("cache", [3, 12, 16, 24, 32, 1000])
def test_fifo_equals_meshoptimizer_on_a_mesh(cache):
    triangles = made.shuffled(made.grid(50, 70))
    assert np.float32(acmr(triangles, cache)) == peer.analyze_cache(triangles, 51 * 71, cache).acmr
    assert np.float32(atvr(triangles, cache)) == peer.analyze_cache(triangles, 51 * 71, cache).atvr


def test_the_first_miss_can_push_out_the_third_vertex():
    before = [[0, 1, 2]]
    assert misses([*before, [3, 1, 0]], 3).tolist() == [3, 2]
    assert misses([*before, [1, 0, 3]], 3).tolist() == [3, 1]


def test_a_hit_refreshes_an_lru_but_no_fifo():
    triangles = [[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 5]]
    assert misses(triangles, 4, "lru").tolist() == [3, 1, 1, 1]
    assert misses(triangles, 4, "fifo").tolist() == [3, 1, 1, 3]


def test_ratios_have_the_limits_they_state():
    apart = made.pieces(50)
    assert (acmr(apart), atvr(apart)) == (3, 1)
    assert acmr(made.grid(40, 40), 10**6) == 41 * 41 / 3200
    assert atvr(made.grid(40, 40), 10**6) == 1


def test_no_triangles_have_no_misses_and_no_ratio():
    assert misses(np.zeros((0, 3), np.int32)).shape == (0,)
    for ratio in (acmr, atvr):
        with pytest.raises(InputError, match="at least one triangle"):
            ratio(np.zeros((0, 3), np.int32))


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (([[0, 1, 2]], 2), "cache: expected a whole number of at least 3, got 2"),
        (([[0, 1, 2]], 12.5), "cache: expected a whole number"),
        (([[0, 1, 2]], 12, "mru"), "policy: expected one of fifo, lru, got 'mru'"),
        (([[0, 1, 2]], 12, "fifo", 2), "triangle 0 names vertex 2 of a mesh with 2 vertices"),
        (([[0, 1, 2], [0, -4, 1]],), "triangle 1 names vertex -4"),
        (([[0, 1]],), "expected \\(m, 3\\) int32"),
        (([[0.0, 1.0, 2.0]],), "expected \\(m, 3\\) int32"),
    ],
)
def test_bad_input_is_named(arguments, match):
    with pytest.raises(InputError, match=match):
        misses(*arguments)


def test_models_are_checked():
    wrong = {"nvidia, amd, intel, mobile": "voodoo", "cache": batch.Model(2), "warp": batch.Model(12, 2), "group": batch.Model(12, 3, -1)}
    for match, model in wrong.items():
        with pytest.raises(InputError, match=match):
            batch.reuse([[0, 1, 2]], model)


@settings(max_examples=20, deadline=None)
@given(made.soups())
def test_inputs_stay_as_they_are(triangles):
    before = triangles.copy()
    misses(triangles)
    assert (triangles == before).all()
