"""What `luxel render` and `luxel demo` share: which values there are, which camera is meant, and one call to draw."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from luxel.cli import values
from luxel.errors import InputError
from luxel.scene import Camera, Material, Scene, TextureRef
from luxel.scene.framing import AZIMUTH, ELEVATION, YFOV, frame, turntable

EXTENSIONS = (".png", ".jpg", ".jpeg", ".exr", ".npz")
SAMPLES = (1, 2, 4, 8, 16)
STREAMED = 64_000_000  # pixels: a picture with more is never held whole
_NUMBERS: dict[str, tuple[str, Callable[[float], bool]]] = {
    "azimuth": ("degrees", isfinite),
    "elevation": ("degrees from -90 to 90", lambda x: abs(x) <= 90),
    "distance": ("metres above 0", lambda x: x > 0),
    "fov": ("degrees between 0 and 180", lambda x: 0 < x < 180),
}
_PLACES = ({"camera"}, {"eye", "target"}, {"azimuth", "elevation", "distance"})  # ways to say where a camera stands


@dataclass
class View:
    """The camera options, as they were typed or as numbers; angles in degrees, None where they were not given.

    Raises:
        InputError: One has a wrong value, or two exclude each other.
    """

    camera: str | None = None
    azimuth: float | None = None
    elevation: float | None = None
    distance: float | None = None
    fov: float | None = None
    eye: str | None = None
    target: str | None = None
    up: str | None = None
    ortho: str | None = None
    turntable: int | None = None
    previous: str | None = None

    def __post_init__(self) -> None:
        for name, (wanted, fits) in _NUMBERS.items():
            if getattr(self, name) is not None:
                setattr(self, name, values.number(getattr(self, name), f"--{name}", wanted, fits))
        if self.turntable is not None:
            self.turntable = values.whole(str(self.turntable), "--turntable", 1, 100_000)
        framed = [self.azimuth, self.elevation, self.distance]
        if self.camera is not None and any(v is not None for v in (*framed, self.eye, self.ortho, self.turntable)):
            raise InputError("--camera takes a camera of the file: it goes with --fov, not with another camera option")
        if self.eye is not None and any(v is not None for v in (*framed, self.turntable)):
            raise InputError("--eye goes with --target, --up, --fov and --ortho, not with what frames the scene")
        if self.target is not None and self.eye is None:
            raise InputError("--target needs --eye: where the camera stands")
        if self.fov is not None and self.ortho is not None:
            raise InputError("--fov and --ortho: an orthographic camera has no field of view")
        if self.previous is not None and self.turntable is not None:
            raise InputError("--previous and --turntable: each picture of a turntable has the one before it")
        if not any(self._up()):
            raise InputError(f"--up: expected a direction, got {self.up!r}")
        self._height()  # wrong words are told before a large file is read
        for option in ("eye", "target"):
            if getattr(self, option) is not None:
                values.vector(getattr(self, option), f"--{option}")
        self._before()

    def cameras(self, scene: Scene, size: tuple[int, int]) -> list[Camera]:
        """The cameras meant, for pictures of `size` (width, height)."""
        if self.camera is not None:
            return [self._lens(_named(scene, self.camera))]
        if self.eye is not None:
            return [self._placed(scene)]
        asked = (self.azimuth, self.elevation, self.distance, self.up, self.ortho, self.turntable)
        if all(v is None for v in asked):
            return [self._lens(scene.cameras[0]) if scene.cameras else frame(scene, size=size, yfov=self._yfov())]
        options: dict[str, Any] = {
            "azimuth": AZIMUTH if self.azimuth is None else np.radians(self.azimuth),
            "elevation": ELEVATION if self.elevation is None else np.radians(self.elevation),
            "distance": self.distance,
            "yfov": self._yfov(),
            "size": size,
            "height": self._height(),
            "up": self._up(),
        }
        return [frame(scene, **options)] if self.turntable is None else turntable(scene, self.turntable, **options)

    def cameras_before(self, cameras: list[Camera], scene: Scene, size: tuple[int, int]) -> list[Camera | None]:
        """For each of `cameras`, the one that motion comes from: of --previous, or in a turntable the one before (a loop)."""
        if self.turntable is not None:
            return [*cameras[-1:], *cameras[:-1]]
        before = self._before()
        return [None] if before is None else [*before.cameras(scene, size)]

    def paths(self, output: Path, count: int) -> list[Path]:
        """Where the pictures of `count` cameras go: `output`, numbered in a turntable."""
        if self.turntable is None:
            return [output]
        digits = max(3, len(str(count - 1)))
        return [output.with_stem(f"{output.stem}_{i:0{digits}}") for i in range(count)]

    def _before(self) -> View | None:
        """The view that --previous describes: these options, but for those that it names."""
        if self.previous is None:
            return None
        known = [name for name in asdict(self) if name not in ("turntable", "previous")]
        try:
            pairs = [word.partition("=") for word in shlex.split(self.previous)]
        except ValueError:  # quotes that do not close
            pairs = []
        if not pairs or not all(value for _, _, value in pairs):
            raise InputError(f"--previous: expected camera options such as 'azimuth=25 elevation=20', got {self.previous!r}")
        named = {values.choice(name, known, "--previous"): value for name, _, value in pairs}
        kept = asdict(self) | {"previous": None}
        if any(place & named.keys() for place in _PLACES):  # it stands in another way: not in two
            kept |= {name: None for place in _PLACES if not place & named.keys() for name in place}
        if "fov" in named or "ortho" in named:
            kept |= {"fov": None, "ortho": None}
        try:
            return View(**kept | named)
        except InputError as error:
            raise InputError(f"--previous: {error}") from None

    def _yfov(self) -> float | None:
        if self.ortho is not None:
            return None
        return YFOV if self.fov is None else float(np.radians(self.fov))

    def _height(self) -> float | None:
        if self.ortho in (None, "fit"):
            return None
        try:
            height = float(self.ortho)  # type: ignore[arg-type]
        except ValueError:
            height = 0.0
        if not (height > 0 and np.isfinite(height)):
            raise InputError(f"--ortho: expected the height of the picture in metres, or fit, got {self.ortho!r}")
        return height

    def _up(self) -> tuple[float, float, float]:
        return values.vector(self.up or "y", "--up")

    def _lens(self, camera: Camera) -> Camera:
        if self.fov is None:
            return camera
        return Camera(camera.world_from_camera, yfov=self._yfov(), near=max(camera.near, 1e-6), name=camera.name)

    def _placed(self, scene: Scene) -> Camera:
        assert self.eye is not None
        eye = values.vector(self.eye, "--eye")
        bounds = scene.bounds()
        target = bounds.mean(0) if self.target is None else values.vector(self.target, "--target")
        if np.array_equal(eye, target):
            raise InputError(f"--eye: expected another place than the target, got {self.eye!r}")
        reach = float(np.linalg.norm(bounds - eye, axis=1).max()) + float(np.linalg.norm(bounds[1] - bounds[0])) + 1e-3
        if self.ortho is None:
            return Camera.look_at(eye, target, self._up(), yfov=self._yfov(), near=1e-4 * reach)
        height = self._height() or float(np.linalg.norm(bounds[1] - bounds[0])) or 1.0
        return Camera.look_at(eye, target, self._up(), yfov=None, height=height, near=0.0, far=reach)


def _named(scene: Scene, word: str) -> Camera:
    known = [camera.name or str(i) for i, camera in enumerate(scene.cameras)]
    if not known:
        raise InputError("--camera: the file has no camera; --azimuth and --elevation frame the scene")
    if word.isdigit() and word not in known:
        if int(word) < len(known):
            return scene.cameras[int(word)]
        raise InputError(f"--camera: expected a number of 0 .. {len(known) - 1} or a name, got {word}")
    return scene.cameras[known.index(values.choice(word, known, "--camera"))]


def with_lightmap(scene: Scene, path: Path) -> None:
    """Give every mesh that has lightmap coordinates the picture at `path` as its lightmap.

    A float picture (.exr, .hdr) is irradiance E in W/m2; an 8-bit one is E / pi: where it is white the
    bare colour shows.
    """
    meshes = [mesh for mesh in scene.meshes if mesh.texcoords1 is not None]
    if not meshes:
        raise InputError("--lightmap: no mesh of the file has lightmap coordinates (TEXCOORD_1)")
    for mesh in meshes:
        if mesh.material < 0:
            scene.materials.append(Material())
            mesh.material = len(scene.materials) - 1
    give_lightmap(scene, path, {mesh.material for mesh in meshes})


def give_lightmap(scene: Scene, path: Path, materials: set[int]) -> None:
    """Give the materials with these numbers the picture at `path` as their lightmap."""
    from luxel.io.images import read_image
    from luxel.scene.material import Texture

    image = read_image(path)
    scale = float(np.pi) if image.dtype == np.uint8 else 1.0
    scene.textures.append(Texture(image, wrap=("clamp", "clamp"), filter="bilinear", name=path.name))
    for number in materials:
        material = scene.materials[number]
        material.lightmap_texture = TextureRef(len(scene.textures) - 1, texcoord=1)
        material.lightmap_scale = scale
