"""glTF and GLB laid out as they are: indices and what they index are rewritten, everything else of the file stays.

Primitives that share accessors, or name the same bytes by several, have one set of vertices: it is renumbered once, with joints, weights, morph
targets and attributes that only the file's author knows. Strips and fans become lists. Vertices stay where they are when something else
in the file may know their numbers; then triangles alone are ordered.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError, LuxelError, UnsupportedError
from luxel.io.files import tell
from luxel.io.gltf.accessors import read
from luxel.io.gltf.document import Document, Part
from luxel.io.gltf.geometry import primitive_triangles
from luxel.layout.clean import vertex_rows
from luxel.layout.gltf_pack import Package, Piece, base, dense, element_size, sparse_rows
from luxel.layout.measure import Draw
from luxel.layout.optimize import Laid, Options, Progress, Report, lay_out
from luxel.layout.same import Soup

_LISTS = (4, 5, 6)  # triangles, strip, fan
_HARMLESS = {"KHR_materials_variants", "EXT_mesh_features", "EXT_structural_metadata"}  # on primitives: they do not number vertices


@dataclass
class _Primitive:
    """One primitive of the file."""

    name: str
    part: Part
    mode: int
    indices: int | None
    attributes: dict[str, int]
    targets: list[dict[str, int]]
    cull: bool

    @property
    def accessors(self) -> list[int]:
        return [*self.attributes.values(), *(index for target in self.targets for index in target.values())]


@dataclass
class _Space:
    """Vertices that primitives share."""

    primitives: list[_Primitive] = field(default_factory=list)
    accessors: list[int] = field(default_factory=list)
    count: int = 0
    fixed: str = ""  # why they may not be renumbered
    keys: dict[tuple[int | None, int, int], list[_Primitive]] = field(default_factory=dict)  # one list of indices may be drawn several times
    lists: dict[tuple[int | None, int, int], Array] = field(default_factory=dict)
    drawn: list[tuple[int | None, int, int]] = field(default_factory=list)  # those that are triangles

    def rewritten(self, key: tuple[int | None, int, int]) -> bool:
        """Whether these indices become others."""
        return key in self.drawn or (bool(self.drawn) and not self.fixed)


def _primitives(document: Document) -> Iterator[_Primitive]:
    for i, mesh in enumerate(document.items("meshes")):
        for j, part in enumerate(mesh.parts("primitives", "primitive")):
            if part.extension("KHR_draco_mesh_compression") is not None:
                raise UnsupportedError(part.where, "KHR_draco_mesh_compression; decompress the file first")
            attributes = part.part("attributes")
            named = {} if attributes is None else {key: attributes.integer(key) for key in sorted(attributes.data)}
            targets = [{key: target.integer(key) for key in sorted(target.data)} for target in part.parts("targets", "target")]
            mode = part.integer("mode", 4, 0, 6)
            cull = not document.item("materials", part.integer("material"), part.where).flag("doubleSided") if part.has("material") else True
            yield _Primitive(f"mesh {i}, primitive {j}", part, mode, part.integer("indices", None), named, targets, cull)


def _place(document: Document, index: int, asked_by: str) -> tuple[Any, ...]:
    """Where an accessor's elements are stored: equal for accessors that name the same bytes."""
    part = document.item("accessors", index, asked_by)
    if not part.has("bufferView") or part.has("sparse"):
        return ("accessor", index)
    return (part.integer("bufferView"), part.integer("byteOffset", 0))


def _spaces(document: Document, primitives: list[_Primitive]) -> list[_Space]:
    """The sets of vertices, by which accessors stand together in a primitive or lie in the same bytes."""
    parent: dict[Any, Any] = {}

    def root(key: Any) -> Any:
        parent.setdefault(key, key)
        while parent[key] != key:
            parent[key] = parent[parent[key]]
            key = parent[key]
        return key

    for primitive in primitives:
        keys = [_place(document, index, primitive.part.where) for index in primitive.accessors]
        for key in keys[1:]:
            parent[root(key)] = root(keys[0])
    spaces: dict[Any, _Space] = {}
    elsewhere = _used_elsewhere(document)
    for primitive in primitives:
        if primitive.accessors:
            space = spaces.setdefault(root(_place(document, primitive.accessors[0], primitive.part.where)), _Space())
            space.primitives.append(primitive)
    for space in spaces.values():
        space.accessors = sorted({index for primitive in space.primitives for index in primitive.accessors})
        counts = {document.item("accessors", index, document.where).integer("count", low=1) for index in space.accessors}
        space.count = max(counts)
        for primitive in space.primitives:
            _check_counts(document, primitive)
        for primitive in space.primitives:
            count = document.item("accessors", primitive.accessors[0], document.where).integer("count")
            space.keys.setdefault((primitive.indices, primitive.mode, count), []).append(primitive)
        space.lists = {key: _indices(document, users[0], key[2]) for key, users in space.keys.items()}
        space.drawn = [key for key, found in space.lists.items() if key[1] in _LISTS and len(found)]
        space.fixed = _reason(space, counts, elsewhere)
    return list(spaces.values())


def _check_counts(document: Document, primitive: _Primitive) -> None:
    counts = {document.item("accessors", index, primitive.part.where).integer("count", low=1) for index in primitive.accessors}
    if len(counts) > 1:
        raise FileError(primitive.part.where, f"its attributes have {' and '.join(map(str, sorted(counts)))} elements")


def _reason(space: _Space, counts: set[int], elsewhere: set[int]) -> str:
    if len(counts) > 1:
        return "primitives that share vertices see different numbers of them"
    if elsewhere & set(space.accessors):
        return "something else in the file reads them"
    if any(key[1] in _LISTS and key not in space.drawn for key in space.keys):
        return "a primitive of them draws nothing"
    for primitive in space.primitives:
        odd = set(primitive.part.data.get("extensions") or {}) - _HARMLESS
        if odd:
            return f"the extension {sorted(odd)[0][:60]} may number them"
        if primitive.mode not in _LISTS and primitive.indices is None:
            return "points or lines without indices are drawn in their order"
    return ""


def _used_elsewhere(document: Document) -> set[int]:
    """Accessors of animations, skins and instancing."""
    used: set[int] = set()
    for animation in document.items("animations"):
        for sampler in animation.parts("samplers", "sampler"):
            used |= {sampler.integer(key) for key in ("input", "output") if sampler.has(key)}
    used |= {skin.integer("inverseBindMatrices") for skin in document.items("skins") if skin.has("inverseBindMatrices")}
    for node in document.items("nodes"):
        instancing = node.extension("EXT_mesh_gpu_instancing")
        attributes = instancing.part("attributes") if instancing is not None else None
        used |= {attributes.integer(key) for key in attributes.data} if attributes is not None else set()
    return used


def _indices(document: Document, primitive: _Primitive, count: int) -> Array:
    """(m, 3) int32 triangles; (k,) int64 for points and lines."""
    if primitive.mode in _LISTS:
        faces = primitive_triangles(document, primitive.part, count, primitive.mode)
        if len(faces) and not 0 <= int(faces.min()) <= int(faces.max()) < count:
            raise FileError(primitive.part.where, f"index {int(faces.max())} of {count} vertices")
        return faces
    if primitive.indices is None:
        return np.arange(count)
    flat = read(document, primitive.indices, primitive.part.where, types=("SCALAR",))[:, 0].astype(np.int64)
    if flat.size and int(flat.max()) >= count:
        raise FileError(primitive.part.where, f"index {int(flat.max())} of {count} vertices")
    return flat


def optimize(path: Path, options: Options, report: Report, progress: Progress | None = None) -> Package:
    """The document of `path`, laid out; `save` writes it.

    Raises:
        FileError: The file is malformed.
        UnsupportedError: Its geometry is compressed with Draco.
    """
    document = Document(path)
    package = Package(document)
    spaces = _spaces(document, list(_primitives(document)))
    for space in spaces:
        package.taken |= {key[0] for key in space.keys if key[0] is not None and not space.rewritten(key)}
    total, done = max(1, sum(space.count for space in spaces)), 0
    for number, space in enumerate(spaces):
        told = None if progress is None else lambda part, done=done, space=space: progress((done + part * space.count) / total)
        _lay_space(package, number, space, options, report, told)
        done += space.count
    return package


def _lay_space(package: Package, number: int, space: _Space, options: Options, report: Report, progress: Progress | None) -> None:
    document = package.document
    if space.fixed and any(primitive.mode in _LISTS for primitive in space.primitives):
        tell(document.where, f"vertices of {space.primitives[0].name} keep their numbers: {space.fixed}")
    if not space.drawn:
        return
    keys, lists, drawn = space.keys, space.lists, space.drawn
    positions = next((p.attributes["POSITION"] for p in space.primitives if "POSITION" in p.attributes), None)
    points = None if positions is None else np.require(read(document, positions, document.where, types=("VEC3",)), np.float32, ["C"])
    if points is not None and len(points) < space.count:
        points = None
    needed = [np.unique(lists[key]) for key in keys if key[1] not in _LISTS]
    laid = lay_out([lists[key] for key in drawn], space.count, options, report, points, lambda: _rows(document, space),
                   all(p.cull for p in space.primitives), not space.fixed, np.concatenate(needed) if needed else None, progress)  # fmt: skip
    if not space.fixed:
        for index in _unique(document, space.accessors):
            _rewrite(package, number, index, space, laid)
    for key, faces in zip(drawn, laid.triangles, strict=True):
        _set_indices(package, keys[key], faces.reshape(-1), space.count)
    for key in keys:
        if key not in drawn and space.rewritten(key):
            _set_indices(package, keys[key], laid.vertex_target[lists[key]], space.count)


def _unique(document: Document, accessors: list[int]) -> list[list[int]]:
    """Accessors that name the same elements, together."""
    places: dict[Any, list[int]] = {}
    for index in accessors:
        part = document.item("accessors", index, document.where)
        places.setdefault((*_place(document, index, document.where), element_size(part)), []).append(index)
    return list(places.values())


def _rows(document: Document, space: _Space) -> Array:
    return vertex_rows([dense(document, index, document.where) for index in space.accessors])


def _rewrite(package: Package, number: int, indices: list[int], space: _Space, laid: Laid) -> None:
    """New bytes for accessors of vertices (that name the same), in the new order."""
    document, first = package.document, indices[0]
    part = document.item("accessors", first, document.where)
    owners = [package.json["accessors"][index] for index in indices]
    count = len(laid.vertex_source)
    if count == 0:  # glTF has no accessors of nothing: the file keeps its vertices, which nothing draws
        return
    stored = base(document, first, document.where)
    if stored is not None:
        package.replace(Piece(owners, part.integer("bufferView"), part.integer("byteOffset", 0), stored[laid.vertex_source], number))
    if part.part("sparse") is not None:
        _rewrite_sparse(package, part, owners[0], laid)
    for owner in owners:
        owner["count"] = count
        if count != space.count and ("min" in owner or "max" in owner):
            _set_bounds(owner, document, first, laid.vertex_source)


def _rewrite_sparse(package: Package, part: Part, owner: dict[str, Any], laid: Laid) -> None:
    """The rows of a sparse accessor under their new numbers, ascending."""
    sparse = part.part("sparse")
    assert sparse is not None
    rows, values = sparse_rows(package.document, sparse, part.integer("count"), element_size(part))
    moved = laid.vertex_target[rows]
    # Of vertices welded into one all are equal: any speaks for the vertex.
    target, last = np.unique(moved[::-1], return_index=True)
    values = values[::-1][last][target >= 0]
    target = target[target >= 0]
    if not len(target):
        del owner["sparse"]
        return
    owner["sparse"]["count"] = len(target)
    for key, data in (("indices", target.astype(np.uint32)), ("values", values)):
        place = sparse.part(key)
        assert place is not None
        if key == "indices":
            width = {5121: 1, 5123: 2, 5125: 4}[place.integer("componentType")]
            data = data.astype(f"<u{width}").view(np.uint8).reshape(len(data), width)
        package.replace(Piece([owner["sparse"][key]], place.integer("bufferView"), place.integer("byteOffset", 0), np.ascontiguousarray(data)))


def _set_bounds(owner: dict[str, Any], document: Document, index: int, source: Array) -> None:
    """min and max, of the vertices that are left."""
    codes = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
    if owner["type"].startswith("MAT"):
        owner.pop("min", None), owner.pop("max", None)
        return
    typed = np.ascontiguousarray(dense(document, index, document.where)[source]).view(codes[owner["componentType"]])
    owner["min"], owner["max"] = typed.min(0).tolist(), typed.max(0).tolist()


def _set_indices(package: Package, primitives: list[_Primitive], flat: Array, count: int) -> None:
    """Let primitives draw by the indices `flat`; their own accessor is used again unless others need it."""
    accessors = package.json.setdefault("accessors", [])
    old = primitives[0].indices
    if not flat.size:  # glTF cannot say "no triangle"
        flat = np.zeros(3, np.int32)
    view, offset = -1, 0
    if old is None or old in package.taken:
        like = {"componentType": 5123 if count <= 65535 else 5125, "type": "SCALAR"} if old is None else accessors[old]
        accessors.append({key: value for key, value in like.items() if key not in ("sparse", "byteOffset", "bufferView")})
        number = len(accessors) - 1
    else:
        number = old
        part = package.document.item("accessors", old, primitives[0].part.where)
        view, offset = (part.integer("bufferView"), part.integer("byteOffset", 0)) if part.has("bufferView") else (-1, 0)
    package.taken.add(number)
    owner = accessors[number]
    owner.pop("sparse", None)
    width = {5121: 1, 5123: 2, 5125: 4}[owner["componentType"]]
    package.replace(Piece([owner], view, offset, flat.astype(f"<u{width}").view(np.uint8).reshape(len(flat), width)))
    owner["count"] = len(flat)
    if "min" in owner or "max" in owner:
        owner["min"], owner["max"] = [int(flat.min())], [int(flat.max())]
    for primitive in primitives:
        data = _json_of(package, primitive)
        data["indices"] = number
        if primitive.mode in (5, 6):
            data.pop("mode", None)


def _json_of(package: Package, primitive: _Primitive) -> dict[str, Any]:
    words = primitive.name.replace(",", "").split()
    data: dict[str, Any] = package.json["meshes"][int(words[1])]["primitives"][int(words[3])]
    return data


# What a file holds, for measures and for proof


def contents(path: Path) -> tuple[list[Draw], dict[str, Soup]]:
    """Draw calls of a file, each list of triangles once, and its primitives as soups with the raw bytes of every attribute."""
    document = Document(path)
    draws: dict[Any, Draw] = {}
    soups: dict[str, Soup] = {}
    for primitive in _primitives(document):
        if not primitive.accessors:
            continue
        _check_counts(document, primitive)
        arrays = [dense(document, index, primitive.part.where) for index in primitive.accessors]
        count = len(arrays[0])
        faces = _indices(document, primitive, count)
        kind = ", ".join(f"{key} {_kind(document, index)}" for key, index in primitive.attributes.items())
        name = f"{primitive.name} ({kind}; material {primitive.part.data.get('material')})"
        positions = None
        if "POSITION" in primitive.attributes:
            positions = read(document, primitive.attributes["POSITION"], primitive.part.where, types=("VEC3",))
        if primitive.mode not in _LISTS:  # in sequence: a triangle of one corner, and its number
            number = np.arange(len(faces), dtype=np.uint32)[:, None]
            soups[name] = Soup(np.repeat(faces[:, None], 3, 1).astype(np.int32), vertex_rows(arrays), None, number)
            continue
        faces = np.ascontiguousarray(faces, np.int32)
        soups[name] = Soup(faces, vertex_rows(arrays), positions)
        stride = sum(array.shape[1] for array in arrays[: len(primitive.attributes)])
        draws.setdefault((primitive.indices, primitive.mode, *primitive.attributes.values()), Draw(faces, count, stride))
    return list(draws.values()), soups


def _kind(document: Document, index: int) -> str:
    part = document.item("accessors", index, document.where)
    return f"{part.text('type')}{'n' if part.flag('normalized') else ''}{part.integer('componentType')}"


def rest_differs(before: Path, after: Path) -> str | None:
    """What differs between two files beside geometry: JSON, animations, skins, instances, pictures; None if nothing does."""
    old, new = Document(before), Document(after)
    geometry = ("accessors", "bufferViews", "buffers", "meshes", "images", "extensionsUsed", "extensionsRequired")
    for key in sorted(set(old.data) | set(new.data)):
        if key not in geometry and old.data.get(key) != new.data.get(key):
            return f"{key} are not the same"
    for a, b in zip(old.data.get("meshes", []), new.data.get("meshes", []), strict=True):
        if _bare(a) != _bare(b):
            return f"mesh {a.get('name', '')!r} is not the same beside its triangles"
    for index in sorted(_used_elsewhere(old)):
        if not np.array_equal(dense(old, index, old.where), dense(new, index, new.where)):
            return f"accessor {index} is not the same"
    if before.suffix.lower() == after.suffix.lower() and not _same_chunks(old, new):
        return "chunks beside JSON and the binary buffer are not the same"
    return _pictures_differ(old, new)


def _same_chunks(old: Document, new: Document) -> bool:
    return [(kind, data.tobytes()) for kind, data in old.chunks] == [(kind, data.tobytes()) for kind, data in new.chunks]


def _bare(mesh: dict[str, Any]) -> dict[str, Any]:
    primitives = [{key: value for key, value in p.items() if key not in ("indices", "mode")} for p in mesh.get("primitives", [])]
    return {**mesh, "primitives": primitives}


def _pictures_differ(old: Document, new: Document) -> str | None:
    if old.count("images") != new.count("images"):
        return "pictures are missing"
    for i in range(old.count("images")):
        a, b = (_picture(document, i) for document in (old, new))
        if a is not None and b is not None and a != b:
            return f"picture {i} is not the same"
    return None


def _picture(document: Document, index: int) -> bytes | None:
    part = document.item("images", index, document.where)
    try:
        if part.has("bufferView"):
            return document.view(part.integer("bufferView"), part.where)[0].tobytes()
        return document.resource(part.text("uri"), part.where).tobytes()
    except LuxelError:
        return None  # it was missing before
