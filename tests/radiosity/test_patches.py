import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.radiosity.patches import build_tree


def elements(rng, n):
    position = rng.uniform(-2, 2, (n, 3)).astype(np.float32)
    normal = np.eye(3)[rng.integers(0, 3, n)] * rng.choice([-1, 1], (n, 1)) + rng.normal(size=(n, 3)) * 0.05
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return position, normal.astype(np.float32), rng.uniform(0.5, 1, n).astype(np.float32) * 1e-3


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 400), st.floats(0.05, 5))
def test_patches_part_the_elements(seed, n, extent):
    rng = np.random.default_rng(seed)
    position, normal, area = elements(rng, n)
    if n > 3:
        position[: n // 3] = position[0]  # equal places must not hang it
    tree = build_tree(position, normal, area, np.full(n, extent, np.float32))
    assert sorted(tree.order.tolist()) == list(range(n))
    spans = tree.span[tree.patches]
    assert spans[0, 0] == 0
    assert spans[-1, 1] == n
    assert (spans[1:, 0] == spans[:-1, 1]).all()
    assert (np.repeat(np.arange(len(spans)), spans[:, 1] - spans[:, 0]) == tree.patch_of).all()
    sorted_position, sorted_normal = position[tree.order], normal[tree.order]
    for (first, last), place in zip(spans, tree.place[tree.patches], strict=True):
        p, m, a = sorted_position[first:last], sorted_normal[first:last], area[tree.order][first:last]
        np.testing.assert_allclose(place[7], a.sum(), rtol=1e-5)
        np.testing.assert_allclose(place[:3], (p * a[:, None]).sum(0) / a.sum(), atol=1e-5)
        assert (np.linalg.norm(p - place[:3], axis=1) <= place[3] + 1e-5).all()
        if last - first > 1:
            assert np.ptp(p, axis=0).max() <= extent + 1e-5
            assert np.ptp(m, axis=0).max() <= 0.35 + 1e-5


def test_children_part_their_parent():
    position, normal, area = elements(np.random.default_rng(0), 300)
    tree = build_tree(position, normal, area, np.full(300, 0.5, np.float32))
    for node, first in enumerate(tree.child):
        if first < 0:
            assert tree.span[node, 1] - tree.span[node, 0] == 1
        else:
            assert tree.span[first, 0] == tree.span[node, 0]
            assert tree.span[first, 1] == tree.span[first + 1, 0]
            assert tree.span[first + 1, 1] == tree.span[node, 1]
