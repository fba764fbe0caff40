"""Meshes that make trouble, and the oracles of the layout's tests."""

from collections import deque

import numpy as np
from hypothesis import strategies as st


def grid(rows, columns):
    """A regular grid of 2 rows x columns triangles, row by row."""
    corner = np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)
    a, b, c, d = corner, corner + 1, corner + columns + 1, corner + columns + 2
    return np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)], 2).reshape(-1, 3).astype(np.int32)


def hub(count):
    """A fan of `count` triangles around vertex 0."""
    rim = np.arange(count)
    return np.stack([np.zeros(count, int), 1 + rim, 1 + (rim + 1) % count], 1).astype(np.int32)


def pieces(count):
    """Triangles that share nothing."""
    return np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def shuffled(triangles, seed=0):
    """The same triangles in a random order, turned at random."""
    rng = np.random.default_rng(seed)
    turns = (np.arange(3) + rng.integers(0, 3, (len(triangles), 1))) % 3
    return np.take_along_axis(triangles, turns, 1)[rng.permutation(len(triangles))]


NAMED = {
    "one": np.array([[0, 1, 2]], np.int32),
    "twice the same": np.array([[0, 1, 2], [0, 1, 2], [1, 2, 0]], np.int32),
    "both sides": np.array([[0, 1, 2], [2, 1, 0]], np.int32),
    "points and lines": np.array([[5, 5, 5], [1, 1, 2], [2, 7, 2], [0, 1, 2], [3, 3, 3]], np.int32),
    "grid": grid(9, 14),
    "shuffled grid": shuffled(grid(20, 20)),
    "hub": hub(500),
    "hub twice": np.concatenate([hub(70), hub(70)[:, ::-1]]),
    "pieces": pieces(40),
    "three on an edge": np.array([[0, 1, k] for k in range(2, 60)], np.int32),
    "all to all": np.array([[a, b, c] for a in range(9) for b in range(a) for c in range(b)], np.int32),
}


@st.composite
def soups(draw, most=60):
    """Random triangles over few vertices: non-manifold, degenerate and repeated as they come."""
    vertices = draw(st.integers(1, 40))
    count = draw(st.integers(1, most))
    corner = st.integers(0, vertices - 1)
    return np.array(draw(st.lists(st.tuples(corner, corner, corner), min_size=count, max_size=count)), np.int32)


def queue_misses(triangles, cache, policy="fifo"):
    """Misses of each triangle, by an explicit queue."""
    held, missed = deque(), []
    for triangle in triangles.tolist():
        misses = 0
        for v in triangle:
            if v in held:
                if policy == "lru":
                    held.remove(v)
                    held.append(v)
                continue
            misses += 1
            held.append(v)
            if len(held) > cache:
                held.popleft()
        missed.append(misses)
    return missed


def queue_batches(triangles, cache, warp, group):
    """Misses of each triangle and batches, by an explicit queue that is emptied before a triangle that does not fit."""
    held, missed, batches, new, drawn = deque(maxlen=cache), [], 0, 0, 0
    for triangle in triangles.tolist():
        absent = sum(v not in held for v in triangle)
        if (group and drawn == group) or (warp and new + absent > warp):
            batches += new > 0
            held.clear()
            new = drawn = 0
        misses = 0
        for v in triangle:
            if v not in held:
                held.append(v)
                misses += 1
        missed.append(misses)
        new += misses
        drawn += 1
    return missed, batches + (new > 0)


def canonical(triangles):
    """Each triangle turned so that its least rotation stands first: equal for the rotations of a triangle and for nothing else."""
    turned = np.stack([triangles[:, [0, 1, 2]], triangles[:, [1, 2, 0]], triangles[:, [2, 0, 1]]], 1)
    return np.array([min(map(tuple, three)) for three in turned.tolist()])
