"""glTF files with everything that a layout could break: shared and interleaved accessors, skins, morph targets, sparse values, strips."""

import json
from pathlib import Path

import numpy as np

_CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Builder:
    """A document in the making."""

    def __init__(self):
        self.data = bytearray()
        self.json = {"asset": {"version": "2.0", "generator": "a test"}, "bufferViews": [], "accessors": [], "meshes": [], "nodes": [],
                     "scenes": [{"nodes": []}], "scene": 0}  # fmt: skip

    def view(self, data, **more):
        self.data.extend(b"\0" * (-len(self.data) % 4))
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data.extend(data)
        return len(self.json["bufferViews"]) - 1

    def accessor(self, array, view=None, offset=0, bounds=False, **more):
        array = np.ascontiguousarray(array)
        width = 1 if array.ndim == 1 else array.shape[1]
        if view is None:
            view = self.view(array.tobytes())
        entry = {"bufferView": view, "byteOffset": offset, "componentType": _CODES[array.dtype.str[1:]], "count": len(array), "type": _TYPES[width]}
        if bounds:
            entry |= {"min": np.atleast_1d(array.min(0)).tolist(), "max": np.atleast_1d(array.max(0)).tolist()}
        self.json["accessors"].append({**entry, **more})
        return len(self.json["accessors"]) - 1

    def interleaved(self, arrays, stride):
        """Accessors, by name, of arrays that share one view."""
        rows = np.zeros((len(next(iter(arrays.values()))), stride), np.uint8)
        offsets, place = {}, 0
        for name, array in arrays.items():
            data = np.ascontiguousarray(array).view(np.uint8).reshape(len(array), -1)
            rows[:, place : place + data.shape[1]] = data
            offsets[name] = place
            place += data.shape[1] + -data.shape[1] % 4
        assert place <= stride
        view = self.view(rows.tobytes(), byteStride=stride, target=34962)
        normal = {name: {"normalized": True} for name in ("TEXCOORD_0", "COLOR_0")}
        return {name: self.accessor(array, view, offsets[name], name == "POSITION", **normal.get(name, {})) for name, array in arrays.items()}

    def sparse(self, count, rows, values, base=None):
        """An accessor of VEC3 that is `base` (a view) or zero, but for `values` at `rows`."""
        entry = {"componentType": 5126, "count": count, "type": "VEC3",
                 "sparse": {"count": len(rows), "indices": {"bufferView": self.view(np.asarray(rows, np.uint16).tobytes()), "componentType": 5123},
                            "values": {"bufferView": self.view(np.asarray(values, np.float32).tobytes())}}}  # fmt: skip
        if base is not None:
            entry["bufferView"] = base
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def mesh(self, *primitives, **more):
        self.json["meshes"].append({"primitives": list(primitives), **more})
        self.json["nodes"].append({"mesh": len(self.json["meshes"]) - 1})
        self.json["scenes"][0]["nodes"].append(len(self.json["nodes"]) - 1)
        return self.json["nodes"][-1]

    def save(self, path: Path):
        """GLB, or .gltf with a .bin beside it."""
        data = dict(self.json)
        data["buffers"] = [{"byteLength": len(self.data)}]
        if path.suffix == ".gltf":
            data["buffers"][0]["uri"] = f"{path.stem}%20data.bin"
            path.with_name(f"{path.stem} data.bin").write_bytes(self.data)
            path.write_text(json.dumps(data))
            return path
        text = json.dumps(data).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.data) + b"\0" * (-len(self.data) % 4)
        total = 28 + len(text) + len(binary)
        head = [np.array([0x46546C67, 2, total, len(text), 0x4E4F534A], "<u4").tobytes(), text]
        path.write_bytes(b"".join([*head, np.array([len(binary), 0x004E4942], "<u4").tobytes(), binary]))
        return path


def grid(n=12, seed=0):
    """Positions (n * n, 3) and triangles in random order."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:n, 0:n]
    points = np.stack([x, y, rng.random((n, n))], -1).reshape(-1, 3).astype(np.float32)
    a = (y[:-1, :-1] * n + x[:-1, :-1]).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n], 1), np.stack([a + 1, a + n + 1, a + n], 1)])
    return points, faces[rng.permutation(len(faces))]


def everything(seed=0):
    """Two primitives that share skinned, morphed, interleaved vertices, and lines on them; strips, a fan, no indices; an animation."""
    b, rng = Builder(), np.random.default_rng(seed)
    points, faces = grid(seed=seed)
    n, half = len(points), len(faces) // 2
    weights = rng.random((n, 4), np.float32)
    attributes = b.interleaved({
        "POSITION": points, "NORMAL": np.tile(np.float32([0, 0, 1]), (n, 1)), "TEXCOORD_0": rng.integers(0, 65536, (n, 2)).astype(np.uint16),
        "COLOR_0": rng.integers(0, 256, (n, 4)).astype(np.uint8), "JOINTS_0": rng.integers(0, 2, (n, 4)).astype(np.uint8),
        "WEIGHTS_0": weights / weights.sum(1, keepdims=True), "_HEAT": rng.random(n).astype(np.float32),
    }, 64)  # fmt: skip
    dense = {"POSITION": b.accessor(rng.random((n, 3), np.float32), bounds=True)}
    rows = np.sort(rng.choice(n, 9, replace=False))
    sparse = {"POSITION": b.sparse(n, rows, rng.random((9, 3))), "NORMAL": b.sparse(n, rows, rng.random((9, 3)))}
    targets = [dense, sparse]
    shared = b.view(np.concatenate([faces.ravel(), [0, 1, 1, 2]]).astype(np.uint16).tobytes())
    first = b.accessor(faces[:half].ravel().astype(np.uint16), shared)
    second = b.accessor(faces[half:].ravel().astype(np.uint16), shared, 6 * half)
    lines = b.accessor(np.array([0, 1, 1, 2], np.uint16), shared, 6 * len(faces))
    b.json["materials"] = [{"name": "red"}, {"doubleSided": True, "extras": {"keep": [1, None]}}]
    primitives = [
        {"attributes": attributes, "indices": first, "material": 0, "targets": targets},
        {"attributes": attributes, "indices": second, "material": 1, "targets": targets, "extensions": {"KHR_materials_variants": {"mappings": []}}},
        {"attributes": attributes, "indices": lines, "mode": 1, "targets": targets},
    ]
    node = b.mesh(*primitives, weights=[0.25, 0.5], name="skinned", extras={"targetNames": ["a", "b"]})
    b.json["nodes"] += [{"name": "joint"}, {"translation": [0, 0, 1]}]
    b.json["scenes"][0]["nodes"] += [1, 2]
    node["skin"] = 0
    b.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": b.accessor(np.tile(np.eye(4, dtype=np.float32).ravel(), (2, 1)))}]
    b.json["animations"] = [{"channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}], "samplers": [
        {"input": b.accessor(np.float32([0, 1]), bounds=True), "output": b.accessor(np.float32([0, 0, 1, 1]))}]}]  # fmt: skip
    strip = np.array([0, 2, 1, 3, 5, 4, 4, 6, 6, 7, 8, 9], np.uint8)
    plain = {"POSITION": b.accessor(points[:20], bounds=True)}
    b.mesh({"attributes": plain, "indices": b.accessor(strip), "mode": 5}, {"attributes": plain, "indices": b.accessor(strip[:5]), "mode": 6})
    b.mesh({"attributes": {"POSITION": b.accessor(points[faces[:40].ravel()], bounds=True)}})
    b.json["images"] = [{"bufferView": b.view(b"not really a picture"), "mimeType": "image/png"}]
    b.json["extensionsUsed"] = ["KHR_materials_variants"]
    return b
