"""What is in a scene, and what is odd about it: for `luxel info`, and before a bake."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.errors import InputError
from luxel.scene.coincidence import coincident, mixed
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Scene

_ATTRIBUTES = ("normals", "texcoords", "texcoords1", "colors", "tangents")
_FLAT = 1e-7  # a triangle lower than this part of its longest edge has no area worth the name in float32
_SMALLEST, _LARGEST = 1e-3, 1e4  # metres: a scene outside of these probably has another unit


@dataclass
class Oddity:
    """Something to look at.

    Attributes:
        kind: A short fixed name, such as "open edges".
        count: How many.
        where: The mesh, instance or material, or "" for the scene.
        what: What it means, in a few words.
    """

    kind: str
    count: int
    where: str
    what: str


@dataclass
class MeshReport:
    """One mesh.

    Attributes:
        name: Of the mesh, or its number.
        vertices, triangles, instances: Counts.
        material: The name of its material, or "".
        attributes: Names of the vertex arrays that it has beside positions.
        bounds: Least and largest finite coordinates, in the mesh's own space.
        closed: Every edge has two triangles, and they agree on the winding.
    """

    name: str
    vertices: int
    triangles: int
    instances: int
    material: str
    attributes: list[str]
    bounds: list[list[float]]
    closed: bool


@dataclass
class Report:
    """A scene in numbers.

    Attributes:
        name: Of the scene.
        triangles: Drawn, each instance counted; `meshes` has what is stored.
        vertices, instances, objects: Counts.
        bounds, extent: Of the world, metres.
        meshes, materials, textures, lights, cameras: What there is.
        oddities: What is odd, worst first as far as one can say.
    """

    name: str
    triangles: int
    vertices: int
    instances: int
    objects: int
    bounds: list[list[float]]
    extent: list[float]
    meshes: list[MeshReport] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    textures: list[dict[str, Any]] = field(default_factory=list)
    lights: list[dict[str, Any]] = field(default_factory=list)
    cameras: list[dict[str, Any]] = field(default_factory=list)
    oddities: list[Oddity] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Plain lists, numbers and strings, for JSON."""
        return asdict(self)


def inspect(scene: Scene) -> Report:
    """Count and check a scene; a few seconds for millions of triangles.

    Raises:
        InputError: It is no Scene, or one that `Scene.check` refuses.
    """
    if not isinstance(scene, Scene):
        raise InputError(f"scene: expected a Scene, as luxel.load gives, got {type(scene).__name__}")
    scene.check()
    used = np.bincount([i.mesh for i in scene.instances], minlength=len(scene.meshes))
    meshes, oddities = [], []
    for i, mesh in enumerate(scene.meshes):
        name = mesh.name or f"mesh {i}"
        with np.errstate(invalid="ignore", over="ignore"):  # infinite positions are said, not warned of
            odd, closed = _check_mesh(mesh, name)
        oddities += odd
        material = scene.materials[mesh.material].name or f"material {mesh.material}" if mesh.material >= 0 else ""
        attributes = [a for a in _ATTRIBUTES if getattr(mesh, a) is not None]
        n, m = len(mesh.positions), len(mesh.triangles)
        meshes.append(MeshReport(name, n, m, int(used[i]), material, attributes, _finite_bounds(mesh), closed))
    bounds = _world_bounds(scene)
    return Report(
        name=scene.name,
        triangles=scene.triangle_count,
        vertices=sum(len(scene.meshes[i.mesh].positions) for i in scene.instances),
        instances=len(scene.instances),
        objects=len({i.object for i in scene.instances}),
        bounds=bounds.tolist(),
        extent=(bounds[1] - bounds[0]).tolist(),
        meshes=meshes,
        materials=[_material(material, i) for i, material in enumerate(scene.materials)],
        textures=[_texture(texture, i) for i, texture in enumerate(scene.textures)],
        lights=[
            {"name": x.name, "kind": x.kind, "intensity": x.intensity, "color": list(x.color)} for x in scene.lights
        ],
        cameras=[_camera(camera, i) for i, camera in enumerate(scene.cameras)],
        oddities=_check_scene(scene, used, bounds) + oddities,
    )


def _material(material: Any, i: int) -> dict[str, Any]:
    textures = [
        name.removesuffix("_texture") for name, ref in vars(material).items() if name.endswith("_texture") and ref
    ]
    return {
        "name": material.name or f"material {i}",
        "shading": material.shading or "",
        "alpha": material.alpha_mode,
        "double_sided": material.double_sided,
        "base_color": [float(c) for c in material.base_color],
        "emissive": [float(c) for c in material.emissive],
        "textures": textures,
    }


def _texture(texture: Any, i: int) -> dict[str, Any]:
    height, width, channels = texture.image.shape
    return {
        "name": texture.name or f"texture {i}",
        "size": [width, height],
        "channels": channels,
        "dtype": str(texture.image.dtype),
        "bytes": texture.image.nbytes,
    }


def _camera(camera: Any, i: int) -> dict[str, Any]:
    lens = {"height": camera.height} if camera.yfov is None else {"yfov_degrees": float(np.degrees(camera.yfov))}
    kind = "orthographic" if camera.yfov is None else "perspective"
    return {"name": camera.name or f"camera {i}", "kind": kind, **lens, "eye": camera.eye.tolist()}


def _finite_bounds(mesh: Mesh) -> list[list[float]]:
    finite = mesh.positions
    if not np.isfinite(finite).all():
        finite = finite[np.isfinite(finite).all(1)]
    if not len(finite):
        return [[0.0] * 3, [0.0] * 3]
    return [finite.min(0).tolist(), finite.max(0).tolist()]


def _world_bounds(scene: Scene) -> Array:
    """As `Scene.bounds`, but of the finite vertices."""
    corners = []
    for instance in scene.instances:
        mesh = scene.meshes[instance.mesh]
        if len(mesh.triangles):
            box = np.array(_finite_bounds(mesh))
            grid = np.stack(np.meshgrid(*box.T), -1).reshape(-1, 3)
            matrix = instance.world_from_mesh
            assert matrix is not None
            corners.append(grid @ matrix[:3, :3].T + matrix[:3, 3])
    if not corners:
        return np.zeros((2, 3))
    points = np.concatenate(corners)
    return np.stack([points.min(0), points.max(0)])


def _check_scene(scene: Scene, used: Array, bounds: Array) -> list[Oddity]:
    found = []

    def say(kind: str, count: int, what: str, where: str = "") -> None:
        if count:
            found.append(Oddity(kind, int(count), where, what))

    size = float((bounds[1] - bounds[0]).max())
    say("no triangles", scene.triangle_count == 0, "there is nothing to draw")
    say("tiny extent", 0 < size < _SMALLEST, f"{size:.3g} m across: another unit than metres?")
    say("huge extent", size > _LARGEST, f"{size:.3g} m across: another unit than metres?")
    far = float(np.abs(bounds).max())
    say("far from the origin", size > 0 and far > 1e5 * size, "float32 positions have few digits left there")
    for i, instance in enumerate(scene.instances):
        assert instance.world_from_mesh is not None
        where = instance.name or f"instance {i}"
        determinant = np.linalg.det(instance.world_from_mesh[:3, :3])
        say("flattening transform", determinant == 0, "the node's matrix has no volume", where)
        say("mirroring transform", determinant < 0, "the node turns the winding around", where)
    for group in coincident(scene, far):
        names = [scene.instances[i].name or f"instance {i}" for i in group]
        where = f"{', '.join(names[:2])}{f' and {len(names) - 2} more' if len(names) > 2 else ''}"
        say("coincident objects", len(group) - 1, "the same triangles at the same place as another's", where)
    say("meshes never placed", (used == 0).sum(), "no instance shows them")
    shown = {mesh.material for mesh in scene.meshes}
    say("unused materials", len(scene.materials) - len(shown - {-1}), "no mesh has them")
    refs = [ref for m in scene.materials for name, ref in vars(m).items() if name.endswith("_texture") and ref]
    say("unused textures", len(scene.textures) - len({ref.texture for ref in refs}), "no material has them")
    return found


def _check_mesh(mesh: Mesh, where: str) -> tuple[list[Oddity], bool]:
    found: list[Oddity] = []

    def say(kind: str, count: Any, what: str) -> None:
        if count:
            found.append(Oddity(kind, int(count), where, what))

    n, m = len(mesh.positions), len(mesh.triangles)
    for name in ("positions", *_ATTRIBUTES):
        array = getattr(mesh, name)
        if array is not None and not np.isfinite(array).all():
            say(f"{name} not finite", (~np.isfinite(array).all(1)).sum(), "NaN or infinity")
    place = _same_rows([mesh.positions])
    corners = place[mesh.triangles]
    facing, flat = _facing(mesh, corners)
    say("degenerate triangles", flat.sum(), "no area: they are never seen")
    say("duplicate triangles", _duplicates(corners[~flat]), "the same three corners as another")
    edges = _edges(corners[~flat], n)
    say("non-manifold edges", edges["many"], "shared by more than two triangles")
    say("inconsistent winding", edges["turned"], "edges whose two triangles face opposite ways")
    say("open edges", edges["open"], "with a triangle on one side only")
    closed = bool(m) and not (edges["many"] or edges["turned"] or edges["open"])
    volume = float(np.einsum("ij,ij->", mesh.positions[mesh.triangles[:, 0]].astype(np.float64), facing)) / 3
    say("inside out", closed and volume < 0, "the mesh is closed and its triangles face inwards")
    say(
        "unreferenced vertices",
        n - np.count_nonzero(np.bincount(mesh.triangles.ravel(), minlength=n)),
        "in no triangle",
    )
    arrays = [getattr(mesh, a) for a in _ATTRIBUTES]
    whole = _same_rows([mesh.positions, *(a for a in arrays if a is not None)])
    say("duplicate vertices", n - np.count_nonzero(np.bincount(whole, minlength=n)), "all their values are another's")
    _check_normals(mesh, facing, flat, say)
    if mesh.texcoords is not None:
        outside = ((mesh.texcoords < -1e-4) | (mesh.texcoords > 1 + 1e-4)).any(1).sum()
        say("texture coordinates outside 0..1", outside, "the texture repeats there, if it may")
    if mesh.texcoords1 is not None:
        outside = ((mesh.texcoords1 < -1e-4) | (mesh.texcoords1 > 1 + 1e-4)).any(1).sum()
        say("lightmap coordinates outside 0..1", outside, "a lightmap must not repeat")
    return found, closed


def flat_triangles(mesh: Mesh) -> Array:
    """(m,) bool: triangles without an area worth the name, which are never seen: lower than float32 can tell, or with two corners in one place."""
    with np.errstate(invalid="ignore", over="ignore"):
        return _facing(mesh, _same_rows([mesh.positions])[mesh.triangles])[1]


def _check_normals(mesh: Mesh, facing: Array, flat: Array, say: Any) -> None:
    if mesh.normals is None:
        return
    length = np.sqrt(np.einsum("ij,ij->i", mesh.normals, mesh.normals))
    say("zero-length normals", (length == 0).sum(), "they light nothing")
    say("normals not of unit length", ((length > 0) & (np.abs(length - 1) > 1e-2)).sum(), "the renderer rescales them")
    against = np.ones(len(facing), bool)
    for k in range(3):
        against &= np.einsum("ij,ij->i", mesh.normals[mesh.triangles[:, k]], facing) < 0
    say("flipped normals", (against & ~flat).sum(), "triangles whose three normals point to their back")


def _facing(mesh: Mesh, corners: Array) -> tuple[Array, Array]:
    """Twice the area times the normal of each triangle, float64 (m, 3); and whether it has none (m,)."""
    a, b, c = (mesh.positions[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    u, v = b - a, c - a
    w = v - u
    facing = np.cross(u, v)
    longest = np.maximum(np.maximum((u * u).sum(1), (v * v).sum(1)), (w * w).sum(1))
    flat = ~(np.sqrt((facing * facing).sum(1)) > _FLAT * longest)
    same = (corners[:, 0] == corners[:, 1]) | (corners[:, 1] == corners[:, 2]) | (corners[:, 2] == corners[:, 0])
    flat |= same
    facing[~np.isfinite(facing).all(1)] = 0
    return facing, flat


def _same_rows(arrays: list[Array]) -> Array:
    """For each row over all float32 arrays, the index of one row that is equal to it: its representative."""
    columns = [(a[:, k] + np.float32(0)).view(np.uint32).astype(np.uint64) for a in arrays for k in range(a.shape[1])]
    key = mixed(columns)
    order = np.argsort(key)
    starts = np.ones(len(key), bool)
    starts[1:] = key[order][1:] != key[order][:-1]
    first = np.empty(len(key), np.int64)
    first[order] = order[np.maximum.accumulate(np.where(starts, np.arange(len(key)), 0))]
    if all((column[first] == column).all() for column in columns):
        return first
    _, index, inverse = np.unique(np.stack(columns, 1), axis=0, return_index=True, return_inverse=True)
    return index[inverse.ravel()]


def _duplicates(corners: Array) -> int:
    """Triangles that have the same corners as another one, in any order; the first of each is not counted."""
    ordered = np.sort(corners, 1)
    order = np.argsort(mixed([ordered[:, k].astype(np.uint64) for k in range(3)]))
    return int((ordered[order][1:] == ordered[order][:-1]).all(1).sum())


def _edges(corners: Array, n: int) -> dict[str, int]:
    """How many edges have one triangle, more than two, or two that run along it in the same direction."""
    keys = []
    for k in range(3):
        a, b = corners[:, k].astype(np.int64), corners[:, (k + 1) % 3].astype(np.int64)
        keys.append((np.minimum(a, b) * n + np.maximum(a, b)) * 2 + (a < b))
    key = np.sort(np.concatenate(keys)) if keys else np.zeros(0, np.int64)
    edge = key >> 1
    starts = np.flatnonzero(np.concatenate([[True], edge[1:] != edge[:-1]])) if len(key) else np.zeros(0, np.int64)
    count = np.diff(np.append(starts, len(key)))
    pairs = starts[count == 2]
    turned = int((key[pairs] == key[pairs + 1]).sum())
    return {"open": int((count == 1).sum()), "many": int((count > 2).sum()), "turned": turned}
