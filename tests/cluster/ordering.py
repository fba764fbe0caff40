"""Run by the tests under mpiexec: files that ranks lay out together, against one process's, byte by byte."""

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import luxel
from luxel.cluster import layout, layout_file, soup_sum
from luxel.cluster.comm import Comm, world
from luxel.errors import FileError, LuxelWarning
from luxel.layout import files, partition
from luxel.layout.cache import acmr
from luxel.layout.optimize import Options
from luxel.scene.builtin import bumpy_sphere

CLEANING = {"weld": True, "drop_degenerate": True, "drop_duplicates": True, "drop_unused": True}


def write_ply(path: Path, rows: np.ndarray, faces: np.ndarray, order: str = "<", tags: np.ndarray | None = None) -> None:
    """Rows (n, 3) float32 of vertices, with a tag each; and triangles, with one each before their corners, if asked for."""
    vertices = np.empty(len(rows), [(name, order + "f4") for name in "xyz"] + [("tag", order + "u2")])
    for k, name in enumerate("xyz"):
        vertices[name] = rows[:, k]
    vertices["tag"] = np.arange(len(rows)) if tags is None else tags
    table = np.empty(len(faces), [("mark", order + "i4"), ("count", "u1"), ("corners", order + "i4", 3)])
    table["mark"], table["count"], table["corners"] = np.arange(len(faces)), 3, faces
    named = {"<": "little", ">": "big"}[order]
    head = f"ply\nformat binary_{named}_endian 1.0\ncomment kept\nelement vertex {len(rows)}\n"
    head += "".join(f"property float {name}\n" for name in "xyz") + "property ushort tag\n"
    head += f"element face {len(faces)}\nproperty int mark\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_bytes(head.encode() + vertices.tobytes() + table.tobytes())


def messy(path: Path, seed: int = 3, order: str = "<") -> None:
    """A sphere in random order, with seams, copies, slivers and vertices that nothing uses."""
    mesh, rng = bumpy_sphere(30), np.random.default_rng(seed)
    positions = np.concatenate([mesh.positions, mesh.positions[::3], rng.normal(size=(50, 3))])
    positions[::7] += np.float32(0)
    faces = mesh.triangles.astype(np.int64)
    swapped = rng.random(faces.shape) < 0.3
    faces = np.where(swapped & (faces % 3 == 0), len(mesh.positions) + faces // 3, faces)
    faces = np.concatenate([faces, faces[:40], np.roll(faces[40:60], 1, 1), np.repeat(faces[:9, :1], 3, 1)])
    place = rng.permutation(len(positions))
    tags = np.concatenate([np.arange(len(mesh.positions)), np.arange(len(mesh.positions))[::3], np.arange(50)])
    write_ply(path, positions[np.argsort(place)].astype(np.float32), place[faces][rng.permutation(len(faces))], order, tags[np.argsort(place)])


def both(comm: Comm, path: Path, options: Options, what: object, check: bool = True) -> None:
    """All ranks, and rank 0 by itself, through the same code; with sums before and after."""
    out, alone = path.with_name(f"ranks{path.suffix}"), path.with_name(f"alone{path.suffix}")
    check = check and not options.drop_duplicates
    report, _, _ = layout_file.optimize_file(path, out, options, comm, check=check)
    if comm.rank == 0:
        one, _, _ = layout_file.optimize_file(path, alone, options, Comm(), check=check)
        assert out.read_bytes() == alone.read_bytes(), what
        assert [report.as_dict()[name] for name in _TOLD] == [one.as_dict()[name] for name in _TOLD], what
    comm.gather(None)


_TOLD = ("target", "orders", "before", "after", "welded", "degenerate", "duplicates", "unused")


def cells(comm: Comm, folder: str) -> None:
    """Many small cells and pieces: the same bytes, and counts, for any number of ranks."""
    layout.CELL, layout.PIECE, soup_sum.PIECE = 500, 300, 300
    path = Path(folder) / "messy.ply"
    for k, options in enumerate(({}, CLEANING, {"order": "greedy", "drop_unused": True}, {"weld": True, "cache": 20, "overdraw": 1.1},
                                 {"profile": "nvidia"}, {"order": "tipsify", "drop_degenerate": True})):  # fmt: skip
        if comm.rank == 0:
            messy(path, k, "<>"[k % 2])
        comm.gather(None)
        both(comm, path, Options(**options), options)
    found = files.optimize_file(path, None, Options())[0] if comm.rank == 0 else None
    report, _, shared = layout_file.optimize_file(path, None, Options(), comm)
    assert shared
    if found is not None:
        assert report.after.acmr[12] < 1.12 * found.after.acmr[12]  # hundreds of triangles a cell: borders cost
        assert abs(report.before.acmr[12] - found.before.acmr[12]) < 0.1
        assert report.after.vertices == found.after.vertices


def one_cell(comm: Comm, folder: str) -> None:
    """A mesh of one cell: the bytes of one process."""
    path = Path(folder) / "messy.ply"
    for k, options in enumerate(({}, CLEANING, {"weld": True}, {"drop_degenerate": True, "overdraw": 1.05})):
        if comm.rank == 0:
            messy(path, 10 + k, "<>"[k % 2])
            files.optimize_file(path, path.with_name("process.ply"), Options(**options), measures=False)
        comm.gather(None)
        _, _, shared = layout_file.optimize_file(path, path.with_name("ranks.ply"), Options(**options), comm)
        assert shared
        if comm.rank == 0:
            assert path.with_name("process.ply").read_bytes() == path.with_name("ranks.ply").read_bytes(), options


def whole(comm: Comm, folder: str) -> None:
    """What is not read in shares: parts go to the ranks, and the bytes are one process's."""
    partition.PART = 700
    for name in ("sphere.obj", "sphere.glb", "ascii.ply", "sphere.stl"):
        path = Path(folder) / name
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LuxelWarning)
            if comm.rank == 0:
                mesh = bumpy_sphere(30)
                if name == "ascii.ply":
                    rows = "".join(f"{x} {y} {z}\n" for x, y, z in mesh.positions.tolist())
                    rows += "".join(f"3 {a} {b} {c}\n" for a, b, c in mesh.triangles)
                    head = f"ply\nformat ascii 1.0\nelement vertex {len(mesh.positions)}\nproperty float x\nproperty float y\nproperty float z\n"
                    path.write_text(f"{head}element face {len(mesh.triangles)}\nproperty list uchar int vertex_indices\nend_header\n{rows}")
                else:
                    luxel.save(mesh, path)
                files.optimize_file(path, path.with_stem("process"), Options(), measures=False)
            comm.gather(None)
            _, _, shared = layout_file.optimize_file(path, path.with_stem("ranks"), Options(), comm, check=True)
        assert not shared or comm.rank
        if comm.rank == 0:
            assert path.with_stem("process").read_bytes() == path.with_stem("ranks").read_bytes(), name
        comm.gather(None)


def proof(comm: Comm, folder: str) -> None:
    """A sum knows triangles by what they carry, whatever their order; and a difference is not written."""
    path, out = Path(folder) / "messy.ply", Path(folder) / "wrong.ply"
    if comm.rank == 0:
        messy(path)
    comm.gather(None)
    kept, turns = layout.Layout._write_rows, []

    def wrong(self, out, table, begin, first, source, corners):
        turned = None if corners is None or turns.append(0) or comm.rank != comm.size - 1 else corners[:, ::-1]
        kept(self, out, table, begin, first, source, corners if turned is None else turned)

    layout.Layout._write_rows, layout.CELL = wrong, 500
    try:
        with pytest.raises(files.DifferenceError, match="triangles differ"):
            layout_file.optimize_file(path, out, Options(), comm, check=True)
    finally:
        layout.Layout._write_rows, layout.CELL = kept, 1 << 18
    assert not out.exists()
    comm.gather(None)
    assert comm.rank or not list(Path(folder).glob(".*.part"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LuxelWarning)
        if comm.rank == 0:
            luxel.save(bumpy_sphere(9), out)
        comm.gather(None)
        assert not layout_file.optimize_file(out, out, Options(drop_duplicates=True), comm, check=True)[2]
    if comm.rank == 0:
        write_ply(Path(folder) / "bad.ply", np.zeros((3, 3), np.float32), np.array([[0, 1, 2], [0, 9, 1]]))
    comm.gather(None)
    if comm.rank == 0:  # the rank that has the face says so; the others would wait
        with pytest.raises(FileError, match="a face names vertex 9 of 3"):
            layout_file.optimize_file(Path(folder) / "bad.ply", None, Options(), Comm())


def cost(comm: Comm, folder: str) -> None:
    """Cells cost what their borders have: per cents, where they have some thousand triangles."""
    layout.CELL = 8000
    path = Path(folder) / "sphere.ply"
    if comm.rank == 0:
        luxel.save(bumpy_sphere(100), path)
    comm.gather(None)
    report, _, _ = layout_file.optimize_file(path, path.with_name("parts.ply"), Options(order="greedy"), comm)
    if comm.rank == 0:
        whole = files.optimize_file(path, None, Options(order="greedy"))[0]
        parts = luxel.load(path.with_name("parts.ply")).meshes[0]
        assert abs(acmr(parts.triangles, 12) - report.after.acmr[12]) < 12 * 5 / 40000
        assert report.after.acmr[12] < 1.03 * whole.after.acmr[12]
        assert len(report.orders) == 5


if __name__ == "__main__":
    comm = world()
    with comm.guard():
        for name in sys.argv[1].split(","):
            globals()[name](comm, *sys.argv[2:])
            layout.CELL, layout.PIECE, soup_sum.PIECE, partition.PART = 1 << 18, 1 << 17, 1 << 17, 1 << 17
    if comm.rank == 0:
        print(f"{sys.argv[1]}: {comm.size} ranks agree")
