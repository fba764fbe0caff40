"""A glTF file to a Scene: nodes, instances, cameras and lights."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError, UnsupportedError
from luxel.io.files import tell
from luxel.io.gltf.accessors import read
from luxel.io.gltf.document import Document, Part
from luxel.io.gltf.geometry import Geometry, declared_triangles, drawn_attributes, read_primitive, skinned
from luxel.io.gltf.materials import Textures, default_material, own_extras, read_material
from luxel.scene.camera import Camera
from luxel.scene.light import Ambient, Light
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Instance, Scene

_SUPPORTED = {
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_transform",
    "MOZ_lightmap",
    "MOZ_texture_rgbe",
}

_INSTANCE_COLUMNS = (
    ("TRANSLATION", "VEC3", (0, 0, 0)),
    ("ROTATION", "VEC4", (0, 0, 0, 1)),
    ("SCALE", "VEC3", (1, 1, 1)),
)


def load(path: Path) -> Scene:
    """The scene that the file shows by default, each node's primitives as instances of one object.

    Raises:
        FileError: Something is missing, out of range or of a wrong type; the message names the object.
        UnsupportedError: The file requires an extension that luxel has not.
    """
    document = Document(path)
    _check_extensions(document)
    scene = Scene(name=path.stem)
    _Reader(document, scene).run()
    return scene


class Later:
    """A primitive that is not read yet, in place of a scene's mesh.

    Attributes:
        count: Triangles that it promises.
        make: Reads it.
    """

    def __init__(self, count: int, make: Callable[[], Mesh]) -> None:
        self.count, self.make, self.material = count, make, -1


def outline(path: Path) -> Scene | None:
    """As `load`, but what its buffers hold of meshes is left there: a `Later` for each; None for files with skins, which must be read."""
    document = Document(path, mapped=True)
    _check_extensions(document)
    if document.count("skins"):
        return None
    scene = Scene(name=path.stem)
    _Outliner(document, scene).run()
    return scene


def _check_extensions(document: Document) -> None:
    missing = sorted(set(document.strings("extensionsRequired")) - _SUPPORTED)
    if missing:
        raise UnsupportedError(document.where, f"requires the extension {', '.join(missing)[:200]}")
    for name in sorted(set(document.strings("extensionsUsed")) - _SUPPORTED):
        tell(document.where, f"the extension {name[:60]} is ignored")
    if document.count("animations"):
        tell(document.where, "animations are ignored; the default pose is loaded")


@dataclass
class _Placed:
    """A node where it stands."""

    index: int
    part: Part
    world: Array


class _Reader:
    def __init__(self, document: Document, scene: Scene) -> None:
        self.document = document
        self.scene = scene
        self.textures = Textures(document, scene)
        self._materials: dict[int | None, int] = {}
        self._meshes: dict[Any, list[tuple[int, Geometry]]] = {}
        self._geometries: dict[Any, tuple[int, Geometry] | None] = {}

    def run(self) -> None:
        """Fill the scene."""
        # Every material of the file is read, in its order, so that numbers agree with the file's.
        for i, part in enumerate(self.document.items("materials")):
            self._materials[i] = i
            self.scene.materials.append(read_material(part, self.textures))
        placed = self._walk(self._roots())
        worlds = {node.index: node.world for node in placed}
        objects = 0
        for node in placed:
            if node.part.has("mesh"):
                self._draw(node, worlds, objects)
                objects += 1
            if node.part.has("camera"):
                self._camera(node)
            light = node.part.extension("KHR_lights_punctual")
            if light is not None:
                self._light(node, light)

    def _roots(self) -> list[int]:
        document = self.document
        if not document.count("scenes"):
            children = {child for part in document.items("nodes") for child in part.indices("children")}
            return [i for i in range(document.count("nodes")) if i not in children]
        index = document.integer("scene", 0)
        if document.count("scenes") > 1:
            tell(document.where, f"of {document.count('scenes')} scenes, scene {index} is loaded")
        scene = document.item("scenes", index, document.where)
        self.scene.name = scene.text("name", "") or self.scene.name
        ambient = own_extras(scene).part("ambient")
        if ambient is not None:
            self.scene.ambient = Ambient(ambient.numbers("sky", 3), ambient.numbers("ground", 3))
        return scene.indices("nodes")

    def _walk(self, roots: list[int]) -> list[_Placed]:
        """All nodes under `roots`, parents first; each once, so that neither a cycle nor a shared child multiplies."""
        placed: list[_Placed] = []
        seen: set[int] = set()
        stack = [(index, np.eye(4), self.document.where) for index in reversed(roots)]
        while stack:
            index, parent, asked_by = stack.pop()
            part = self.document.item("nodes", index, asked_by)
            if index in seen:
                tell(
                    part.where,
                    f"is reached twice, again from {asked_by.rpartition(', ')[2]}, or is its own ancestor; drawn once",
                )
                continue
            seen.add(index)
            world = parent @ _local(part)
            if not np.isfinite(world).all():
                raise FileError(part.where, "its transform is not finite")
            placed.append(_Placed(index, part, world))
            stack.extend((child, world, part.where) for child in reversed(part.indices("children")))
        return placed

    def _draw(self, node: _Placed, worlds: dict[int, Array], number: int) -> None:
        index = node.part.integer("mesh")
        mesh = self.document.item("meshes", index, node.part.where)
        weights = node.part.numbers("weights", None, ()) or mesh.numbers("weights", None, ())
        skin = node.part.integer("skin", None)
        name = node.part.text("name", "") or mesh.text("name", "")
        copies = self._copies(node)
        for made, geometry in self._primitives(index, mesh, weights):
            world = node.world
            if skin is not None and geometry.joints is not None:
                self.scene.meshes.append(skinned(geometry, self._joint_matrices(skin, node, worlds), mesh.where))
                made, world = len(self.scene.meshes) - 1, np.eye(4)
            for copy in copies:
                self.scene.instances.append(Instance(made, world @ copy, number, name))

    def _primitives(self, index: int, mesh: Part, weights: tuple[float, ...]) -> list[tuple[int, Geometry]]:
        """The scene's mesh number and the geometry of each primitive that draws triangles."""
        key = (index, weights)
        if key not in self._meshes:
            made = [self._primitive(part, weights, mesh.text("name", "")) for part in mesh.parts("primitives", "primitive")]
            self._meshes[key] = [one for one in made if one is not None]
        return self._meshes[key]

    def _primitive(self, part: Part, weights: tuple[float, ...], name: str) -> tuple[int, Geometry] | None:
        """A primitive; meshes that share one (the same accessors and material) share the scene's mesh."""
        key = (json.dumps(part.data, sort_keys=True), weights)
        if key not in self._geometries:
            name = own_extras(part).text("name", name)
            geometry = self._geometry(part, weights, name)
            self._geometries[key] = None
            if geometry is not None:
                self.scene.meshes.append(geometry.mesh)
                self._geometries[key] = (len(self.scene.meshes) - 1, geometry)
        return self._geometries[key]

    def _geometry(self, part: Part, weights: tuple[float, ...], name: str) -> Geometry | None:
        return read_primitive(self.document, part, weights, name, self._material(part))

    def _material(self, primitive: Part) -> int:
        index = primitive.integer("material", None)
        if index is not None:
            self.document.item("materials", index, primitive.where)
        elif None not in self._materials:
            self._materials[None] = len(self.scene.materials)
            self.scene.materials.append(default_material())
        return self._materials[index]

    def _joint_matrices(self, skin: int, node: _Placed, worlds: dict[int, Array]) -> Array:
        """(k, 4, 4): world from the mesh's bind space, for each joint."""
        part = self.document.item("skins", skin, node.part.where)
        joints = part.indices("joints")
        missing = [joint for joint in joints if joint not in worlds]
        if missing or not joints:
            raise FileError(part.where, f"joint node {missing[0]} is not in the scene" if missing else "has no joints")
        matrices = np.stack([worlds[joint] for joint in joints])
        if part.has("inverseBindMatrices"):
            bind = read(self.document, part.integer("inverseBindMatrices"), part.where, types=("MAT4",))
            if len(bind) < len(joints):
                raise FileError(part.where, f"{len(bind)} inverse bind matrices for {len(joints)} joints")
            matrices = matrices @ bind[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
        return matrices

    def _copies(self, node: _Placed) -> Array:
        """(k, 4, 4): one identity, or the transforms of EXT_mesh_gpu_instancing."""
        part = node.part.extension("EXT_mesh_gpu_instancing")
        attributes = None if part is None else part.part("attributes")
        if attributes is None:
            return np.eye(4)[None]
        columns = []
        rows: int | None = None
        for key, kind, none in _INSTANCE_COLUMNS:
            column = np.array([none], np.float32)
            if attributes.has(key):
                column = read(self.document, attributes.integer(key), attributes.where, types=(kind,), rows=rows)
                rows = len(column)
            columns.append(column)
        translations, rotations, scales = (np.broadcast_to(column, (rows or 1, column.shape[1])) for column in columns)
        return np.stack([_compose(*row, attributes.where) for row in zip(translations, rotations, scales, strict=True)])

    def _camera(self, node: _Placed) -> None:
        part = self.document.item("cameras", node.part.integer("camera"), node.part.where)
        kind = part.text("type")
        lens = part.part(kind) if kind in ("perspective", "orthographic") else None
        if lens is None:
            raise FileError(part.where, f"type: expected perspective or orthographic with its object, got {kind[:20]!r}")
        pose = _rigid(node.world, node.part.where)
        name = node.part.text("name", "") or part.text("name", "")
        if kind == "perspective":
            far = lens.number("zfar", float("inf"))
            aspect = lens.number("aspectRatio", None)
            lens_args: dict[str, Any] = {
                "yfov": lens.number("yfov"),
                "near": lens.number("znear"),
                "far": far,
                "aspect": aspect,
            }
        else:
            wide, high = abs(lens.number("xmag")), abs(lens.number("ymag"))
            aspect = wide / high if wide and high else None
            lens_args = {
                "yfov": None,
                "height": 2 * high,
                "near": lens.number("znear"),
                "far": lens.number("zfar"),
                "aspect": aspect,
            }
        if lens_args["aspect"] is not None and not lens_args["aspect"] > 0:
            raise FileError(lens.where, f"aspectRatio: expected a number > 0, got {lens_args['aspect']}")
        self.scene.cameras.append(Camera(pose, name=name, **lens_args))

    def _light(self, node: _Placed, ref: Part) -> None:
        root = self.document.extension("KHR_lights_punctual")
        lights = [] if root is None else root.parts("lights", "light")
        index = ref.integer("light")
        if index >= len(lights):
            raise FileError(ref.where, f"names light {index}, the file has {len(lights)}")
        part = lights[index]
        kind = part.text("type")
        if kind not in ("point", "spot", "directional"):
            raise FileError(part.where, f"type: expected point, spot or directional, got {kind[:20]!r}")
        cone = (part.part("spot") or Part(part.where, {})) if kind == "spot" else Part(part.where, {})
        self.scene.lights.append(
            Light(
                kind,
                part.numbers("color", 3, (1.0, 1.0, 1.0)),
                part.number("intensity", 1.0, 0.0),
                _rigid(node.world, node.part.where),
                part.number("range", float("inf"), 0.0),
                cone.number("innerConeAngle", 0.0, 0.0),
                cone.number("outerConeAngle", float(np.pi / 4), 0.0),
                node.part.text("name", "") or part.text("name", ""),
            )
        )


class _Outliner(_Reader):
    """Reads all but meshes."""

    def _geometry(self, part: Part, weights: tuple[float, ...], name: str) -> Any:
        material = self._material(part)
        if drawn_attributes(part) is None:
            return None

        def make() -> Mesh:
            geometry = read_primitive(self.document, part, weights, name, material)
            assert geometry is not None
            return geometry.mesh

        return Geometry(cast(Mesh, Later(declared_triangles(self.document, part), make)))


def _local(part: Part) -> Array:
    """Parent from node, (4, 4)."""
    matrix = part.numbers("matrix", 16, None)
    if matrix is not None:
        out = np.array(matrix).reshape(4, 4).T
        if not np.array_equal(out[3], (0, 0, 0, 1)):
            raise FileError(part.where, "matrix: expected a last row of 0, 0, 0, 1")
        return out
    triple = [part.numbers(key, n, (0.0,) * n) for key, n in (("translation", 3), ("rotation", 4), ("scale", 3))]
    return _compose(
        triple[0],
        triple[1] if part.has("rotation") else (0.0, 0.0, 0.0, 1.0),
        triple[2] if part.has("scale") else (1.0, 1.0, 1.0),
        part.where,
    )


def _compose(translation: Any, rotation: Any, scale: Any, where: str) -> Array:
    """(4, 4) from a translation, a quaternion x, y, z, w and a scale."""
    quaternion = np.asarray(rotation, np.float64)
    length = np.linalg.norm(quaternion)
    if not (np.isfinite(length) and length > 1e-9):
        raise FileError(where, f"rotation: expected a unit quaternion, got {quaternion.tolist()}")
    x, y, z, w = quaternion / length
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.asarray(scale, np.float64)
    matrix[:3, 3] = np.asarray(translation, np.float64)
    return matrix


def _rigid(world: Array, where: str) -> Array:
    """The rotation and place of `world`, without its scale: cameras and lights have none."""
    back, up = world[:3, 2], world[:3, 1]
    right = np.cross(up, back)
    lengths = [float(np.linalg.norm(v)) for v in (back, right)]
    if not all(np.isfinite(lengths)) or min(lengths) < 1e-150:
        raise FileError(where, "a camera or light on a node whose transform is singular")
    matrix = np.eye(4)
    back, right = back / lengths[0], right / lengths[1]
    matrix[:3, :4] = np.stack([right, np.cross(back, right), back, world[:3, 3]], 1)
    return matrix
