"""Files laid out. A format that comes out as it went in keeps everything: the file is rewritten, not made anew from a scene.

glTF and GLB, OBJ and PLY are rewritten so (`gltf_file`, `obj_file`, `ply_file`); any other pair goes through a Scene, and what the new format
does not hold is said. Files are written beside, proved if asked for, and renamed.
"""

from __future__ import annotations

import os
import stat
import tempfile
import time
import warnings
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from luxel.errors import FileError, LuxelWarning, UnsupportedError
from luxel.io import load, save
from luxel.io.files import door
from luxel.layout.measure import Draw, measure
from luxel.layout.optimize import Options, Progress, Report, draws_of, optimize_scene, seen_of
from luxel.layout.same import Soup, difference, soups_of
from luxel.scene.scene import Scene
from luxel.unfinished import unfinished

_FAMILIES = {".gltf": "gltf", ".glb": "gltf", ".obj": "obj", ".ply": "ply"}
FORMATS = (".gltf", ".glb", ".obj", ".ply", ".stl", ".off")


class DifferenceError(FileError):
    """What was written is not the same mesh: it was thrown away."""


def optimize_file(source: Path, target: Path | None, options: Options, *, measures: bool = True, check: bool = False,
                  progress: Progress | None = None) -> tuple[Report, list[Scene]]:  # fmt: skip
    """Lay out the meshes of a file and write them to another, or to the same.

    Args:
        source: A file that `luxel.load` reads.
        target: Where to; the extension says in which format. None writes nothing.
        options: What to do.
        measures: Measure before and after.
        check: Read both files again and prove that they hold the same triangles, with everything at their corners.
        progress: To be told the fraction that is done.

    Returns:
        The report; and, with `measures`, the scenes before and after, as far as luxel can read them (none if it cannot).

    Raises:
        FileError: A file cannot be read or written.
        DifferenceError: `check` found a difference; `target` is as it was.
    """
    report = Report(options.target)
    aim = source if target is None else target
    family = _FAMILIES.get(source.suffix.lower())
    module: Any = None
    if family is not None and family == _FAMILIES.get(aim.suffix.lower()):
        module = import_module(f"luxel.layout.{family}_file")
    try:
        folder = tempfile.TemporaryDirectory(prefix=f".{aim.name[:60]}.", dir=None if target is None else target.parent)
    except OSError as error:
        raise FileError(aim, f"cannot write: {error.strerror}") from error
    with folder as name, unfinished(name):
        made = Path(name) / aim.name
        before = None
        told = progress or (lambda done: None)
        ordering: Progress = lambda done: told(0.6 * done)  # noqa: E731
        if module is None:
            before = _convert(source, made, options, report, check, ordering)
        else:
            with door(source.name):
                package = module.optimize(source, options, report, ordering)
                report.refuse_nothing()
            with door(aim, "cannot be written"):
                package.save(made, aim.parent)
        told(0.7)
        held = [_Held(path, module) for path in (source, made)]
        if check and module is not None:
            _prove(held, module, options, aim)
        told(0.8)
        scenes = _measure(held, report, options.threads, before) if measures else []
        if target is not None:
            _into_place(Path(name), target)
        told(1.0)
    return report, scenes


class _Held:
    """What a file holds, read when it is first asked for."""

    def __init__(self, path: Path, module: Any) -> None:
        self.path, self.module = path, module
        self._contents: tuple[list[Draw], dict[str, Soup]] | None = None

    @property
    def contents(self) -> tuple[list[Draw], dict[str, Soup]]:
        if self._contents is None:
            self._contents = self.module.contents(self.path) if self.module is not None else ([], {})
        return self._contents


def _convert(source: Path, made: Path, options: Options, report: Report, check: bool, progress: Progress | None) -> Scene:
    """Through a Scene; the one that was read."""
    scene = load(source, normals=False)
    result = optimize_scene(scene, options, report, measures=False, progress=progress)
    found = difference(soups_of(scene), soups_of(result), options.drop_degenerate, options.drop_duplicates) if check else None
    if found:
        raise DifferenceError(source, f"the result is not the same mesh: {found}")
    save(result, made)
    return scene


def _prove(held: list[_Held], module: Any, options: Options, target: Path) -> None:
    before, after = (each.contents[1] for each in held)
    found = difference(before, after, options.drop_degenerate, options.drop_duplicates)
    found = found or module.rest_differs(*(each.path for each in held))
    if found:
        raise DifferenceError(target, f"not written, because it would not be the same: {found}")


def _measure(held: list[_Held], report: Report, threads: int | None, before: Scene | None) -> list[Scene]:
    """Measures of both files into the report; their scenes."""
    start = time.perf_counter()
    scenes = [_scene(held[0].path) if before is None else before, _scene(held[1].path)]
    known = [scene for scene in scenes if scene is not None]
    readable = known if len(known) == 2 else []
    report.lap("read again", start)
    start = time.perf_counter()
    found = []
    for i, each in enumerate(held):
        draws = each.contents[0] or (draws_of(readable[i]) if readable else [])
        found.append(measure(draws, seen_of(readable[i]) if readable else None, threads))
    report.before, report.after = found
    report.lap("measure", start)
    return readable


def _scene(path: Path) -> Scene | None:
    """As luxel reads it; silent, for what it does not use is none of this command's business."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LuxelWarning)
        try:
            return load(path, normals=False)
        except UnsupportedError:
            return None


def _into_place(folder: Path, target: Path) -> None:
    """Move everything from `folder` beside `target`, which comes last."""
    with suppress(OSError):
        os.chmod(folder / target.name, stat.S_IMODE(target.stat().st_mode))
    try:
        for path in sorted(folder.rglob("*")):
            place = target.parent / path.relative_to(folder)
            if path.is_dir():
                place.mkdir(exist_ok=True)
            elif place != target:
                os.replace(path, place)
        os.replace(folder / target.name, target)
    except OSError as error:
        raise FileError(target, f"cannot write: {error.strerror}") from error
