"""From the words of the command line to values, with errors that name the option and what it wants."""

from __future__ import annotations

import difflib
import importlib.util
import math
import os
import re
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TypeVar

from luxel.errors import ExtraMissingError, FileError, InputError

T = TypeVar("T")
LARGEST = 1 << 20  # pixels a side, as `luxel.render` has it


def size(text: str) -> tuple[int, int]:
    """ "1280x720" to (1280, 720); one number makes a square."""
    found = re.fullmatch(r"\s*(\d+)\s*(?:[xX*,]\s*(\d+))?\s*", text)
    width, height = (int(found[1]), int(found[2] or found[1])) if found else (0, 0)
    if width < 1 or height < 1:
        raise InputError(f"--size: expected WIDTHxHEIGHT in pixels, such as 1280x720, got {text!r}")
    if max(width, height) > LARGEST:
        raise InputError(f"--size: expected at most {LARGEST} pixels a side, got {text!r}")
    return width, height


def whole(text: str, option: str, low: int, high: int | None = None) -> int:
    """ "4" to 4, if it lies in low .. high."""
    value = int(text) if re.fullmatch(r"\s*[+-]?[0-9]{1,18}\s*", text) else None
    if value is None or value < low or (high is not None and value > high):
        reach = f"of at least {low}" if high is None else f"from {low} to {high}"
        raise InputError(f"{option}: expected a whole number {reach}, got {text!r}")
    return value


def number(text: str | float, option: str, wanted: str, fits: Callable[[float], bool] = math.isfinite) -> float:
    """ "2.5" to 2.5, if it is one that `fits`; `wanted` says in the error which do."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and fits(value)):
        raise InputError(f"{option}: expected {wanted}, got {text!r}")
    return value


def vector(text: str, option: str) -> tuple[float, float, float]:
    """ "1,2,-3" to three floats; x, y and z name the axes, with a minus before them if need be."""
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    name = text.strip().lower()
    if name.lstrip("+-") in axes:
        sign = -1.0 if name.startswith("-") else 1.0
        x, y, z = (sign * c for c in axes[name.lstrip("+-")])
        return x, y, z
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        raise InputError(f"{option}: expected three numbers such as 1,2,-3, or an axis such as z or -x, got {text!r}") from None
    if not all(map(math.isfinite, (x, y, z))):
        raise InputError(f"{option}: expected finite numbers, got {text!r}")
    return x, y, z


def background(text: str) -> tuple[float, float, float] | None:
    """ "none" (transparent), a CSS colour name, or "#rgb" or "#rrggbb" in sRGB, to linear RGB."""
    if text.strip().lower() in ("none", "transparent"):
        return None
    from PIL import ImageColor

    from luxel.scene.colour import linear_from_srgb

    word = text.strip().lower()
    bare = re.fullmatch(r"[0-9a-f]{6}|[0-9a-f]{3}", word)  # the shell eats an unquoted "#"
    try:
        rgb = ImageColor.getrgb(f"#{word}" if bare and word not in ImageColor.colormap else word)[:3]
    except ValueError:
        near = _nearest(word, ImageColor.colormap)
        raise InputError(f"--background: expected none, a colour name or '#rrggbb', got {text!r}{near}") from None
    red, green, blue = (float(c) for c in linear_from_srgb([c / 255 for c in rgb]))
    return red, green, blue


def choice(text: str, allowed: Collection[T], option: str) -> T:
    """The one of those allowed (words, or numbers) that is spelled `text`."""
    known = {str(value): value for value in allowed}
    if text not in known:
        raise InputError(f"{option}: expected one of {', '.join(known)}, got {text!r}{_nearest(text, known)}")
    return known[text]


def names(text: str, allowed: Collection[str], option: str) -> tuple[str, ...]:
    """ "color,depth" to a tuple of names, each one of those allowed, none twice."""
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not words:
        raise InputError(f"{option}: expected one or more of {', '.join(allowed)}, got {text!r}")
    return tuple(dict.fromkeys(choice(word, allowed, option) for word in words))


def output(path: Path, extensions: Collection[str], option: str = "--output") -> Path:
    """`path`, if a file of that kind can be put there: found out before hours of work, not after."""
    if path.is_dir():
        raise FileError(path, "cannot write: it is a folder")
    if path.suffix.lower() not in extensions:
        wanted = ", ".join(extensions)
        raise InputError(f"{option}: expected a file name that ends in one of {wanted}, got {str(path)!r}")
    if path.suffix.lower() == ".exr" and importlib.util.find_spec("OpenEXR") is None:
        raise ExtraMissingError("OpenEXR", "exr", f"writing {path}")
    if not path.parent.is_dir():
        raise FileError(path, f"cannot write: there is no folder {str(path.parent)!r}")
    if not os.access(path.parent, os.W_OK):
        raise FileError(path, f"cannot write: no permission to write into {str(path.parent)!r}")
    return path


def _nearest(word: str, known: object) -> str:
    near = difflib.get_close_matches(word, list(known), 1)  # type: ignore[call-overload]
    return f"; did you mean {near[0]}?" if near else ""
