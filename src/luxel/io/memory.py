"""Scenes from what a program has at hand: trimesh objects, or plain arrays."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.io.build import build_mesh, turned
from luxel.scene.colour import linear_from_srgb
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Instance, Scene


def scene_from(source: Any) -> Scene:
    """A scene of a trimesh.Trimesh or trimesh.Scene, or of a pair (positions, triangles).

    Raises:
        InputError: `source` is neither, or its arrays do not fit.
    """
    trimesh = sys.modules.get("trimesh")  # whoever has such an object has imported it
    if trimesh is not None and isinstance(source, trimesh.Trimesh):
        scene = Scene()
        scene.add(_mesh(source, scene, {}))
        return scene
    if trimesh is not None and isinstance(source, trimesh.Scene):
        return _from_trimesh_scene(source, trimesh)
    if isinstance(source, (tuple, list)) and len(source) == 2:
        return Scene.from_mesh(_from_arrays(*source))
    raise InputError(
        "load: expected a path, a Mesh, a Scene, a trimesh object or a pair (positions, triangles), "
        f"got {type(source).__module__}.{type(source).__qualname__}"
    )


def _from_arrays(positions: object, triangles: object) -> Mesh:
    positions = checked(positions, ("n", 3), np.float32, "positions")
    if not np.isfinite(positions).all():
        raise InputError(f"positions: {np.count_nonzero(~np.isfinite(positions).all(1))} of {len(positions)} are not finite")
    return Mesh(positions, triangles)  # type: ignore[arg-type]


def _from_trimesh_scene(source: Any, trimesh: Any) -> Scene:
    scene = Scene()
    numbers: dict[str, int] = {}
    materials: dict[int, int] = {}
    for node in source.graph.nodes_geometry:
        matrix, name = source.graph[node]
        geometry = source.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh):
            continue  # a path or a point cloud
        if name not in numbers:
            numbers[name] = len(scene.meshes)
            scene.meshes.append(_mesh(geometry, scene, materials, str(name)))
        scene.instances.append(Instance(numbers[name], np.array(matrix, np.float64), len(scene.instances), str(node)))
    return scene


def _mesh(source: Any, scene: Scene, materials: dict[int, int], name: str = "") -> Mesh:
    attributes: dict[str, Array | None] = {}
    if "vertex_normals" in source._cache:  # as the file gave them; else trimesh would make them, all smooth
        attributes["normals"] = source.vertex_normals
    material = -1
    if source.visual.kind == "vertex":
        colors = np.asarray(source.visual.vertex_colors)
        attributes["colors"] = np.concatenate([linear_from_srgb(colors[:, :3]), colors[:, 3:4].astype(np.float32) / 255], 1)
    elif source.visual.kind == "texture":
        uv = source.visual.uv
        if uv is not None and np.shape(uv) == (len(source.vertices), 2):
            attributes["texcoords"] = turned(np.asarray(uv))
        key = id(source.visual.material)
        if key not in materials:
            materials[key] = len(scene.materials)
            scene.materials.append(_material(source.visual.material, scene))
        material = materials[key]
    return build_mesh("trimesh object", source.vertices, source.faces, material=material, name=name, **attributes)


def _material(source: Any, scene: Scene) -> Material:
    """A trimesh PBRMaterial (factors as in glTF) or SimpleMaterial (as in MTL)."""
    if hasattr(source, "baseColorFactor"):
        given = {
            "metallic": source.metallicFactor,
            "roughness": source.roughnessFactor,
            "emissive": source.emissiveFactor,
            "alpha_mode": source.alphaMode,
            "alpha_cutoff": source.alphaCutoff,
            "double_sided": source.doubleSided,
        }
        material = Material(base_color=(1, 1, 1, 1), metallic=1.0, roughness=1.0, shading="pbr")
        for key, value in given.items():
            if value is not None:
                setattr(material, key, tuple(map(float, value)) if key == "emissive" else value)
        factor = source.baseColorFactor
        images = [
            ("base_color_texture", source.baseColorTexture, True),
            ("metallic_roughness_texture", source.metallicRoughnessTexture, False),
            ("normal_texture", source.normalTexture, False),
            ("occlusion_texture", source.occlusionTexture, False),
            ("emissive_texture", source.emissiveTexture, True),
        ]
    else:
        material = Material()
        factor = source.diffuse
        images = [("base_color_texture", source.image, True)]
    if factor is not None:
        factor = np.asarray(factor)
        rgba = factor / 255 if factor.dtype.kind in "iu" else factor.astype(float)
        material.base_color = tuple(map(float, [*rgba, 1.0][:4]))  # type: ignore[assignment]
    for field, image, srgb in images:
        if image is not None:
            setattr(material, field, TextureRef(len(scene.textures)))
            scene.textures.append(Texture(np.asarray(image.convert("RGBA" if "A" in image.mode else "RGB")), srgb))
    material.name = str(source.name or "")
    return material
