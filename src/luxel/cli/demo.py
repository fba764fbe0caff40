"""luxel demo: a picture on a bare machine, without a file: a scene made by code, its light baked, and drawn."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from luxel.cli import values
from luxel.cli.console import Console, Json, Quiet, seconds
from luxel.errors import ExtraMissingError

if TYPE_CHECKING:
    from luxel.scene import Scene

_DENSITY = {"room": 10.0, "cornell-box": 120.0, "room-simple": None, "room-complex": None}  # luxels per metre; in the other scenes nothing shines
EXAMPLE = "luxel demo -o room.png --size 1920x1080"


def demo(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The picture: .png, .jpg, .exr or .npz.")] = Path("luxel-demo.png"),
    size: Annotated[str, typer.Option("--size", metavar="WxH", help="Pixels.")] = "1280x720",
    scene: Annotated[str, typer.Option("--scene", metavar="NAME", help=f"{', '.join(_DENSITY)}, bumpy-sphere or two-triangles.")] = "room",
    samples: Annotated[str, typer.Option("--samples", metavar="N", help="Samples a pixel: 1, 2, 4, 8 or 16.")] = "4",
    direct: Annotated[bool, typer.Option("--direct", help="Without baking: lamps alone, no shadows.")] = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Bake the light of a scene made by code, and draw it; no file needed."""
    from luxel.cli.drawing import EXTENSIONS, SAMPLES
    from luxel.scene.builtin import SCENES

    make = SCENES[values.choice(scene, SCENES, "--scene")]
    width, height = values.size(size)
    count = values.choice(samples, SAMPLES, "--samples")
    values.output(output, EXTENSIONS)
    console = Console(quiet, as_json)
    start = time.perf_counter()
    built = make()
    baked = None if direct or scene not in _DENSITY else _baked(console, built, _DENSITY[scene])
    with console.work("drawing") as report:
        from luxel import render

        picture = render(baked or built, size=(width, height), samples=count, progress=report)
    picture.save(output)
    took = time.perf_counter() - start
    triangles = built.triangle_count
    data = {"output": [str(output)], "scene": scene, "baked": baked is not None, "size": [width, height], "triangles": triangles, "seconds": took}
    console.result(data, f"{output}  ({width}x{height}, {triangles:,} triangles, {seconds(took)})")


def _baked(console: Console, scene: Scene, density: float | None) -> Scene | None:
    """The scene with its light in it, as a picture shows it; None where what baking needs is not installed, which is said."""
    from luxel.radiosity.bake import bake
    from luxel.scene.builtin import to_bake

    try:
        with console.work("baking light") as report:

            def told(unshot: float, _: object) -> None:
                report(1 - unshot, f"{unshot:.1%} of the light unshot")

            lit = bake(to_bake(scene), quality="normal", density=density, progress=told).scene
    except ExtraMissingError as error:
        console.note(f"the light is not baked: {error}")
        return None
    shown = {material.name: material.emissive for material in scene.materials}
    for material in lit.materials:
        material.emissive = shown[material.name]
    return lit
