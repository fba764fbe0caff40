"""OFF, the Object File Format, ASCII: OFF, COFF (colours), NOFF (normals), STOFF (texture coordinates) and their combinations."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import FileError, UnsupportedError
from luxel.io.build import build_mesh, turned
from luxel.io.files import atomic_write, read_bytes, tell
from luxel.io.flatten import flatten
from luxel.io.polygons import triangulate
from luxel.io.text import parse, table_lines, words_per_line
from luxel.scene.colour import bytes_from_linear, linear_from_srgb
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

_HEADER = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b([ \t]+BINARY)?")


def load(path: Path) -> Scene:
    """A scene of one mesh. Colours are decoded from sRGB; colours of faces are ignored."""
    where = path.name
    text = re.sub(rb"#[^\n]*", b"", read_bytes(path).tobytes().replace(b"\r\n", b"\n").replace(b"\r", b"\n"))
    header = _HEADER.match(text)
    if not header:
        raise FileError(where, "expected a file that begins with OFF, COFF, NOFF or STOFF")
    if header[4] or header[5] or header[6]:
        raise UnsupportedError(where, "binary OFF" if header[6] else "OFF in other than three dimensions")
    text = text[header.end() :].lstrip()
    first, _, body = text.partition(b"\n")
    if not re.fullmatch(rb"\s*\d{1,18}\s+\d{1,18}(\s+\d{1,18})?\s*", first):
        raise FileError(where, f"expected counts of vertices and faces, got {first[:60].decode('utf-8', 'replace')!r}")
    rows, faces = (int(word) for word in first.split()[:2])
    body = re.sub(rb"\n\s*\n", b"\n", body.strip() + b"\n")
    words = words_per_line(body)
    if rows + faces > len(words):
        raise FileError(where, f"{rows} vertices and {faces} faces need {rows + faces} lines, {len(words)} are left")
    values = parse(body, float, where, expected=int(words.sum()))
    scene = Scene(name=path.stem)
    place = int(words[:rows].sum())
    vertices = _vertices(values[:place], words[:rows], header, where)
    scene.add(_mesh(where, vertices, values[place:], words[rows : rows + faces]))
    return scene


def _vertices(values: Array, words: Array, header: re.Match[bytes], where: str) -> dict[str, Any]:
    """The arrays of the vertex lines: position, normal, colour, texture coordinate, in this order (Geomview's manual)."""
    texcoord, normal = bool(header[1]), bool(header[3])
    least = 3 + 3 * normal + 2 * texcoord
    if len(words) and int(words.min()) < least:
        raise FileError(f"{where}, vertex {int(words.argmin())}", f"expected {least} numbers, got {int(words.min())}")
    table = table_lines(values, words)
    out: dict[str, Any] = {"positions": table[:, :3]}
    if normal:
        out["normals"] = table[:, 3:6]
    if texcoord:
        out["texcoords"] = turned(table[:, -2:])
    color = table[:, 3 + 3 * normal : table.shape[1] - 2 * texcoord]
    if color.shape[1] >= 3 and np.isfinite(color[:, :3]).all():
        scale = 255 if color.max(initial=0) > 1 else 1
        out["colors"] = np.ones((len(color), 4), np.float32)
        out["colors"][:, :3] = linear_from_srgb(np.clip(color[:, :3] / scale, 0, 1))
        if color.shape[1] > 3:
            out["colors"][:, 3] = np.clip(np.nan_to_num(color[:, 3] / scale, nan=1.0), 0, 1)
    return out


def _mesh(where: str, vertices: dict[str, Any], values: Array, words: Array) -> Mesh:
    begin = np.cumsum(words) - words
    heads = values[begin] if len(words) else np.zeros(0)
    bad = np.flatnonzero(~((heads >= 0) & (heads == np.floor(heads)) & (heads < words)))
    if len(bad):
        first = int(bad[0])
        raise FileError(f"{where}, face {first}", f"a count of {heads[first]:g} and {int(words[first]) - 1} numbers after it")
    counts: Array = heads.astype(np.int64)
    if (words > counts + 1).any():
        tell(where, "colours of faces are ignored")
    inside = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    corners = np.nan_to_num(values[np.repeat(begin + 1, counts) + inside], nan=-1)
    corners = np.clip(corners, -1, 2**40).astype(np.int64)
    few = int(np.count_nonzero(counts < 3))
    if few:
        tell(where, f"{few} faces with fewer than 3 corners are dropped")
    positions = vertices.pop("positions")
    within = np.clip(corners, 0, max(len(positions) - 1, 0))
    cut = triangulate(counts, within, positions) if len(positions) else np.zeros((0, 3), np.int64)
    return build_mesh(where, positions, corners[cut], **vertices)


def save(scene: Scene, path: Path) -> None:
    """ASCII OFF, COFF or NOFF: all instances in world space; positions with 9 digits, which is exact in float32."""
    mesh = flatten(scene, path.name, keeps=("normals", "colors"))
    columns, formats, header = [mesh.positions], ["%.9g"] * 3, "OFF"
    if mesh.normals is not None:
        columns, formats, header = [*columns, mesh.normals], formats + ["%.9g"] * 3, "N" + header
    if mesh.colors is not None:
        alpha = np.clip(mesh.colors[:, 3:] * 255 + 0.5, 0, 255).astype(np.uint8)
        columns, formats, header = (
            [*columns, bytes_from_linear(mesh.colors[:, :3]), alpha],
            formats + ["%d"] * 4,
            "C" + header,
        )
    with atomic_write(path) as file:
        file.write(f"{header}\n{len(mesh.positions)} {len(mesh.triangles)} 0\n".encode())
        for start in range(0, len(mesh.positions), 1 << 16):
            rows = zip(*(column.tolist() for part in columns for column in part[start : start + (1 << 16)].T), strict=True)
            line = " ".join(formats) + "\n"
            file.write("".join(line % row for row in rows).encode())
        for start in range(0, len(mesh.triangles), 1 << 16):
            part = mesh.triangles[start : start + (1 << 16)].tolist()
            file.write("".join(f"3 {a} {b} {c}\n" for a, b, c in part).encode())
