"""Welding, degenerate and duplicate triangles, and the proof that two meshes are the same."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from luxel.layout.clean import canonical, degenerate, duplicate, vertex_rows, weld
from luxel.layout.same import Soup, difference

ROWS = arrays(np.uint32, st.tuples(st.integers(0, 60), st.integers(1, 3)), elements=st.integers(0, 3))
FACES = arrays(np.int32, st.tuples(st.integers(1, 40), st.just(3)), elements=st.integers(0, 6))


@settings(deadline=None, max_examples=60)
@given(ROWS)
def test_weld_is_a_dictionary(rows):
    target, source = weld(rows)
    seen: dict[tuple[int, ...], int] = {}
    assert target.tolist() == [seen.setdefault(tuple(row), len(seen)) for row in rows.tolist()]
    assert (rows[source][target] == rows).all()
    assert len(source) == len(seen)


def test_weld_of_many():
    rng = np.random.default_rng(0)
    rows = rng.integers(0, 2**32, (5000, 4), dtype=np.uint32)[rng.integers(0, 5000, 40000)]
    target, source = weld(rows)
    assert (rows[source[target]] == rows).all()
    assert len(source) == len(np.unique(rows, axis=0))


def test_rows_hold_every_attribute():
    a, b = np.array([[0.0, 1], [-0.0, 1], [0, 2]]), np.array([[1, 2, 3], [1, 2, 3], [1, 2, 3]], np.uint8)
    rows = vertex_rows([a, b])
    assert rows.shape == (3, 5)
    assert (rows[0] == rows[1]).all()  # -0 is 0
    assert (rows[0] != rows[2]).any()
    assert vertex_rows([np.zeros((2, 3), np.float32), np.arange(2, dtype=np.int16)]).shape == (2, 4)


@settings(deadline=None, max_examples=60)
@given(FACES)
def test_canonical_is_a_rotation_and_the_same_for_all_rotations(faces):
    least = canonical(faces)
    for k in range(3):
        assert (canonical(np.roll(faces, k, 1)) == least).all()
    rotations = np.stack([np.roll(faces, k, 1) for k in range(3)])
    assert (rotations == least).all(2).any(0).all()


@settings(deadline=None, max_examples=60)
@given(FACES)
def test_duplicates_are_those_of_the_same_winding(faces):
    seen: set[tuple[int, ...]] = set()
    expected = []
    for a, b, c in faces.tolist():
        key = min((a, b, c), (b, c, a), (c, a, b))
        expected.append(key in seen)
        seen.add(key)
    assert duplicate(faces).tolist() == expected


def test_both_sides_of_a_sheet_are_no_duplicates():
    assert duplicate([[0, 1, 2], [2, 1, 0], [1, 2, 0]]).tolist() == [False, False, True]


def test_degenerate():
    faces = [[0, 1, 2], [0, 0, 1], [0, 1, 3], [3, 2, 1]]
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0]], np.float32)
    assert degenerate(faces).tolist() == [False, True, False, False]
    assert degenerate(faces, points).tolist() == [False, True, True, False]
    assert degenerate(np.zeros((0, 3), np.int32)).shape == (0,)


# Sameness


def soup(faces, rows, per_face=None):
    rows = np.asarray(rows, np.float32)
    data = None if per_face is None else vertex_rows([np.asarray(per_face)])
    return {"": Soup(np.asarray(faces, np.int32), vertex_rows([rows]), rows[:, :3], data)}


@settings(deadline=None, max_examples=60)
@given(FACES, st.integers(0, 2**32 - 1))
def test_renumbered_turned_and_shuffled_is_the_same(faces, seed):
    rng = np.random.default_rng(seed)
    rows = rng.random((7, 5), np.float32)
    number, place = rng.permutation(7), rng.permutation(len(faces))
    turned = np.stack([np.roll(face, rng.integers(3)) for face in faces])
    back = np.empty(7, np.int32)
    back[number] = np.arange(7)
    assert difference(soup(faces, rows), soup(back[turned][place], rows[number])) is None


SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


@pytest.mark.parametrize(
    ("faces", "rows"),
    [
        ([[0, 1, 2]], SQUARE),  # one is missing
        ([[0, 1, 2], [0, 2, 3], [0, 2, 3]], SQUARE),  # one is there twice
        ([[0, 1, 2], [0, 3, 2]], SQUARE),  # one is turned over
        ([[0, 1, 2], [0, 2, 3]], SQUARE + np.float32([0, 0, 1e-7])),  # one bit
        ([[0, 1, 2], [0, 2, 3]], np.concatenate([SQUARE, SQUARE], 1)),  # more attributes
    ],
)
def test_what_differs_is_found(faces, rows):
    assert difference(soup([[0, 1, 2], [0, 2, 3]], SQUARE), soup(faces, rows))


def test_faces_and_parts_count():
    a, b = soup([[0, 1, 2], [0, 2, 3]], SQUARE, [1, 2]), soup([[2, 3, 0], [0, 1, 2]], SQUARE, [2, 1])
    assert difference(a, b) is None
    assert difference(a, soup([[2, 3, 0], [0, 1, 2]], SQUARE, [1, 2]))
    assert difference(a, {"other": a[""]}) == "2 triangles became 0"
    assert difference(a, {"": a[""]._replace(triangles=a[""].triangles[:0], faces=a[""].faces[:0])}) == "2 triangles became 0"


def test_what_was_to_be_dropped_may_be_missing():
    full = soup([[0, 1, 2], [0, 0, 1], [1, 2, 0], [0, 2, 3]], SQUARE)
    lean = soup([[0, 1, 2], [0, 2, 3]], SQUARE)
    assert difference(full, lean)
    assert difference(full, lean, dropped_degenerate=True)
    assert difference(full, lean, dropped_duplicates=True)
    assert difference(full, lean, True, True) is None
    assert difference(full, soup([[0, 1, 2]], SQUARE), True, True)
