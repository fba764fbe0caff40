"""The exception tree. Every error says what was expected, what came, and where."""

from __future__ import annotations


class LuxelError(Exception):
    """Base of every exception that luxel raises on purpose."""


class InputError(LuxelError, ValueError):
    """An argument has the wrong shape, dtype, range or name."""


class DarkError(InputError):
    """Nothing in a scene shines, so there is no light to bake."""


class FileError(LuxelError):
    """A file cannot be read or written: `where` names it and, if known, the line, accessor or byte.

    >>> str(FileError("model.gltf, accessor 3", "count 10 needs 120 bytes, its buffer view holds 96"))
    'model.gltf, accessor 3: count 10 needs 120 bytes, its buffer view holds 96'
    """

    def __init__(self, where: object, what: str) -> None:
        super().__init__(f"{where}: {what}")
        self.where = str(where)
        self.what = what


class UnsupportedError(FileError):
    """A file is sound but needs a feature that luxel has not; the message names it."""


class ExtraMissingError(LuxelError, ImportError):
    """An optional dependency is not installed; the message names the extra that brings it."""

    def __init__(self, package: str, extra: str, why: str) -> None:
        super().__init__(f"{why} needs the package {package}: pip install 'luxel[{extra}]'")


class DeviceError(LuxelError):
    """A GPU is asked for, and none can be used, or it has too little memory."""


class LuxelWarning(UserWarning):
    """Something in the input was dropped, repaired or ignored, and the result goes on without it."""


def in_words(error: BaseException) -> str | None:
    """What luxel's own errors, a lack of memory, and what the system says of a file come down to in a line; None for others, whose place matters."""
    if isinstance(error, LuxelError):
        return str(error)
    if isinstance(error, MemoryError):
        return f"not enough memory: {error or 'no more could be had'}"
    return f"{error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else None
