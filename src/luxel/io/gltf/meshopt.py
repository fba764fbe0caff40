"""EXT_meshopt_compression: buffer views packed by meshoptimizer, through its own decoder (extra `meshopt`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import ExtraMissingError, FileError, UnsupportedError
from luxel.io.gltf.document import Document, Part

_FILTER_STRIDES = {"OCTAHEDRAL": (4, 8), "QUATERNION": (8,), "EXPONENTIAL": tuple(range(4, 257, 4))}


def decode(document: Document, view: Part, packed: Part) -> Array:
    """The decompressed bytes of buffer view `view`, uint8; `packed` is its extension object.

    Raises:
        ExtraMissingError: The package meshoptimizer is not installed.
        FileError: The parameters break the extension's rules, or the data cannot be decoded.
    """
    data = document.span(packed)
    count, stride = packed.integer("count"), packed.integer("byteStride", low=1, high=256)
    mode, name = packed.text("mode"), packed.text("filter", "NONE")
    if count * stride != view.integer("byteLength"):
        raise FileError(
            packed.where,
            f"count {count} x byteStride {stride} is not byteLength {view.integer('byteLength')} of the buffer view",
        )
    try:
        import meshoptimizer
    except ImportError as error:
        raise ExtraMissingError("meshoptimizer", "meshopt", f"{packed.where}: the extension") from error
    if mode == "ATTRIBUTES":
        return _attributes(meshoptimizer, packed.where, data, count, stride, name)
    if name != "NONE":
        raise FileError(packed.where, f"filter {name[:20]!r} in mode {mode[:20]!r}")
    return _indices(meshoptimizer, packed.where, data, count, stride, mode)


def _attributes(library: Any, where: str, data: Array, count: int, stride: int, name: str) -> Array:
    if stride % 4:
        raise FileError(where, f"byteStride: expected a multiple of 4, got {stride}")
    if name != "NONE" and name not in _FILTER_STRIDES:
        raise UnsupportedError(where, f"filter {name[:20]!r}")
    if name != "NONE" and stride not in _FILTER_STRIDES[name]:
        raise FileError(where, f"filter {name} with byteStride {stride}")
    # A block of up to 256 rows takes at least a byte for 16 rows of a column's group, so data cannot unfold without bound.
    _proportionate(where, count * stride, 512 * len(data) + 65536)
    out = _call(where, library.decode_vertex_buffer, count, stride, data, np.dtype((np.void, stride)))
    if name == "NONE" or not count:
        return out.view(np.uint8)
    function = {
        "OCTAHEDRAL": library.decode_filter_oct,
        "QUATERNION": library.decode_filter_quat,
        "EXPONENTIAL": library.decode_filter_exp,
    }[name]
    return _call(where, function, out.view(np.uint8), count, stride)


def _indices(library: Any, where: str, data: Array, count: int, stride: int, mode: str) -> Array:
    if mode not in ("TRIANGLES", "INDICES"):
        raise UnsupportedError(where, f"mode {mode[:20]!r}")
    if stride not in (2, 4):
        raise FileError(where, f"byteStride: expected 2 or 4 in mode {mode}, got {stride}")
    if mode == "TRIANGLES" and count % 3:
        raise FileError(where, f"count: expected a multiple of 3 in mode TRIANGLES, got {count}")
    _proportionate(where, count, 3 * len(data))
    function = library.decode_index_buffer if mode == "TRIANGLES" else library.decode_index_sequence
    out = _call(where, function, count, 4, data)
    if stride == 2 and count and int(out.max()) > 65535:
        raise FileError(where, f"index {int(out.max())} in 2 bytes")
    return out.astype("<u2" if stride == 2 else "<u4").view(np.uint8)


def _proportionate(where: str, size: int, most: int) -> None:
    if size > most:
        raise FileError(where, "its count is more than its compressed data can hold")


def _call(where: str, function: Any, *arguments: Any) -> Array:
    try:
        return function(*arguments)
    except (ValueError, RuntimeError) as error:
        raise FileError(where, f"cannot be decoded: {error}") from error
