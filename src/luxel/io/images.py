"""Pictures in and out: Pillow for what it knows, OpenEXR for .exr, Radiance .hdr; PNG is written by `luxel.io.png`."""

from __future__ import annotations

import io
import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import ExtraMissingError, FileError, InputError
from luxel.io.files import atomic_write, door, read_bytes, tell
from luxel.io.png import PngStream
from luxel.scene.material import Texture
from luxel.unfinished import unfinished

__all__ = [
    "PngStream",
    "decode_image",
    "exr_bytes",
    "load_texture",
    "png_bytes",
    "read_image",
    "with_alpha",
    "write_exr",
    "write_image",
    "write_png",
]

_EXR_MAGIC = b"\x76\x2f\x31\x01"


def read_image(path: str | os.PathLike[str]) -> Array:
    """A picture file as (h, w, c), c in 1..4, row 0 at the top.

    Returns:
        uint8 as encoded in the file; float32 in 0..1 (still sRGB-encoded) for 16-bit grey; float32 linear for .exr and .hdr.

    Raises:
        FileError: It is missing, malformed, or larger than Pillow's limit against decompression bombs.
        ExtraMissingError: An .exr file, and the extra `exr` is not installed.
    """
    path = Path(path)
    return decode_image(read_bytes(path).tobytes(), path.name)


def decode_image(data: bytes, where: str) -> Array:
    """As `read_image`, of the bytes of a file; `where` names it in errors."""
    with door(where):
        if data[:4] == _EXR_MAGIC:
            return _decode_exr(data, where)
        if data[:10].startswith((b"#?RADIANCE", b"#?RGBE")):
            return _decode_hdr(data, where)
        return _decode_pillow(data, where)
    raise AssertionError  # the door lets nothing fall through


def load_texture(path: Path, where: str, srgb: bool = True) -> Texture | None:
    """A texture of the picture at `path`; None, and a warning, where it cannot be had."""
    try:
        data = read_bytes(path, where).tobytes()
        image = decode_image(data, f"{where}, {path.name}")
    except FileError as error:
        tell(error.where, f"{error.what}; the texture is left out")
        return None
    if srgb and image.dtype != np.uint8 and data[:1] not in (b"#", _EXR_MAGIC[:1]):
        from luxel.scene.colour import linear_from_srgb

        image = linear_from_srgb(image)  # a float texture is taken as linear
    return Texture(image, srgb, name=path.name)


def with_alpha(image: Array, alpha: Array) -> Array:
    """`image` (h, w, 1..4) as RGBA with the first channel of `alpha`, resized to fit."""
    from PIL import Image

    h, w, channels = image.shape
    mask = alpha[..., 0]
    if mask.dtype != np.uint8:
        mask = (np.clip(mask, 0, 1) * 255 + 0.5).astype(np.uint8)
    if mask.shape != (h, w):
        mask = np.asarray(Image.fromarray(mask).resize((w, h)))
    rgb = image[..., :3] if channels >= 3 else np.repeat(image[..., :1], 3, 2)
    scaled = mask if image.dtype == np.uint8 else mask.astype(np.float32) / 255
    return np.concatenate([rgb, scaled[..., None]], 2)


def _decode_pillow(data: bytes, where: str) -> Array:
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # an error, below
        try:
            image: Image.Image = Image.open(io.BytesIO(data))
        except Image.UnidentifiedImageError:
            raise FileError(where, "not a picture in a format that Pillow knows") from None
    _check_size(image.width, image.height, where)
    with image:
        if image.mode.startswith("I"):
            wide = np.asarray(image, np.float32)[..., None] / np.float32(65535)
            return np.clip(wide, 0, 1)
        if image.mode == "F":
            return np.asarray(image, np.float32)[..., None]
        if image.mode not in ("L", "LA", "RGB", "RGBA"):
            alpha = "A" in image.mode or "a" in image.mode or "transparency" in image.info
            grey = image.mode in ("1", "L;16") and not alpha
            image = image.convert("L" if grey else "RGBA" if alpha else "RGB")
        elif "transparency" in image.info:
            image = image.convert("RGBA")
        array = np.array(image)
    return array[..., None] if array.ndim == 2 else array


def _check_size(width: int, height: int, where: str) -> None:
    from PIL import Image

    limit = Image.MAX_IMAGE_PIXELS
    if limit and width * height > limit:
        raise FileError(where, f"{width} x {height} pixels, more than the limit of {limit} against decompression bombs")


def _decode_exr(data: bytes, where: str) -> Array:
    OpenEXR = _openexr(f"{where}: reading .exr")
    import tempfile

    with tempfile.NamedTemporaryFile(suffix=".exr") as file, unfinished(file.name):  # OpenEXR reads files only
        file.write(data)
        file.flush()
        try:
            with OpenEXR.File(file.name, header_only=True) as exr:
                low, high = exr.header()["dataWindow"]
            _check_size(int(high[0]) - int(low[0]) + 1, int(high[1]) - int(low[1]) + 1, where)
            with OpenEXR.File(file.name, separate_channels=True) as exr:
                channels = {name: np.asarray(channel.pixels, np.float32) for name, channel in exr.channels().items()}
        except FileError:
            raise
        except Exception as error:
            raise FileError(where, f"cannot be decoded as OpenEXR: {error}") from error
    names = [name for name in "RGBA" if name in channels] or [name for name in ("Y", *sorted(channels)) if name in channels][:1]
    if not names:
        raise FileError(where, "an OpenEXR file without channels")
    return np.stack([channels[name] for name in names], -1)


def _openexr(why: str) -> Any:
    try:
        import OpenEXR
    except ImportError as error:
        raise ExtraMissingError("OpenEXR", "exr", why) from error
    return OpenEXR


def _decode_hdr(data: bytes, where: str) -> Array:
    """Radiance RGBE, flat or run-length coded by component (Ward, "Real Pixels", Graphics Gems II)."""
    head, _, rest = data.partition(b"\n\n")
    size, _, body = rest.partition(b"\n")
    words = size.split()
    if len(words) != 4 or words[0] != b"-Y" or words[2] != b"+X" or b"32-bit_rle_xyze" in head:
        raise FileError(where, f"expected a Radiance picture of RGBE rows from the top, got {size[:40]!r}")
    height, width = int(words[1]), int(words[3])
    if not (0 < width < 2**15 and 0 < height < 2**15) or 4 * width * height > 64 * len(body):
        raise FileError(where, f"{width} x {height} pixels in {len(body)} bytes")
    if len(body) >= 4 and body[:2] == b"\x02\x02" and 8 <= width == body[2] << 8 | body[3]:
        rgbe = _unpack_runs(body, width, height, where)
    elif len(body) >= 4 * width * height:
        rgbe = np.frombuffer(body, np.uint8, 4 * width * height).reshape(height, width, 4)
    else:
        raise FileError(where, f"{width} x {height} pixels need {4 * width * height} bytes, {len(body)} are left")
    scale = np.where(rgbe[..., 3:] > 0, np.exp2(rgbe[..., 3:].astype(np.float32) - np.float32(136)), np.float32(0))
    return rgbe[..., :3] * scale


def _unpack_runs(body: bytes, width: int, height: int, where: str) -> Array:
    out = np.zeros((height, 4, width), np.uint8)
    place = 0
    for row in range(height):
        place += 4  # the mark and the width
        for component in range(4):
            x = 0
            while x < width:
                if place + 1 >= len(body):
                    raise FileError(where, f"row {row} of {height}: the file ends")
                count = body[place]
                run = count - 128 if count > 128 else count
                if not 0 < run <= width - x:
                    raise FileError(where, f"row {row}: a run of {run} in {width - x} pixels")
                if count > 128:
                    out[row, component, x : x + run] = body[place + 1]
                    place += 2
                else:
                    piece = body[place + 1 : place + 1 + run]
                    if len(piece) < run:
                        raise FileError(where, f"row {row} of {height}: the file ends")
                    out[row, component, x : x + run] = np.frombuffer(piece, np.uint8)
                    place += 1 + run
                x += run
    return out.transpose(0, 2, 1)


def write_png(path: str | os.PathLike[str], image: object) -> None:
    """Write (h, w) or (h, w, 1..4) uint8 as a PNG.

    Raises:
        InputError: Another shape or dtype.
        FileError: The file cannot be written.
    """
    array = np.asarray(image)
    if array.ndim == 2:
        array = array[..., None]
    if array.ndim != 3 or array.dtype != np.uint8 or not 1 <= array.shape[2] <= 4 or 0 in array.shape:
        raise InputError(f"write_png: expected (h, w, 1..4) uint8, got {array.shape} {array.dtype}")
    with PngStream(path, array.shape[1], array.shape[0], array.shape[2]) as png:
        png.write(array)


def png_bytes(image: Array) -> bytes:
    """The bytes of a PNG file of (h, w, 1..4) uint8, packed well (for pictures inside of other files)."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(image[..., 0] if image.shape[2] == 1 else image).save(out, "PNG", compress_level=3)
    return out.getvalue()


def write_image(path: str | os.PathLike[str], image: Array, quality: int = 95) -> None:
    """Write (h, w, 1..4) uint8 by the extension of `path`: .png, or anything that Pillow writes (alpha is left out where it cannot be held)."""
    from PIL import Image

    path = Path(path)
    if path.suffix.lower() == ".png":
        write_png(path, image)
        return
    extensions = Image.registered_extensions()
    if path.suffix.lower() not in extensions:
        raise FileError(path, f"no picture format has the extension {path.suffix or '(none)'}")
    kind = extensions[path.suffix.lower()]
    array = image[..., :3] if kind == "JPEG" and image.ndim == 3 and image.shape[2] == 4 else image
    array = array[..., 0] if array.ndim == 3 and array.shape[2] == 1 else array
    with atomic_write(path) as file, door(path, "cannot be written"):
        Image.fromarray(array).save(file, kind, quality=quality)


def write_exr(path: str | os.PathLike[str], layers: dict[str, Array], notes: dict[str, str] | None = None) -> None:
    """Write one OpenEXR file with named layers.

    Args:
        path: The file.
        layers: Name ("" for the main one) to (h, w) or (h, w, c), all of one size: float32, float16, or uint32. Channels are named RGBA (c of 1
            gives Y, or Z in the layer "depth"), XYZ for normals and positions, UV for texture coordinates. A name with a dot
            ("triangle.id") is a single channel's whole name.
        notes: Attributes for the file's header, by name: text, such as the unit.

    Raises:
        ExtraMissingError: The extra `exr` is not installed.
        InputError: Shapes differ, or a dtype is none of these.
        FileError: The file cannot be written.
    """
    OpenEXR = _openexr(f"writing {path}")
    channels: dict[str, Array] = {}
    sizes = {np.shape(array)[:2] for array in layers.values()}
    if len(sizes) != 1:
        raise InputError(f"write_exr: expected layers of one size, got {sorted(sizes)}")
    for name, array in layers.items():
        array = np.asarray(array)
        array = array[..., None] if array.ndim == 2 else array
        if array.ndim != 3 or array.dtype not in (np.float32, np.float16, np.uint32):
            raise InputError(f"write_exr, layer {name!r}: expected (h, w, c) float32, float16 or uint32, got {array.shape} {array.dtype}")
        for letter, k in zip(_letters(name, array.shape[2]), range(array.shape[2]), strict=True):
            full = name if "." in name and array.shape[2] == 1 else f"{name}.{letter}" if name else letter
            channels[full] = np.ascontiguousarray(array[..., k])
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **(notes or {})}
    with atomic_write(path) as file, door(path, "cannot be written"):
        OpenEXR.File(header, channels).write(file.name)


def exr_bytes(image: Array, notes: dict[str, str] | None = None) -> bytes:
    """The bytes of an OpenEXR file of one layer; as of `write_exr`."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder, unfinished(folder):  # OpenEXR writes files only
        path = Path(folder, "image.exr")
        write_exr(path, {"": image}, notes)
        return path.read_bytes()


def _letters(name: str, count: int) -> str:
    if name in ("normal", "position") and count == 3:
        return "XYZ"
    if name in ("texcoord", "motion", "barycentric"):
        return "UVW"[:count]
    if count == 1:
        return "Z" if name == "depth" else "Y"
    return "RGBA"[:count] if count >= 3 else "XY"
