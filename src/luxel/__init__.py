"""luxel: a triangle scene from file to lit picture, without a display, a driver or a GPU.

    import luxel
    picture = luxel.render("model.glb", size=(1280, 720), samples=4)
    picture.save("model.png")

Importing this is cheap: what it offers is imported when it is first asked for, and Numba with the first kernel.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from luxel.errors import ExtraMissingError, FileError, InputError, LuxelError, LuxelWarning, UnsupportedError
    from luxel.io import load, save
    from luxel.layout.optimize import optimize
    from luxel.radiosity.bake import Baked, bake
    from luxel.radiosity.form_factors import form_factors
    from luxel.radiosity.output import save_baked
    from luxel.radiosity.relight import Transport
    from luxel.raster.picture import Picture
    from luxel.raster.render import prepare, render, render_to_png, render_views
    from luxel.scene import Ambient, Camera, Instance, Light, Material, Mesh, Scene, Texture, TextureRef
    from luxel.scene.framing import camera_for, frame, turntable
    from luxel.scene.inspect import inspect

__version__ = "0.1.0"

_HOMES = {
    "luxel.errors": ("ExtraMissingError", "FileError", "InputError", "LuxelError", "LuxelWarning", "UnsupportedError"),
    "luxel.io": ("load", "save"),
    "luxel.layout.optimize": ("optimize",),
    "luxel.radiosity.bake": ("Baked", "bake"),
    "luxel.radiosity.form_factors": ("form_factors",),
    "luxel.radiosity.output": ("save_baked",),
    "luxel.radiosity.relight": ("Transport",),
    "luxel.raster.picture": ("Picture",),
    "luxel.raster.render": ("prepare", "render", "render_to_png", "render_views"),
    "luxel.scene": ("Ambient", "Camera", "Instance", "Light", "Material", "Mesh", "Scene", "Texture", "TextureRef"),
    "luxel.scene.framing": ("camera_for", "frame", "turntable"),
    "luxel.scene.inspect": ("inspect",),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Ambient", "Baked", "Camera", "ExtraMissingError", "FileError", "InputError", "Instance", "Light", "LuxelError", "LuxelWarning", "Material",
    "Mesh", "Picture", "Scene", "Texture", "TextureRef", "Transport", "UnsupportedError", "__version__", "bake", "camera_for", "form_factors",
    "frame", "inspect", "load", "optimize", "prepare", "render", "render_to_png", "render_views", "save", "save_baked", "turntable",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = globals()[name] = getattr(importlib.import_module(_HOME[name]), name)
        return value
    raise AttributeError(f"module 'luxel' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(_HOME))
