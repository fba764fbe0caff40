"""Shares: which triangles each rank has, and how it comes to have no others.

A scene's triangles stand in one order, that of its instances and of the triangles in their meshes; rank r has a run of them, the r-th of as many. So
what a rank calls triangle t is triangle t + offset of the scene.
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from luxel.cluster.comm import Comm
from luxel.cluster.ply_share import Stream, load_share
from luxel.cluster.slices import FILLS, check_count, sliced
from luxel.cluster.sort_last import Division
from luxel.cluster.units import folder_share, gltf_share
from luxel.io import load
from luxel.io.files import door, tell
from luxel.scene.scene import Scene


class Shared(NamedTuple):
    """A scene as a rank has it.

    Attributes:
        scene: This rank's triangles, with all materials, textures, lights and cameras.
        outline: All of it, as far as framing a camera asks; only rank 0 need have it.
        division: Who shares what; None where every rank has everything.
        triangles: Of the whole scene.
        stream: Where this rank's triangles are, if they are left in the file; `scene` then has one of them, for what they are made of.
    """

    scene: Scene
    outline: Scene
    division: Division | None
    triangles: int
    stream: Stream | None = None


def group_count(size: int) -> int:
    """How many groups share the screen when both are shared: the root of the number of ranks, down to a whole number. So no group has fewer ranks
    than there are groups, memory goes before speed, and 2 and 3 ranks are one group, which shares the triangles."""
    return math.isqrt(size)


def share_scene(source: Any, comm: Comm, divide: str = "screen", composition: str = "swap", crease_angle: float | None = None) -> Shared:
    """Load a scene, or this rank's share of it.

    Binary PLY files are read in ranges of bytes, glTF by its primitives, and folders by their files. Of what cannot be read in parts every rank
    reads all, one time, and keeps its share; a LuxelWarning says so.

    Args:
        source: As of `luxel.load`.
        comm: All ranks.
        divide: "screen": every rank has everything; "objects": each has a share; "both": each has a share of its group's (see `group_count`).
        composition: For the `Division`.
        crease_angle: As of `luxel.load`.

    Raises:
        FileError, InputError: As of `luxel.load`.
    """
    if divide == "screen":
        scene = load(source, crease_angle=crease_angle)
        return Shared(scene, scene, None, scene.triangle_count)
    groups = 1 if divide == "objects" else group_count(comm.size)
    number_of = np.arange(comm.size) * groups // comm.size
    number = int(number_of[comm.rank])
    group = comm.part(number)
    path = Path(source) if isinstance(source, (str, os.PathLike)) else None
    found = None
    if path is not None:
        with door(path.name):
            found = _in_parts(path, group, crease_angle)
    if found is None:
        whole = load(source, crease_angle=crease_angle)
        found = sliced(whole, *group.share_out(whole.triangle_count)[group.rank]), whole
        if path is not None and comm.rank == 0 and comm.size > 1:
            tell(path.name, "cannot be read in parts: every rank reads all of it, and keeps its share")
    share, outline = found
    stream = share if isinstance(share, Stream) else None
    if isinstance(share, Stream):
        count, share = share.count, share.scene(np.arange(min(share.count, 1), dtype=np.int32))
    else:
        count = share.triangle_count
        with_all_attributes(share, comm)
    at = np.cumsum([0, *group.gather(count)]).astype(np.int64)
    check_count(source if path is not None else "scene", int(at[-1]))
    return Shared(share, outline, Division(comm, group, number, np.bincount(number_of), at, composition), int(at[-1]), stream)


def _in_parts(path: Path, group: Comm, crease_angle: float | None) -> tuple[Scene | Stream, Scene] | None:
    if path.is_dir():
        return folder_share(path, group, crease_angle)
    extension = path.suffix.lower()
    if extension == ".ply":
        return load_share(path, group, crease_angle)
    return gltf_share(path, group, crease_angle) if extension in (".gltf", ".glb") else None


def with_all_attributes(scene: Scene, comm: Comm) -> None:
    """Give this rank's first mesh the attributes that any mesh of the scene has, with the values that stand for none: kernels ask for what a scene
    has, not for what a rank has of it."""
    present = set().union(*comm.gather({name for mesh in scene.meshes for name in FILLS if getattr(mesh, name) is not None}))
    if scene.instances:
        at = scene.instances[0].mesh
        mesh = scene.meshes[at]
        missing: dict[str, Any] = {name: np.full((len(mesh.positions), FILLS[name][0]), FILLS[name][1], np.float32)
                                   for name in present if getattr(mesh, name) is None}  # fmt: skip
        scene.meshes[at] = replace(mesh, **missing)
