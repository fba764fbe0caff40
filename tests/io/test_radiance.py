import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel.io.images import decode_image
from luxel.io.radiance import radiance_bytes


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), width=st.integers(1, 300), height=st.integers(1, 4), stops=st.integers(0, 60), runs=st.integers(1, 200))
def test_light_of_any_range_comes_back_to_a_part_in_256(seed, width, height, stops, runs):
    rng = np.random.default_rng(seed)
    image = np.exp2(rng.uniform(-stops, stops, (height, width, 3))).astype(np.float32)
    image = np.repeat(image, runs, 1)[:, :width]  # runs of equal pixels
    back = decode_image(radiance_bytes(image), "x.hdr")
    assert back.shape == image.shape
    assert (np.abs(back - image) <= image.max(-1, keepdims=True) * (1 / 256)).all()


def test_odd_values_become_light():
    image = np.float32([[[0, 0, 0], [-1, 2, 3], [np.nan, 1, 1], [np.inf, 0, 0], [1e-42, 0, 0], [255.9, 1, 0], [0.999999, 0, 0], [1, 0.5, 0.25]]])
    back = decode_image(radiance_bytes(image), "x.hdr")[0]
    assert np.array_equal(back[[0, 1, 2, 4]], [[0, 0, 0], [0, 2, 3], [0, 1, 1], [0, 0, 0]])
    assert back[3, 0] > 9e37
    assert np.abs(back[5] - image[0, 5]).max() <= 1
    assert np.array_equal(back[6:], [[1, 0, 0], [1, 0.5, 0.25]])


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_rows_of_one_colour_take_little(value):
    data = radiance_bytes(np.full((8, 1024, 3), value, np.float32))
    assert len(data) < 8 * 4 * (4 + 2 * 9) + 100
    assert np.array_equal(decode_image(data, "x.hdr"), np.full((8, 1024, 3), value))
