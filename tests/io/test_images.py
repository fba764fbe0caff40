import struct
import tracemalloc
import warnings
import zlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from io_samples import png

from luxel.errors import ExtraMissingError, FileError, InputError
from luxel.io.images import PngStream, decode_image, read_image, write_exr, write_image, write_png


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_png_round_trip(tmp_path, channels):
    image = np.random.default_rng(channels).integers(0, 256, (37, 19, channels), dtype=np.uint8)
    write_png(tmp_path / "x.png", image)
    assert np.array_equal(read_image(tmp_path / "x.png"), image)


def test_png_of_two_axes(tmp_path):
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    write_png(tmp_path / "x.png", image)
    assert np.array_equal(read_image(tmp_path / "x.png")[..., 0], image)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(1, 40), st.lists(st.integers(0, 15), min_size=1, max_size=6), st.sampled_from([1, 3, 4]))
def test_png_bands_do_not_show(tmp_path, width, bands, channels):
    height = sum(bands)
    if not height:
        return
    image = np.random.default_rng(height).integers(0, 256, (height, width, channels), dtype=np.uint8)
    with PngStream(tmp_path / "x.png", width, height, channels) as stream:
        start = 0
        for rows in bands:
            stream.write(image[start : start + rows])
            start += rows
    assert np.array_equal(read_image(tmp_path / "x.png"), image)


def test_png_is_well_formed(tmp_path):
    write_png(tmp_path / "x.png", np.full((300, 5000, 4), 7, np.uint8))  # several pieces
    data = (tmp_path / "x.png").read_bytes()
    place, kinds, body = 8, [], b""
    while place < len(data):
        size, kind = struct.unpack(">I4s", data[place : place + 8])
        content = data[place + 8 : place + 8 + size]
        assert struct.unpack(">I", data[place + 8 + size : place + 12 + size])[0] == zlib.crc32(kind + content)
        kinds.append(kind)
        body += content if kind == b"IDAT" else b""
        place += 12 + size
    assert kinds[0] == b"IHDR"
    assert kinds[-1] == b"IEND"
    assert len(zlib.decompress(body)) == 300 * (1 + 5000 * 4)  # checks the Adler sum too


def test_png_stream_takes_bounded_memory(tmp_path):
    band = np.zeros((64, 4096, 4), np.uint8)
    tracemalloc.start()
    with PngStream(tmp_path / "x.png", 4096, 4096) as stream:
        for k in range(64):
            stream.write(band + np.uint8(k))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6  # the picture is 67 MB


def test_png_stream_faults(tmp_path):
    path = tmp_path / "x.png"
    with pytest.raises(InputError, match="expected width and height in"):
        PngStream(path, 0, 5)
    with pytest.raises(InputError, match="3 rows were written, expected 5"), PngStream(path, 2, 5, 1) as stream:
        stream.write(np.zeros((3, 2), np.uint8))
    with pytest.raises(InputError, match=r"expected \(k, 2, 4\) uint8"), PngStream(path, 2, 5) as stream:
        stream.write(np.zeros((3, 2, 3), np.uint8))
    with pytest.raises(InputError, match=r"0 \+ 6 of 5"), PngStream(path, 2, 5, 1) as stream:
        stream.write(np.zeros((6, 2), np.uint8))
    with pytest.raises(InputError, match="inside its with block"):
        stream.write(np.zeros((1, 2), np.uint8))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="write_png: expected"):
        write_png(path, np.zeros((3, 3, 3)))


@pytest.mark.parametrize("extension", ["jpg", "webp", "bmp", "tif"])
def test_other_formats(tmp_path, extension):
    image = np.full((8, 9, 4), 200, np.uint8)
    write_image(tmp_path / f"x.{extension}", image)
    assert np.abs(read_image(tmp_path / f"x.{extension}")[..., :3].astype(int) - 200).max() <= 2
    with pytest.raises(FileError, match=r"no picture format has the extension .what"):
        write_image(tmp_path / "x.what", image)


def test_modes(tmp_path):
    from PIL import Image

    grey = Image.new("L", (2, 2), 5)
    cases = {
        "1": (Image.new("1", (2, 2), 1), (1,), 255),
        "L": (grey, (1,), 5),
        "LA": (Image.new("LA", (2, 2), (5, 6)), (2,), [5, 6]),
        "CMYK": (Image.new("CMYK", (2, 2)), (3,), 255),
        "RGBA": (Image.new("RGBA", (2, 2), (1, 2, 3, 4)), (4,), [1, 2, 3, 4]),
    }
    for mode, (image, shape, value) in cases.items():
        path = tmp_path / ("x.tif" if mode == "CMYK" else "x.png")
        image.save(path)
        array = read_image(path)
        assert array.shape == (2, 2, *shape), mode
        assert (array == value).all(), mode
    grey.save(tmp_path / "t.png", transparency=5)
    assert (read_image(tmp_path / "t.png") == [5, 5, 5, 0]).all()
    Image.fromarray(np.full((2, 3), 1000, np.uint16)).save(tmp_path / "deep.png")
    assert np.allclose(read_image(tmp_path / "deep.png"), 1000 / 65535)


def test_exr_round_trip(tmp_path):
    pytest.importorskip("OpenEXR")
    rng = np.random.default_rng(0)
    layers = {
        "": rng.random((6, 7, 4), np.float32) * 100,
        "depth": np.where(rng.random((6, 7)) < 0.5, np.inf, 3).astype(np.float32),
        "triangle.id": np.arange(42, dtype=np.uint32).reshape(6, 7) + np.uint32(2**31),
        "normal": rng.random((6, 7, 3), np.float32),
    }
    write_exr(tmp_path / "x.exr", layers)
    import OpenEXR

    with OpenEXR.File(str(tmp_path / "x.exr"), separate_channels=True) as file:
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    assert sorted(channels) == ["A", "B", "G", "R", "depth.Z", "normal.X", "normal.Y", "normal.Z", "triangle.id"]
    assert np.array_equal(channels["triangle.id"], layers["triangle.id"])
    assert channels["triangle.id"].dtype == np.uint32
    assert np.array_equal(channels["depth.Z"], layers["depth"])
    assert np.array_equal(channels["normal.Y"], layers["normal"][..., 1])
    assert np.array_equal(read_image(tmp_path / "x.exr"), layers[""])
    with pytest.raises(InputError, match="expected layers of one size"):
        write_exr(tmp_path / "y.exr", {"": layers[""], "depth": layers["depth"][:3]})
    with pytest.raises(InputError, match="layer 'a'"):
        write_exr(tmp_path / "y.exr", {"a": np.zeros((2, 2), np.int64)})


def test_exr_without_its_extra(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(ExtraMissingError, match=r"pip install 'luxel\[exr\]'"):
        write_exr(tmp_path / "x.exr", {"": np.zeros((2, 2, 4), np.float32)})
    (tmp_path / "x.exr").write_bytes(b"\x76\x2f\x31\x01 and so on")
    with pytest.raises(ExtraMissingError, match="OpenEXR"):
        read_image(tmp_path / "x.exr")


def hdr(flat: bool) -> bytes:
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 8\n"
    if flat:
        return head + bytes([128, 64, 32, 129]) * 16
    row = b"\x02\x02\x00\x08" + b"\x88\x80" + b"\x08" + bytes([64] * 8) + b"\x88\x20" + b"\x84\x81\x84\x81"
    return head + row * 2


@pytest.mark.parametrize("flat", [True, False])
def test_hdr(tmp_path, flat):
    (tmp_path / "x.hdr").write_bytes(hdr(flat))
    image = read_image(tmp_path / "x.hdr")
    assert image.shape == (2, 8, 3)
    assert np.allclose(image, [1, 0.5, 0.25])


def test_decompression_bombs_are_errors(tmp_path, monkeypatch):
    from PIL import Image

    (tmp_path / "x.png").write_bytes(png(40, 40))
    for limit in (1000, 100):  # Pillow warns at the first and raises at the second
        monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", limit)
        with pytest.raises(FileError, match=r"x.png: .*(decompression bomb|40 x 40 pixels)"):
            read_image(tmp_path / "x.png")


def test_exr_that_claims_too_much(tmp_path):
    pytest.importorskip("OpenEXR")
    write_exr(tmp_path / "x.exr", {"": np.zeros((4, 5, 4), np.float32)})
    window = struct.pack("<4i", 0, 0, 4, 3)
    huge = struct.pack("<4i", 0, 0, 60_000, 60_000)
    data = (tmp_path / "x.exr").read_bytes()
    assert data.count(window) == 2  # data and display
    tracemalloc.start()
    with pytest.raises(FileError, match=r"60001 x 60001 pixels"):
        decode_image(data.replace(window, huge), "x.exr")
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


@pytest.mark.parametrize("name", ["png", "jpg", "hdr", "flat.hdr"])
def test_broken_pictures_are_errors(name, tmp_path):
    if name.endswith("hdr"):
        data = hdr(name == "flat.hdr")
    else:
        write_image(tmp_path / f"x.{name}", np.random.default_rng(0).integers(0, 256, (8, 9, 3), dtype=np.uint8))
        data = (tmp_path / f"x.{name}").read_bytes()
    rng = np.random.default_rng(1)
    pieces = [data[:k] for k in range(0, len(data) - 1, 1 + len(data) // 200)]
    for _ in range(200):
        broken = bytearray(data)
        for at in rng.integers(0, len(data), 3):
            broken[at] = rng.integers(0, 256)
        pieces.append(bytes(broken))
    failures = loaded = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for piece in pieces:
            try:
                image = decode_image(piece, "broken")
            except FileError as error:
                failures += str(error).startswith("broken: ")
            else:
                assert image.ndim == 3
                loaded += 1
    assert failures + loaded == len(pieces)
    assert failures > 50
