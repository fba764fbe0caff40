"""luxel bake: from a scene to a scene whose light is in it."""

from __future__ import annotations

import math
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet
from luxel.cli.forecast import advice, check_apart, check_room, check_targets, tell
from luxel.cli.watch import Watch, draw, shares, stages
from luxel.cli.written import Wishes, lit, save, say, shade
from luxel.errors import FileError, InputError

if TYPE_CHECKING:
    from luxel.cluster.comm import Comm

EXAMPLE = "luxel bake room.glb -o lit.glb --quality draft --sky 0.4,0.6,1 --preview lit.png"

_QUALITIES, _CONVENTIONS = ("draft", "normal", "final", "progressive", "reference"), ("moz", "unlit", "emissive", "sidecar")
_WHITE = "1"


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
        state = checkpoint or output.with_name(f"{output.name}.state")
        check_apart({"the scene": file, "--sky": sky}, {"--output": output, "--checkpoint": state, "--preview": preview})
        above = "a number above 0"
        options: dict[str, Any] = {
            "quality": values.choice(quality, _QUALITIES, "--quality"),
            "density": None if density is None else values.number(density, "--density", above, lambda x: x > 0),
            "page": values.whole(page, "--page", 16, 16384),
            "tolerance": None if tolerance is None else values.number(tolerance, "--tolerance", "a share between 0 and 1", lambda x: 0 < x <= 1),
            "seconds": None if seconds_ is None else values.number(seconds_, "--seconds", above, lambda x: x > 0),
            "threads": None if threads is None else values.whole(threads, "--threads", 1),
            "device": "cpu" if device is None else values.choice(device, ("cpu", "cuda", "auto"), "--device"),
            "checkpoint": state,
            "resume": resume,
        }
        wishes = Wishes(
            output,
            values.choice(convention, _CONVENTIONS, "--convention"),
            values.number(white, "--white", "a radiance above 0", lambda x: x > 0),
            exr,
            layers,
            not no_lights,
            only_indirect,
            None if ao is None else values.number(ao, "--ao", "metres above 0", lambda x: x > 0),
        )
        if wishes.convention != "unlit" and wishes.white != float(_WHITE):
            raise InputError(f"--white: only of --convention unlit, got {white!r} with {wishes.convention}")
        console = Console(quiet or comm.rank > 0, as_json and comm.rank == 0)
        share_work(comm, file=file, sky=sky, write=wishes, **options)
        options["sky"] = None if sky is None or comm.rank else _sky(sky)
        if dry_run:
            if comm.rank == 0:
                with advice():
                    tell(console, comm, file, options)
            return
        if layers:
            options["layers"] = True
        if comm.rank == 0:
            check_targets(wishes, preview, options)
        with advice():
            _bake(console, comm, file, wishes, preview, options)


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


def _bake(console: Console, comm: Comm, file: Path, wishes: Wishes, preview: Path | None, options: dict[str, Any]) -> None:
    from luxel.cli.ranks import compile_first, shares_of
    from luxel.radiosity.bake import bake

    start = time.perf_counter()
    state: Path = options["checkpoint"]
    earlier = None if options["resume"] or not state.exists() else state.stat().st_mtime_ns
    if options["resume"] and not state.exists():
        console.note(f"nothing to resume: there is no {state}; the bake starts anew")
    try:
        with console.work("baking") as report:
            told = stages(report)
            watch = Watch(report, preview, options["tolerance"] or 1e-3, shares(options), partial(check_room, wishes, options))
            compile_first(comm, lambda: _bake_little(options) if file.exists() else None)
            baked = bake(file, progress=watch, preparing=told, comm=comm, **options)
            shaded = shade(baked, wishes, comm, options["threads"])
            ranks = shares_of(comm)
            if comm.rank:
                return
            told(1.0, "writing")
            shown = lit(baked, wishes, shaded)
            written = save(shown, baked, wishes)
            if preview is not None:
                draw(shown, preview)
                written.append(preview)
    except KeyboardInterrupt:
        goes_on = f"what is done is kept in {state}; the same command with --resume goes on"
        kept = state.exists() and state.stat().st_mtime_ns != earlier
        console.note(goes_on if kept else "there was no light yet, so nothing is kept")
        raise
    except FileError:
        if watch.refused and not options["resume"]:
            state.unlink(missing_ok=True)  # of a bake that was refused when it was to begin
        raise
    if baked.finished:
        state.unlink(missing_ok=True)
    say(console, baked, written, state, time.perf_counter() - start, ranks)


def _bake_little(options: dict[str, Any]) -> None:
    from luxel.radiosity.bake import bake
    from luxel.scene.builtin import cornell_box

    bake(cornell_box(), density=4, quality=options["quality"], sky=None if options["sky"] is None else 1.0, threads=1)
