"""luxel hardware: the colour interpolator as a circuit: its Verilog, pictures through its simulation, its synthesis."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet, seconds
from luxel.errors import FileError, InputError

EXAMPLE = "luxel hardware synth --liberty cells.lib"
HELP = "The colour interpolator as a circuit: Verilog, pictures through its simulation, synthesis."
_COMPILING = "compiling the simulation of the circuit, about a minute; only the first run waits for it ..."
_MODULES = "area, reciprocal, scan, barycentrics, color, whole"
Modules = Annotated[list[str] | None, typer.Option("--module", metavar="NAME", help=f"Which, of {_MODULES}; may be repeated.", show_default=False)]


def verilog(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder to write to.")],
    module: Annotated[str, typer.Option("--module", metavar="NAME", help=f"Which: {_MODULES}.")] = "whole",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Write the circuit in Verilog: a file a module, and a list of them for simulators."""
    from luxel.hardware.rtl.verilog import write
    from luxel.hardware.synthesis.designs import designs

    _folder(output, "--output")
    files = write(designs([module])[0], output)
    text = f"{len(files) - 1} modules in {output}; try: iverilog -g2005 -s {files[-1].stem} -c {files[-1].name}"
    Console(quiet, as_json).result({"files": [str(path) for path in files]}, text)


def render(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="A .glb, .gltf, .obj, .ply, .stl or .off.", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="PNG", help="The picture.")],
    size: Annotated[str, typer.Option("--size", metavar="WxH", help="Of the picture, up to 4096 x 4096.")] = "320x240",
    simulator: Annotated[str, typer.Option("--simulator", metavar="NAME", help="auto, cxx (needs a C++ compiler), amaranth (slow).")] = "auto",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Draw a picture through the simulated circuit: the bytes of `luxel render --shading hardware --aa none`."""
    import time

    from luxel import load
    from luxel.cli.drawing import EXTENSIONS
    from luxel.hardware.rtl import draw

    console = Console(quiet, as_json)
    width, height = values.size(size)
    values.output(output, EXTENSIONS)
    using = draw.simulator(simulator)
    start = time.perf_counter()
    with console.work("circuit"):
        picture, found = draw.render(load(scene), size=(width, height), using=using, compiling=lambda: console.note(_COMPILING))
    picture.save(output)
    took = time.perf_counter() - start
    data = {
        "output": str(output), "simulator": using, "fragments": len(found.x), "clocks": found.clocks, "first_fragment_clock": found.first,
        "seconds": took,
    }  # fmt: skip
    console.result(data, f"{output}: {len(found.x):,} fragments in {found.clocks:,} clocks, simulated in {seconds(took)} ({using})")


def synth(
    library: Annotated[
        Path | None, typer.Option("--liberty", metavar="FILE", help="Map to these standard cells, before layout, instead.", show_default=False)
    ] = None,
    module: Modules = None,
    seeds: Annotated[str, typer.Option("--seeds", metavar="N", help="Placements of each, for median and range.")] = "5",
    device: Annotated[str, typer.Option("--device", metavar="NAME", help="An ECP5: 25k, 45k, 85k, um5g-45k ...")] = "um5g-45k",
    speed: Annotated[str, typer.Option("--speed", metavar="GRADE", help="6, 7 or 8; 8 for um5g.")] = "8",
    jobs: Annotated[str, typer.Option("--jobs", metavar="N", help="Placements at once.")] = "1",
    keep: Annotated[
        Path | None, typer.Option("--keep", metavar="DIR", help="Keep netlists and reports there.", show_default=False)
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Synthesise the circuit: Yosys and nextpnr for an ECP5, or Yosys and OpenSTA for standard cells. Takes minutes."""
    from luxel.hardware.synthesis import ecp5, liberty, report
    from luxel.hardware.synthesis.designs import designs

    console = Console(quiet, as_json)
    each = designs(module)
    counts = values.whole(seeds, "--seeds", 1), values.whole(speed, "--speed", 6, 8), values.whole(jobs, "--jobs", 1)
    values.choice(device, ecp5.DEVICES, "--device")
    if device.startswith("um5g") and counts[1] != 8:
        raise InputError(f"--speed: expected 8, the only one of {device}, got {speed!r}")
    cells = None if library is None else liberty.read(library)
    if keep is not None:
        _folder(keep, "--keep")
    with tempfile.TemporaryDirectory() as scratch, console.work("synthesis") as progress:
        folder = (keep or Path(scratch)).resolve()
        if cells is not None:
            rows = report.rows_of(each, lambda design: report.in_cells(design, folder, cells), progress)
        else:
            rows = report.rows_of(each, lambda design: report.on_ecp5(design, folder, counts[0], device, counts[1], counts[2]), progress)
    what = f"{library.name}, before layout" if library else f"ECP5 {device}, speed {speed}, median of {seeds} seeds"
    text = f"{what}\n\n{report.table(rows)}\n\n" + "\n".join(f"{row['module']}: {row['slowest path']}" for row in rows)
    console.result({"target": what, "paper_MHz": report.PAPER_MHZ, "modules": rows}, text)


def _folder(path: Path, option: str) -> None:
    """Refuse what is no folder before work begins."""
    if path.exists() and not path.is_dir():
        raise FileError(path, f"{option}: expected a folder, found a file")


COMMANDS = (
    (verilog, "luxel hardware verilog -o rtl"),
    (render, "luxel hardware render model.glb -o model.png --size 160x120"),
    (synth, "luxel hardware synth --module color --seeds 3"),
)
