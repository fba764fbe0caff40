import io

import numpy as np
import pytest

from luxel.errors import FileError, InputError
from luxel.io.images import read_image
from luxel.raster.picture import Picture, encode
from luxel.scene.colour import linear_from_srgb


def picture():
    rng = np.random.default_rng(0)
    h, w = 5, 7
    alpha = rng.random((h, w, 1), np.float32)
    return Picture(
        linear=np.concatenate([rng.random((h, w, 3), np.float32) * alpha, alpha], -1),
        depth=np.where(rng.random((h, w)) < 0.3, np.inf, 2.5).astype(np.float32),
        triangle=rng.integers(-1, 1000, (h, w)).astype(np.int32),
        object=rng.integers(-1, 4, (h, w)).astype(np.int32),
        normal=rng.random((h, w, 3), np.float32),
        motion=rng.random((h, w, 2), np.float32),
        seconds={"project": 0.5},
    )


def test_encoding_undoes_premultiplication():
    straight = np.float32([[[0.2, 0.4, 0.6, 0.5], [0, 0, 0, 0], [5, 1, 0.5, 1]]])
    linear = straight.copy()
    linear[..., :3] *= linear[..., 3:]
    color = encode(linear)
    assert color[0, 1].tolist() == [0, 0, 0, 0]
    assert color[0, 2, :2].tolist() == [255, 255]
    assert color[0, 0, 3] == 128
    assert np.abs(linear_from_srgb(color[0, 0, :3]) - straight[0, 0, :3]).max() < 0.005


def test_encoding_survives_values_that_are_not_finite():
    linear = np.float32([[[np.nan, np.inf, -np.inf, 1], [1, 1, 1, np.nan]]])
    assert encode(linear).tolist() == [[[0, 255, 0, 255], [255, 255, 255, 0]]]
    with pytest.raises(InputError, match=r"expected \(h, w, 4\)"):
        encode(np.zeros((2, 2, 3), np.float32))


def test_size_outputs_and_array():
    p = picture()
    assert p.size == (7, 5)
    assert list(p.outputs()) == ["linear", "depth", "triangle", "object", "normal", "motion"]
    assert repr(p) == "Picture(7 x 5: linear, depth, triangle, object, normal, motion)"
    array = np.asarray(p)
    assert array.shape == (5, 7, 4)
    assert array.dtype == np.uint8
    assert np.asarray(p, np.float32).dtype == np.float32
    color = Picture(color=array)
    assert np.asarray(color) is array
    assert np.array(color, copy=True) is not array
    assert (Picture().size, Picture().outputs(), repr(Picture())) == ((0, 0), {}, "Picture(0 x 0: no outputs)")


@pytest.mark.parametrize("extension", ["png", "PNG", "jpg", "webp"])
def test_save_colour(tmp_path, extension):
    p = picture()
    p.save(tmp_path / f"x.{extension}")
    image = read_image(tmp_path / f"x.{extension}")
    assert image.shape[:2] == (5, 7)
    if extension.lower() == "png":
        assert np.array_equal(image, np.asarray(p))


def test_save_npz(tmp_path):
    p = picture()
    p.save(tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as arrays:
        assert sorted(arrays) == sorted(p.outputs())
        assert all(np.array_equal(arrays[name], array) for name, array in p.outputs().items())


def test_save_exr(tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    p = picture()
    p.save(tmp_path / "x.exr")
    with OpenEXR.File(str(tmp_path / "x.exr"), separate_channels=True) as file:
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    names = ["A", "B", "G", "R", "depth.Z", "motion.U", "motion.V", "normal.X", "normal.Y", "normal.Z", "object.id", "triangle.id"]
    assert sorted(channels) == names
    assert np.array_equal(channels["triangle.id"].view(np.int32), p.triangle)
    assert np.array_equal(channels["depth.Z"], p.depth)
    assert np.array_equal(channels["G"], p.linear[..., 1])
    Picture(color=np.asarray(p)).save(tmp_path / "y.exr")
    assert np.abs(read_image(tmp_path / "y.exr") - p.linear).max() < 0.01


def test_faults(tmp_path):
    depth = Picture(depth=np.zeros((2, 2), np.float32))
    with pytest.raises(InputError, match="no colour; it has depth"):
        depth.save(tmp_path / "x.png")
    with pytest.raises(FileError, match="no picture format has the extension"):
        picture().save(tmp_path / "x.what")
    with pytest.raises(InputError, match="no outputs to save"):
        Picture().save(tmp_path / "x.exr")
    assert list(tmp_path.iterdir()) == []


def test_notebook():
    from PIL import Image

    data = picture()._repr_png_()
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(data))), np.asarray(picture()))
    large = Picture(color=np.zeros((3000, 2000, 4), np.uint8))
    assert Image.open(io.BytesIO(large._repr_png_())).size == (1000, 1500)
    assert Picture(depth=np.zeros((2, 2), np.float32))._repr_png_() is None
