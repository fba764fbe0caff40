"""A glTF document taken apart into bytes and put together again: only what was changed changes.

Buffer views keep their numbers, so extensions that luxel does not know may go on naming them. A view all of whose users moved gets their new data
in its place; where others still need it, the new data gets a view at the end. Buffers are then written anew, without gaps.
"""

from __future__ import annotations

import base64
import copy
import json
import mimetypes
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.files import atomic_write, tell
from luxel.io.gltf.accessors import sparse_parts, strided
from luxel.io.gltf.document import Document, Part, file_name

_COMPONENT = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_SHAPE = {"SCALAR": (1, 1), "VEC2": (2, 1), "VEC3": (3, 1), "VEC4": (4, 1), "MAT2": (2, 2), "MAT3": (3, 3), "MAT4": (4, 4)}
_PACKED = ("EXT_meshopt_compression", "KHR_meshopt_compression")


def element_size(part: Part) -> int:
    """Bytes of one element of an accessor; columns of matrices begin at multiples of 4 (glTF 2.0, section 3.6.2.4)."""
    code, kind = part.integer("componentType"), part.text("type")
    if code not in _COMPONENT or kind not in _SHAPE:
        raise FileError(part.where, f"type and componentType: got {kind[:20]!r} and {code}")
    rows, columns = _SHAPE[kind]
    column = rows * _COMPONENT[code]
    return column if columns == 1 else columns * (column + -column % 4)


def dense(document: Document, index: int, asked_by: str) -> Array:
    """(count, size) uint8: the elements of an accessor as they are stored, sparse ones put in."""
    part = document.item("accessors", index, asked_by)
    size, count = element_size(part), part.integer("count", low=1)
    if part.has("bufferView"):
        values = _bytes(document, part, count, size)
    elif count * size > 64 * max(document.size, 1 << 10):
        raise FileError(part.where, f"count {count} without a buffer view, in a file of {document.size} bytes")
    else:
        values = np.zeros((count, size), np.uint8)
    sparse = part.part("sparse")
    if sparse is not None:
        rows, fresh = sparse_rows(document, sparse, count, size)
        values = values.copy()
        values[rows] = fresh
    return values


def base(document: Document, index: int, asked_by: str) -> Array | None:
    """As `dense`, without what is sparse; None where the accessor has no buffer view."""
    part = document.item("accessors", index, asked_by)
    return _bytes(document, part, part.integer("count", low=1), element_size(part)) if part.has("bufferView") else None


def sparse_rows(document: Document, sparse: Part, count: int, size: int) -> tuple[Array, Array]:
    """Rows (k,) int64 and their elements (k, size) uint8."""
    where, what, code = sparse_parts(sparse)
    number = sparse.integer("count", low=1)
    width = _COMPONENT[code]
    rows = _bytes(document, where, number, width).copy().view(f"<u{width}")[:, 0].astype(np.int64)
    if int(rows.max()) >= count:
        raise FileError(where.where, f"row {int(rows.max())} of an accessor of {count}")
    return rows, _bytes(document, what, number, size)


def _bytes(document: Document, part: Part, count: int, size: int) -> Array:
    return strided(document, part, part.integer("bufferView"), part.integer("byteOffset", 0), count, np.dtype(np.uint8), size)


@dataclass
class Piece:
    """New bytes for what a JSON object (an accessor, or its sparse indices or values) names by bufferView and byteOffset.

    Attributes:
        owners: The objects; several where they named the same bytes.
        view: The view they named, or -1.
        offset: Where in it.
        data: (rows, size) uint8.
        space: Of which vertices: rows of one space may be interleaved.
    """

    owners: list[dict[str, Any]]
    view: int
    offset: int
    data: Array
    space: int = -1


class Package:
    """A document whose bytes can be replaced, and written.

    Attributes:
        document: As it was read; not changed.
        json: A copy of its JSON, to be changed.
        taken: Accessors of indices that somebody needs as they are now.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self.json: dict[str, Any] = copy.deepcopy(document.data)
        self.taken: set[int] = set()
        self._pieces: list[Piece] = []
        self._fresh: dict[int, bytes] = {}

    def replace(self, piece: Piece) -> None:
        """Give new bytes to the owners of `piece`."""
        self._pieces.append(piece)

    def _repack(self) -> None:
        """Lay the pieces out in views."""
        users = _users(self.json)
        views = self.json.setdefault("bufferViews", [])
        by_view: dict[int, list[Piece]] = {}
        for piece in self._pieces:
            by_view.setdefault(piece.view, []).append(piece)
        for view, pieces in by_view.items():
            moved = sum(len(piece.owners) for piece in pieces)
            stride = views[view].get("byteStride", 0) if view >= 0 else 0
            data = _blocks(pieces, stride)
            slot = view
            if view < 0 or users.get(view, 0) > moved:
                like = views[view] if view >= 0 else {"target": 34963}  # indices, which had no view
                fresh = {key: value for key, value in like.items() if key in ("byteStride", "target", "name")}
                views.append(fresh)
                slot = len(views) - 1
            elif any(views[slot].get("extensions", {}).pop(name, None) is not None for name in _PACKED):
                tell(self.document.where, "buffer views that were compressed by meshoptimizer are written as they are")
                if not views[slot]["extensions"]:
                    del views[slot]["extensions"]
            self._fresh[slot] = data
            for piece in pieces:
                for owner in piece.owners:
                    owner["bufferView"] = slot
        self._pieces = []
        for name in _PACKED:
            if not any(name in view.get("extensions", {}) for view in views):
                _forget(self.json, name)

    def save(self, path: Path, home: Path) -> None:
        """Write .glb, or .gltf with its buffers beside it; pictures beside the input come along, unless `home`, where it is to stand, has them."""
        self._repack()
        binary = path.suffix.lower() == ".glb"
        self._pictures(path, home, binary)
        self._tell_unnamed(binary)
        buffers = self._buffers(binary)
        if binary:
            _save_glb(path, self.json, buffers[0] if buffers else b"", self.document.chunks)
            return
        if self.document.chunks:
            names = ", ".join(repr(kind.to_bytes(4, "little"))[1:] for kind, _ in self.document.chunks)
            tell(self.document.where, f"chunks that only a .glb can hold are dropped: {names}")
        entries = self.json.get("buffers", [])
        files: dict[Path, bytes] = {}
        for i, data in buffers.items():
            if str(self.document.data["buffers"][i].get("uri", ""))[:5].lower() == "data:":
                entries[i]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
            else:
                name = f"{path.stem}.bin" if not files else f"{path.stem}_{i}.bin"
                entries[i]["uri"] = quote(name)
                files[path.with_name(name)] = data
        for place, data in files.items():
            with atomic_write(place) as file:
                file.write(data)
        with atomic_write(path) as file:
            file.write(_json(self.json))

    def _buffers(self, merged: bool) -> dict[int, bytes]:
        """The bytes of each buffer that has any, by number, with all views moved to where they now lie; in one, number 0, if `merged`."""
        views, entries = self.json.get("bufferViews", []), self.json.setdefault("buffers", [])
        old = self.document
        out: dict[int, bytearray] = {}
        written: dict[tuple[int, int, int], int] = {}
        named = {int(view.get("buffer", 0)) for view in old.data.get("bufferViews", [])}
        usual = min((i for i in named if self._stored(i)), default=0)  # for data that is new
        for i, view in enumerate(views):
            packed = next((view.get("extensions", {}).get(name) for name in _PACKED if name in view.get("extensions", {})), None)
            holder = view if packed is None or i in self._fresh else packed
            home = 0 if merged else int(holder.get("buffer", usual))
            if i in self._fresh:
                home = 0 if merged else home if self._stored(home) else usual
                data, key = self._fresh[i], None
            else:
                data = old.span(Part(f"{old.where}, buffer view {i}", holder)).tobytes()
                key = (int(holder.get("buffer", 0)), int(holder.get("byteOffset", 0)), len(data))
            target = out.setdefault(home, bytearray())
            place = written.get(key) if key is not None else None
            if place is None:
                target.extend(b"\0" * (-len(target) % 8))
                place = len(target)
                target.extend(data)
                if key is not None:
                    written[key] = place
            holder["buffer"], holder["byteOffset"], holder["byteLength"] = home, place, len(data)
        for i in range(0 if merged else old.count("buffers")):
            if i not in out and self._stored(i):
                out[i] = bytearray(old.buffer(i, old.where).tobytes())  # whatever asks for it: an extension that luxel does not know
        self._entries(entries, out, merged)
        return {i: bytes(data) for i, data in out.items()}

    def _tell_unnamed(self, merged: bool) -> None:
        """Say which bytes of the input go, because no buffer view names them; a buffer of which none names any stays where buffers do."""
        named: dict[int, list[tuple[int, int]]] = {}
        for view in self.document.data.get("bufferViews", []):
            holders = [view, *(packed for key in _PACKED if (packed := view.get("extensions", {}).get(key)) is not None)]
            for holder in holders:
                start = int(holder.get("byteOffset", 0))
                named.setdefault(int(holder.get("buffer", 0)), []).append((start, start + int(holder["byteLength"])))
        for i in range(self.document.count("buffers")):
            if not self._stored(i) or (i not in named and not merged):
                continue
            lost = _unnamed(self.document.buffer(i, self.document.where), named.get(i, []))
            if lost:
                tell(self.document.where, f"{lost} bytes of buffer {i} that no buffer view names are dropped")

    def _stored(self, index: int) -> bool:
        """Whether a buffer of the input has bytes of its own; one that only stands for decompressed data has none."""
        entries = self.document.data.get("buffers", [])
        return index < len(entries) and ("uri" in entries[index] or (index == 0 and self.document.binary is not None))

    def _entries(self, entries: list[dict[str, Any]], out: dict[int, bytearray], merged: bool) -> None:
        """The JSON of the buffers, for the bytes they now have; those that stand for decompressed data stay while a view names them."""
        if merged:
            kept = [(i, entry) for i, entry in enumerate(entries) if i and not self._stored(i)]
            number = {i: k + 1 for k, (i, _) in enumerate(kept)}
            for view in self.json.get("bufferViews", []):
                if any(name in view.get("extensions", {}) for name in _PACKED):
                    view["buffer"] = number.get(view["buffer"], 0)
            first = {key: value for key, value in entries[0].items() if key != "uri"} if entries else {}
            entries[:] = [first, *(entry for _, entry in kept)] if out or kept else []
        for i, data in out.items():
            while len(entries) <= i:
                entries.append({})
            entries[i]["byteLength"] = len(data)
        named = {view["buffer"] for view in self.json.get("bufferViews", [])} | set(out)
        while entries and len(entries) - 1 not in named:
            entries.pop()
        if not entries:
            del self.json["buffers"]
        if not self.json.get("bufferViews"):
            self.json.pop("bufferViews", None)

    def _pictures(self, path: Path, home: Path, binary: bool) -> None:
        """Pictures in files: into a .glb, or beside a .gltf in another folder."""
        folder = self.document.path.parent
        for i, image in enumerate(self.json.get("images", [])):
            uri = image.get("uri")
            if not isinstance(uri, str) or uri[:5].lower() == "data:" or (not binary and home.resolve() == folder.resolve()):
                continue
            try:
                data = self.document.resource(uri, f"{self.document.where}, image {i}").tobytes()
            except FileError as error:
                tell(self.document.where, f"a picture cannot be brought along: {error}")
                continue
            name = Path(file_name(uri))
            if binary:
                del image["uri"]
                image["mimeType"] = image.get("mimeType") or mimetypes.guess_type(name.name)[0] or "image/png"
                views = self.json.setdefault("bufferViews", [])
                views.append({})
                image["bufferView"] = len(views) - 1
                self._fresh[len(views) - 1] = data
                continue
            if name.is_absolute() or ".." in name.parts:
                name = Path(f"{i}_{name.name}")
                image["uri"] = quote(str(name))
            (path.parent / name).parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(path.parent / name) as file:
                file.write(data)


def _unnamed(data: Array, spans: list[tuple[int, int]]) -> int:
    """Bytes of a buffer outside all `spans`, without the zeros that align them."""
    lost, end = 0, 0
    for start, stop in [*sorted(spans), (len(data), len(data))]:
        gap = data[end:start] if start > end else data[:0]
        lost += len(gap) if gap.any() else 0
        end = max(end, stop)
    return lost


def _forget(data: dict[str, Any], extension: str) -> None:
    """Take an extension off the lists of those used and required."""
    for key in ("extensionsUsed", "extensionsRequired"):
        if extension in data.get(key, []):
            data[key] = [name for name in data[key] if name != extension]
            if not data[key]:
                del data[key]


def _users(data: Any) -> dict[int, int]:
    """How often each buffer view is named, anywhere in the JSON."""
    counts: dict[int, int] = {}
    stack = [data]
    while stack:
        item = stack.pop()
        if isinstance(item, dict):
            view = item.get("bufferView")
            if isinstance(view, int):
                counts[view] = counts.get(view, 0) + 1
            stack.extend(item.values())
        elif isinstance(item, list):
            stack.extend(item)
    return counts


def _groups(pieces: list[Piece], stride: int) -> list[list[Piece]]:
    """The pieces of one view in their order; those of one space that were interleaved are together."""
    groups: list[list[Piece]] = []
    latest: dict[int, list[Piece]] = {}
    for piece in sorted(pieces, key=lambda piece: piece.offset):
        group = latest.get(piece.space)
        if not stride or group is None or piece.offset - group[0].offset + piece.data.shape[1] > stride:
            group = latest[piece.space] = []
            groups.append(group)
        group.append(piece)
    return groups


def _blocks(pieces: list[Piece], stride: int) -> bytes:
    """The pieces of one view one after the other, interleaved ones interleaved again; sets the owners' byteOffset."""
    out = bytearray()
    for group in _groups(pieces, stride):
        first = group[0]
        out.extend(b"\0" * (-len(out) % 4))
        start = len(out)
        for piece in group:
            for owner in piece.owners:
                owner["byteOffset"] = start + piece.offset - first.offset
        if not stride:
            out.extend(first.data.tobytes())
            continue
        rows = np.zeros((len(first.data), stride), np.uint8)
        for piece in group:
            at = piece.offset - first.offset
            rows[:, at : at + piece.data.shape[1]] = piece.data
        out.extend(rows.tobytes())
    return bytes(out)


def _json(data: dict[str, Any]) -> bytes:
    try:
        return json.dumps(data, ensure_ascii=False, separators=(",", ":")).encode()
    except UnicodeEncodeError:  # half a surrogate pair in a name
        return json.dumps(data, separators=(",", ":")).encode()


def _save_glb(path: Path, data: dict[str, Any], binary: bytes, others: Sequence[tuple[int, Array]]) -> None:
    """A GLB: JSON, the binary buffer if there is one, and what other chunks the input had."""
    text = _json(data)
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = [(len(text), b"JSON", text)] + ([(len(binary), b"BIN\0", binary)] if binary else [])
    for kind, extra in others:
        chunks.append((len(extra), kind.to_bytes(4, "little"), extra.tobytes() + b"\0" * (-len(extra) % 4)))
    total = 12 + sum(8 + len(body) for _, _, body in chunks)
    if total >= 1 << 32:
        raise FileError(path, f"a GLB holds less than 4 GiB, this is {total} bytes; write .gltf")
    with atomic_write(path) as file:
        file.write(b"glTF" + np.array([2, total], "<u4").tobytes())
        for size, name, body in chunks:
            file.write(np.uint32(size).astype("<u4").tobytes() + name + body)
