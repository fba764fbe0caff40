"""Scenes, and the same picture from the processor and from a GPU."""

import needs_numba_cuda  # noqa: F401 - before what it may skip
import numpy as np

import luxel
from luxel.cuda.frame import draw_views
from luxel.cuda.resident import Resident
from luxel.raster.render import Options, prepare, render

EVERYTHING = ("color", "linear", "depth", "triangle", "object", "material", "normal", "position", "barycentric", "texcoord", "motion")


def camera(z=8.0, **more):
    matrix = np.eye(4)
    matrix[2, 3] = z
    return luxel.Camera(matrix, **more)


def soup(rng, count, material=-1, size=1.5, rich=True):
    """Triangles with shared corners or without, of all sizes, also behind the camera and beyond the picture."""
    corners = (rng.normal(size=(3 * count, 3)) * size).astype(np.float32)
    triangles = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    triangles[: count // 2] = rng.integers(0, 3 * count, (count // 2, 3))
    uv = rng.uniform(-1, 2, (3 * count, 2)).astype(np.float32) if rich else None
    colors = rng.uniform(0.2, 1, (3 * count, 4)).astype(np.float32) if rich else None
    return luxel.Mesh(corners, triangles, texcoords=uv, colors=colors, material=material)


def materials():
    ref, glow = luxel.TextureRef, luxel.TextureRef(1)
    return [
        luxel.Material(base_color_texture=ref(0), shading="pbr", metallic=0.7, roughness=0.3, normal_texture=ref(0), occlusion_texture=ref(0)),
        luxel.Material(base_color_texture=ref(0), alpha_mode="MASK", alpha_cutoff=0.4, double_sided=True),
        luxel.Material(base_color_texture=ref(0), alpha_mode="BLEND", base_color=(1, 0.5, 0.7, 0.6), double_sided=True),
        luxel.Material(emissive=(0.2, 0.1, 0), emissive_texture=glow, specular=(0.3, 0.3, 0.3), shininess=20.0),
    ]


def textured(seed, kinds=(0, 1, 2, 3), count=20):
    """A scene with materials of these kinds (rows of `materials`), lamps, and textures of bytes and of floats."""
    rng = np.random.default_rng(seed)
    textures = [
        luxel.Texture(rng.integers(0, 255, (33, 20, 4)).astype(np.uint8), wrap=("mirror", "clamp")),
        luxel.Texture(rng.uniform(0, 2, (16, 16, 4)).astype(np.float32), filter="bilinear", srgb=False),
    ]
    lamp = np.eye(4)
    lamp[:3, 3] = 1, 3, 2
    lights = [luxel.Light("point", intensity=20.0, world_from_light=lamp), luxel.Light("directional"), luxel.Light("spot", world_from_light=lamp)]
    meshes = [soup(rng, count, kind) for kind in kinds]
    instances = [luxel.Instance(i) for i in range(len(meshes))]
    return luxel.Scene(meshes=meshes, instances=instances, materials=materials(), textures=textures, lights=lights)


def plain(seed, count=60, size=1.5):
    mesh = soup(np.random.default_rng(seed), count, size=size, rich=False)
    return luxel.Scene(meshes=[mesh], instances=[luxel.Instance(0)])


def both(gpu, scene, cameras, size, *, shading=None, cull="material", previous=None, split=None, **options):
    """Pictures of the processor and of `gpu`, view by view."""
    prepared = prepare(scene, shading, cull)
    resident = Resident(gpu, prepared)
    if split is not None:
        resident.split, resident.side = split
    theirs = draw_views(resident, cameras, size, Options(**options), [previous] * len(cameras))
    ours = [render(prepared, one, size, previous_camera=previous, **options) for one in cameras]
    return ours, theirs


def assert_same(ours, theirs, step=0):
    """All but colours are the same bytes; colours differ by no more than `step` of 255."""
    for one, other in zip(ours, theirs, strict=True):
        assert one.outputs().keys() == other.outputs().keys()
        for name, array in one.outputs().items():
            seen = np.asarray(getattr(other, name))
            assert array.shape == seen.shape
            assert array.dtype == seen.dtype
            if name == "color":
                assert np.abs(array.astype(int) - seen.astype(int)).max() <= step
            elif name == "linear":
                np.testing.assert_allclose(seen, array, atol=1e-3 * step, rtol=1e-3 * step)
            else:
                np.testing.assert_array_equal(array, seen, err_msg=name)
