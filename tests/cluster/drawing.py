"""Run by the tests under mpiexec: pictures that ranks draw together, against one process's, byte by byte; and composition against NumPy."""

import os
import signal
import sys
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "raster"))

from scenes import around, room

import luxel
from luxel import Material, Mesh, Scene
from luxel.cluster import units as units_of
from luxel.cluster.agree import agree
from luxel.cluster.comm import Comm, world
from luxel.cluster.composite import COMPOSITIONS, clear, composite, regions
from luxel.cluster.plan import BALANCES
from luxel.cluster.render import Renderer
from luxel.cluster.shares import share_scene
from luxel.errors import LuxelWarning
from luxel.scene import normals
from luxel.scene.builtin import bumpy_sphere
from luxel.scene.framing import camera_for

ALL = ("color", "linear", "depth", "triangle", "object", "material", "normal", "position", "barycentric", "texcoord", "motion")
WAYS = [("screen", "swap", "dynamic"), ("screen", "swap", "static"), ("objects", "direct", "dynamic"), ("objects", "swap", "dynamic"),
        ("objects", "radix", "dynamic"), ("both", "swap", "dynamic")]  # fmt: skip


def random_scene(count: int, seed: int = 0) -> Scene:
    """Triangles of all sizes that cross each other; vertices have colours."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-3, -0.3, (count, 1, 1))
    positions = (rng.normal(size=(count, 1, 3)) + size * rng.normal(size=(count, 3, 3))).reshape(-1, 3)
    mesh = Mesh(positions, np.arange(3 * count).reshape(-1, 3), colors=rng.uniform(0, 1, (3 * count, 4)))
    return Scene.from_mesh(mesh, Material(double_sided=True))


def same(mine: luxel.Picture, one: luxel.Picture, what: object) -> None:
    assert set(mine.outputs()) == set(one.outputs()), what
    for name, array in one.outputs().items():
        assert mine.outputs()[name].tobytes() == array.tobytes(), (what, name)


def against_one(comm: Comm, scene: Scene, camera: object, size: tuple[int, int], ways: list, **options: object) -> None:
    one = luxel.render(scene, camera, size, threads=1, **options) if comm.rank == 0 else None
    for way in ways:
        divide, composition, balance = way
        renderer = Renderer(scene, comm, divide, composition, balance)
        for _ in range(2 if balance == "dynamic" and divide == "screen" else 1):  # the second has learnt from the first
            mine = renderer.render(camera, size, **options)
            assert (mine is None) == (comm.rank > 0)
            if mine is not None:
                same(mine, one, (way, size, options))


def modes(comm: Comm, *_: str) -> None:
    """Masked, blended, textured, metallic, mirrored: near enough to be clipped, too."""
    for camera in (around(), around(1.0, 1.5, near=0.05)):
        against_one(comm, room(), camera, (97, 81), WAYS, samples=8, tile=16, outputs=ALL, previous_camera=around(0.4), background=(0.1, 0.2, 0.3))
    against_one(comm, room(1), around(0.3), (130, 70), WAYS[::3], tile=8, outputs=("color", "triangle", "depth"))
    against_one(comm, room(2), around(), (90, 60), WAYS[4:], tile=16, samples=2, filter="tent", outputs=("linear", "normal", "object"))


def samplings(comm: Comm, *_: str) -> None:
    """Opaque scenes go straight to pixels; filters reach beyond tiles; supersampling shades every sample."""
    scene = random_scene(1500)
    for options in ({}, {"samples": 8}, {"ssaa": 2}, {"samples": 4, "filter": "mitchell"}, {"ssaa": 2, "filter": "lowpass"}):
        against_one(comm, scene, around(0.7), (101, 60), WAYS[:1] + WAYS[2:4] + WAYS[5:], tile=16, **options)
    for shading in ("gouraud", "flat", "hardware"):
        renderer = Renderer(scene, comm, "objects", "radix", shading=shading)
        mine = renderer.render(around(), (64, 48), samples=2, tile=16)
        if mine is not None:
            same(mine, luxel.render(scene, around(), (64, 48), samples=2, tile=16, shading=shading), shading)


def matrix(comm: Comm, *models: str) -> None:
    """Every division and composition, with one sample a pixel and with eight: a random scene, one with blended and masked materials, real models."""
    ways = [("screen", "swap", balance) for balance in BALANCES]
    ways += [(divide, way, "dynamic") for divide in ("objects", "both") for way in COMPOSITIONS]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LuxelWarning)
        scenes = [(random_scene(600, 3), around(0.7)), (room(), around()), *((luxel.load(path), None) for path in models)]
    for scene, camera in scenes:
        view = camera or comm.share(camera_for(scene, (112, 80)))
        for samples in (1, 8):
            against_one(comm, scene, view, (112, 80), ways, samples=samples, tile=16, outputs=("color", "depth", "triangle"))


def few(comm: Comm, *_: str) -> None:
    """More ranks than triangles, than tiles, than anything."""
    for count in (0, 1, 3):
        scene = Scene.from_mesh(Mesh(np.random.default_rng(1).normal(size=(3 * count, 3)), np.arange(3 * count).reshape(-1, 3)))
        for size in ((1, 1), (9, 3)):
            against_one(comm, scene, around(), size, WAYS, tile=8, samples=2, outputs=("color", "triangle"))


def windows(comm: Comm, *_: str) -> None:
    """Pictures of several windows and bands, as very large ones are."""
    from luxel.raster import frame

    kept = frame._WINDOW, frame._BAND_BYTES
    frame._WINDOW, frame._BAND_BYTES = 64, 1
    try:
        for options in ({"samples": 2, "outputs": ("color", "depth")}, {"samples": 2, "filter": "tent"}):
            against_one(comm, room(2), around(), (150, 90), [WAYS[0], WAYS[3], WAYS[5]], tile=16, **options)
    finally:
        frame._WINDOW, frame._BAND_BYTES = kept


def files(comm: Comm, folder: str) -> None:
    """A binary PLY file in ranges of bytes; and real models, which have what cannot be read in parts."""
    size = (160, 90)
    for path in sorted(Path(folder).iterdir()):
        if path.suffix == ".bin" or path.name.startswith("units"):
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LuxelWarning)
            one = luxel.render(path, None, size, threads=1, samples=8) if comm.rank == 0 else None
            for divide in ("objects", "both"):
                renderer = Renderer(path, comm, divide)
                mine = renderer.render(None, size, samples=8)
                if mine is not None:
                    same(mine, one, (path, divide))


def units(comm: Comm, folder: str) -> None:
    """glTF by primitives, and a folder by files: nobody reads what others draw, but for what a cut goes through."""
    place = Path(folder) / f"units{comm.size}"
    if comm.rank == 0:
        models = place / "models"
        models.mkdir(parents=True)
        sphere = bumpy_sphere(20)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LuxelWarning)
            luxel.save(room(2), place / "room.glb")
            luxel.save(Mesh(sphere.positions, sphere.triangles), place / "bare.gltf")  # flat, as glTF asks for
            luxel.save(room(1), models / "a.gltf")
            luxel.save(Mesh(sphere.positions, sphere.triangles), models / "b.obj")
            luxel.save(sphere, models / "c.PLY")
            luxel.save(room(3), models / "d.glb")
            (models / "read.me").write_text("no model")
    comm.gather(None)
    read, made = [], units_of._made
    units_of._made = lambda later, crease: read.append(later.count) or made(later, crease)
    files(comm, str(place))
    units_of._made = made
    share = units_of.gltf_share(place / "room.glb", comm, None)[0]
    counts = comm.gather(share.triangle_count)
    whole = luxel.load(place / "room.glb").triangle_count
    assert sum(counts) == whole
    assert max(counts) <= whole / comm.size + 1
    largest = max(len(mesh.triangles) for mesh in luxel.load(place / "room.glb").meshes)
    assert sum(read) <= 2 * (whole / comm.size + 2 * largest) + 2 * 1600  # for two divisions; and the sphere, whole


def bare(comm: Comm, folder: str) -> None:
    """PLY files without normals: made by each rank for its share, with the faces around it; in many chunks of triangles."""
    normals._CHUNK, kept = 700, normals._CHUNK
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # none is read whole
        for name in ("bare.ply", "soup.ply", "edges.ply"):
            for crease in (None, np.pi, 0.2):
                path = Path(folder) / name
                one = luxel.load(path, crease_angle=crease)
                share = share_scene(path, comm, "objects", crease_angle=crease)
                assert share.scene.triangle_count < one.triangle_count or comm.size == 1
                mine = Renderer(share, comm, "objects").render(None, (96, 64), samples=2, outputs=ALL)
                if mine is not None:
                    same(mine, luxel.render(one, None, (96, 64), samples=2, outputs=ALL, threads=1), (name, crease))
    normals._CHUNK = kept


def streamed(comm: Comm, folder: str) -> None:
    """Shares that stay in the file, in pieces; near enough for triangles to be clipped."""
    from luxel.cluster import ply_share

    ply_share.STREAMED, ply_share.PIECE = 0, 100
    for name in ("sphere.ply", "long.ply", "bare.ply", "soup.ply"):
        path = Path(folder) / name
        cameras = [None, luxel.Camera.look_at((0.3, 0.2, 0.9), (0, 0.3, 0), near=0.05)]
        for divide in ("objects", "both"):
            renderer = Renderer(path, comm, divide, "radix")
            assert renderer.shared.stream is not None
            assert renderer.shared.triangles == 4 * 40 * 40
            for camera in cameras:
                mine = renderer.render(camera, (160, 90), samples=2, outputs=ALL)
                if mine is not None:
                    same(mine, luxel.render(path, camera, (160, 90), samples=2, outputs=ALL, threads=1), (name, divide, camera))


def compositions(comm: Comm, *_: str) -> None:
    """Random visibility, full of ties, against the nearest and then lowest of all ranks; and what is sent against N b (1 - 1 / P)."""
    tiles, samples = 13, 50
    for composition in COMPOSITIONS:
        for density in (0.0, 0.02, 0.5, 1.0):
            rng = np.random.default_rng([comm.rank, int(100 * density)])
            ids = np.full((tiles, samples + 8), -1, np.int32)
            depths = np.full(ids.shape, -1, np.float32)
            covered = rng.random((tiles, samples)) < density
            ids[:, :samples][covered] = rng.permutation(tiles * samples)[: covered.sum()] * comm.size + comm.rank
            depths[:, :samples][covered] = rng.integers(0, 4, covered.sum())
            every = comm.gather((ids.copy(), depths.copy()))
            slots = np.flatnonzero(sum((i >= 0).any(1) for i, _ in every))
            before = comm.sent
            composite(slots, samples, ids, depths, comm, composition)
            sent = comm.sent - before
            want_ids, want_depths = np.full(ids.shape, -1, np.int32), np.full(ids.shape, -1, np.float32)
            for i, d in every:
                nearer = (d > want_depths) | ((d == want_depths) & (i < want_ids))
                want_ids, want_depths = np.where(nearer, i, want_ids), np.where(nearer, d, want_depths)
            shares = regions(slots, comm.size, composition)
            assert np.array_equal(np.sort(np.concatenate(shares)), slots)
            mine = shares[comm.rank]
            assert np.array_equal(ids[mine, :samples], want_ids[mine, :samples])
            assert np.array_equal(depths[mine, :samples], want_depths[mine, :samples])
            if density == 1.0 and composition != "swap" and comm.size > 1:
                all_of_it = 8 * len(slots) * samples
                assert sent <= all_of_it * (1 - 1 / comm.size) * (1 + 2 / comm.size) * 1.3 + 1000 * comm.size
    clear(np.arange(tiles), ids, depths)
    assert (ids < 0).all()


def learning(comm: Comm, *_: str) -> None:
    """All of it in one corner: parts of equal cost are of unequal size, and the ranks know them alike."""
    mesh = bumpy_sphere(60)
    scene = Scene.from_mesh(Mesh(mesh.positions * 0.2 + np.float32([1.5, 1.0, 0]), mesh.triangles, mesh.normals))
    renderer = Renderer(scene, comm)
    camera = luxel.Camera.look_at((0, 0, 4), (0, 0, 0))
    for _ in range(3):
        renderer.render(camera, (256, 256), tile=16)
    assert len(renderer.ranks) == comm.size
    window = next(iter(renderer.plan._known), None)
    known = comm.gather(renderer.plan.cuts(lambda: np.ones(256), window, 256, np.ones(comm.size)).tolist() if comm.size > 1 else [])
    assert all(cuts == known[0] for cuts in known)


def differ(comm: Comm) -> None:
    agree(comm, one=1)
    agree(comm, one=comm.rank)


def dies(comm: Comm) -> None:
    if comm.rank == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    comm.share(1)
    comm.gather(1)


def starves(comm: Comm) -> None:
    if comm.rank == 1:
        raise MemoryError("Unable to allocate 9 EiB")
    comm.gather(1)


def all_fail(comm: Comm) -> None:
    raise luxel.errors.InputError("all of us")


if __name__ == "__main__":
    comm = world()
    with comm.guard():
        for name in sys.argv[1].split(","):
            globals()[name](comm, *sys.argv[2:])
    if comm.rank == 0:
        print(f"{sys.argv[1]}: {comm.size} ranks agree")
