"""Files in and out: `load` a scene, `save` one, and pictures (`luxel.io.images`)."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from luxel.errors import FileError
from luxel.io.files import atomic_write, door
from luxel.scene.mesh import Mesh
from luxel.scene.normals import CREASE_ANGLE, with_normals
from luxel.scene.scene import Scene

__all__ = ["atomic_write", "load", "save"]

READERS = {"ply": "ply", "obj": "obj", "stl": "stl", "off": "off", "gltf": "gltf.read", "glb": "gltf.read"}
_WRITERS = READERS | {"obj": "obj_write", "gltf": "gltf.write", "glb": "gltf.write"}


def load(source: object, *, crease_angle: float | None = None, normals: bool = True) -> Scene:
    """A scene from a file or from data at hand.

    Args:
        source: A path (.ply, .obj, .stl, .off, .gltf, .glb), or a folder of such files, which are drawn together; a Mesh or a Scene; a
            trimesh.Trimesh or trimesh.Scene; or a pair of positions (n, 3) and triangles (m, 3). Data at hand is not copied where it fits.
        crease_angle: Radians: where faces turn by more, normals that are made anew are split. None takes what suits the format: 50 degrees,
            and 0 (flat faces) for glTF, whose specification asks for it. pi smooths everything and keeps the vertices as they are.
        normals: False leaves meshes without normals as they are.

    Raises:
        FileError: The file is missing or malformed; the message names the place.
        UnsupportedError: The file needs what luxel has not.
        InputError: `source` is none of these.
    """
    if isinstance(source, (str, os.PathLike)):
        if Path(source).is_dir():
            return _load_folder(Path(source), crease_angle, normals)
        scene, crease = _load_file(Path(source))
    elif isinstance(source, Scene):
        return source
    elif isinstance(source, Mesh):
        return Scene.from_mesh(source)
    else:
        from luxel.io.memory import scene_from

        scene, crease = scene_from(source), CREASE_ANGLE
    if normals:
        crease = crease if crease_angle is None else crease_angle
        for i, mesh in enumerate(scene.meshes):
            if mesh.normals is None:
                scene.meshes[i] = with_normals(mesh, crease)
    return scene


def save(source: object, path: str | os.PathLike[str]) -> None:
    """Write a scene, or anything that `load` takes, to a file by the extension of `path`.

    glTF and GLB hold a whole scene. OBJ holds meshes in world space and Blinn-Phong materials; PLY, STL and OFF one mesh in world
    space; what the format cannot hold is said by a LuxelWarning. The file appears whole, or not at all.

    Raises:
        FileError: The extension is not known, or the file cannot be written.
        InputError: The scene is inconsistent.
    """
    path = Path(path)
    write: Callable[[Scene, Path], None] = _module(_WRITERS, path).save
    scene = load(source, normals=False)
    scene.check()
    with door(path, "cannot be written"):
        write(scene, path)


def _load_folder(folder: Path, crease_angle: float | None, normals: bool) -> Scene:
    from luxel.io.folder import joined, model_files, object_count

    scenes = (load(path, crease_angle=crease_angle, normals=normals) for path in model_files(folder, READERS))
    return joined(folder.name, ((scene, object_count(scene)) for scene in scenes))


def _load_file(path: Path) -> tuple[Scene, float]:
    read: Callable[[Path], Scene] = _module(READERS, path).load
    with door(path.name):
        scene = read(path)
        scene.check()
    return scene, 0.0 if path.suffix.lower() in (".gltf", ".glb") else CREASE_ANGLE


def _module(modules: dict[str, str], path: Path) -> Any:
    name = modules.get(path.suffix[1:].lower())
    if name is None:
        if path.is_dir():
            raise FileError(path, "expected a file, and it is a folder")
        known = ", ".join(f".{extension}" for extension in modules)
        raise FileError(path, f"expected one of the extensions {known}, got {path.suffix or 'none'}")
    return import_module(f"luxel.io.{name}")
