"""What every reader and writer shares: whole files in, whole files out, and luxel's own exceptions at the door."""

from __future__ import annotations

import difflib
import os
import secrets
import stat
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError, LuxelError, LuxelWarning
from luxel.unfinished import unfinished


@contextmanager
def door(where: object, fault: str = "malformed") -> Iterator[None]:
    """What goes wrong inside leaves as a FileError that names `where`; floating-point noise in a file's numbers is quiet."""
    try:
        with np.errstate(all="ignore"):
            yield
    except (FileError, ImportError, Warning):
        raise
    except LuxelError as error:
        raise FileError(where, str(error)) from error
    except OSError as error:
        raise FileError(where, error.strerror or str(error) or type(error).__name__) from error
    except RecursionError as error:
        raise FileError(where, "nested too deeply") from error
    except MemoryError as error:
        raise FileError(where, "not enough memory for what it holds") from error
    except Exception as error:
        raise FileError(where, f"{fault} ({type(error).__name__}: {error})") from error


def tell(where: object, what: str) -> None:
    """Warn that something in `where` was dropped, repaired or ignored; points at the caller outside of luxel."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).startswith("luxel."):
        level, frame = level + 1, frame.f_back
    warnings.warn(f"{where}: {what}", LuxelWarning, stacklevel=level)


def open_plain(path: Path, where: object | None = None) -> IO[bytes]:
    """Open a file for reading; `where` stands for it in errors.

    Raises:
        FileError: It is missing, empty, unreadable or not a plain file (a pipe or a device would block, or never end).
    """
    what = "" if where is None else f" {path}"
    where = path if where is None else where
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise FileError(where, f"cannot read{what}: it is {'a folder' if stat.S_ISDIR(status.st_mode) else 'not a plain file'}")
        if not status.st_size:
            raise FileError(where, f"cannot read{what}: the file is empty")
        return path.open("rb")
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        near = _near(path) if isinstance(error, FileNotFoundError) else ""
        raise FileError(where, f"cannot read{what}: {getattr(error, 'strerror', None) or error}{near}") from error


def _near(path: Path) -> str:
    """What the name may have been meant to be, of what is in the folder."""
    with suppress(OSError):
        like = [name for name in os.listdir(path.parent) if difflib.get_close_matches(path.stem, [Path(name).stem], 1)]  # endings are all alike
        found = difflib.get_close_matches(path.name, like, 1)
        return f"; did you mean {path.with_name(found[0])}?" if found else ""
    return f"; there is no folder {str(path.parent)!r}"


def read_bytes(path: Path, where: object | None = None) -> Array:
    """The whole file as uint8, writable, in one array; errors as of `open_plain`."""
    with open_plain(path, where) as file:
        return np.fromfile(file, np.uint8)


def map_bytes(path: Path, where: object | None = None) -> Array:
    """As `read_bytes`, and what nobody looks at is not read; what is written into it stays with this process."""
    with open_plain(path, where) as file:
        return np.asarray(np.memmap(file, np.uint8, "c"))


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """A binary file that takes `path`'s place only when the block ends well; otherwise `path` stays as it was.

    Raises:
        FileError: The folder is missing or cannot be written, or the disk is full.
    """
    path = Path(path)
    temporary = str(beside(path))
    with unfinished(temporary):
        try:
            with open(temporary, "xb", opener=_private) as file:  # by name, which libraries that write on their own need
                yield file
            os.chmod(temporary, mode_of(path))
            os.replace(temporary, path)
        except OSError as error:
            raise FileError(path, f"cannot write: {error.strerror or error}") from error
        finally:
            with suppress(OSError):
                os.unlink(temporary)


def beside(path: Path) -> Path:
    """A name in the folder of `path` that nobody has, for a file that is to take its place: hidden, and ending in ".part"."""
    return path.with_name(f".{path.name[:100]}.{secrets.token_hex(4)}.part")


def _private(name: str, flags: int) -> int:
    return os.open(name, flags, 0o600)


def mode_of(path: Path) -> int:
    """The mode of the file that is replaced, or that of any new file (a part's own is private)."""
    with suppress(OSError):
        return stat.S_IMODE(path.stat().st_mode)
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
