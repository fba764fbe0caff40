"""PLY (the Stanford polygon format): ASCII and both binary byte orders.

Read here and not through trimesh, which reads no binary file that mixes triangles with other polygons, takes 2.4 times the memory and 3
times the time on 10 M triangles in binary (7 times in ASCII), and costs most of a second to import.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import IO, Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.build import build_mesh, turned
from luxel.io.files import atomic_write, open_plain, tell
from luxel.io.flatten import flatten
from luxel.io.ply_rows import ROWS, Columns, Element, Lists, Property, ascii_reader, binary_reader
from luxel.io.polygons import strip, triangulate, unify
from luxel.scene.colour import bytes_from_linear, linear_from_srgb
from luxel.scene.material import Material, TextureRef
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

_DTYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
    "int64": "i8",
    "uint64": "u8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
INDEX_NAMES = ("vertex_indices", "vertex_index")
_TEXCOORD_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_LONGEST_HEADER = 1 << 20


def load(path: Path) -> Scene:
    """A scene of one mesh. Vertex colours are decoded from sRGB; texture coordinates are turned to glTF's v = 0 at the top."""
    with open_plain(path) as file:
        order, elements, texture = read_header(file, path.name)
        read = binary_reader(file, path) if order else ascii_reader(file, path)
        columns: dict[str, Columns] = {}
        for element in elements:
            if element.rows and element.properties:
                columns[element.name] = read(element)
    return scene_of(path, columns, texture)


def scene_of(path: Path, columns: dict[str, Columns], texture: str = "") -> Scene:
    """The scene of a file's elements, by name; `texture` is the name of the picture file, or ""."""
    scene = Scene(name=path.stem)
    mesh = _mesh(path.name, columns)
    if texture and mesh.texcoords is not None:
        from luxel.io.images import load_texture

        loaded = load_texture(path.parent / texture, f"{path.name}, TextureFile")
        if loaded is not None:
            scene.textures.append(loaded)
            scene.materials.append(Material(base_color=(1, 1, 1, 1), base_color_texture=TextureRef(0)))
            mesh.material = 0
    scene.add(mesh)
    return scene


def read_header(file: IO[bytes], where: str) -> tuple[str, list[Element], str]:
    """Byte order ("" for ASCII), the elements, the texture's file name ("" for none); leaves `file` at the data.

    Raises:
        FileError: It is no header of a PLY.
    """
    head = file.read(_LONGEST_HEADER)
    match = re.search(rb"(?m)^end_header[ \t]*(\r\n|\r|\n|\Z)", head)
    if not re.match(rb"ply\s", head) or not match:
        raise FileError(where, "expected a PLY header from `ply` to `end_header`")
    file.seek(match.end())
    order: str | None = None
    elements: list[Element] = []
    texture = ""
    for number, line in enumerate(head[: match.start()].decode("utf-8", "replace").splitlines(), 1):
        words = line.split()
        at = f"{where}, line {number}"
        if not words or words[0] in ("ply", "obj_info"):
            continue
        known = [p.name for p in elements[-1].properties] if words[0] == "property" and elements else [e.name for e in elements]
        if len(words) > 1 and words[0] in ("element", "property") and words[1 if words[0] == "element" else -1] in known:
            raise FileError(at, f"{words[0]} {words[-1][:40]!r} comes twice")
        if words[0] == "format" and len(words) >= 2 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif words[0] == "element" and len(words) == 3 and re.fullmatch(r"\d{1,18}", words[2]):
            elements.append(Element(words[1], int(words[2])))
        elif words[0] == "property" and elements and order is not None:
            elements[-1].properties.append(_property(words, order, at))
        elif words[0] == "comment":
            found = re.match(r"\s*comment\s+TextureFile\s+(.+)", line, re.IGNORECASE)
            texture = found[1].strip() if found else texture
        else:
            raise FileError(at, f"expected format, element, property or comment, got {line[:80]!r}")
    if order is None:
        raise FileError(where, "the header has no format line")
    return order, elements, texture


def _property(words: list[str], order: str, at: str) -> Property:
    kinds = words[2:4] if words[1:2] == ["list"] else words[1:2]
    if not kinds or len(words) != len(kinds) + (3 if len(kinds) == 2 else 2) or any(kind not in _DTYPES for kind in kinds):
        raise FileError(at, f"expected `property TYPE NAME` or `property list TYPE TYPE NAME`, got {' '.join(words)[:80]!r}")
    dtypes = [np.dtype((order or "<") + _DTYPES[kind]) for kind in kinds]
    if len(dtypes) == 2 and dtypes[0].kind == "f":
        raise FileError(at, f"the length of a list cannot be a {kinds[0]}")
    return Property(words[-1], dtypes[-1], dtypes[0] if len(dtypes) == 2 else None)


def _mesh(where: str, columns: dict[str, Columns]) -> Mesh:
    vertex = columns.get("vertex", {})
    positions = _stack(vertex, ("x", "y", "z"))
    if positions is None:
        raise FileError(f"{where}, element vertex", "expected rows with the properties x, y and z")
    attributes: dict[str, Any] = {"normals": _stack(vertex, ("nx", "ny", "nz")), "colors": _colors(vertex)}
    for names in _TEXCOORD_NAMES:
        uv = _stack(vertex, names)
        if uv is not None and "texcoords" not in attributes:
            attributes["texcoords"] = turned(uv)
    triangles, corners, texcoords = _triangles(where, columns, positions)
    if texcoords is not None:  # given for each corner: a vertex for each pair that differs
        rows, kind = np.unique(np.require(texcoords, np.float32, "C").view(np.uint64), return_inverse=True)
        good = (corners >= 0) & (corners < len(positions))
        first, triangles = unify([np.where(good, corners, 0), kind.reshape(-1)])
        triangles = np.where(good, triangles, -1).reshape(-1, 3)
        source = np.where(good, corners, 0)[first]
        positions = positions[source]
        attributes = {key: value[source] for key, value in attributes.items() if value is not None}
        attributes["texcoords"] = turned(rows.view(np.float32).reshape(-1, 2)[kind.reshape(-1)[first]])
    return build_mesh(where, positions, triangles, **attributes)


def _triangles(where: str, columns: dict[str, Columns], positions: Array) -> tuple[Array, Array, Array | None]:
    """Triangles (m, 3), the vertex at each of their corners (3 m,), and texture coordinates (3 m, 2) if corners have their own."""
    strips = columns.get("tristrips", {}).get("vertex_indices")
    if isinstance(strips, Lists):
        flat = integers(strips.values, f"{where}, element tristrips")
        cuts = np.flatnonzero(flat == -1)
        ends = np.union1d(cuts, np.cumsum(strips.counts))
        parts = [strip(part[part >= 0]) for part in np.split(flat, ends)]
        triangles = np.concatenate([part for part in parts if len(part)] or [np.zeros((0, 3), np.int64)])
        return triangles, triangles.reshape(-1), None
    face = columns.get("face", {})
    if "red" in face:
        tell(where, "colours of faces are ignored")
    lists = next((face[name] for name in INDEX_NAMES if isinstance(face.get(name), Lists)), None)
    if lists is None:
        if face:
            raise FileError(f"{where}, element face", "expected a list property vertex_indices")
        return np.zeros((0, 3), np.int32), np.zeros(0, np.int32), None
    flat = integers(lists.values, f"{where}, element face")
    uv = face.get("texcoord")
    texcoords = uv.values.reshape(-1, 2) if isinstance(uv, Lists) and np.array_equal(uv.counts, 2 * lists.counts) else None
    if len(flat) == 3 * len(lists.counts) and (lists.counts == 3).all():
        return flat.reshape(-1, 3), flat, texcoords
    few = int(np.count_nonzero(lists.counts < 3))
    if few:
        tell(where, f"{few} faces with fewer than 3 corners are dropped")
    within = np.clip(flat, 0, len(positions) - 1)  # only to choose where to cut; build_mesh drops what is out of range
    cut = triangulate(lists.counts, within, positions).reshape(-1)
    triangles = flat[cut]
    return triangles.reshape(-1, 3), triangles, None if texcoords is None else texcoords[cut]


def integers(values: Array, at: str) -> Array:
    """Vertex indices as whole numbers; some writers store them as floats.

    Raises:
        FileError: One is not finite, or not below 2^53; `at` says where.
    """
    if values.dtype.kind == "f":
        if not (np.isfinite(values) & (np.abs(values) < 2**53)).all():
            raise FileError(at, "vertex indices that are not finite numbers")
        return values.astype(np.int64)
    return values


def _stack(vertex: Columns, names: tuple[str, ...]) -> Array | None:
    """(n, len(names)) float32 of scalar properties, which are taken out of `vertex` so that no second copy stays; None if one is missing."""
    if any(not isinstance(vertex.get(name), np.ndarray) for name in names):
        return None
    out = np.empty((len(vertex[names[0]]), len(names)), np.float32)
    for k, name in enumerate(names):
        out[:, k] = vertex.pop(name)
    return out


def _colors(vertex: Columns) -> Array | None:
    for prefix in ("", "diffuse_"):
        red = vertex.get(f"{prefix}red")
        encoded = _stack(vertex, (f"{prefix}red", f"{prefix}green", f"{prefix}blue"))
        if encoded is not None:
            break
    else:
        return None
    assert isinstance(red, np.ndarray)
    alpha = vertex.get("alpha")
    kind = red.dtype
    scale = np.iinfo(kind).max if kind.kind in "iu" else 255 if encoded.max(initial=0) > 1 else 1
    out = np.ones((len(encoded), 4), np.float32)
    out[:, :3] = linear_from_srgb(np.clip(encoded / np.float32(scale), 0, 1))
    if isinstance(alpha, np.ndarray):
        out[:, 3] = np.clip(alpha / scale, 0, 1)
    return out


def save(scene: Scene, path: Path) -> None:
    """Binary little-endian PLY: all instances in world space, with normals, colours (sRGB, 8 bits) and texture coordinates."""
    mesh = flatten(scene, path.name, keeps=("normals", "texcoords", "colors"))
    fields: list[Any] = [(name, "<f4") for name in "xyz"]
    parts = [mesh.positions]
    if mesh.normals is not None:
        fields += [(name, "<f4") for name in ("nx", "ny", "nz")]
        parts.append(mesh.normals)
    if mesh.texcoords is not None:
        fields += [("s", "<f4"), ("t", "<f4")]
        parts.append(turned(mesh.texcoords))
    if mesh.colors is not None:
        fields += [(name, "u1") for name in ("red", "green", "blue", "alpha")]
        alpha = np.clip(mesh.colors[:, 3:] * 255 + 0.5, 0, 255).astype(np.uint8)
        parts += [bytes_from_linear(mesh.colors[:, :3]), alpha]
    kinds = {"<f4": "float", "u1": "uchar"}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.positions)}"]
    header += [f"property {kinds[kind]} {name}" for name, kind in fields]
    header += [f"element face {len(mesh.triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    with atomic_write(path) as file:
        file.write("\n".join(header).encode())
        for start in range(0, len(mesh.positions), ROWS):
            rows = np.empty(len(mesh.positions[start : start + ROWS]), fields)
            columns = (column for part in parts for column in part[start : start + ROWS].T)
            for (name, _), column in zip(fields, columns, strict=True):
                rows[name] = column
            file.write(rows.data)
        for start in range(0, len(mesh.triangles), ROWS):
            triangles = mesh.triangles[start : start + ROWS]
            faces = np.empty(len(triangles), [("count", "u1"), ("vertices", "<i4", 3)])
            faces["count"], faces["vertices"] = 3, triangles
            file.write(faces.data)
