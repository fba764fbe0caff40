"""Writing OBJ and MTL; the pictures of textures go beside them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from luxel.arrays import Array
from luxel.io.build import turned
from luxel.io.files import atomic_write, tell
from luxel.io.flatten import placed
from luxel.io.images import write_png
from luxel.io.mtl import texture_file
from luxel.scene.colour import bytes_from_linear, srgb_from_linear
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

_ROWS = 1 << 16
_MAPS = {"map_Kd": "base_color_texture", "map_Ke": "emissive_texture", "norm": "normal_texture"}


def save(scene: Scene, path: Path) -> None:
    """One object for each instance, in world space; materials to an .mtl of the same name. Numbers have 9 digits: exact in float32."""
    names = material_names(scene)
    if scene.materials:
        _save_materials(scene, path.with_suffix(".mtl"), names)
    with atomic_write(path) as file:
        if scene.materials:
            file.write(f"mtllib {path.with_suffix('.mtl').name}\n".encode())
        counts = [0, 0, 0]
        last = None
        for instance in scene.instances:
            mesh = placed(scene, instance)
            if instance.object != last or not mesh.name:
                file.write(f"o {_line(instance.name or mesh.name or f'object_{instance.object}')}\n".encode())
            last = instance.object
            for block in _vertices(mesh):
                file.write(block.encode())
            if mesh.material >= 0:
                file.write(f"usemtl {names[mesh.material]}\n".encode())
            for block in _faces(mesh, counts):
                file.write(block.encode())
            arrays = (mesh.positions, mesh.texcoords, mesh.normals)
            counts = [count + (0 if array is None else len(array)) for count, array in zip(counts, arrays, strict=True)]


def _line(name: str) -> str:
    return " ".join(name.split())


def material_names(scene: Scene) -> list[str]:
    """A different name for each material, without line breaks."""
    names: list[str] = []
    for i, material in enumerate(scene.materials):
        name = _line(material.name) or f"material_{i}"
        names.append(name if name not in names else f"{name}_{i}")
    return names


def _vertices(mesh: Mesh) -> Iterator[str]:
    colored = mesh.positions if mesh.colors is None else np.concatenate([mesh.positions, srgb_from_linear(mesh.colors[:, :3])], 1)
    flipped = None if mesh.texcoords is None else turned(mesh.texcoords)
    for key, table in (("v", colored), ("vt", flipped), ("vn", mesh.normals)):
        if table is not None:
            line = key + " %.9g" * table.shape[1] + "\n"
            for start in range(0, len(table), _ROWS):
                yield "".join(line % tuple(row) for row in table[start : start + _ROWS].tolist())


def _faces(mesh: Mesh, counts: list[int]) -> Iterator[str]:
    """Face lines; `counts` are the v, vt and vn written before this mesh."""
    columns = [counts[0]]
    pattern = "%d"
    if mesh.texcoords is not None:
        columns.append(counts[1])
        pattern += "/%d"
    if mesh.normals is not None:
        columns.append(counts[2])
        pattern += "//%d" if mesh.texcoords is None else "/%d"
    line = f"f {pattern} {pattern} {pattern}\n"
    for start in range(0, len(mesh.triangles), _ROWS):
        part = mesh.triangles[start : start + _ROWS].astype(np.int64) + 1
        rows = (part[:, :, None] + np.array(columns)).reshape(len(part), -1).tolist()
        yield "".join(line % tuple(row) for row in rows)


def _save_materials(scene: Scene, path: Path, names: list[str]) -> None:
    files: dict[int, str] = {}
    lines = []
    for name, material in zip(names, scene.materials, strict=True):
        lines += [f"newmtl {name}", *_statements(material)]
        for key, field in _MAPS.items():
            ref: TextureRef | None = getattr(material, field)
            if ref is not None:
                if ref.texture not in files:
                    files[ref.texture] = f"{path.stem}_{texture_file(scene.textures[ref.texture], ref.texture)}"
                    write_png(path.parent / files[ref.texture], eight_bit(scene.textures[ref.texture]))
                lines.append(f"{key} {_options(ref, scene.textures[ref.texture])}{files[ref.texture]}")
        lost = [n for n in ("metallic_roughness", "occlusion", "lightmap") if getattr(material, f"{n}_texture") is not None]
        if lost:
            tell(path.name, f"material {name}: MTL does not hold the {', '.join(lost)} texture")
    with atomic_write(path) as file:
        file.write(("\n".join(lines) + "\n").encode())


def _statements(material: Material) -> Iterator[str]:
    yield "Kd " + " ".join(f"{c:.9g}" for c in material.base_color[:3])
    if material.specular is not None:
        yield "Ks " + " ".join(f"{c:.9g}" for c in material.specular)
    if material.shininess is not None:
        yield f"Ns {material.shininess:.9g}"
    if any(material.emissive):
        yield "Ke " + " ".join(f"{c:.9g}" for c in material.emissive)
    if material.base_color[3] < 1:
        yield f"d {material.base_color[3]:.9g}"
    yield f"Pr {material.roughness:.9g}"
    yield f"Pm {material.metallic:.9g}"


def _options(ref: TextureRef, texture: Texture) -> str:
    """Offset, scale and clamp of a map statement: t = s * (u, v) + o, with v upwards."""
    out = ""
    if ref.scale != (1.0, 1.0) or ref.offset != (0.0, 0.0):
        out += f"-s {ref.scale[0]:.9g} {ref.scale[1]:.9g} 1 -o {ref.offset[0]:.9g} {1 - ref.scale[1] - ref.offset[1]:.9g} 0 "
    return out + ("-clamp on " if texture.wrap == ("clamp", "clamp") else "")


def eight_bit(texture: Texture) -> Array:
    """The image as uint8: float ones are clamped to 0..1, their colour sRGB-encoded if the texture holds colour."""
    image = texture.image
    if image.dtype == np.uint8:
        return image
    tell(f"texture {texture.name!r}", "is written with 8 bits, clamped to 0..1")
    flat = (np.clip(np.nan_to_num(image), 0, 1) * 255 + 0.5).astype(np.uint8)
    if texture.srgb:
        colors = min(image.shape[2], 3) if image.shape[2] != 2 else 1
        flat[..., :colors] = bytes_from_linear(image[..., :colors])
    return flat
