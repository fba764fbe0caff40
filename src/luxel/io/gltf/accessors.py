"""Accessors: typed arrays out of buffer views, with stride, sparse values and normalised integers."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.gltf.document import Document, Part

_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def read(document: Document, index: int, asked_by: str, *, types: tuple[str, ...], rows: int | None = None) -> Array:
    """Accessor `index` as stored, (count, width); float32 where it is float or normalised.

    Args:
        document: The file.
        index: Of the accessor.
        asked_by: Place for errors about the index itself.
        types: glTF types that fit ("VEC3", ...).
        rows: The count that is needed, or None for any.

    Raises:
        FileError: It does not fit, or reaches outside of its buffer view.
    """
    part = document.item("accessors", index, asked_by)
    kind, count = part.text("type"), part.integer("count", low=1)
    if kind not in types or kind not in _WIDTHS:
        raise FileError(part.where, f"type: expected {' or '.join(types)}, got {kind[:20]!r}")
    if rows is not None and count != rows:
        raise FileError(part.where, f"count: expected {rows} as of the others of its primitive, got {count}")
    code = part.integer("componentType")
    if code not in _COMPONENTS:
        raise FileError(part.where, f"componentType: expected one of {sorted(_COMPONENTS)}, got {code}")
    dtype, width = np.dtype(_COMPONENTS[code]), _WIDTHS[kind]
    if part.has("bufferView"):
        values = strided(document, part, part.integer("bufferView"), part.integer("byteOffset", 0), count, dtype, width)
    elif count * dtype.itemsize > 64 * document.size:
        raise FileError(part.where, f"count {count} without a buffer view, in a file of {document.size} bytes")
    else:
        values = np.zeros((count, width), dtype)
    sparse = part.part("sparse")
    if sparse is not None:
        values = _with_sparse(document, sparse, values)
    return _normalised(values) if part.flag("normalized") else values


def strided(document: Document, part: Part, view: int, offset: int, count: int, dtype: np.dtype, width: int) -> Array:
    """(count, width) of `dtype`: a view of the buffer where it is aligned, else a copy.

    Raises:
        FileError: The elements overlap, or end beyond the buffer view.
    """
    data, stride = document.view(view, part.where)
    item = dtype.itemsize * width
    stride = stride or item
    if stride < item and count > 1:
        raise FileError(part.where, f"byteStride {stride} is less than the {item} bytes of an element")
    needed = (count - 1) * stride + item
    if offset + needed > len(data):
        raise FileError(part.where, f"count {count} needs {needed} bytes from byte {offset} of a buffer view of {len(data)}")
    values = np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))
    return values if values.flags.aligned else values.copy()


def sparse_parts(sparse: Part) -> tuple[Part, Part, int]:
    """Where the rows of a sparse accessor are told, where their values, and the component type of the rows.

    Raises:
        FileError: One of them is missing, or the rows are no unsigned integers.
    """
    where, what = sparse.part("indices"), sparse.part("values")
    if where is None or what is None:
        raise FileError(sparse.where, "indices and values: expected both")
    code = where.integer("componentType")
    if code not in (5121, 5123, 5125):
        raise FileError(where.where, f"componentType: expected 5121, 5123 or 5125, got {code}")
    return where, what, code


def _with_sparse(document: Document, sparse: Part, values: Array) -> Array:
    """A copy of `values` with the sparse ones put in."""
    count = sparse.integer("count", low=1)
    where, what, code = sparse_parts(sparse)
    rows = strided(
        document,
        where,
        where.integer("bufferView"),
        where.integer("byteOffset", 0),
        count,
        np.dtype(_COMPONENTS[code]),
        1,
    )[:, 0]
    fresh = strided(document, what, what.integer("bufferView"), what.integer("byteOffset", 0), count, values.dtype, values.shape[1])
    if int(rows.max()) >= len(values):
        raise FileError(where.where, f"row {int(rows.max())} of an accessor of {len(values)}")
    values = values.copy()
    values[rows] = fresh
    return values


def _normalised(values: Array) -> Array:
    """Integers as float32 in 0..1 or -1..1 (glTF 2.0, section 3.6.2.2)."""
    if values.dtype.kind == "f":
        return values
    scaled = values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
    return np.maximum(scaled, np.float32(-1)) if values.dtype.kind == "i" else scaled
