"""STL: binary and ASCII. A soup of triangles; equal corners are joined again."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.build import build_mesh
from luxel.io.files import atomic_write, read_bytes, tell
from luxel.io.flatten import flatten
from luxel.io.text import parse
from luxel.scene.mesh import Mesh
from luxel.scene.normals import weld
from luxel.scene.scene import Scene

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84


def load(path: Path) -> Scene:
    """A scene of one mesh, or one for each `solid` of an ASCII file. The facets' own normals are not used."""
    raw = read_bytes(path)
    scene = Scene(name=path.stem)
    for name, corners in _ascii(raw, path.name) if _is_ascii(raw) else [("", _binary(raw, path.name))]:
        scene.add(_mesh(path.name, name, corners))
    return scene


def _is_ascii(raw: Array) -> bool:
    """Begins with `solid` and is not as long as a binary file with this count (many of those begin with `solid` too)."""
    head = raw[:_HEADER].tobytes()
    if head.lstrip()[:5].lower() != b"solid":
        return False
    count = int.from_bytes(head[80:84], "little")
    return len(head) < _HEADER or len(raw) != _HEADER + count * _FACET.itemsize


def _binary(raw: Array, where: str) -> Array:
    """(m, 3, 3) float32 corners."""
    if len(raw) < _HEADER:
        raise FileError(where, f"{len(raw)} bytes are too few for an STL file")
    count = int.from_bytes(raw[80:84].tobytes(), "little")
    held, rest = divmod(len(raw) - _HEADER, _FACET.itemsize)
    if count > held:
        raise FileError(where, f"the header says {count} triangles, the file holds {held}")
    if count < held or rest:
        tell(where, f"{len(raw) - _HEADER - count * _FACET.itemsize} bytes after the last triangle are ignored")
    facets = raw[_HEADER : _HEADER + count * _FACET.itemsize].view(_FACET)
    return facets["corners"].astype(np.float32)


def _ascii(raw: Array, where: str) -> list[tuple[str, Array]]:
    """Name and corners (m, 3, 3) of each solid."""
    text = raw.tobytes()
    if not re.search(rb"(?i)endsolid[^\n]*\s*\Z", text):
        raise FileError(where, "an ASCII STL file that does not end with endsolid")
    solids = []
    for part in re.split(rb"(?im)^[ \t]*endsolid[^\n]*$", text):
        match = re.match(rb"(?i)\s*solid[ \t]*([^\n]*)\n?", part)
        if not match:
            if part.strip():
                raise FileError(where, f"expected `solid`, got {part.strip()[:40].decode('utf-8', 'replace')!r}")
            continue
        numbers = b"\n".join(re.findall(rb"(?i)\bvertex\s+([^\n]*)", part))
        values = parse(numbers, float, f"{where}, a vertex")
        facets = len(re.findall(rb"(?i)\bfacet\s+normal", part))
        if len(values) != 9 * facets:
            raise FileError(where, f"{facets} facets need {9 * facets} coordinates, got {len(values)}")
        solids.append((match[1].decode("utf-8", "replace").strip(), values.reshape(-1, 3, 3)))
    return solids


def _mesh(where: str, name: str, corners: Array) -> Mesh:
    """Joined where corners are equal, so that the mesh is connected as it was before it became an STL file."""
    positions = corners.reshape(-1, 3).astype(np.float32, copy=False)
    first = weld(positions)
    triangles = np.arange(len(positions), dtype=np.int32)
    if first is not None:
        kept = np.flatnonzero(first == triangles)
        number = np.zeros(len(positions), np.int32)
        number[kept] = np.arange(len(kept), dtype=np.int32)
        triangles, positions = number[first], positions[kept]
    return build_mesh(where, positions, triangles.reshape(-1, 3), name=name)


def save(scene: Scene, path: Path) -> None:
    """Binary STL: all instances in world space, positions only."""
    mesh = flatten(scene, path.name, keeps=())
    if len(mesh.triangles) >= 2**32:
        raise FileError(path, f"STL holds at most 2^32 - 1 triangles, got {len(mesh.triangles)}")
    with atomic_write(path) as file:
        file.write(b"binary STL".ljust(80) + len(mesh.triangles).to_bytes(4, "little"))
        for start in range(0, len(mesh.triangles), 1 << 18):
            corners = mesh.positions[mesh.triangles[start : start + (1 << 18)]]
            facets = np.zeros(len(corners), _FACET)
            facets["corners"] = corners
            with np.errstate(all="ignore"):
                normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
                length = np.linalg.norm(normal, axis=1, keepdims=True)
                facets["normal"] = np.where(length > 0, normal / np.where(length > 0, length, 1), 0)
            file.write(facets.data)
