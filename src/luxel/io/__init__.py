"""Files in and out: `load` a scene, `save` one, and pictures (`luxel.io.images`)."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from luxel.errors import FileError, InputError
from luxel.io.files import atomic_write, door
from luxel.scene.mesh import Mesh
from luxel.scene.normals import CREASE_ANGLE, with_normals
from luxel.scene.scene import Scene

__all__ = ["atomic_write", "load"]

_READERS = {"ply": "ply", "obj": "obj", "stl": "stl", "off": "off", "gltf": "gltf", "glb": "gltf"}


def load(source: object, *, crease_angle: float | None = None, normals: bool = True) -> Scene:
    """A scene from a file or from data at hand.

    Args:
        source: A path (.ply, .obj, .stl, .off, .gltf, .glb); a Mesh or a Scene; a trimesh.Trimesh or trimesh.Scene; or a pair of
            positions (n, 3) and triangles (m, 3). Data at hand is not copied where it fits.
        crease_angle: Radians: where faces turn by more, normals that are made anew are split. None takes what suits the format: 50 degrees,
            and 0 (flat faces) for glTF, whose specification asks for it. pi smooths everything and keeps the vertices as they are.
        normals: False leaves meshes without normals as they are.

    Raises:
        FileError: The file is missing or malformed; the message names the place.
        UnsupportedError: The file needs what luxel has not.
        InputError: `source` is none of these.
    """
    if isinstance(source, (str, os.PathLike)):
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


def _load_file(path: Path) -> tuple[Scene, float]:
    extension = path.suffix[1:].lower()
    if extension not in _READERS:
        known = ", ".join(f".{name}" for name in _READERS)
        raise FileError(path, f"expected a file with one of the extensions {known}, got {path.suffix or 'none'}")
    reader: Callable[[Path], Scene] = import_module(f"luxel.io.{_READERS[extension]}").load
    with door(path.name):
        scene = reader(path)
        scene.check()
    return scene, 0.0 if _READERS[extension] == "gltf" else CREASE_ANGLE
