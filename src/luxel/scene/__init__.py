"""The scene's nouns: Mesh, Material, Texture, Light, Camera, Instance, Scene."""

from luxel.scene.camera import Camera
from luxel.scene.light import Ambient, Light
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.mesh import Mesh
from luxel.scene.scene import Instance, Scene

__all__ = ["Ambient", "Camera", "Instance", "Light", "Material", "Mesh", "Scene", "Texture", "TextureRef"]
