"""luxel demo: a picture on a bare machine, without a file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet, seconds

EXAMPLE = "luxel demo -o room.png --size 1920x1080"


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The picture: .png, .jpg, .exr or .npz.")] = Path("luxel-demo.png"),
    size: Annotated[str, typer.Option("--size", metavar="WxH", help="Pixels.")] = "1280x720",
    scene: Annotated[str, typer.Option("--scene", metavar="NAME", help="room, cornell-box, bumpy-sphere or two-triangles.")] = "room",
    samples: Annotated[str, typer.Option("--samples", metavar="N", help="Samples a pixel: 1, 2, 4, 8 or 16.")] = "4",
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Draw a scene made by code; no file needed."""
    from luxel.cli.drawing import EXTENSIONS, SAMPLES
    from luxel.scene.builtin import SCENES

    make = SCENES[values.choice(scene, SCENES, "--scene")]
    width, height = values.size(size)
    count = values.choice(samples, SAMPLES, "--samples")
    values.output(output, EXTENSIONS)
    console = Console(quiet, as_json)
    start = time.perf_counter()
    built = make()
    with console.work("drawing") as report:
        from luxel import render

        picture = render(built, size=(width, height), samples=count, progress=report)
    picture.save(output)
    took = time.perf_counter() - start
    triangles = built.triangle_count
    data = {"output": [str(output)], "scene": scene, "size": [width, height], "triangles": triangles, "seconds": took}
    console.result(data, f"{output}  ({width}x{height}, {triangles:,} triangles, {seconds(took)})")
