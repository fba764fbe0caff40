"""Triangles turned for a FIFO: by pieces and threads as by one."""

import numpy as np
import troublesome as made
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.layout import gather as module
from luxel.layout import misses
from luxel.layout.gather import gather


@settings(max_examples=100, deadline=None)
@given(made.soups(), st.integers(3, 20), st.integers(1, 9), st.randoms())
def test_pieces_are_joined_as_if_there_were_none(triangles, cache, piece, random):
    n, source = int(triangles.max()) + 1, np.array(random.sample(range(len(triangles)), len(triangles)), np.int32)
    whole, loads = gather(triangles, source, n, cache)
    before, module.PIECE = module.PIECE, piece
    try:
        pieces, same_loads = gather(triangles, source, n, cache, threads=2)
    finally:
        module.PIECE = before
    assert loads == same_loads == misses(whole, cache).sum()
    assert (whole == pieces).all()
    assert (made.canonical(whole) == made.canonical(triangles[source])).all()


def test_pieces_of_a_large_mesh():
    triangles = made.shuffled(made.grid(300, 300))
    source = np.arange(len(triangles), dtype=np.int32)
    whole, pieces = (gather(triangles, source, 301 * 301, 12, threads) for threads in (1, 2))
    assert len(triangles) > 2 * module.PIECE
    assert whole[1] == pieces[1]
    assert (whole[0] == pieces[0]).all()
