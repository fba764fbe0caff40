"""MTL, the material library of OBJ files: the Blinn-Phong terms, textures, and the common PBR additions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from luxel.errors import FileError
from luxel.io.files import read_bytes, tell
from luxel.scene.material import Material, Texture, TextureRef, Wrap
from luxel.scene.scene import Scene

_OPTIONS = {  # of a map statement: how many words follow at most
    "-o": 3, "-s": 3, "-t": 3, "-mm": 2, "-bm": 1, "-blendu": 1, "-blendv": 1, "-boost": 1, "-clamp": 1, "-imfchan": 1,
    "-texres": 1, "-type": 1, "-cc": 1, "-colorspace": 1,
}  # fmt: skip
_MAPS = {  # statement: (field of Material, colours are sRGB-encoded)
    "map_kd": ("base_color_texture", True),
    "map_ke": ("emissive_texture", True),
    "norm": ("normal_texture", False),
    "map_kn": ("normal_texture", False),
}
_IGNORED_MAPS = (
    "map_ka",
    "map_ks",
    "map_ns",
    "map_bump",
    "bump",
    "disp",
    "decal",
    "refl",
    "map_pr",
    "map_pm",
    "map_ps",
)


@dataclass
class Library:
    """The materials read so far, by name, and the textures they share; both are appended to `scene`."""

    scene: Scene
    folder: Path
    where: str

    def __post_init__(self) -> None:
        self.numbers: dict[str, int] = {}
        self._textures: dict[tuple[Any, ...], int | None] = {}

    def number(self, name: str) -> int:
        """Index of the material `name`; one that no library has becomes a plain one."""
        if name not in self.numbers:
            tell(self.where, f"material {name!r} is in no material library; it becomes plain grey")
            self._append(name, Material(name=name))
        return self.numbers[name]

    def read(self, name: str) -> None:
        """Read the library `name`, looked for as written, then beside the OBJ file by its last part; a missing one is said."""
        tail = name.replace("\\", "/")
        candidates = [self.folder / tail, self.folder / tail.rsplit("/", 1)[-1]]
        path = next((path for path in candidates if _is_file(path)), None)
        if path is None:
            tell(self.where, f"material library {name!r} is not there")
            return
        text = read_bytes(path).tobytes().decode("utf-8", "replace")
        current: dict[str, str] = {}
        for line in [*text.replace("\\\n", " ").splitlines(), "newmtl"]:
            key, _, rest = line.split("#")[0].strip().partition(" ")
            key, _, tabbed = key.partition("\t")  # a tab may follow the key as well
            rest = f"{tabbed} {rest}".strip()
            if key.lower() == "newmtl":
                if current:
                    self._append(current["newmtl"], self._material(path, current))
                current = {"newmtl": rest}
            elif key and current:
                current[key.lower()] = rest

    def _append(self, name: str, material: Material) -> None:
        self.numbers[name] = len(self.scene.materials)
        self.scene.materials.append(material)

    def _material(self, path: Path, entries: dict[str, str]) -> Material:
        where = f"{path.name}, material {entries['newmtl']}"
        numbers = {key: _numbers(where, key, entries[key]) for key in ("kd", "ks", "ke", "ns", "d", "tr", "pr", "pm") if key in entries}
        alpha = numbers["d"][0] if "d" in numbers else 1 - numbers["tr"][0] if "tr" in numbers else 1.0
        alpha = min(max(alpha, 0.0), 1.0)
        material = Material(name=entries["newmtl"], base_color=(*_rgb(numbers.get("kd", [0.8])), alpha))
        if "ks" in numbers:
            material.specular = _rgb(numbers["ks"])
        if "ns" in numbers:
            material.shininess = max(numbers["ns"][0], 0.0)
        if "ke" in numbers:
            material.emissive = _rgb(numbers["ke"])
        if "pr" in numbers:
            material.roughness = min(max(numbers["pr"][0], 0.0), 1.0)
        if "pm" in numbers:
            material.metallic = min(max(numbers["pm"][0], 0.0), 1.0)
        self._maps(where, path.parent, entries, material)
        if alpha < 1 or "map_d" in entries:
            material.alpha_mode = "BLEND"
        return material

    def _maps(self, where: str, folder: Path, entries: dict[str, str], material: Material) -> None:
        for key in _MAPS.keys() & entries.keys():
            name, srgb = _MAPS[key]
            cut = entries.get("map_d", "") if key == "map_kd" else ""
            setattr(material, name, self._texture(f"{where}, {key}", folder, entries[key], srgb, cut))
        if material.emissive_texture is not None and not any(material.emissive):
            material.emissive = (1.0, 1.0, 1.0)
        if "map_d" in entries and "map_kd" not in entries:
            tell(where, "map_d without map_Kd is ignored")
        for key in sorted(entries.keys() & set(_IGNORED_MAPS)):
            if key != "map_ka" or entries[key] != entries.get("map_kd"):
                tell(where, f"{key} is ignored")

    def _texture(self, where: str, folder: Path, entry: str, srgb: bool, cut: str) -> TextureRef | None:
        """The texture of a map statement, with its offset, scale and clamp; `cut` is the statement of its alpha, or empty."""
        name, options = _map_statement(entry)
        wrap: Wrap = "clamp" if options.get("-clamp", ["off"])[:1] == ["on"] else "repeat"
        key = (folder, name, srgb, wrap, cut)
        if key not in self._textures:
            self._textures[key] = self._load(where, folder, name, srgb, wrap, cut)
        number = self._textures[key]
        if number is None:
            return None
        offset = [*_numbers(where, "-o", " ".join(options.get("-o", ["0"]))), 0.0][:2]
        scale = [*_numbers(where, "-s", " ".join(options.get("-s", ["1"]))), 1.0][:2]
        # OBJ: t = s * (u, v) + o with v upwards; luxel's v runs downwards, 1 - v.
        return TextureRef(number, offset=(offset[0], 1 - scale[1] - offset[1]), scale=(scale[0], scale[1]))

    def _load(self, where: str, folder: Path, name: str, srgb: bool, wrap: Wrap, cut: str) -> int | None:
        from luxel.io.images import load_texture, with_alpha

        texture = load_texture(_locate(folder, name), where, srgb)
        if texture is None:
            return None
        cut_name = _map_statement(cut)[0]
        if cut_name and cut_name != name:
            alpha = load_texture(_locate(folder, cut_name), f"{where}, map_d", False)
            texture = texture if alpha is None else replace(texture, image=with_alpha(texture.image, alpha.image))
        self.scene.textures.append(replace(texture, wrap=(wrap, wrap)))
        return len(self.scene.textures) - 1


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name too long, or with a null byte
        return False


def _locate(folder: Path, name: str) -> Path:
    """A texture as written, or beside the library by the last part of its name where only that is there."""
    path = folder / name.replace("\\", "/")
    beside = folder / path.name
    return beside if not _is_file(path) and _is_file(beside) else path


def _map_statement(entry: str) -> tuple[str, dict[str, list[str]]]:
    """The file name (which may hold blanks) and the options of a map statement."""
    words = entry.split()
    options: dict[str, list[str]] = {}
    place = 0
    while place < len(words) and words[place] in _OPTIONS:
        option, most = words[place], _OPTIONS[words[place]]
        place += 1
        taken: list[str] = []
        while len(taken) < most and place < len(words) - 1 and (most == 1 or _is_number(words[place])):
            taken.append(words[place])
            place += 1
        options[option] = taken
    name = entry.split(maxsplit=place)[place] if place < len(words) else ""
    return name.strip().strip('"'), options


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _numbers(where: str, key: str, text: str) -> list[float]:
    """The finite numbers that start `text`, at least one."""
    numbers = []
    for word in text.split():
        if not _is_number(word):
            break
        numbers.append(float(word))
    if not numbers:
        raise FileError(where, f"{key}: expected numbers, got {text[:60]!r}")
    return numbers


def _rgb(numbers: list[float]) -> tuple[float, float, float]:
    red, green, blue = (numbers * 3)[:3] if len(numbers) < 3 else numbers[:3]
    return max(red, 0.0), max(green, 0.0), max(blue, 0.0)


def texture_file(texture: Texture, number: int) -> str:
    """A file name for a texture that is written beside a model."""
    stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in Path(texture.name).stem)[:60]
    return f"{stem or 'texture'}_{number}.png"
