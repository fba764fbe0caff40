"""Plain: `surface`, `light` and `encode` in one loop, where all that is seen is diffuse and of one colour each, under ambient light and one
directional light.

What models look like before anybody gave them textures is that, and then time goes into passing a batch's rows from loop to loop. Here what
is between them stays in registers. The operations and their order are those of the loops that this one stands for, so are the bits.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.raster.channels import FRONT, NX, NY, NZ, OB, OG, OR
from luxel.raster.encode import pack, srgb_code
from luxel.raster.geometry import Geometry
from luxel.raster.lighting import COLOR, ORIGIN, PUNCTUAL, LightTable
from luxel.raster.materials import BLUE, CODE, GREEN, MODEL_LAMBERT, NEEDS_NORMAL, RED, MaterialTable
from luxel.raster.surface import run_length

_NX, _NY, _NZ, _FRONT, _OR, _OG, _OB = (np.uint64(row) for row in (NX, NY, NZ, FRONT, OR, OG, OB))
_ZERO, _HALF, _ONE = (np.float32(x) for x in (0, 0.5, 1))
_PI, _INVERSE_PI, _TINY = (np.float32(x) for x in (math.pi, 1 / math.pi, 1e-30))
_WHOLE = np.int32(255)

if jit.DISABLED:

    def in_widest_vectors():
        """Nothing, without a compiler."""

else:
    from luxel.jit import intrinsic, types

    @intrinsic
    def in_widest_vectors(typingctx):
        """The function that calls this is vectorised for registers of 512 bits, where the machine has them. LLVM prefers 256 even there, as short
        loops do; a long one that does nothing but arithmetic takes two thirds of the time."""

        def codegen(context, builder, signature, arguments):
            set.update(builder.function.attributes, {"noinline", '"prefer-vector-width"="512"'})  # llvmlite knows no attributes with values
            return context.get_dummy_value()

        return types.void(), codegen



def is_plain(geometry: Geometry, materials: MaterialTable, lights: LightTable, features: int) -> bool:
    """Whether `shade_plainly` does all that these ask for."""
    if features != NEEDS_NORMAL or len(lights.lights) != 1 or lights.lights[0, PUNCTUAL] != 0:
        return False
    return bool((materials.ints[geometry.part_material, CODE] == MODEL_LAMBERT).all())


@jit.part
def shade_plainly(g, n, material, parts, table, lights, exposure, codes):
    """Shade the first `n` fragments of a batch whose normals are filled: OR OG OB get their radiance.

    Args:
        material: (>= n,) int32, row of each fragment's material in the table, or -1 for the default material.
        parts: If 1, all are of one material.
        codes: (>= n,) uint32; gets sRGB, opaque.
    """
    start = 0
    while start < n:
        end = start + (run_length(material[start:n]) if parts > 1 else n)
        row = material[start] if material[start] >= 0 else len(table.floats) - 1
        _shade_run(g, start, end, table.floats[row], lights.ambient, lights.lights[0], exposure, codes)
        start = end


@jit.part
def _shade_run(g, start, end, numbers, radiance, light, exposure, codes):
    """Shade fragments start .. end - 1, all of one material."""
    in_widest_vectors()
    own_red, own_green, own_blue = numbers[RED], numbers[GREEN], numbers[BLUE]
    red, green, blue = radiance[1, 0] * _PI, radiance[1, 1] * _PI, radiance[1, 2] * _PI
    more_red, more_green, more_blue = radiance[0, 0] * _PI - red, radiance[0, 1] * _PI - green, radiance[0, 2] * _PI - blue
    to_x, to_y, to_z = light[ORIGIN], light[ORIGIN + 1], light[ORIGIN + 2]
    light_red, light_green, light_blue = light[COLOR], light[COLOR + 1], light[COLOR + 2]
    for i in range(np.uint64(start), np.uint64(end)):
        x, y, z = g[_NX + i], g[_NY + i], g[_NZ + i]
        scale = g[_FRONT + i] / np.float32(math.sqrt(max(x * x + y * y + z * z, _TINY)))
        x, y, z = x * scale, y * scale, z * scale
        up = _HALF + _HALF * y
        facing = max(_ZERO, x * to_x + y * to_y + z * to_z)
        r = own_red * ((red + more_red * up + facing * light_red) * _INVERSE_PI)
        s = own_green * ((green + more_green * up + facing * light_green) * _INVERSE_PI)
        t = own_blue * ((blue + more_blue * up + facing * light_blue) * _INVERSE_PI)
        g[_OR + i], g[_OG + i], g[_OB + i] = r, s, t
        codes[i] = pack(srgb_code(r * exposure), srgb_code(s * exposure), srgb_code(t * exposure), _WHOLE)
