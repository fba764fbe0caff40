"""Lit scenes as files, and the pictures beside them."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import FileError, InputError
from luxel.io.files import atomic_write, door
from luxel.radiosity.conventions import CONVENTIONS, Convention, converted
from luxel.radiosity.shown import light_of, lit_materials
from luxel.scene.scene import Scene

__all__ = ["CONVENTIONS", "check_writable", "save_baked", "save_pages"]

EXTENSIONS = (".glb", ".gltf")


def save_baked(
    scene: Scene,
    path: str | os.PathLike[str],
    convention: Convention = "moz",
    *,
    exr: bool = False,
    white: float = 1.0,
    lights: bool = True,
) -> list[Path]:
    """Write a lit scene as glTF or GLB, which luxel and others show as it is lit.

    Each file appears whole or not at all, the scene last.

    Args:
        scene: Its materials have lightmaps (of `luxel.bake`, or loaded from such a file).
        path: .glb, or .gltf with its files beside.
        convention: "moz": MOZ_lightmap, of any range. "unlit": KHR_materials_unlit, what every viewer shows. "emissive": emissive textures
            with KHR_materials_emissive_strength. "sidecar": OpenEXR files beside, of irradiance E in W/m2 (extra `exr`).
        exr: Such files in any convention.
        white, lights: As of `conventions.converted`.

    Returns:
        The scene's file, and the OpenEXR files.

    Raises:
        InputError: Another extension or convention, or no material has a lightmap.
        FileError: A file cannot be written.
        ExtraMissingError: OpenEXR files are asked for, and the extra is not installed.
    """
    from luxel.io.gltf import write

    path = Path(path)
    if path.suffix.lower() not in EXTENSIONS:
        raise InputError(f"expected a file name that ends in .glb or .gltf, got {str(path)!r}")
    made = converted(scene, convention, white=white, lights=lights)
    made.check()
    pages = [light_of(scene.textures[page]) * np.float32(scene.materials[users[0]].lightmap_scale) for page, users in lit_materials(scene).items()]
    with door(path, "cannot be written"):
        if exr and convention != "sidecar":
            save_pages(path.with_name(f"{path.stem}_lightmap.exr"), pages)
        write.save(made, path, "sidecar" if convention == "sidecar" else "moz")
    beside = exr or convention == "sidecar"
    return [path, *(path.with_name(f"{path.stem}_lightmap_{i}.exr") for i in range(len(pages)) if beside)]


def save_pages(path: str | os.PathLike[str], pages: Array | list[Array], layers: dict[str, Array] | None = None) -> list[Path]:
    """Write a lightmap's pages as OpenEXR files, float32: NAME_0.exr, NAME_1.exr ..., whose headers say what they hold.

    Args:
        path: NAME.exr.
        pages: p of (h, w, 3) float32: irradiance E, W/m2.
        layers: More of the same by name, such as what each light gives: they become layers of the same files.

    Returns:
        The files written.
    """
    from luxel.io.gltf.write_lightmaps import NOTES
    from luxel.io.images import write_exr

    path = Path(path)
    written = []
    for i, page in enumerate(pages):
        named = {name: checked(layer[i], ("h", "w", 3), np.float32, f"layer {name!r}") for name, layer in (layers or {}).items()}
        target = path.with_name(f"{path.stem}_{i}{path.suffix}")
        write_exr(target, {"": np.ascontiguousarray(page[..., :3], np.float32)} | named, NOTES)
        written.append(target)
    return written


def check_writable(path: str | os.PathLike[str], size: int = 0) -> None:
    """Find out that a file can be put at `path` before hours are spent on what goes into it.

    Args:
        path: It need not exist; its folder must.
        size: Bytes that it and what goes beside it will need, about.

    Raises:
        FileError: There is no such folder, it cannot be written to, `path` is a folder, or the disk has less room.
    """
    path = Path(path)
    if path.is_dir():
        raise FileError(path, "cannot write: it is a folder")
    if not path.parent.is_dir():
        raise FileError(path, f"cannot write: there is no folder {str(path.parent)!r}")
    probe = path.with_name(f".{path.name[:100]}.probe")
    try:
        with atomic_write(probe) as file:
            file.write(b"\0")
    except FileError as error:
        raise FileError(path, f"cannot write: nothing can be made in {str(path.parent)!r}") from error
    probe.unlink(missing_ok=True)
    free = shutil.disk_usage(path.parent).free
    if free < size:
        raise FileError(path, f"cannot write: about {size / 1e6:,.0f} MB will be needed, and the disk has {free / 1e6:,.0f} MB left")
