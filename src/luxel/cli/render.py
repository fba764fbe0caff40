"""luxel render: a file to a picture."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet, seconds
from luxel.errors import InputError, LuxelWarning

if TYPE_CHECKING:
    from luxel.cli.drawing import View
    from luxel.scene import Camera, Scene

EXAMPLE = "luxel render model.glb -o model.png --size 1920x1080 --samples 8 --azimuth 45"

_SHADINGS = ("flat", "gouraud", "phong", "pbr", "unlit", "hardware")
_FILTERS = ("box", "tent", "gaussian", "mitchell", "blackman-harris", "lowpass")
_DIVISIONS, _COMPOSITIONS, _BALANCES = ("screen", "objects", "both"), ("direct", "swap", "radix"), ("dynamic", "static")
_AA: dict[str, dict[str, str]] = {
    "none": {"samples": "1"}, "msaa": {"samples": "4"}, "ssaa": {"ssaa": "3"}, "lowpass": {"ssaa": "3", "filter": "lowpass"},
}  # fmt: skip
_OUTPUTS = (
    "color",
    "linear",
    "depth",
    "triangle",
    "object",
    "material",
    "normal",
    "position",
    "barycentric",
    "texcoord",
    "motion",
)


def _option(heading: str | None, *names: str, metavar: str, help: str, **more: Any) -> Any:
    shown = heading != "Camera"  # their defaults depend on each other and stand in the text
    return typer.Option(*names, metavar=metavar, help=help, rich_help_panel=heading, show_default=shown, **more)


_kinds = "A .glb, .gltf, .obj, .ply, .stl or .off."
_pictures = "The picture: .png, .jpg, .exr (layers) or .npz (arrays)."
File = Annotated[Path, typer.Argument(metavar="FILE", help=_kinds, show_default=False)]
Output = Annotated[Path | None, _option(None, "-o", "--output", metavar="OUT", help=f"{_pictures} [FILE's name, .png, here]")]
Size = Annotated[str, _option(None, "--size", metavar="WxH", help="Pixels; one number makes a square.")]
Outputs = Annotated[str, _option(None, "--outputs", metavar="LIST", help=f"For .exr and .npz: {', '.join(_OUTPUTS)}.")]
Threads = Annotated[str | None, _option(None, "--threads", metavar="N", help="Of the processor [all].")]
Device = Annotated[str | None, _option(None, "--device", metavar="NAME", help="What draws: cpu, cuda, or auto (a GPU if it can) [cpu].")]

_camera = partial(_option, "Camera")
NamedCamera = Annotated[str | None, _camera("--camera", metavar="NAME", help="One of the file's, or its number [the first].")]
Azimuth = Annotated[str | None, _camera("--azimuth", metavar="DEG", help="Frame from this side: 0 front, 90 right [30].")]
Elevation = Annotated[str | None, _camera("--elevation", metavar="DEG", help="And from so high, -90 to 90 [20].")]
Distance = Annotated[str | None, _camera("--distance", metavar="M", help="And from so far [what fits the picture].")]
Fov = Annotated[str | None, _camera("--fov", metavar="DEG", help="Vertical field of view [40, or the camera's].")]
Eye = Annotated[str | None, _camera("--eye", metavar="X,Y,Z", help="Or stand here ...")]
Target = Annotated[str | None, _camera("--target", metavar="X,Y,Z", help="... and look there [the middle].")]
Up = Annotated[str | None, _camera("--up", metavar="AXIS", help="What is up: y, z or X,Y,Z [y].")]
Ortho = Annotated[str | None, _camera("--ortho", metavar="M", help="Orthographic, so many metres high, or fit.")]
Turntable = Annotated[str | None, _camera("--turntable", metavar="N", help="N pictures around: OUT_000.png, OUT_001.png ...")]
_before = "Where motion comes from: options of the camera before, such as 'azimuth=25 elevation=20'."
Previous = Annotated[str | None, _camera("--previous", metavar="CAMERA", help=_before)]

_sampling = partial(_option, "Sampling")
_modes = "In short: none, msaa (--samples 4), ssaa (--ssaa 3), or lowpass (of the spectrum)."
AntiAliasing = Annotated[str | None, _sampling("--aa", metavar="MODE", help=_modes)]
Samples = Annotated[str | None, _sampling("--samples", metavar="N", help="Samples a pixel: 1, 2, 4, 8 or 16 [4].")]
Pattern = Annotated[str, _sampling("--pattern", metavar="NAME", help="Where they lie: standard, or grid (of 4).")]
Ssaa = Annotated[str | None, _sampling("--ssaa", metavar="N", help="In place of samples: shade N x N times a pixel, N up to 8.")]
Filter = Annotated[str | None, _sampling("--filter", metavar="NAME", help=f"From samples to pixels: {', '.join(_FILTERS)}.")]

_look = partial(_option, "Look")
_shadings = f"{', '.join(_SHADINGS)} [what the material asks for]."
Shading = Annotated[str | None, _look("--shading", metavar="NAME", help=_shadings)]
Background = Annotated[str, _look("--background", metavar="COLOR", help="'#rrggbb', a name, or none: transparent; white in a .jpg.")]
Cull = Annotated[str, _look("--cull", metavar="WHAT", help="Hide back faces: material (as it says), back or none.")]
Exposure = Annotated[str, _look("--exposure", metavar="EV", help="Brighter by so many stops.")]
Lightmap = Annotated[Path | None, _look("--lightmap", metavar="FILE", help="A baked picture for TEXCOORD_1.")]
_ranks = partial(_option, "Ranks of MPI")
_divisions = "What ranks share: the screen, the triangles (objects), or both [screen]."
Divide = Annotated[str | None, _ranks("--divide", metavar="WHAT", help=_divisions)]
_compositions = "How pictures of objects become one: direct, swap or radix [swap]."
Composition = Annotated[str | None, _ranks("--composition", metavar="NAME", help=_compositions)]
_balances = "The screen in parts of equal cost (dynamic) or of equal size (static) [dynamic]."
Balance = Annotated[str | None, _ranks("--balance", metavar="NAME", help=_balances)]

_creases = "Where normals are made, edges sharper than this stay [50]."
CreaseAngle = Annotated[str | None, _look("--crease-angle", metavar="DEG", help=_creases)]


def render(
    file: File,
    output: Output = None,
    size: Size = "1280x720",
    outputs: Outputs = "color",
    device: Device = None,
    threads: Threads = None,
    camera: NamedCamera = None,
    azimuth: Azimuth = None,
    elevation: Elevation = None,
    distance: Distance = None,
    fov: Fov = None,
    eye: Eye = None,
    target: Target = None,
    up: Up = None,
    ortho: Ortho = None,
    turntable: Turntable = None,
    previous: Previous = None,
    aa: AntiAliasing = None,
    samples: Samples = None,
    pattern: Pattern = "standard",
    ssaa: Ssaa = None,
    filter: Filter = None,
    shading: Shading = None,
    background: Background = "none",
    cull: Cull = "material",
    exposure: Exposure = "0",
    lightmap: Lightmap = None,
    crease_angle: CreaseAngle = None,
    divide: Divide = None,
    composition: Composition = None,
    balance: Balance = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Draw a file, lit and anti-aliased.

    It is seen by its own camera, or by one that frames it. Under mpiexec the ranks share the work, and one file is written.
    """
    from luxel.cluster.comm import world

    comm = world()
    with comm.guard():
        from luxel.cli.drawing import EXTENSIONS, SAMPLES, View

        pixels = values.size(size)
        mode = {} if aa is None else _AA[values.choice(aa, tuple(_AA), "--aa")]
        samples, filter = samples or mode.get("samples"), filter or mode.get("filter", "box")
        shots = values.whole(ssaa or mode.get("ssaa", "1"), "--ssaa", 1, 8)
        output = output or Path(f"{file.stem}.png")
        opaque = output.suffix.lower() in (".jpg", ".jpeg")  # they have no transparency
        numbers: dict[str, Any] = {"azimuth": azimuth, "elevation": elevation, "distance": distance, "fov": fov, "turntable": turntable}
        view = View(camera, eye=eye, target=target, up=up, ortho=ortho, previous=previous, **numbers)
        options: dict[str, Any] = {
            "samples": values.choice(samples or ("1" if shots > 1 else "4"), SAMPLES, "--samples"),
            "pattern": values.choice(pattern, ("standard", "grid"), "--pattern"),
            "ssaa": shots,
            "filter": values.choice(filter, _FILTERS, "--filter"),
            "shading": None if shading is None else values.choice(shading, _SHADINGS, "--shading"),
            "cull": values.choice(cull, ("material", "back", "none"), "--cull"),
            "background": values.background("white" if background == "none" and opaque else background),
            "outputs": values.names(outputs, _OUTPUTS, "--outputs"),
            "exposure": values.number(exposure, "--exposure", "-64 to 64 stops", lambda stops: abs(stops) <= 64),
            "threads": None if threads is None else values.whole(threads, "--threads", 1),
            "device": "cpu" if device is None else values.choice(device, ("cpu", "cuda", "auto"), "--device"),
        }
        crease = None if crease_angle is None else values.number(crease_angle, "--crease-angle", "degrees from 0 to 180", lambda a: 0 <= a <= 180)
        values.output(output, EXTENSIONS)
        _check_together(options, samples, output, turntable is not None, previous is not None)
        console = Console(quiet or comm.rank > 0, as_json and comm.rank == 0)
        shared = divide is not None or composition is not None or balance is not None
        if comm.size == 1 and not shared:
            _draw_file(console, file, output, pixels, view, options, lightmap, crease)
            return
        from luxel.cli.ranks import draw_file

        draw_file(console, comm, file, output, pixels, view, options, lightmap, crease, *_ways(divide, composition, balance))


def _ways(divide: str | None, composition: str | None, balance: str | None) -> tuple[str, str, str]:
    """What ranks share, how their pictures become one, and how parts are balanced."""
    return (
        values.choice(divide or "screen", _DIVISIONS, "--divide"),
        values.choice(composition or "swap", _COMPOSITIONS, "--composition"),
        values.choice(balance or "dynamic", _BALANCES, "--balance"),
    )


def _check_together(options: dict[str, Any], samples: str | None, output: Path, turns: bool, moves: bool) -> None:
    """What is asked for must go together: `samples` as given, `turns` with --turntable, `moves` with --previous."""
    shots, wanted = options["ssaa"], set(options["outputs"]) - {"color"}
    if shots > 1 and options["samples"] != 1:
        raise InputError(f"--ssaa {shots}: it takes the place of --samples {samples}; give one of them")
    if options["filter"] == "lowpass" and shots == 1:
        raise InputError("--filter lowpass: filters the picture that --ssaa draws at a higher rate; give --ssaa 2 to 8, or --aa lowpass")
    if options["pattern"] == "grid" and options["samples"] != 4:
        raise InputError(f"--pattern grid: expected --samples 4, got {samples or 1}")
    if wanted and output.suffix.lower() not in (".exr", ".npz"):
        raise InputError(f"--outputs: {output.suffix} holds color alone; {', '.join(sorted(wanted))} goes to .exr or .npz")
    if "motion" in wanted and not (turns or moves):
        raise InputError("--outputs motion: needs --previous, the camera before, or --turntable")
    if moves and "motion" not in wanted:
        raise InputError("--previous: needs --outputs motion")


def _draw_file(
    console: Console,
    file: Path,
    output: Path,
    size: tuple[int, int],
    view: View,
    options: dict[str, Any],
    lightmap: Path | None,
    crease_angle: float | None,
) -> None:
    from math import radians

    from luxel import load
    from luxel.cli.drawing import with_lightmap

    start = time.perf_counter()
    scene = load(file, crease_angle=None if crease_angle is None else radians(crease_angle))
    if not scene.triangle_count:
        warnings.warn(f"{file}: no triangles: the picture is empty", LuxelWarning, stacklevel=2)
    if lightmap is not None:
        with_lightmap(scene, lightmap)
    cameras = view.cameras(scene, size)
    before = view.cameras_before(cameras, scene, size)
    loaded = time.perf_counter()
    with console.work("drawing") as report:
        written = _draw(scene, cameras, before, size, options, view.paths(output, len(cameras)), report)
    took = {"load": loaded - start, "draw": time.perf_counter() - loaded}
    data = {"output": [str(p) for p in written], "size": list(size), "triangles": scene.triangle_count, "seconds": took}
    what = str(written[0]) if len(written) == 1 else f"{written[0]} .. {written[-1].name}"
    times = f"loaded in {seconds(took['load'])}, drawn in {seconds(took['draw'])}"
    console.result(data, f"{what}  ({size[0]}x{size[1]}, {scene.triangle_count:,} triangles; {times})")


def _draw(
    scene: Scene,
    cameras: list[Camera],
    before: list[Camera | None],
    size: tuple[int, int],
    options: dict[str, Any],
    paths: list[Path],
    report: Callable[[float], None],
) -> list[Path]:
    """Draw and write one picture a camera; the paths written."""
    from luxel import prepare, render
    from luxel.cli.drawing import STREAMED

    if len(paths) > 1:
        prepared = prepare(scene, options.pop("shading"), options.pop("cull"), options.pop("device"))
        for i, path in enumerate(paths):
            render(prepared, cameras[i], size, previous_camera=before[i], **options).save(path)
            report((i + 1) / len(paths))
        return paths
    output = paths[0]
    streamed = size[0] * size[1] > STREAMED and options["filter"] != "lowpass" and options["device"] == "cpu"
    if streamed and output.suffix.lower() == ".png" and options["outputs"] == ("color",):
        from luxel.raster.render import render_to_png

        del options["outputs"], options["device"]
        render_to_png(output, scene, cameras[0], size, progress=report, **options)
    else:
        try:
            render(scene, cameras[0], size, previous_camera=before[0], progress=report, **options).save(output)
        except MemoryError as error:
            hint = "a smaller --size, or color alone in a .png, needs less"
            raise InputError(f"--size {size[0]}x{size[1]}: not enough memory for {', '.join(options['outputs'])}; {hint}") from error
    return [output]
