"""luxel bake: from a scene to a scene whose light is in it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet, seconds
from luxel.errors import FileError, InputError

if TYPE_CHECKING:
    from luxel.arrays import Array
    from luxel.cluster.comm import Comm
    from luxel.radiosity.bake import Baked, Progress
    from luxel.scene import Scene

EXAMPLE = "luxel bake room.glb -o lit.glb --quality draft --sky 0.4,0.6,1 --preview lit.png"

SCENES = (".glb", ".gltf")
PICTURES = (".png", ".jpg", ".jpeg")
_QUALITIES, _CONVENTIONS = ("draft", "normal", "final", "progressive", "reference"), ("moz", "unlit", "emissive", "sidecar")
_PREVIEW_SIZE = (960, 540)
_REDRAW = 12  # a preview may take a part of the time like this
_ROOM = {"moz": 3, "unlit": 1, "emissive": 1, "sidecar": 0}  # bytes a texel of a page, in the scene's file, about: pictures are compressed
_EXR_ROOM, _SHADE_ROOM = 10, 1  # in an OpenEXR file, for each layer; and of ambient occlusion
_WHITE = "1"
_PASSING = 0.15  # of the time: lights shoot, and light goes from luxel to luxel


def _option(heading: str | None, *names: str, metavar: str | None = None, help: str) -> Any:
    return typer.Option(*names, metavar=metavar, help=help, rich_help_panel=heading, show_default=False)


_kinds = "A .glb, .gltf, .obj, .ply, .stl or .off."
File = Annotated[Path, typer.Argument(metavar="SCENE", help=_kinds, show_default=False)]
Output = Annotated[Path | None, _option(None, "-o", "--output", metavar="OUT", help="The lit scene: .glb or .gltf [SCENE's name, _lit.glb, here].")]
DryRun = Annotated[bool, _option(None, "--dry-run", help="Only lay the lightmap out, and tell what the bake would take, its time roughly.")]
Threads = Annotated[str | None, _option(None, "--threads", metavar="N", help="Of the processor [all]. The light does not depend on it.")]
_devices = "What bakes: cpu, cuda, or auto (a GPU if it can) [cpu]."
Device = Annotated[str | None, _option(None, "--device", metavar="NAME", help=_devices)]

_light = partial(_option, "Light")
_skies = "Radiance of the sky, W/(m2 sr): a number, R,G,B, or a picture all around (.hdr, .exr, .png) [dark]."
Sky = Annotated[str | None, _light("--sky", metavar="SKY", help=_skies)]
OnlyIndirect = Annotated[bool, _light("--only-indirect", help="Leave out what comes straight from the lights, which stay in the file.")]

_quality = partial(_option, "Quality")
QualityName = Annotated[str, _quality("--quality", metavar="NAME", help=f"{', '.join(_QUALITIES)} [normal].")]
Density = Annotated[str | None, _quality("--density", metavar="N", help="Luxels per metre [about 250,000 in all].")]
Page = Annotated[str, _quality("--page", metavar="N", help="Side of a lightmap's page, at most [1024].")]
Tolerance = Annotated[str | None, _quality("--tolerance", metavar="X", help="Done when this share of the light is unshot [0.001].")]
Seconds = Annotated[str | None, _quality("--seconds", metavar="S", help="Or after so long; what is unshot is then spread evenly.")]

_written = partial(_option, "What is written")
_conventions = "moz (MOZ_lightmap), unlit (any viewer), emissive, or sidecar (OpenEXR beside) [moz]."
ConventionName = Annotated[str, _written("--convention", metavar="NAME", help=_conventions)]
White = Annotated[str, _written("--white", metavar="L", help="unlit: the radiance that is shown as white [1].")]
NoLights = Annotated[bool, _written("--no-lights", help="Leave the lamps out, for viewers that would add them to the lightmap.")]
Exr = Annotated[bool, _written("--exr", help="Also OUT_lightmap_0.exr ..., irradiance in W/m2.")]
Layers = Annotated[bool, _written("--layers", help="Also OUT_layers_0.exr ...: what each lamp gives, and the sky, as a layer of its own.")]
Occlusion = Annotated[str | None, _written("--ao", metavar="M", help="Ambient occlusion within so many metres, as occlusion textures.")]

_working = partial(_option, "While it works")
_pictures = "A .png or .jpg, drawn again as light spreads."
Preview = Annotated[Path | None, _working("--preview", metavar="FILE", help=_pictures)]
_checkpoints = "Where the state is kept, twice a minute and when it is interrupted [OUT.state]."
Checkpoint = Annotated[Path | None, _working("--checkpoint", metavar="FILE", help=_checkpoints)]
Resume = Annotated[bool, _working("--resume", help="Go on from there.")]


def bake(
    file: File,
    output: Output = None,
    dry_run: DryRun = False,
    threads: Threads = None,
    device: Device = None,
    sky: Sky = None,
    only_indirect: OnlyIndirect = False,
    quality: QualityName = "normal",
    density: Density = None,
    page: Page = "1024",
    tolerance: Tolerance = None,
    seconds_: Seconds = None,
    convention: ConventionName = "moz",
    white: White = _WHITE,
    no_lights: NoLights = False,
    exr: Exr = False,
    layers: Layers = False,
    ao: Occlusion = None,
    preview: Preview = None,
    checkpoint: Checkpoint = None,
    resume: Resume = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Light a scene: what its lamps, its glowing surfaces and the sky give, from surface to surface, as a lightmap.

    The result is a scene that shows its light without any computing. Under mpiexec the ranks share the work, and rank 0 reads and writes.
    """
    from luxel.cli.ranks import share_work
    from luxel.cluster.comm import world

    comm = world()
    with comm.guard():
        output = output or Path(f"{file.stem}_lit.glb")
        if output.exists() and file.exists() and output.samefile(file):
            raise InputError(f"--output: {file} is the scene itself: expected another file, as what is lit cannot be lit again as it was")
        above = "a number above 0"
        options: dict[str, Any] = {
            "quality": values.choice(quality, _QUALITIES, "--quality"),
            "density": None if density is None else values.number(density, "--density", above, lambda x: x > 0),
            "page": values.whole(page, "--page", 16, 16384),
            "tolerance": None if tolerance is None else values.number(tolerance, "--tolerance", "a share between 0 and 1", lambda x: 0 < x <= 1),
            "seconds": None if seconds_ is None else values.number(seconds_, "--seconds", above, lambda x: x > 0),
            "threads": None if threads is None else values.whole(threads, "--threads", 1),
            "device": "cpu" if device is None else values.choice(device, ("cpu", "cuda", "auto"), "--device"),
            "checkpoint": checkpoint or output.with_name(f"{output.name}.state"),
            "resume": resume,
        }
        write = _Write(
            output,
            values.choice(convention, _CONVENTIONS, "--convention"),
            values.number(white, "--white", "a radiance above 0", lambda x: x > 0),
            exr,
            layers,
            not no_lights,
            only_indirect,
            None if ao is None else values.number(ao, "--ao", "metres above 0", lambda x: x > 0),
        )
        if write.convention != "unlit" and write.white != float(_WHITE):
            raise InputError(f"--white: only of --convention unlit, got {white!r} with {write.convention}")
        console = Console(quiet or comm.rank > 0, as_json and comm.rank == 0)
        share_work(comm, file=file, sky=sky, write=write, **options)
        options["sky"] = None if sky is None or comm.rank else _sky(sky)
        if dry_run:
            if comm.rank == 0:
                with _advice():
                    _tell(console, comm, file, options)
            return
        if layers:
            options["layers"] = True
        if comm.rank == 0:
            _check_targets(write, preview, options)
        with _advice():
            _bake(console, comm, file, write, preview, options)


@contextmanager
def _advice() -> Iterator[None]:
    """Names the option that lights what is dark."""
    try:
        yield
    except InputError as error:
        if "nothing shines" not in str(error):
            raise
        raise InputError(f"{error}; --sky 1 lights it from all around") from error


@dataclass(frozen=True)
class _Write:
    """What is to be written, and how."""

    output: Path
    convention: str
    white: float
    exr: bool
    layers: bool
    lights: bool
    only_indirect: bool
    occlusion: float | None


def _check_targets(write: _Write, preview: Path | None, options: dict[str, Any]) -> None:
    """Everything that would keep the result from being written, before anything is computed."""
    from luxel.radiosity.output import check_writable

    values.output(write.output, SCENES)
    if write.exr or write.layers or write.convention == "sidecar":
        values.output(write.output.with_suffix(".exr"), (".exr",))
    check_writable(write.output)
    check_writable(options["checkpoint"])
    if preview is not None:
        check_writable(values.output(preview, PICTURES, "--preview"))


def _check_room(write: _Write, options: dict[str, Any], begun: Progress) -> None:
    """That the disk has room, once it is known for how much; the state is still there when the result is written."""
    from luxel.radiosity.output import check_writable

    texels, state = begun.sizes
    scene = begun.prepared.atlas.scene
    lamps = _lamps(scene) + (options["sky"] is not None)
    exrs = (write.exr or write.convention == "sidecar") + (1 + lamps) * write.layers  # layers are beside their sum
    own = _ROOM[write.convention] + _SHADE_ROOM * (write.occlusion is not None)
    meshes = sum(array.nbytes for mesh in scene.meshes for array in vars(mesh).values() if hasattr(array, "nbytes"))
    check_writable(options["checkpoint"], state)
    check_writable(write.output, texels * (own + _EXR_ROOM * exrs) + meshes + state)


def _lamps(scene: Scene) -> int:
    """Of how many lights there is a layer: objects that glow, and lights of the scene."""
    glows = [max(material.emissive) > 0 for material in scene.materials] + [False]
    return len({instance.object for instance in scene.instances if glows[scene.meshes[instance.mesh].material]}) + len(scene.lights)


def _sky(text: str) -> Any:
    """A radiance (3,), or an equirectangular picture (h, w, 3) of it."""
    import numpy as np

    words = text.split(",")
    if len(words) in (1, 3):
        try:
            radiance = [float(word) for word in words]
        except ValueError:
            radiance = []
        if radiance:
            if not all(math.isfinite(x) and x >= 0 for x in radiance):
                raise InputError(f"--sky: expected radiance of at least 0, got {text!r}")
            return np.array(radiance * (3 if len(radiance) == 1 else 1))
    from luxel.io.images import read_image
    from luxel.scene.colour import linear_from_srgb

    if Path(text).suffix.lower() not in (".hdr", ".exr", ".png", ".jpg", ".jpeg"):
        raise InputError(f"--sky: expected a number, R,G,B, or a picture (.hdr, .exr, .png), got {text!r}")
    image = read_image(text)
    light = linear_from_srgb(image / np.float32(255)) if image.dtype == np.uint8 else image
    light = np.repeat(light[..., :1], 3, 2) if light.shape[2] < 3 else light[..., :3]
    if not np.isfinite(light).all():
        raise FileError(text, "a sky with pixels that are not finite")
    return np.maximum(light, 0)


def _tell(console: Console, comm: Comm, file: Path, options: dict[str, Any]) -> None:
    """What the lightmap would be, and what the bake would take; refuses what the bake would refuse, but tells first if it can."""
    import numpy as np

    from luxel import load
    from luxel.radiosity.bake import effort
    from luxel.radiosity.diagnosis import check_memory, diagnose
    from luxel.radiosity.elements import QUALITIES
    from luxel.radiosity.lamps import lamps_of
    from luxel.radiosity.unwrap import expected_luxels, unwrap

    scene, settings, density, threads = load(file), QUALITIES[options["quality"]], options["density"], options["threads"]
    settings = settings._replace(tolerance=options["tolerance"] or settings.tolerance)
    sky = options["sky"] is not None and bool(np.any(options["sky"]))
    rays, work, shooters = effort(settings, sky, _glows(scene))
    fits = partial(check_memory, rays=rays // comm.size, density=density, here=comm.here)
    if density is not None:
        fits(expected_luxels(scene, density), 0)
    with console.work("laying out") as report:
        start = time.perf_counter()
        atlas = unwrap(scene, density, options["page"], threads=threads, progress=report)
        found = diagnose(atlas, threads, rays, work, shooters, time.perf_counter() - start)
    refused = _refusal(partial(lamps_of, scene, options["sky"])) or _refusal(partial(fits, found.sides, found.triangles))
    data = {**found._asdict(), "density": found.density._asdict(), "faults": found.faults(), "serves": found.serves}
    console.result({"file": str(file), **data, "refused": None if refused is None else str(refused)}, found.text())
    if refused:
        raise InputError(f"a bake would be refused: {refused}") from refused


def _glows(scene: Scene) -> bool:
    return any(max(scene.materials[mesh.material].emissive) > 0 for mesh in scene.meshes if mesh.material >= 0)


def _refusal(check: Callable[[], object]) -> InputError | None:
    try:
        check()
    except InputError as error:
        return error
    return None


def _bake(console: Console, comm: Comm, file: Path, write: _Write, preview: Path | None, options: dict[str, Any]) -> None:
    from luxel.cli.ranks import compile_first, shares_of
    from luxel.radiosity.bake import bake

    start = time.perf_counter()
    state: Path = options["checkpoint"]
    if options["resume"] and not state.exists():
        console.note(f"nothing to resume: there is no {state}; the bake starts anew")
    try:
        with console.work("laying out the lightmap") as report:
            watch = _Watch(report, preview, options["tolerance"] or 1e-3, _shares(options), partial(_check_room, write, options))
            compile_first(comm, lambda: _bake_little(options) if file.exists() else None)
            baked = bake(file, progress=watch, comm=comm, **options)
            shade = _shade(baked, write, comm, options["threads"])
            ranks = shares_of(comm)
            if comm.rank:
                return
            report(1.0, "writing")
            lit = _lit(baked, write, shade)
            written = _save(lit, baked, write)
            if preview is not None:
                _draw(lit, preview)
                written.append(preview)
    except KeyboardInterrupt:
        goes_on = f"what is done is kept in {state}; the same command with --resume goes on"
        console.note(goes_on if state.exists() else "there was no light yet, so nothing is kept")
        raise
    except FileError:
        if watch.refused and not options["resume"]:
            state.unlink(missing_ok=True)  # of a bake that was refused when it was to begin
        raise
    if baked.finished:
        state.unlink(missing_ok=True)
    _say(console, baked, written, state, time.perf_counter() - start, ranks)


def _bake_little(options: dict[str, Any]) -> None:
    from luxel.radiosity.bake import bake
    from luxel.scene.builtin import cornell_box

    bake(cornell_box(), density=4, quality=options["quality"], sky=None if options["sky"] is None else 1.0, threads=1)


class _Watch:
    """Shows how the unshot light falls, and draws previews as often as they cost little.

    Args:
        shares: Of the time, what looking around takes, the light, and the last bounce.
        begun: Called once, and may refuse; `refused` tells that it did.
    """

    def __init__(self, report: Callable[..., None], preview: Path | None, tolerance: float, shares: tuple[float, float, float],
                 begun: Callable[[Progress], None]) -> None:  # fmt: skip
        self.report, self.preview, self.tolerance, self.shares = report, preview, tolerance, shares
        self.begun: Callable[[Progress], None] | None = begun
        self.refused = False
        self.next = 0.0
        self.done = [0.0, 0.0, 0.0]

    def __call__(self, unshot: float, state: Progress) -> None:
        if self.begun:
            begun, self.begun, self.refused = self.begun, None, True
            begun(state)
            self.refused = False
        if unshot <= self.tolerance:
            light = 1.0
        else:  # where luxels look around, it is the lights that take time
            light = 1 - unshot if self.shares[0] else math.log(min(unshot, 1.0)) / math.log(self.tolerance)
        looks = 2 if light == 1.0 else 0
        self.done[1], self.done[looks] = light, max(self.done[looks], state.looked)
        looking = f"; {'last bounce' if looks else 'looking around'} {state.looked:.0%}" if 0 < state.looked < 1 else ""
        bar = sum(share * done for share, done in zip(self.shares, self.done, strict=True))
        self.report(bar, f"{unshot:7.2%} of the light unshot{looking}")
        if self.preview is not None and time.monotonic() >= self.next:
            start = time.monotonic()
            _draw(state.preview(), self.preview)
            self.next = time.monotonic() + max(1.0, _REDRAW * (time.monotonic() - start))


def _shares(options: dict[str, Any]) -> tuple[float, float, float]:
    """Of the time of a bake, what looking around takes, about, what light takes that shoots and goes on, and the last bounce."""
    from luxel.radiosity.bake import rays_of
    from luxel.radiosity.diagnosis import work_of
    from luxel.radiosity.elements import QUALITIES

    settings, sky = QUALITIES[options["quality"]], options["sky"] is not None
    if not settings.seen:
        return 0.0, 1.0, 0.0
    rays = rays_of(settings, sky)
    first = work_of(rays, 0, False, sky) / work_of(rays, settings.gathered, settings.unlike < math.inf, sky)
    return (1 - _PASSING) * first, _PASSING, (1 - _PASSING) * (1 - first)


def _draw(scene: Scene, path: Path) -> None:
    from luxel import render

    render(scene, size=_PREVIEW_SIZE, samples=4, background=(0.0, 0.0, 0.0)).save(path)


def _shade(baked: Baked, write: _Write, comm: Comm, threads: int | None) -> Array | None:
    """(n,) float32: each luxel's ambient occlusion, if it is asked for."""
    if write.occlusion is None:
        return None
    from luxel.radiosity.ambient_occlusion import ambient_occlusion
    from luxel.radiosity.bake import labour_of

    return ambient_occlusion(baked.atlas, baked.luxels, write.occlusion, labour=labour_of(threads, comm))


def _lit(baked: Baked, write: _Write, share: Array | None) -> Scene:
    """The scene with what is asked for in its lightmaps."""
    from luxel.radiosity import lightmap

    pages = lightmap.finish(baked.atlas, baked.luxels, baked.irradiance - baked.direct, baked.valid)[0] if write.only_indirect else baked.pages
    shade = None if share is None else lightmap.finish(baked.atlas, baked.luxels, share, baked.valid)[0]
    return lightmap.attach(baked.atlas, pages, shade)


def _save(lit: Scene, baked: Baked, write: _Write) -> list[Path]:
    """The files written, the scene's first."""
    from luxel.radiosity import lightmap
    from luxel.radiosity.output import save_baked, save_pages

    beside: list[Path] = []
    if write.layers:
        named = {name.replace(".", "_") or "lamp": lightmap.finish(baked.atlas, baked.luxels, e, baked.valid)[0] for name, e in baked.layers.items()}
        beside = save_pages(write.output.with_name(f"{write.output.stem}_layers.exr"), baked.pages, named)
    convention: Any = write.convention
    return save_baked(lit, write.output, convention, exr=write.exr, white=write.white, lights=write.lights) + beside


def _say(console: Console, baked: Baked, written: list[Path], state: Path, took: float, ranks: list[dict[str, float]]) -> None:
    import numpy as np

    from luxel.scene.inspect import flat_triangles

    last = baked.ledger[-1] if baked.ledger else None
    unshot, shots = (last.unshot_fraction, last.shots) if last else (0.0, 0)
    (width, height), pages, luxels = baked.atlas.size, baked.atlas.pages, len(baked.luxels.area)
    ledger = {} if last is None else {name: [float(x) for x in getattr(last, name)] for name in ("emitted", "absorbed", "escaped", "unshot")}
    data = {
        "output": [str(path) for path in written],
        "luxels": luxels,
        "pages": pages,
        "page": [width, height],
        "shots": int(shots),
        "unshot": float(unshot),
        "finished": baked.finished,
        "watts": ledger,
        "mean_irradiance": [float(x) for x in baked.irradiance[baked.valid].mean(0)] if baked.valid.any() else [0.0, 0.0, 0.0],
        "seconds": {**{name: float(value) for name, value in baked.seconds.items()}, "all": took},
        **({"ranks": ranks} if len(ranks) > 1 else {}),
    }
    flat = sum(int(np.count_nonzero(flat_triangles(mesh))) for mesh in baked.atlas.scene.meshes)
    if flat:
        console.note(f"{flat:,} triangle{'s have' if flat > 1 else ' has'} no area, and no light")
    if not baked.finished:
        console.note(f"stopped with {unshot:.2%} of the light unshot; the state is kept in {state}, and --resume goes on")
    on = f"a page of {width}x{height}" if pages == 1 else f"{pages} pages of {width}x{height}"
    by = f"{len(ranks)} ranks, " if len(ranks) > 1 else ""
    by_shots = f"{shots:,} shot{'s' if shots > 1 else ''}, " if shots else ""
    console.result(data, f"{written[0]}  ({luxels:,} luxels on {on}, {by_shots}{unshot:.2%} unshot; {by}{seconds(took)})")
