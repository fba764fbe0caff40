"""The peer: Mesa's llvmpipe, OpenGL on the processor, through EGL without a display (moderngl; extra `peers`)."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from luxel.scene.camera import Camera
from luxel.scene.mesh import Mesh

_VERTEX = """#version 330
uniform mat4 clip_from_world; in vec3 position; in vec3 normal; out vec3 n;
void main() { gl_Position = clip_from_world * vec4(position, 1); n = normal; }"""

_FRAGMENT = """#version 330
uniform vec3 albedo, to_light; uniform float irradiance, ambient; in vec3 n; out vec4 color;
void main() {
    vec3 m = normalize(gl_FrontFacing || !two_sided ? n : -n);
    color = vec4(albedo * (ambient + irradiance / 3.14159265 * max(dot(m, to_light), 0.0)), 1);
}"""


class Missing(Exception):
    """llvmpipe cannot be had here; the message says why."""


class Llvmpipe:
    """A context of its own, with as many threads as asked for."""

    def __init__(self, threads: int) -> None:
        os.environ.update(LP_NUM_THREADS=str(threads), LIBGL_ALWAYS_SOFTWARE="1", GALLIUM_DRIVER="llvmpipe", EGL_PLATFORM="surfaceless")
        try:
            import moderngl
        except ImportError:
            raise Missing("moderngl is not installed: pip install 'luxel[peers]'") from None
        try:
            self.context: Any = moderngl.create_context(standalone=True, backend="egl")
        except Exception as error:
            raise Missing(f"no OpenGL through EGL ({error}); Debian: libegl1 and libgl1-mesa-dri") from None
        self.name = f"{self.context.info['GL_RENDERER']}, {self.context.info['GL_VERSION']}"
        if "llvmpipe" not in self.name:
            raise Missing(f"EGL gives another renderer: {self.name}")


class Drawing:
    """One mesh with one material and light, drawn and read back by each `draw`: the Lambert model that `raster.py` asks of luxel.

    The colours stay linear, which spares llvmpipe the sRGB encoding that luxel does.
    """

    def __init__(self, peer: Llvmpipe, mesh: Mesh, camera: Camera, size: tuple[int, int], samples: int, look: Any, two_sided: bool) -> None:
        import moderngl

        context = self.context = peer.context
        self.size, self.samples = size, samples
        fragment = _FRAGMENT.replace("two_sided", "true" if two_sided else "false")
        program = context.program(vertex_shader=_VERTEX, fragment_shader=fragment)
        program["clip_from_world"].write(_gl_matrix(camera, size).T.astype("f4").tobytes())
        program["albedo"], program["to_light"] = look.albedo, look.to_light
        program["irradiance"], program["ambient"] = look.irradiance, look.ambient
        assert mesh.normals is not None
        buffers = [(context.buffer(array.tobytes()), "3f", name) for name, array in (("position", mesh.positions), ("normal", mesh.normals))]
        self.array = context.vertex_array(program, buffers, context.buffer(mesh.triangles.tobytes()))
        self.frame = context.framebuffer([context.renderbuffer(size, 4, samples=samples if samples > 1 else 0)],
                                         context.depth_renderbuffer(size, samples=samples if samples > 1 else 0))  # fmt: skip
        self.plain = context.framebuffer([context.renderbuffer(size, 4)])
        context.enable(moderngl.DEPTH_TEST)
        (context.disable if two_sided else context.enable)(moderngl.CULL_FACE)
        context.front_face = "ccw"

    def draw(self) -> bytes:
        """RGBA bytes, bottom row first."""
        self.frame.use()
        self.frame.clear(0, 0, 0, 0, depth=1.0)
        self.array.render()
        if self.samples > 1:
            self.context.copy_framebuffer(self.plain, self.frame)
            return self.plain.read(components=4)
        return self.frame.read(components=4)

    def picture(self) -> np.ndarray:
        """(h, w, 4) uint8, linear, top row first."""
        width, height = self.size
        return np.frombuffer(self.draw(), np.uint8).reshape(height, width, 4)[::-1]

    def release(self) -> None:
        for thing in (self.array, self.frame, self.plain):
            thing.release()


def _gl_matrix(camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """OpenGL's clip_from_world: luxel's, with depth from -w at near to w far away."""
    matrix = camera.clip_from_world(size)
    matrix[2] = matrix[3] - 2 * matrix[2]
    return matrix
