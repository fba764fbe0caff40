"""A folder of model files as one scene: what each of them holds, in the order of their names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from luxel.errors import FileError
from luxel.io.files import tell
from luxel.scene.material import Material, TextureRef
from luxel.scene.scene import Scene


def model_files(folder: Path, extensions: Iterable[str]) -> list[Path]:
    """The files in a folder that have one of these extensions (without dots), by name; not those in folders inside it.

    Raises:
        FileError: There is none, or the folder cannot be read.
    """
    known = set(extensions)
    try:
        found = sorted(path for path in folder.iterdir() if path.suffix[1:].lower() in known and path.is_file())
    except OSError as error:
        raise FileError(folder, f"cannot read this folder: {error.strerror}") from error
    if not found:
        raise FileError(folder, f"a folder without model files; expected some of {', '.join(f'.{name}' for name in sorted(known))}")
    return found


def object_count(scene: Scene) -> int:
    """One more than the highest object id."""
    return 1 + max((instance.object for instance in scene.instances), default=-1)


def joined(name: str, scenes: Iterable[tuple[Scene, int]]) -> Scene:
    """One scene of several, in their order, with how many object ids each takes."""
    out, objects = Scene(name=name), 0
    for scene, count in scenes:
        meshes, materials, textures = len(out.meshes), len(out.materials), len(out.textures)
        out.textures += scene.textures
        out.materials += [_moved(material, textures) for material in scene.materials]
        out.meshes += [replace(mesh, material=mesh.material + materials if mesh.material >= 0 else -1) for mesh in scene.meshes]
        out.instances += [replace(each, mesh=each.mesh + meshes, object=each.object + objects) for each in scene.instances]
        out.lights += scene.lights
        out.cameras += scene.cameras
        if scene.ambient is not None and out.ambient is not None and scene.ambient != out.ambient:
            tell(scene.name or name, "its ambient light is left out: another file of the folder has one")
        out.ambient = out.ambient or scene.ambient
        objects += count
    return out


def _moved(material: Material, by: int) -> Material:
    refs: dict[str, Any] = {f.name: getattr(material, f.name) for f in fields(material)}
    moved: dict[str, Any] = {name: replace(ref, texture=ref.texture + by) for name, ref in refs.items() if isinstance(ref, TextureRef)}
    return replace(material, **moved)
