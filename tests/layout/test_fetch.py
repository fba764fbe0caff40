"""The order of vertices and what reading them costs."""

import meshopt_peer as peer
import numpy as np
import pytest
import troublesome as made
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.errors import InputError
from luxel.layout.fetch import edge_span, fetched, overfetch, renumber


@settings(deadline=None)
@given(made.soups(), st.integers(0, 9), st.booleans())
def test_vertices_are_numbered_by_first_use(triangles, more, keep):
    n = int(triangles.max()) + 1 + more
    numbered, source = renumber(triangles, n, keep_unused=keep)
    assert (source[numbered] == triangles).all()
    first = list(dict.fromkeys(numbered.ravel().tolist()))
    assert first == list(range(len(first)))
    assert sorted(source.tolist()) == (list(range(n)) if keep else sorted(set(triangles.ravel().tolist())))
    assert (np.diff(source[len(first) :]) > 0).all()


@pytest.mark.skipif(peer.LIBRARY is None, reason="meshoptimizer is not installed")
@settings(deadline=None)
@given(made.soups(), st.integers(1, 300))
def test_overfetch_equals_meshoptimizer(triangles, stride):
    n = int(triangles.max()) + 1
    theirs, ours = peer.analyze_fetch(triangles, n, stride), fetched(triangles, n, stride)
    assert (theirs.bytes, theirs.overfetch) == (ours.bytes, np.float32(ours.overfetch))


@pytest.mark.skipif(peer.LIBRARY is None, reason="meshoptimizer is not installed")
@pytest.mark.parametrize("stride", [12, 32, 60, 256])
def test_overfetch_of_a_large_mesh_equals_meshoptimizer(stride):
    triangles = made.shuffled(made.grid(150, 150))
    assert peer.analyze_fetch(triangles, 151**2, stride).bytes == fetched(triangles, 151**2, stride).bytes


def test_renumbering_helps_what_was_at_random():
    triangles = np.random.default_rng(1).permutation(151**2).astype(np.int32)[made.grid(150, 150)]
    better, _ = renumber(triangles)
    assert overfetch(better, 151**2, 16) < 1.2 < 3 < overfetch(triangles, 151**2, 16)
    assert edge_span(better) < edge_span(triangles) / 20


def test_edge_span_is_a_geometric_mean():
    assert edge_span([[0, 1, 9]]) == pytest.approx((1 * 8 * 9) ** (1 / 3))
    assert edge_span([[4, 4, 8]]) == pytest.approx(4)


def test_bad_input_is_named():
    with pytest.raises(InputError, match="stride: expected a whole number of at least 1, got 0"):
        overfetch([[0, 1, 2]], 3, 0)
    with pytest.raises(InputError, match="triangles of one vertex"):
        edge_span([[1, 1, 1]])
    with pytest.raises(InputError, match="at least one triangle"):
        overfetch(np.zeros((0, 3), np.int32), 3, 12)
