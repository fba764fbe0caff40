"""OBJ laid out as it is: faces move within their run (between statements such as `g` or `usemtl`), lines of vertices move as they are written.

Comments and statements stay where they stand. Polygons become triangles. A vertex, for the cache, is what a corner names of v, vt and vn
together; lines v, vt and vn are each put in the order in which the faces first name them. They keep their places when the file has
free-form geometry, whose statements count them too.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError
from luxel.io.files import atomic_write, read_bytes, tell
from luxel.io.obj import face_corners, library_names
from luxel.io.polygons import triangulate, unify
from luxel.io.text import parse, table_lines, words_per_line
from luxel.layout.clean import vertex_rows
from luxel.layout.measure import Draw
from luxel.layout.optimize import Options, Progress, Report, lay_out, tell_polygons
from luxel.layout.same import Soup

_TABLES = (b"v", b"vt", b"vn")
_LEAST = {b"v": 3, b"vt": 1, b"vn": 3}
_WIDEST = {b"v": 8, b"vt": 3, b"vn": 3}  # of lines as they are usual: rows of two files are as wide
_FREE_FORM = {b"curv", b"curv2", b"surf", b"trim", b"hole", b"scrv", b"sp", b"cstype", b"bmat", b"vp", b"con"}
_ELEMENTS = {b"l", b"p"}
_STATE = {b"g", b"o", b"usemtl", b"s", b"mtllib"}


class _Faces:
    """What `luxel.io.obj.face_corners` asks of its lines."""

    def __init__(self, lines: list[bytes], numbers: list[int]) -> None:
        self.text = b"".join(lines[i].split(b"#")[0].strip()[1:] + b"\n" for i in numbers)

    def block(self, runs: Any, key: bytes) -> bytes:
        return self.text


@dataclass
class _Run:
    """Faces between two statements."""

    state: str
    lines: list[int] = field(default_factory=list)


class Content:
    """An OBJ file taken apart.

    Attributes:
        lines: As they stand, without line ends.
        slots: The lines of v, vt and vn.
        tables: Their numbers, (n, widest) float64 with NaN where a line is short.
        runs: The faces.
        counts, corners: Per face its corners; what all corners name of v, vt and vn, from 0, -1 where left out.
        triangles: (m, 3) places in `corners`; `begin` (runs + 1,): the first of each run.
        elements: Lines of l and p.
        fixed: Statements that number vertices are there.
    """

    def __init__(self, path: Path) -> None:
        raw = read_bytes(path).tobytes()
        self.where = path.name
        self.eol = b"\r\n" if b"\r\n" in raw else b"\n"
        text = raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b"  ")
        self.lines = text.split(b"\n")
        self.slots: dict[bytes, list[int]] = {key: [] for key in _TABLES}
        self.runs: list[_Run] = []
        self.elements: list[int] = []
        self.fixed = False
        self._scan()
        self.tables = {key: self._table(key) for key in _TABLES}
        self._faces()

    def _scan(self) -> None:
        state: dict[bytes, str] = {}
        open_run = False
        for number, line in enumerate(self.lines):
            words = line.split(None, 1)
            key = words[0] if words else b""
            if key in self.slots:
                self.slots[key].append(number)
            elif key == b"f":
                if not open_run:
                    self.runs.append(_Run(", ".join(f"{k.decode()} {v}" for k, v in state.items())))
                    open_run = True
                self.runs[-1].lines.append(number)
            elif key and not key.startswith(b"#"):
                open_run = False
                self.fixed |= key in _FREE_FORM
                if key in _ELEMENTS:
                    self.elements.append(number)
                elif key in _STATE:
                    state[key] = words[1].decode("utf-8", "replace").strip() if len(words) > 1 else ""

    def _table(self, key: bytes) -> Array:
        numbers = self.slots[key]
        if not numbers:
            return np.zeros((0, _LEAST[key]))
        text = b"".join(self.lines[i].split(b"#")[0].split(None, 1)[1] + b"\n" if len(self.lines[i].split(None, 1)) > 1 else b"\n" for i in numbers)
        counts = words_per_line(text)
        if len(counts) != len(numbers) or int(counts.min()) < _LEAST[key]:
            at = numbers[int(counts.argmin())] + 1
            raise FileError(f"{self.where}, line {at}", f"`{key.decode()}` needs {_LEAST[key]} numbers, got {counts.min()}")
        return table_lines(parse(text, float, self.where, lambda k: numbers[k] + 1, int(counts.sum())), counts)

    def _faces(self) -> None:
        numbers = [i for run in self.runs for i in run.lines]
        self.counts, self.corners = np.zeros(0, np.int64), np.zeros((0, 3), np.int64)
        if numbers:
            faces: Any = _Faces(self.lines, numbers)
            self.counts, self.corners = face_corners(faces, self.where, [(i, i + 1) for i in numbers])
            self._resolve(np.repeat(np.array(numbers), self.counts))
        sizes = np.array([len(run.lines) for run in self.runs], np.int64)
        cut = triangulate(self.counts, np.maximum(self.corners[:, 0], 0), self.tables[b"v"][:, :3])
        self.triangles = cut
        made = np.maximum(self.counts - 2, 0)
        ends = np.cumsum(made)
        self.begin = np.append(0, ends[np.cumsum(sizes) - 1]) if len(sizes) else np.zeros(1, np.int64)

    def _resolve(self, line: Array) -> None:
        """Make indices absolute, from 0, and check them; `line` is that of each corner."""
        for k, key in enumerate(_TABLES):
            column, rows = self.corners[:, k], len(self.slots[key])
            before = np.searchsorted(np.array(self.slots[key], np.int64), line)
            absolute = np.where(column < 0, before + column, column - 1)
            wrong = (absolute >= rows) | ((absolute < 0) & (column != 0)) | ((column == 0) & (k == 0))
            if wrong.any():
                at = int(np.flatnonzero(wrong)[0])
                raise FileError(f"{self.where}, line {line[at] + 1}", f"a corner names {key.decode()} {column[at]} of {rows}")
            self.corners[:, k] = np.where(column == 0, -1, absolute)

    def vertices(self) -> tuple[Array, list[Array]]:
        """(n, 3): what each different vertex names; and the triangles of each run by such vertices, (m, 3) int32."""
        corners = self.corners[self.triangles.reshape(-1)]
        first, number = unify([corners[:, k] + 1 for k in range(3)])
        return corners[first], np.split(number.reshape(-1, 3), self.begin[1:-1]) if len(self.runs) else []

    def rows(self, named: Array) -> Array:
        """Everything of vertices, to compare them by: all numbers of the lines they name, and which lines they lack."""
        parts = [np.ascontiguousarray(named < 0).astype(np.uint8)]
        for k, key in enumerate(_TABLES):
            have = self.tables[key]
            table = np.full((len(have) + 1, max(have.shape[1], _WIDEST[key])), np.nan)
            table[:-1, : have.shape[1]] = have
            parts.append(table[named[:, k]])  # -1: the last row, of nothing
        return vertex_rows(parts)


class Package:
    """A file laid out, to be written."""

    def __init__(self, content: Content, source: Path, maps: dict[bytes, Array], keep: dict[bytes, Array], faces: list[bytes]) -> None:
        self.content, self.source, self.maps, self.keep, self.faces = content, source, maps, keep, faces

    def save(self, path: Path, home: Path) -> None:
        """Write the file; material libraries and their pictures come along, unless `home`, where it is to stand, has them."""
        content = self.content
        lines: list[bytes | None] = list(content.lines)
        for key in _TABLES:
            slots = content.slots[key]
            moved = [content.lines[slots[i]] for i in self.keep[key].tolist()]
            for place, line in zip(slots, [*moved, *[None] * (len(slots) - len(moved))], strict=True):
                lines[place] = line
        for run, text in zip(content.runs, self.faces, strict=True):
            for number in run.lines[:-1]:
                lines[number] = None
            lines[run.lines[-1]] = text or None  # after all vertices that the run may name
        for number in content.elements:
            lines[number] = self._element(content.lines[number], number)
        with atomic_write(path) as file:
            text = b"\n".join(line for line in lines if line is not None)
            file.write((text or b"\n").replace(b"\n", content.eol))
        if home.resolve() != self.source.parent.resolve():
            for line in content.lines:
                if line.split(None, 1)[:1] == [b"mtllib"]:
                    _bring_library(self.source.parent, path.parent, line.split(None, 1)[1].decode("utf-8", "replace").strip())

    def _element(self, line: bytes, number: int) -> bytes:
        """A line l or p with its indices absolute and renumbered."""
        key, *corners = line.split(b"#")[0].split()
        return b" ".join([key, *(b"/".join(map(b"%d".__mod__, r)) for r in _named(self.content, corners, number, self.maps))])


def _named(content: Content, corners: list[bytes], number: int, maps: dict[bytes, Array] | None) -> list[list[int]]:
    """What the corners of a line l or p name, from 1; renumbered by `maps`."""
    out = []
    for corner in corners:
        row = []
        for key, word in zip(_TABLES, corner.split(b"/"), strict=False):
            if not re.fullmatch(rb"-?\d+", word):
                raise FileError(f"{content.where}, line {number + 1}", f"expected v or v/vt, got {corner.decode('utf-8', 'replace')!r}")
            index = int(word)
            index = int(np.searchsorted(content.slots[key], number)) + index if index < 0 else index - 1
            if not 0 <= index < len(content.slots[key]):
                raise FileError(f"{content.where}, line {number + 1}", f"names {key.decode()} {int(word)} of {len(content.slots[key])}")
            row.append(1 + (index if maps is None else int(maps[key][index])))
        out.append(row)
    return out


def optimize(path: Path, options: Options, report: Report, progress: Progress | None = None) -> Package:
    """The file laid out; `save` writes it.

    Raises:
        FileError: A line is malformed, or names what is not there.
    """
    content = Content(path)
    tell_polygons(content.where, content.counts)
    named, lists = content.vertices()
    points = np.ascontiguousarray(content.tables[b"v"][:, :3][named[:, 0]], np.float32) if len(named) else np.zeros((0, 3), np.float32)
    laid = lay_out(lists, len(named), options, report, points, lambda: content.rows(named), progress=progress)
    drawn = [named[laid.vertex_source[faces.reshape(-1)]] for faces in laid.triangles]
    every = np.concatenate(drawn) if drawn else np.zeros((0, 3), np.int64)
    maps, keep = {}, {}
    for k, key in enumerate(_TABLES):
        rows = len(content.slots[key])
        was = np.zeros(rows, bool)
        was[named[named[:, k] >= 0, k]] = True
        held = _held(content, key, k)
        if content.fixed:
            keep[key] = np.arange(rows)
        else:
            first = _first_use(every[every[:, k] >= 0, k])
            rest = np.ones(rows, bool)
            rest[first] = False
            # What only welded or dropped triangles named goes; what nothing ever named stays, unless that is to go too.
            keep[key] = np.concatenate([first, np.flatnonzero(rest & (held | (~was & (not options.drop_unused))))])
        maps[key] = np.full(rows + 1, -1, np.int64)
        maps[key][keep[key]] = np.arange(len(keep[key]))
    faces = [_face_lines(corners, maps) for corners in drawn]
    return Package(content, path, maps, keep, faces)


def _held(content: Content, key: bytes, k: int) -> Array:
    """(rows,) bool: what lines and points name."""
    held = np.zeros(len(content.slots[key]), bool)
    for number in content.elements:
        rows = _named(content, content.lines[number].split(b"#")[0].split()[1:], number, None)
        held[[row[k] - 1 for row in rows if len(row) > k]] = True
    return held


def _first_use(flat: Array) -> Array:
    values, first = np.unique(flat, return_index=True)
    return np.asarray(values[np.argsort(first)])


def _face_lines(corners: Array, maps: dict[bytes, Array]) -> bytes:
    """Lines f of triangles whose corners name (3 m, 3) of v, vt and vn."""
    numbers = np.stack([np.where(corners[:, k] < 0, 0, maps[key][corners[:, k]] + 1) for k, key in enumerate(_TABLES)], 1)
    has = numbers[:, 1:] > 0
    if not len(corners):
        return b""
    if (has == has[0]).all():
        pattern, columns = _pattern(*has[0].tolist())
        line = "f " + " ".join([pattern] * 3)
        rows = numbers[:, columns].reshape(len(corners) // 3, -1).tolist()
        return "\n".join(line % tuple(row) for row in rows).encode()
    words = []
    for row, (vt, vn) in zip(numbers.tolist(), has.tolist(), strict=True):
        pattern, columns = _pattern(vt, vn)
        words.append(pattern % tuple(row[k] for k in columns))
    return "\n".join("f " + " ".join(words[i : i + 3]) for i in range(0, len(words), 3)).encode()


def _pattern(vt: bool, vn: bool) -> tuple[str, list[int]]:
    return {(False, False): ("%d", [0]), (True, False): ("%d/%d", [0, 1]), (False, True): ("%d//%d", [0, 2]), (True, True): ("%d/%d/%d", [0, 1, 2])}[
        vt, vn
    ]


def _bring_library(source: Path, target: Path, names: str) -> None:
    """Copy material libraries, and the pictures they name, from one folder to another."""
    for name in library_names(names, source):
        tail = name.replace("\\", "/")
        found = next((each for each in (tail, tail.rsplit("/", 1)[-1]) if _inside(each) and (source / each).is_file()), None)
        if found is None:
            tell(name, "this material library cannot be brought along")
            continue
        data = read_bytes(source / found).tobytes()
        _copy(data, target / found)
        for line in data.decode("utf-8", "replace").splitlines():
            words = line.split("#")[0].split()
            if len(words) > 1 and (words[0].lower().startswith("map_") or words[0].lower() in ("bump", "disp", "norm", "decal", "refl")):
                tails = [" ".join(words[i:]) for i in range(1, len(words))]  # after options; a name may hold blanks
                picture = next((tail for tail in tails if _inside(tail) and (source / tail).is_file()), None)
                if picture is not None:
                    _copy(read_bytes(source / picture).tobytes(), target / picture)


def _inside(name: str) -> bool:
    return not Path(name).is_absolute() and ".." not in Path(name).parts


def _copy(data: bytes, place: Path) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(place) as file:
        file.write(data)


# What a file holds, for proof


def contents(path: Path) -> tuple[list[Draw], dict[str, Soup]]:
    """No draw calls of its own (a scene's are used); faces as soups by the statements in force, with all numbers of the lines they name."""
    content = Content(path)
    named, lists = content.vertices()
    rows, points = content.rows(named), content.tables[b"v"][:, :3]
    positions = points[named[:, 0]] if len(named) else None
    states: dict[str, list[Array]] = {}
    for run, faces in zip(content.runs, lists, strict=True):
        states.setdefault(run.state, []).append(faces)
    return [], {state: Soup(np.concatenate(parts), rows, positions) for state, parts in states.items()}


def rest_differs(before: Path, after: Path) -> str | None:
    """What differs between two files beside faces and the numbering of vertices; None if nothing does."""
    old, new = Content(before), Content(after)
    skip: Callable[[bytes], bool] = lambda line: (line.split(None, 1)[:1] or [b""])[0] in (*_TABLES, *_ELEMENTS, b"f")  # noqa: E731
    a, b = ([line for line in content.lines if line and not skip(line)] for content in (old, new))
    if a != b:
        return "statements or comments are not the same"
    if len(old.elements) != len(new.elements):
        return "lines or points are missing"
    for i, j in zip(old.elements, new.elements, strict=True):
        rows = [_named(c, c.lines[n].split(b"#")[0].split()[1:], n, None) for c, n in ((old, i), (new, j))]
        places = [[c.tables[b"v"][row[0] - 1].tobytes() for row in part] for c, part in zip((old, new), rows, strict=True)]
        if places[0] != places[1]:
            return f"{old.lines[i][:40].decode('utf-8', 'replace')!r} is not the same"
    return None
