"""From file to file: 8 and 16 bits, alpha, arrays; and the same through bands from disk to disk as in memory."""

import io
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from luxel.errors import FileError, InputError
from luxel.filter import lowpass
from luxel.filter.borders import BORDERS
from luxel.filter.files import Sink, decoded, kernel_file, opened
from luxel.filter.filters import make_filter
from luxel.filter.png_rows import bands, header
from luxel.filter.spectrum import spectrum_picture
from luxel.filter.streamed import Job, filtered_bands
from luxel.io.images import read_image, write_exr, write_png
from luxel.io.png import PngStream

KINDS = {1: 0, 2: 4, 3: 2, 4: 6}


def png(image, filters, chunk=1000):
    """A PNG by the book: each row with the filter that `filters` says, in several IDAT chunks."""
    height, width, channels = image.shape
    bits = 8 * image.itemsize
    rows = image.astype(">u2").view(np.uint8).reshape(height, -1) if bits == 16 else image.reshape(height, -1)
    pixel, above, data = channels * bits // 8, np.zeros(rows.shape[1], int), b""
    for row, kind in zip(rows.astype(int), filters):
        left, corner = np.concatenate([np.zeros(pixel, int), row])[: len(row)], np.concatenate([np.zeros(pixel, int), above])[: len(row)]
        p = left + above - corner
        near = np.where(
            (abs(p - left) <= abs(p - above)) & (abs(p - left) <= abs(p - corner)), left, np.where(abs(p - above) <= abs(p - corner), above, corner)
        )
        guess = [0 * row, left, above, (left + above) // 2, near][kind]
        data += bytes([kind]) + ((row - guess) % 256).astype(np.uint8).tobytes()
        above = row
    packed = zlib.compress(data)

    def part(name, content):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    idat = b"".join(part(b"IDAT", packed[i : i + chunk]) for i in range(0, len(packed), chunk))
    head = part(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, KINDS[channels], 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + part(b"tEXt", b"Title\0x") + idat + part(b"IEND", b"")


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 30), st.integers(1, 4), st.sampled_from(["u1", "u2"]), st.integers(1, 50))
def test_png_rows(tmp_path_factory, seed, height, width, channels, kind, rows):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, np.iinfo(kind).max, (height, width, channels), endpoint=True).astype(kind)
    path = tmp_path_factory.mktemp("png") / "a.png"
    path.write_bytes(png(image, rng.integers(0, 5, height)))
    assert header(path) == ((height, width, channels), 8 * image.itemsize)
    got = list(bands(path, rows))
    assert all(len(band) <= rows for band in got)
    assert np.array_equal(np.concatenate(got), image)
    if kind == "u1":
        assert np.array_equal(read_image(path), image)  # Pillow agrees


def test_what_is_not_read_in_rows(tmp_path):
    Image.new("P", (4, 4)).save(tmp_path / "palette.png")
    Image.new("1", (4, 4)).save(tmp_path / "bits.png")
    Image.new("RGB", (4, 4)).save(tmp_path / "clear.png", transparency=(0, 0, 0))
    (tmp_path / "text.png").write_text("no picture")
    for path in tmp_path.iterdir():
        assert header(path) is None, path


def test_damaged_pngs(tmp_path):
    image = np.random.default_rng(1).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    whole = png(image, [1] * 20, chunk=300)
    for length in (50, len(whole) // 2, len(whole) - 30):
        (tmp_path / "cut.png").write_bytes(whole[:length])
        with pytest.raises(FileError, match=r"cut\.png: (the file ends|the picture ends)"):
            list(bands(tmp_path / "cut.png", 8)) if header(tmp_path / "cut.png") else None
    (tmp_path / "flipped.png").write_bytes(whole[:200] + bytes([whole[200] ^ 1]) + whole[201:])
    with pytest.raises(FileError, match="damaged"):
        list(bands(tmp_path / "flipped.png", 8))
    packed = zlib.compress(bytes([9, 1, 2, 3]))
    head = struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0)
    parts = [(b"IHDR", head), (b"IDAT", packed), (b"IEND", b"")]
    data = b"".join(struct.pack(">I", len(c)) + n + c + struct.pack(">I", zlib.crc32(n + c)) for n, c in parts)
    (tmp_path / "odd.png").write_bytes(b"\x89PNG\r\n\x1a\n" + data)
    with pytest.raises(FileError, match="row 0: 9 is no filter"):
        list(bands(tmp_path / "odd.png", 8))


def test_sixteen_bits_out(tmp_path):
    image = np.random.default_rng(2).integers(0, 65536, (9, 7, 3)).astype(np.uint16)
    with PngStream(tmp_path / "a.png", 7, 9, 3, 16) as stream:
        stream.write(image[:4])
        stream.write(image[4:])
    assert np.array_equal(np.concatenate(list(bands(tmp_path / "a.png", 4))), image)
    grey = image[..., :1]
    with PngStream(tmp_path / "g.png", 7, 9, 1, 16) as stream:
        stream.write(grey)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "g.png")), grey[..., 0])
    with pytest.raises(InputError, match="8 or 16 bits"):
        PngStream(tmp_path / "b.png", 7, 9, 3, 12)
    with pytest.raises(InputError, match="uint16, got"), PngStream(tmp_path / "b.png", 7, 9, 3, 16) as stream:
        stream.write(image.astype(np.uint8))


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("options", [{"gaussian": 3.0}, {"kernel": np.full((3, 70), 1 / 210)}, {"ideal": 0.2}, {"butterworth": (0.15, 4)}])
def test_bands_are_the_whole(options, border):
    """Bands of 64 rows; the transfer functions pass through a file, strip by strip."""
    image = np.random.default_rng(3).random((150, 90, 3)).astype(np.float32)
    done = []
    job = Job(image.shape, image.dtype, make_filter(**options), border, 0.3, threads=2, memory=20_000)
    parts = list(filtered_bands(image, job, done.append))
    assert len(parts) > 1
    assert done[-1] == 1
    assert np.abs(np.concatenate(parts) - lowpass(image, border=border, value=0.3, **options)).max() < 1e-6


@pytest.mark.parametrize("options", [{"gaussian": 3.0}, {"ideal": 0.2}])
def test_what_is_no_number_is_named_by_its_row(options):
    image = np.zeros((200, 90, 3), np.float32)
    image[150, 7, 1] = np.inf
    with pytest.raises(InputError, match="got inf at row 150, column 7, channel 1"), np.errstate(invalid="ignore"):
        list(filtered_bands(image, Job(image.shape, image.dtype, make_filter(**options), memory=20_000), lambda done: None))


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("memory", [1, 1 << 30])
def test_files_in_memory_and_on_disk(tmp_path, kind, memory):
    image = np.random.default_rng(4).integers(0, np.iinfo(kind).max, (80, 50, 4), endpoint=True).astype(kind)
    path = tmp_path / "in.png"
    path.write_bytes(png(image, np.arange(80) % 5))
    with opened(path, memory) as source:
        assert isinstance(source.array, np.memmap) == (memory == 1)
        assert np.array_equal(source.array, image)
        with Sink(tmp_path / "out.png", image.shape, image.dtype, source.bits, 1) as sink:
            for band in filtered_bands(source.array, Job(image.shape, sink.dtype, make_filter(gaussian=2.0), memory=1 << 14), lambda done: None):
                assert band.dtype == kind
                sink.write(band)
    out = np.concatenate(list(bands(tmp_path / "out.png", 100)))
    assert out.dtype == kind
    assert np.array_equal(out, lowpass(image, gaussian=2.0))


def test_formats(tmp_path):
    image = np.random.default_rng(5).random((12, 10, 3)).astype(np.float32)
    np.save(tmp_path / "a.npy", image)
    with opened(tmp_path / "a.npy", 1) as source:
        assert isinstance(source.array.base, np.memmap)
        for name in ("b.npy", "b.png", "b.jpg", "b.tif"):
            with Sink(tmp_path / name, source.array.shape, source.array.dtype, 8, 1) as sink:
                sink.write(decoded(source.array[:5], 1))
                sink.write(decoded(source.array[5:], 1))
    assert np.array_equal(np.load(tmp_path / "b.npy"), image)
    encoded = read_image(tmp_path / "b.png")
    assert np.abs(decoded(encoded, 1) - image).max() < 0.005
    assert np.array_equal(read_image(tmp_path / "b.tif"), encoded)
    assert read_image(tmp_path / "b.jpg").shape == image.shape
    Image.fromarray(np.arange(100, dtype=np.uint16).reshape(10, 10) * 600).save(tmp_path / "grey.tif")
    with opened(tmp_path / "grey.tif", 1 << 30) as source:
        assert source.bits == 16
        assert np.array_equal(source.array[..., 0], np.arange(100).reshape(10, 10) * 600)


def test_exr(tmp_path):
    pytest.importorskip("OpenEXR")
    image = np.random.default_rng(6).random((12, 10, 4)).astype(np.float32)
    write_exr(tmp_path / "a.exr", {"": image})
    with opened(tmp_path / "a.exr", 1 << 30) as source:
        assert np.array_equal(source.array, image)
        with Sink(tmp_path / "b.exr", image.shape, image.dtype, 8, 1) as sink:
            sink.write(image)
    assert np.array_equal(read_image(tmp_path / "b.exr"), image)


def test_a_failure_leaves_no_file(tmp_path):
    def fail(name):
        with Sink(tmp_path / name, (4, 4, 3), np.float32, 8, 1) as sink:
            sink.write(np.zeros((2, 4, 3), np.float32))
            raise ZeroDivisionError

    for name in ("a.png", "a.npy"):
        with pytest.raises(ZeroDivisionError):
            fail(name)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match=r"ends in one of .*got 'a\.gif'"):
        Sink("a.gif", (4, 4, 3), np.uint8, 8, 1)


def test_kernels_from_files(tmp_path):
    weights = np.random.default_rng(7).normal(size=(3, 5))
    np.save(tmp_path / "k.npy", weights)
    assert np.array_equal(kernel_file(tmp_path / "k.npy"), weights)
    write_png(tmp_path / "k.png", np.array([[0, 255], [255, 0]], np.uint8))
    assert np.allclose(kernel_file(tmp_path / "k.png"), [[0, 0.5], [0.5, 0]])
    write_png(tmp_path / "black.png", np.zeros((3, 3, 3), np.uint8))
    with pytest.raises(FileError, match="this one is black"):
        kernel_file(tmp_path / "black.png")


def test_arrays_that_are_no_pictures(tmp_path):
    np.save(tmp_path / "many.npy", np.zeros((4, 4, 16)))
    (tmp_path / "text.npy").write_text("no array")
    for name, message in (("many.npy", r"got \(4, 4, 16\)"), ("text.npy", "not an array of NumPy's"), ("none.npy", "No such file")):
        with pytest.raises(FileError, match=message), opened(tmp_path / name, 1 << 20):
            pass


def test_spectrum():
    x = np.arange(64)
    wave = np.broadcast_to(0.5 + 0.25 * np.cos(2 * np.pi * x * 10 / 64), (32, 64))[..., None].repeat(3, 2)
    picture, peak = spectrum_picture(wave)
    assert picture.shape == (32, 64)
    assert peak == pytest.approx(0.125 * wave.shape[0] * wave.shape[1])
    assert np.argwhere(picture == 255).tolist() == [[16, 22], [16, 32], [16, 42]]  # the mean in the middle, and the wave beside it
    assert not spectrum_picture(np.zeros((4, 4, 1)))[0].any()
    assert spectrum_picture(np.ones((1, 1, 1)))[0].shape == (1, 1)


def test_pillow_reads_what_is_written():
    image = np.random.default_rng(8).integers(0, 256, (6, 5, 4), dtype=np.uint8)
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(png(image, [0, 1, 2, 3, 4, 0])))), image)
