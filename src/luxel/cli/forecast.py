"""What is said before a bake: what it would take, and what would keep its result from being written."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from luxel.cli import values
from luxel.cli.console import Console
from luxel.cli.watch import stages
from luxel.errors import DarkError, InputError

if TYPE_CHECKING:
    from luxel.cli.written import Wishes
    from luxel.cluster.comm import Comm
    from luxel.radiosity.lighting import Progress
    from luxel.scene import Scene

SCENES = (".glb", ".gltf")
PICTURES = (".png", ".jpg", ".jpeg")
_ROOM = {"moz": 3, "unlit": 1, "emissive": 1, "sidecar": 0}  # bytes a texel of a page, in the scene's file, about: pictures are compressed
_EXR_ROOM, _SHADE_ROOM = 10, 1  # in an OpenEXR file, for each layer; and of ambient occlusion


@contextmanager
def advice() -> Iterator[None]:
    """Names the option that lights what is dark."""
    try:
        yield
    except DarkError as error:
        raise DarkError(f"{error}; --sky 1 lights it from all around") from error


def check_apart(read: Mapping[str, Path | str | None], written: Mapping[str, Path | None]) -> None:
    """Refuse names of one file for two things: what is read would be lost, or what is written."""
    others = {name: Path(path) for name, path in read.items() if path is not None}
    for name, path in written.items():
        if path is None:
            continue
        for other, its in others.items():
            if its.resolve() == path.resolve() or (its.exists() and path.exists() and its.samefile(path)):
                itself = f"is {other} itself" if other in read else f"is what {other} writes"
                raise InputError(f"{name}: {path} {itself}: expected another file")
        others[name] = path


def check_targets(wishes: Wishes, preview: Path | None, options: dict[str, Any]) -> None:
    """Everything that would keep the result from being written, before anything is computed."""
    from luxel.radiosity.checkpoint import is_checkpoint
    from luxel.radiosity.output import check_writable

    values.output(wishes.output, SCENES)
    if wishes.exr or wishes.layers or wishes.convention == "sidecar":
        values.output(wishes.output.with_suffix(".exr"), (".exr",))
    check_writable(wishes.output)
    state: Path = options["checkpoint"]
    check_writable(state)
    if state.exists() and not is_checkpoint(state):
        raise InputError(f"--checkpoint: {state} is something else, and would be lost: expected a new file's name, or an earlier checkpoint")
    if preview is not None:
        check_writable(values.output(preview, PICTURES, "--preview"))


def check_room(wishes: Wishes, options: dict[str, Any], begun: Progress) -> None:
    """That the disk has room, once it is known for how much; the state is still there when the result is written."""
    from luxel.radiosity.output import check_writable

    texels, state = begun.sizes
    scene = begun.prepared.atlas.scene
    lamps = _lamps(scene) + (options["sky"] is not None)
    exrs = (wishes.exr or wishes.convention == "sidecar") + (1 + lamps) * wishes.layers  # layers are beside their sum
    own = _ROOM[wishes.convention] + _SHADE_ROOM * (wishes.occlusion is not None)
    meshes = sum(array.nbytes for mesh in scene.meshes for array in vars(mesh).values() if hasattr(array, "nbytes"))
    check_writable(options["checkpoint"], state)
    check_writable(wishes.output, texels * (own + _EXR_ROOM * exrs) + meshes + state)


def _lamps(scene: Scene) -> int:
    """Of how many lights there is a layer: objects that glow, and lights of the scene."""
    glows = [max(material.emissive) > 0 for material in scene.materials] + [False]
    return len({instance.object for instance in scene.instances if glows[scene.meshes[instance.mesh].material]}) + len(scene.lights)


def tell(console: Console, comm: Comm, file: Path, options: dict[str, Any]) -> None:
    """What the lightmap would be, and what the bake would take; refuses what the bake would refuse, but tells first if it can."""
    import numpy as np

    from luxel import load
    from luxel.radiosity.diagnosis import check_memory, diagnose
    from luxel.radiosity.effort import effort
    from luxel.radiosity.lamps import lamps_of
    from luxel.radiosity.quality import QUALITIES
    from luxel.radiosity.unwrap import expected_luxels, unwrap

    scene, settings, density, threads = load(file), QUALITIES[options["quality"]], options["density"], options["threads"]
    settings = settings._replace(tolerance=options["tolerance"] or settings.tolerance)
    sky = options["sky"] is not None and bool(np.any(options["sky"]))
    rays, work, shooters, spots = effort(settings, sky, _glows(scene))
    fits = partial(check_memory, rays=rays // comm.size, spots=spots // comm.size, density=density, here=comm.here)
    if density is not None:
        fits(expected_luxels(scene, density), 0)
    with console.work("laying out") as report:
        start, told = time.perf_counter(), stages(report)
        atlas = unwrap(scene, density, options["page"], threads=threads, progress=lambda share: told(share, "laying out"))
        found = diagnose(atlas, threads, rays, work, shooters, spots, time.perf_counter() - start)
    refused = _refusal(partial(lamps_of, scene, options["sky"])) or _refusal(partial(fits, found.sides, found.triangles))
    data = {**found._asdict(), "density": found.density._asdict(), "faults": found.faults(), "serves": found.serves}
    console.result({"file": str(file), **data, "refused": None if refused is None else str(refused)}, found.text())
    if refused:
        raise type(refused)(f"a bake would be refused: {refused}") from refused


def _glows(scene: Scene) -> bool:
    return any(max(scene.materials[mesh.material].emissive) > 0 for mesh in scene.meshes if mesh.material >= 0)


def _refusal(check: Callable[[], object]) -> InputError | None:
    try:
        check()
    except InputError as error:
        return error
    return None
