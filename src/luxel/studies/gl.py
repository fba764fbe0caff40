"""OpenGL without a display, through EGL (moderngl; extra `peers`): how fast a graphics card, or llvmpipe in its place, draws a mesh."""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.scene.camera import Camera

_VERTEX = """#version 330
uniform mat4 clip_from_world; in vec3 position; out vec3 seen;
void main() { gl_Position = clip_from_world * vec4(position, 1); seen = position; }"""
_FRAGMENT = """#version 330
in vec3 seen; out vec4 color;
void main() { color = vec4(fract(seen), 1); }"""


class Renderer:
    """A context of its own.

    Attributes:
        name: Of the renderer, as OpenGL gives it; None if there is none.
        missing: Why there is none, or "".
    """

    def __init__(self) -> None:
        self.name: str | None = None
        self.missing = ""
        try:
            import moderngl

            options: Any = {"standalone": True, "backend": "egl"}
            self.context: Any = moderngl.create_context(**options)
            self.name = str(self.context.info["GL_RENDERER"])
        except ImportError:
            self.missing = "moderngl is not installed (pip install 'luxel[peers]')"
        except Exception as error:
            self.missing = f"OpenGL cannot be had through EGL ({error})"

    def seconds(self, positions: Array, triangles: Array, camera: Camera, size: int = 64, repeats: int = 9) -> float:
        """Median time of drawing the mesh into a picture of `size` x `size`, so small that the vertices are most of the work."""
        import moderngl

        context = self.context
        program = context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        matrix = camera.clip_from_world((size, size))
        matrix[2] = matrix[3] - 2 * matrix[2]  # depth from -w at near to w far away
        program["clip_from_world"].write(matrix.T.astype("f4").tobytes())
        data = np.ascontiguousarray(positions, np.float32), np.ascontiguousarray(triangles, np.int32)
        buffers = [context.buffer(array.tobytes()) for array in data]
        array = context.vertex_array(program, [(buffers[0], "3f", "position")], buffers[1])
        frame = context.framebuffer([context.renderbuffer((size, size), 4)], context.depth_renderbuffer((size, size)))
        frame.use()
        context.enable(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        taken = []
        for _ in range(repeats + 1):
            frame.clear(depth=1.0)
            context.finish()
            start = time.perf_counter()
            array.render()
            context.finish()
            taken.append(time.perf_counter() - start)
        for thing in (array, frame, program, *buffers):
            thing.release()
        return statistics.median(taken[1:])
