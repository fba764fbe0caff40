"""A Scene to glTF 2.0 (.gltf with .bin and pictures beside) or GLB, through pygltflib's classes and container."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as g

from luxel.arrays import Array
from luxel.io.files import atomic_write
from luxel.io.gltf.write_lightmaps import Convention
from luxel.io.gltf.write_materials import Materials
from luxel.scene.scene import Instance, Scene

_TYPES = {1: g.SCALAR, 2: g.VEC2, 3: g.VEC3, 4: g.VEC4}
_ATTRIBUTES = {
    "positions": g.POSITION,
    "normals": g.NORMAL,
    "tangents": g.TANGENT,
    "texcoords": g.TEXCOORD_0,
    "texcoords1": g.TEXCOORD_1,
    "colors": g.COLOR_0,
}


class Buffer:
    """The one binary buffer of the file."""

    def __init__(self, gltf: g.GLTF2) -> None:
        self.gltf = gltf
        self.data = io.BytesIO()

    def view(self, data: bytes | memoryview, target: int | None = None) -> int:
        """Append bytes at a multiple of 4 and return the number of their buffer view."""
        self.data.write(b"\0" * (-self.data.tell() % 4))
        view = g.BufferView(buffer=0, byteOffset=self.data.tell(), byteLength=memoryview(data).nbytes, target=target)
        self.data.write(data)
        self.gltf.bufferViews.append(view)
        return len(self.gltf.bufferViews) - 1

    def accessor(self, array: Array, target: int, bounds: bool = False) -> int:
        """Append an array (n,) or (n, 2..4), float32, uint16 or uint32, and return the number of its accessor."""
        array = np.ascontiguousarray(array)
        component = {"f4": g.FLOAT, "u2": g.UNSIGNED_SHORT, "u4": g.UNSIGNED_INT}[array.dtype.str[1:]]
        accessor = g.Accessor(
            bufferView=self.view(array.data.cast("B") if array.size else b"", target),
            componentType=component,
            count=len(array),
            type=_TYPES[1 if array.ndim == 1 else array.shape[1]],
        )
        if bounds:
            accessor.min, accessor.max = array.min(0).tolist(), array.max(0).tolist()
        self.gltf.accessors.append(accessor)
        return len(self.gltf.accessors) - 1


def save(scene: Scene, path: Path, lightmaps: Convention = "exact") -> None:
    """Everything that a Scene holds: instances, materials with textures, cameras and lights. Meshes without triangles are left out.

    Args:
        scene: What to write.
        path: A .glb, or a .gltf with its files beside.
        lightmaps: "exact": MOZ_lightmap with OpenEXR pictures, which luxel reads. "moz": with Radiance pictures and PNG, as others read it.
            "sidecar": OpenEXR pictures beside the file, which the materials' extras name.
    """
    gltf = g.GLTF2(asset=g.Asset(version="2.0", generator="luxel"))
    buffer = Buffer(gltf)
    materials = Materials(scene, buffer, path, lightmaps)
    root = g.Scene(name=scene.name or None, nodes=[])
    gltf.scene, gltf.scenes = 0, [root]
    meshes = _Meshes(scene, buffer, materials)
    for group in _groups(scene):
        number = meshes.number(tuple(instance.mesh for instance in group))
        if number is not None:
            root.nodes.append(_node(gltf, group[0].world_from_mesh, group[0].name, mesh=number))
    _write_cameras(scene, gltf, root)
    _write_lights(scene, gltf, root)
    if scene.ambient is not None:
        root.extras = {"luxel": {"ambient": {"sky": list(scene.ambient.sky), "ground": list(scene.ambient.ground)}}}
    gltf.extensionsUsed = sorted({*gltf.extensionsUsed, *materials.extensions})
    _write_container(gltf, buffer.data.getvalue(), path)


def _groups(scene: Scene) -> list[list[Instance]]:
    """Instances that become one node: neighbours of one object, in one place."""
    groups: list[list[Instance]] = []
    for instance in scene.instances:
        first = groups[-1][0] if groups else instance
        if groups and first.object == instance.object and _matrix(first) == _matrix(instance):
            groups[-1].append(instance)
        else:
            groups.append([instance])
    return groups


def _matrix(instance: Instance) -> list[list[float]]:
    assert instance.world_from_mesh is not None
    return instance.world_from_mesh.tolist()


class _Meshes:
    """glTF meshes, one for each different set of luxel meshes that stands together."""

    def __init__(self, scene: Scene, buffer: Buffer, materials: Materials) -> None:
        self.scene, self.buffer, self.materials = scene, buffer, materials
        self._primitives: dict[int, g.Primitive] = {}
        self._accessors: dict[tuple[int, str], int] = {}
        self._numbers: dict[tuple[int, ...], int] = {}

    def number(self, meshes: tuple[int, ...]) -> int | None:
        """The glTF mesh whose primitives are `meshes`; None where none has a triangle."""
        meshes = tuple(mesh for mesh in meshes if len(self.scene.meshes[mesh].triangles))
        if not meshes:
            return None
        if meshes not in self._numbers:
            primitives = [self._primitive(mesh) for mesh in meshes]
            gltf = self.buffer.gltf
            self._numbers[meshes] = len(gltf.meshes)
            gltf.meshes.append(g.Mesh(primitives=primitives, name=self.scene.meshes[meshes[0]].name or None))
        return self._numbers[meshes]

    def _primitive(self, index: int) -> g.Primitive:
        if index not in self._primitives:
            mesh = self.scene.meshes[index]
            attributes = {name: self._attribute(field, array) for field, name in _ATTRIBUTES.items() if (array := getattr(mesh, field)) is not None}
            narrow = len(mesh.positions) <= 65535
            indices = mesh.triangles.reshape(-1).astype(np.uint16 if narrow else np.uint32)
            self._primitives[index] = g.Primitive(
                attributes=g.Attributes(**attributes),
                indices=self.buffer.accessor(indices, g.ELEMENT_ARRAY_BUFFER),
                material=self.materials.number(mesh.material),
                mode=g.TRIANGLES,
                extras={"luxel": {"name": mesh.name}} if mesh.name else {},
            )
        return self._primitives[index]

    def _attribute(self, field: str, array: Array) -> int:
        key = (id(array), field)  # meshes may share arrays
        if key not in self._accessors:
            self._accessors[key] = self.buffer.accessor(array, g.ARRAY_BUFFER, bounds=field == "positions")
        return self._accessors[key]


def _node(gltf: g.GLTF2, matrix: Array | None, name: str, **what: Any) -> int:
    """Append a node and return its number."""
    node = g.Node(name=name or None, **what)
    if matrix is not None and not np.array_equal(matrix, np.eye(4)):
        node.matrix = matrix.T.reshape(-1).tolist()
    gltf.nodes.append(node)
    return len(gltf.nodes) - 1


def _write_cameras(scene: Scene, gltf: g.GLTF2, root: g.Scene) -> None:
    for camera in scene.cameras:
        far = camera.far if np.isfinite(camera.far) else None
        if camera.yfov is not None:
            lens = {"perspective": g.Perspective(yfov=camera.yfov, znear=camera.near, zfar=far, aspectRatio=camera.aspect)}
        else:
            half = camera.height / 2
            lens = {"orthographic": g.Orthographic(xmag=half * (camera.aspect or 1.0), ymag=half, znear=camera.near, zfar=far)}
        gltf.cameras.append(g.Camera(type=next(iter(lens)), name=camera.name or None, **lens))
        root.nodes.append(_node(gltf, camera.world_from_camera, camera.name, camera=len(gltf.cameras) - 1))


def _write_lights(scene: Scene, gltf: g.GLTF2, root: g.Scene) -> None:
    lights: list[dict[str, Any]] = []
    for light in scene.lights:
        made: dict[str, Any] = {
            "type": light.kind,
            "color": list(map(float, light.color)),
            "intensity": float(light.intensity),
        }
        if np.isfinite(light.range):
            made["range"] = float(light.range)
        if light.kind == "spot":
            made["spot"] = {"innerConeAngle": float(light.inner_cone), "outerConeAngle": float(light.outer_cone)}
        if light.name:
            made["name"] = light.name
        reference = {"KHR_lights_punctual": {"light": len(lights)}}
        root.nodes.append(_node(gltf, light.world_from_light, light.name, extensions=reference))
        lights.append(made)
    if lights:
        gltf.extensions = {"KHR_lights_punctual": {"lights": lights}}
        gltf.extensionsUsed.append("KHR_lights_punctual")


def _write_container(gltf: g.GLTF2, data: bytes, path: Path) -> None:
    if data:
        gltf.buffers = [g.Buffer(byteLength=len(data))]
    if path.suffix.lower() == ".glb":
        gltf.set_binary_blob(data)
        parts = gltf.save_to_bytes()
        with atomic_write(path) as file:
            for part in parts:
                file.write(part)
        return
    if data:
        name = f"{path.stem}.bin"
        gltf.buffers[0].uri = quoted(name)
        with atomic_write(path.with_name(name)) as file:
            file.write(data)
    with atomic_write(path) as file:
        file.write(gltf.gltf_to_json().encode())


def quoted(name: str) -> str:
    """A file name as a URI."""
    from urllib.parse import quote

    return quote(name)
