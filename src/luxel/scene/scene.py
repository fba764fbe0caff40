"""Scene: meshes placed in the world, with what lights and sees them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from luxel.arrays import Array, checked
from luxel.errors import InputError
from luxel.scene import checks
from luxel.scene.camera import Camera
from luxel.scene.light import Ambient, Light
from luxel.scene.material import Material, Texture
from luxel.scene.mesh import Mesh


@dataclass(eq=False)
class Instance:
    """A mesh placed in the world.

    Attributes:
        mesh: Index into the scene's meshes.
        world_from_mesh: (4, 4) float64; may mirror and scale.
        object: Object id; instances with the same id are parts of one thing (the primitives of a glTF node).
        name: Of the node; may be empty.
    """

    mesh: int
    world_from_mesh: Array | None = None
    object: int = 0
    name: str = ""

    def __post_init__(self) -> None:
        matrix = np.eye(4) if self.world_from_mesh is None else self.world_from_mesh
        self.world_from_mesh = checked(matrix, (4, 4), np.float64, "world_from_mesh")


@dataclass(eq=False)
class Scene:
    """What is drawn: instances of meshes, materials, textures, lights, cameras.

    `ambient` None and no lights means that the renderer brings a head light and a faint ambient of its own.
    """

    meshes: list[Mesh] = field(default_factory=list)
    instances: list[Instance] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    ambient: Ambient | None = None
    name: str = ""

    @classmethod
    def from_mesh(cls, mesh: Mesh, material: Material | None = None) -> Scene:
        """A scene of one mesh, where it stands; `material` replaces the mesh's own index."""
        scene = cls()
        scene.add(mesh, material)
        return scene

    def add(self, mesh: Mesh, material: Material | None = None, world_from_mesh: Array | None = None, name: str = "") -> Instance:
        """Append `mesh` as an object of its own and return its instance; `material` (if given) becomes the mesh's.

        Raises:
            InputError: `mesh` is no Mesh, `material` no Material, or the matrix not (4, 4).
        """
        checks.kind([mesh], Mesh, "mesh")
        checks.kind([] if material is None else [material], Material, "material")
        if material is not None:
            found = [i for i, known in enumerate(self.materials) if known is material]
            if not found:
                self.materials.append(material)
            mesh.material = found[0] if found else len(self.materials) - 1
        self.meshes.append(mesh)
        number = 1 + max((instance.object for instance in self.instances), default=-1)
        self.instances.append(Instance(len(self.meshes) - 1, world_from_mesh, number, name or mesh.name))
        return self.instances[-1]

    @property
    def triangle_count(self) -> int:
        """Triangles drawn, each instance counted."""
        return sum(len(self.meshes[instance.mesh].triangles) for instance in self.instances)

    def bounds(self) -> Array:
        """(2, 3) float64: the least and largest world coordinates of all instances; zeros for an empty scene."""
        corners = []
        for instance in self.instances:
            mesh = self.meshes[instance.mesh]
            if len(mesh.triangles):
                low, high = mesh.bounds()
                box = np.array([[x, y, z, 1.0] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
                corners.append((box @ instance.world_from_mesh.T)[:, :3])  # type: ignore[union-attr]
        if not corners:
            return np.zeros((2, 3))
        points = np.concatenate(corners)
        return np.stack([points.min(0), points.max(0)])

    def check(self) -> None:
        """Look whether the scene can be drawn.

        Raises:
            InputError: An index names a mesh, material or texture that is not there, or a material, texture, light or matrix has a
                value that cannot be drawn with; the message says which.
        """
        checks.kind(self.meshes, Mesh, "mesh")
        checks.kind(self.instances, Instance, "instance")
        for i, instance in enumerate(self.instances):
            if not isinstance(instance.mesh, (int, np.integer)) or not 0 <= instance.mesh < len(self.meshes):
                raise InputError(f"instance {i}: mesh {instance.mesh!r} of {len(self.meshes)}")
        matrices = np.array([instance.world_from_mesh for instance in self.instances]).reshape(-1, 16)
        finite = np.isfinite(matrices).all(1)
        if not finite.all():
            raise InputError(f"instance {finite.argmin()}, world_from_mesh: expected finite numbers")
        for i, mesh in enumerate(self.meshes):
            if not isinstance(mesh.material, (int, np.integer)) or not -1 <= mesh.material < len(self.materials):
                raise InputError(f"mesh {i}: material {mesh.material!r} of {len(self.materials)}")
        checks.check_materials(self.materials, self.textures)
        checks.check_lights(self.lights, self.ambient)
