"""Run by the tests under mpiexec: bakes that ranks share, against one process's, byte by byte."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "raster"))

from drawing import WAYS, against_one
from scenes import around, room

import luxel
from luxel import Light, Material, Mesh, Scene
from luxel.cluster.comm import Comm, world
from luxel.cluster.items import pack, unpack
from luxel.cluster.team import dealt
from luxel.radiosity.ambient_occlusion import ambient_occlusion
from luxel.radiosity.bake import Baked, bake, labour_of
from luxel.radiosity.hemicube import frames_of, room_for, see
from luxel.radiosity.labour import Labour
from luxel.scene.builtin import cornell_box

FEW = {"density": 16, "quality": "draft"}


def lamps() -> Scene:
    """Masked, two-sided and blended surfaces, some inside of others, under all kinds of lights."""
    scene = room()
    scene.lights.append(Light("spot", intensity=5.0, name="spot"))
    scene.lights[-1].world_from_light[:3, 3] = 0, 0.5, 2.5
    return scene


def sky() -> np.ndarray:
    """Bright above, with a sun, and of another colour on each side."""
    rows, columns = np.indices((16, 32))
    picture = np.stack([17.0 - rows, columns / 8, 2.0 + 0 * rows], 2)
    picture[3, 20] = 400
    return picture


def beam() -> Scene:
    """Lit by what a beam throws on a wall."""
    scene = cornell_box()
    scene.lights = [Light("spot", intensity=500.0, outer_cone=0.15, name="beam")]
    scene.lights[-1].world_from_light = np.diag([-1.0, 1.0, -1.0, 1.0])  # towards the back
    scene.lights[-1].world_from_light[:3, 3] = 0.28, 0.25, 0.2
    return scene


CASES = {
    "beam": (beam, {"density": 24, "transport": True, "layers": True}),
    "cornell": (cornell_box, {"density": 24}),
    "lamps": (lamps, {"density": 9, "layers": True, "transport": True}),
    "sky": (cornell_box, {"density": 16, "sky": sky(), "layers": True}),
}


def bytes_of(baked: Baked) -> Iterator[tuple[str, bytes]]:
    for name in ("irradiance", "direct", "valid", "pages"):
        yield name, getattr(baked, name).tobytes()
    yield "ledger", b"".join(np.concatenate([[step.shots], *step[1:]]).tobytes() for step in baked.ledger)
    yield from ((name, layer.tobytes()) for name, layer in baked.layers.items())
    if baked.transport is not None:
        for name in ("hits", "rows", "touched", "exchange", "still", "spot_element", "spot_rows", "spot_touched"):
            yield name, getattr(baked.transport, name).tobytes()


def light(comm: Comm, *cases: str) -> None:
    """`scene:quality` each."""
    for case in cases:
        name, quality = case.split(":")
        make, options = CASES[name]
        mine = bake(make(), quality=quality, comm=comm, **options)
        if comm.rank == 0:
            one = bake(make(), quality=quality, threads=1, **options)
            assert len(one.ledger) > 1, case
            assert dict(bytes_of(mine)) == dict(bytes_of(one)), case
        else:
            assert mine.transport is None
            assert not mine.layers
        everyone = comm.gather((mine.irradiance.tobytes(), mine.finished))
        assert all(each == everyone[0] for each in everyone)


def few(comm: Comm, *_: str) -> None:
    """Fewer luxels than ranks."""
    corners = np.float32([[0, 0, 0], [0.5, 0, 0], [0, 0, 0.4]])
    scene = Scene.from_mesh(Mesh(corners, np.array([[0, 2, 1]])), Material(double_sided=True))
    for options in ({"sky": 1.0}, {"sky": 1.0, "quality": "progressive"}):
        mine = bake(scene, density=2, comm=comm, **options)
        assert len(mine.luxels.area) < 7
        if comm.rank == 0:
            assert dict(bytes_of(mine)) == dict(bytes_of(bake(scene, density=2, **options)))


def occlusion(comm: Comm, *_: str) -> None:
    """All ranks have it."""
    baked = bake(cornell_box(), comm=comm, **FEW)
    mine = ambient_occlusion(baked.atlas, baked.luxels, 0.3, labour=labour_of(None, comm))
    assert mine.tobytes() == ambient_occlusion(baked.atlas, baked.luxels, 0.3, threads=1).tobytes()


def pictures(comm: Comm, *_: str) -> None:
    """A lit scene is drawn by ranks as by one process."""
    scene = bake(lamps(), density=9, quality="draft", comm=comm).scene
    assert all(mesh.texcoords1 is not None for mesh in scene.meshes)
    against_one(comm, scene, around(), (96, 64), WAYS[:1] + WAYS[2:], tile=16, samples=4, outputs=("color", "linear", "triangle"))


def dealing(comm: Comm, *_: str) -> None:
    """Every item is somebody's, once; parts are put where they belong, whatever is left over; hemicubes come through whole."""
    team = labour_of(None, comm).team
    for n in (0, 1, 5, 16, 17, 100, 333):
        for grain in (1, 4, 16):
            every = np.concatenate([dealt(n, grain, rank, comm.size) for rank in range(comm.size)])
            assert np.array_equal(np.sort(every), np.arange(n))
            for lead in ((), (3,), (2, 3)):
                whole = np.random.default_rng(n).random((*lead, n)).astype(np.float32)
                got = team.join(whole[..., team.mine(n, grain)], n, grain)
                assert got.tobytes() == whole.tobytes()
                assert got.flags.c_contiguous
            rows = np.arange(3 * n).reshape(n, 3)
            collected = team.collect(rows[team.mine(n, grain)], n, grain)
            assert (collected is None) == (comm.rank > 0)
            assert collected is None or np.array_equal(collected, rows)
    assert team.once(lambda: comm.rank) == 0
    rng = np.random.default_rng(7)
    positions, triangles = rng.normal(size=(3, 300)).astype(np.float32), rng.integers(0, 300, (200, 3)).astype(np.int32)
    for shooters in (1, 2, 9):
        centers, frames = rng.normal(size=(shooters, 3)).astype(np.float32), frames_of(np.tile(np.float32([[0, 0.6, 0.8]]), (shooters, 1)))
        sizes = np.full(shooters, 32, np.int64)
        seen = see(positions, triangles, centers, frames, sizes, 1e-3, 1)
        data, lengths = pack(seen, 2)
        got = room_for(sizes, seen.near)
        unpack(data, lengths, got, 2)
        end = seen.start[-1]
        assert got.depth[:end].tobytes() == seen.depth[:end].tobytes()
        assert got.ids[:end].tobytes() == seen.ids[:end].tobytes()
        assert len(data) < 8 * end / 3  # noise of triangles: rooms are far below


def stops(comm: Comm, folder: str) -> None:
    """After the first batch; the state is kept."""
    for quality in ("final", "progressive"):
        path = Path(folder) / quality
        mine = bake(cornell_box(), density=16, quality=quality, seconds=1e-9, checkpoint=path, comm=comm)
        assert not mine.finished
        assert path.exists()


def goes_on(comm: Comm, folder: str) -> None:
    for quality in ("final", "progressive"):
        mine = bake(cornell_box(), density=16, quality=quality, checkpoint=Path(folder) / quality, resume=True, comm=comm)
        assert mine.finished
        if comm.rank == 0:
            one = bake(cornell_box(), density=16, quality=quality)
            assert dict(bytes_of(mine)) == dict(bytes_of(one)), quality


def _spoil(comm: Comm, what: str, does: object) -> None:
    """What a rank does in the middle of the bake, in place of its work."""
    if comm.rank == 1:
        setattr(Labour, what, does)


def dies(comm: Comm, folder: str) -> None:
    _spoil(comm, "bounce", lambda *arguments: os.kill(os.getpid(), signal.SIGKILL))
    bake(cornell_box(), checkpoint=Path(folder) / "state", comm=comm, **FEW)


def starves(comm: Comm, folder: str) -> None:
    def look(*arguments: object) -> None:
        raise MemoryError("Unable to allocate 9 EiB")

    _spoil(comm, "look", look)
    bake(cornell_box(), checkpoint=Path(folder) / "state", comm=comm, **FEW)


def dark(comm: Comm, folder: str) -> None:
    bake(Scene.from_mesh(luxel.Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]))), comm=comm, **FEW)


def unreadable(comm: Comm, folder: str) -> None:
    bake(Path(folder) / "nothing.glb", comm=comm)


if __name__ == "__main__":
    comm = world()
    with comm.guard():
        for name in sys.argv[1].split(","):
            globals()[name](comm, *sys.argv[2:])
    if comm.rank == 0:
        print(f"{sys.argv[1]}: {comm.size} ranks agree")
