"""Small files of every format, made by code, for the tests of luxel.io."""

import base64
import json
import struct
import zlib
from pathlib import Path

import numpy as np

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def png(width=2, height=2, value=200, channels=3) -> bytes:
    """A PNG file of one value."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = (b"\0" + bytes([value]) * (width * channels)) * height
    kind = {1: 0, 3: 2, 4: 6}[channels]
    head = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def data_uri(data: bytes, mime="application/octet-stream") -> str:
    return f"data:{mime};base64,{base64.b64encode(data).decode()}"


class Gltf:
    """A glTF file under construction: `json` may be changed before it is written."""

    def __init__(self):
        self.data = bytearray()
        self.json = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], "meshes": [], "nodes": [], "materials": []}

    def append(self, key, value) -> int:
        self.json.setdefault(key, []).append(value)
        return len(self.json[key]) - 1

    def view(self, data: bytes, **more) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        offset = len(self.data)
        self.data += data
        return self.append("bufferViews", {"buffer": 0, "byteOffset": offset, "byteLength": len(data), **more})

    def accessor(self, array, view=None, **more) -> int:
        array = np.ascontiguousarray(array)
        width = 1 if array.ndim == 1 else array.shape[1]
        view = self.view(array.tobytes()) if view is None else view
        kind = {"componentType": COMPONENTS[array.dtype.str[1:]], "type": TYPES[width], "count": len(array)}
        return self.append("accessors", {"bufferView": view, **kind, **more})

    def primitive(self, positions=TETRAHEDRON, indices=FACES, **attributes) -> dict:
        """A primitive of arrays; other keyword arguments are accessor numbers."""
        primitive = {"attributes": {"POSITION": self.accessor(positions), **attributes}}
        if indices is not None:
            primitive["indices"] = self.accessor(np.asarray(indices, np.uint16).reshape(-1))
        return primitive

    def mesh(self, *primitives, **more) -> int:
        return self.append("meshes", {"primitives": list(primitives), **more})

    def node(self, **more) -> int:
        return self.append("nodes", more)

    def write(self, path: Path) -> Path:
        buffer = {"byteLength": len(self.data)}
        if path.suffix == ".glb":
            self.json.setdefault("buffers", [buffer])
            path.write_bytes(glb(json.dumps(self.json).encode(), bytes(self.data)))
        else:
            self.json.setdefault("buffers", [buffer | {"uri": data_uri(bytes(self.data))}])
            path.write_text(json.dumps(self.json))
        return path


def glb(text: bytes, data: bytes) -> bytes:
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def full_gltf() -> Gltf:
    """A file that uses much of the format."""
    g = Gltf()
    normals = g.accessor(np.tile(np.float32([0, 0, 1]), (4, 1)))
    uv = g.accessor(np.float32([[0, 0], [1, 0], [0, 1], [1, 1]]))
    color = g.accessor(np.full((4, 4), 255, np.uint8), normalized=True)
    g.json["images"] = [{"bufferView": g.view(png()), "mimeType": "image/png"}]
    g.json["samplers"] = [{"magFilter": 9728, "minFilter": 9728, "wrapS": 33071}]
    g.json["textures"] = [{"source": 0, "sampler": 0}]
    transform = {"KHR_texture_transform": {"offset": [0.5, 0], "scale": [2, 2]}}
    g.append("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": transform}}, "normalTexture": {"index": 0}})
    primitive = g.primitive(NORMAL=normals, TEXCOORD_0=uv, COLOR_0=color) | {"material": 0}
    rows = g.view(np.uint16([1]).tobytes())
    moved = g.view(np.float32([[0.5, 0, 0]]).tobytes())
    sparse = {"count": 1, "indices": {"bufferView": rows, "componentType": 5123}, "values": {"bufferView": moved}}
    primitive["targets"] = [{"POSITION": g.append("accessors", {"componentType": 5126, "type": "VEC3", "count": 4, "sparse": sparse})}]
    mesh = g.mesh(primitive, weights=[1.0])
    g.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]
    g.json["extensionsUsed"] = ["KHR_texture_transform", "KHR_lights_punctual"]
    g.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {"innerConeAngle": 0.1}}]}}
    child = g.node(camera=0, rotation=[0, 0, 0, 1], extensions={"KHR_lights_punctual": {"light": 0}})
    root = g.node(mesh=mesh, children=[child], translation=[1, 2, 3], name="root")
    g.json["scenes"], g.json["scene"] = [{"nodes": [root]}], 0
    return g


def ply(binary="", faces=FACES, colors=True, dtype="float") -> bytes:
    """PLY: `binary` is "", "<" or ">"."""
    form = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[binary]
    lines = ["ply", f"format {form} 1.0", "comment made by code", "element vertex 4"]
    lines += [f"property {dtype} {name}" for name in "xyz"]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue")] * colors
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    head = "\n".join(lines).encode()
    color = [255, 128, 0] if colors else []
    if not binary:
        rows = [[*row, *color] for row in TETRAHEDRON.tolist()] + [[len(face), *map(int, face)] for face in faces]
        return head + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    real = "d" if dtype == "double" else "f"
    body = b"".join(struct.pack(f"{binary}3{real}", *row) + bytes(color) for row in TETRAHEDRON.tolist())
    return head + body + b"".join(struct.pack(f"{binary}B{len(face)}i", len(face), *map(int, face)) for face in faces)


OBJ = b"""# a square and a triangle
mtllib sample.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vn 0 0 1
o first
usemtl red
f 1/1/1 2/2/1 3/3/1 4//1
v 0 0 1 1 0 0
usemtl shiny
f -1 1 2
l 1 2
"""

MTL = b"""newmtl red
Kd 1 0 0
Ks 0.5 0.5 0.5
Ns 20
map_Kd -s 2 2 1 sample.png
newmtl shiny
Kd 0.1 0.2 0.3
d 0.5
"""

STL_ASCII = b"""solid sample
facet normal 0 0 1
  outer loop
    vertex 0 0 0
    vertex 1 0 0
    vertex 0 1 0
  endloop
endfacet
endsolid sample
"""


def stl_binary() -> bytes:
    facets = np.zeros(4, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = TETRAHEDRON[FACES]
    return b"made by code".ljust(80) + struct.pack("<I", 4) + facets.tobytes()


OFF = b"COFF\n# a comment\n4 3 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n1 1 0 0 0 255 255\n0 1 0 9 9 9 255\n4 0 1 2 3\n3 0 1 2\n3 0 2 3 1 0 0\n"


def write_all(folder: Path) -> list[Path]:
    """Every sample as a file."""
    (folder / "sample.mtl").write_bytes(MTL)
    (folder / "sample.png").write_bytes(png())
    quads = [[0, 1, 2, 3], [0, 1, 2]]
    files = {
        "ascii.ply": ply(),
        "little.ply": ply("<"),
        "big.ply": ply(">"),
        "mixed.ply": ply("<", quads),
        "mixed_ascii.ply": ply("", quads),
        "sample.obj": OBJ,
        "ascii.stl": STL_ASCII,
        "binary.stl": stl_binary(),
        "sample.off": OFF,
    }
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return [folder / name for name in files] + [full_gltf().write(folder / "full.gltf"), full_gltf().write(folder / "full.glb")]
