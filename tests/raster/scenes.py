"""Scenes and cameras for tests that draw whole pictures."""

import numpy as np

from luxel import Ambient, Camera, Instance, Light, Material, Mesh, Scene, Texture, TextureRef
from luxel.scene.builtin import shapes

UNLIT = {"shading": "unlit", "double_sided": True}


def flat_camera(size, near=-1.0, far=1.0):
    """Orthographic: world x, y are pixels, y down from the top left corner of the picture (so fronts are clockwise as listed); z = 1 is nearest."""
    width, height = size
    matrix = np.array([[1.0, 0, 0, width / 2], [0, 1, 0, -height / 2], [0, 0, 1, 0], [0, 0, 0, 1]])
    return Camera(matrix, yfov=None, height=height, near=near, far=far)


def flat_mesh(points, triangles, z=0.0, **rest):
    """A mesh for `flat_camera`: points (n, 2) in pixels, y down."""
    points = np.asarray(points, float)
    z = np.broadcast_to(np.asarray(z, float), len(points))
    return Mesh(np.stack([points[:, 0], -points[:, 1], z], 1), np.asarray(triangles, np.int32).reshape(-1, 3), **rest)


def rectangle(x0, y0, x1, y1, z=0.0, **rest):
    """A mesh of two triangles for `flat_camera`, front to the eye, with texture coordinates 0..1."""
    texcoords = [[0, 0], [1, 0], [1, 1], [0, 1]]
    return flat_mesh([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], [[0, 3, 2], [0, 2, 1]], z, texcoords=texcoords, **rest)


def room(seed=0, modes=True):
    """Several parts, materials, objects, a texture, lights; masked and blended parts among them."""
    rng = np.random.default_rng(seed)
    checks = np.full((16, 16, 4), 255, np.uint8)
    checks[..., :3] = rng.integers(60, 255, (16, 16, 1))
    checks[..., 3] = 255 * (np.indices((16, 16)).sum(0) // 2 % 2)
    scene = Scene(textures=[Texture(checks)], lights=[Light(intensity=2.0), Light("point", intensity=8.0)], ambient=Ambient((0.3,) * 3, (0.1,) * 3))
    scene.lights[1].world_from_light[:3, 3] = 1, 2, 1
    materials = [
        Material((0.8, 0.3, 0.2, 1), double_sided=True), Material((0.9, 0.9, 0.9, 1), base_color_texture=TextureRef(0)),
        Material((0.2, 0.6, 0.3, 1), shading="pbr", metallic=0.7, roughness=0.3),
    ]  # fmt: skip
    if modes:
        materials += [
            Material((0.9, 0.8, 0.2, 1), alpha_mode="MASK", base_color_texture=TextureRef(0), double_sided=True),
            Material((0.2, 0.4, 0.9, 0.5), alpha_mode="BLEND", double_sided=True),
        ]
    meshes = [shapes.sphere(0.6, 24), shapes.box(), shapes.torus(0.7, 0.2, 24, 12), shapes.plane(1.5, 1.5, 3, 3), shapes.cone(0.4, 0.9, 16)]
    for i in range(9):
        turn = np.eye(4)
        turn[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]  # half of them mirror
        turn[:3, 3] = rng.uniform(-1.2, 1.2, 3)
        mesh = meshes[i % len(meshes)]
        scene.add(Mesh(mesh.positions, mesh.triangles, mesh.normals, mesh.texcoords), materials[i % len(materials)], turn)
    return scene


def around(angle=0.5, distance=4.0, **rest):
    place = np.array([np.cos(angle), 0.4, np.sin(angle)]) * distance
    return Camera.look_at(place, [0, 0, 0], **rest)


def instance(matrix, mesh=0, number=0):
    return Instance(mesh, np.asarray(matrix, float), number)
