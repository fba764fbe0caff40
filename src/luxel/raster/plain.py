"""Plain: `surface`, `light` and `encode` in one loop, where all that is seen is diffuse and of one colour each, under ambient light and one
directional light.

What models look like before anybody gave them textures is that, and then time goes into passing a batch's rows from loop to loop. Here what
is between them stays in registers. The operations and their order are those of the loops that this one stands for, so are the bits.
"""

from __future__ import annotations

import math

import numpy as np

from luxel import jit
from luxel.raster.channels import FRONT, NX, NY, NZ, OB, OG, OR, PITCH
from luxel.raster.encode import pack, srgb_code
from luxel.raster.fragments import AT_SIDE, AT_X, AT_Y, NEEDS_ANYTHING, NORMAL
from luxel.raster.geometry import Geometry
from luxel.raster.lighting import COLOR, ORIGIN, PUNCTUAL, LightTable
from luxel.raster.materials import BLUE, CODE, GREEN, MODEL_LAMBERT, NEEDS_NORMAL, RED, MaterialTable
from luxel.raster.rows import fill, ramp
from luxel.raster.surface import run_length

_NX, _NY, _NZ, _FRONT, _OR, _OG, _OB = (np.uint64(row) for row in (NX, NY, NZ, FRONT, OR, OG, OB))
_AT_X, _AT_Y, _AT_SIDE, _N = (np.uint64(column) for column in (AT_X, AT_Y, AT_SIDE, NORMAL))
_1, _2, _4, _5, _6, _8, _9, _10 = (np.uint64(column) for column in (1, 2, 4, 5, 6, 8, 9, 10))
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
    if features & NEEDS_ANYTHING != NEEDS_NORMAL or len(lights.lights) != 1 or lights.lights[0, PUNCTUAL] != 0:
        return False
    return bool((materials.ints[geometry.part_material, CODE] == MODEL_LAMBERT).all())


@jit.part
def fill_normals(g, r, shared, batch, material, setups, parts):
    """Fill the rows of a batch that `shade_plainly` reads, as `attributes` does, and `material` (FRAGMENTS,) int32."""
    for run in range(np.uint64(0), np.uint64(batch.whole_runs)):
        i, setup = np.int64(r.head[run]), np.uint64(r.setup[run])
        count, record = np.int64(r.head[run + np.uint64(1)]) - i, setups.stored[setup]
        x, dy = r.x[run] - record[AT_X], r.y[run] - record[AT_Y]
        fill(g, FRONT + i, count, record[AT_SIDE])
        for k in range(3):
            at = NORMAL + 4 * k
            ramp(g, NX + k * PITCH + i, count, x, record[at], record[at + 1] * dy + record[at + 2])
        if parts > 1:
            for k in range(i, i + count):
                material[k] = setups.material[setup]
    for j in range(np.uint64(0), np.uint64(batch.fragments - batch.whole_fragments)):
        i, setup = np.uint64(batch.whole_fragments) + j, np.uint64(shared.setup[j])
        record = setups.stored[setup]
        x, dy = shared.x[j] - record[_AT_X], shared.y[j] - record[_AT_Y]
        g[_FRONT + i] = record[_AT_SIDE]
        g[_NX + i] = record[_N] * x + (record[_N + _1] * dy + record[_N + _2])
        g[_NY + i] = record[_N + _4] * x + (record[_N + _5] * dy + record[_N + _6])
        g[_NZ + i] = record[_N + _8] * x + (record[_N + _9] * dy + record[_N + _10])
        if parts > 1:
            material[i] = setups.material[setup]


@jit.part
def shade_plainly(g, first, last, material, parts, table, lights, exposure, codes):
    """Shade fragments `first` .. `last` - 1 of a batch whose normals are filled.

    Args:
        material: (>= last,) int32, row of each fragment's material in the table, or -1 for the default material.
        parts: If 1, all are of one material.
        codes: (>= last,) uint32; gets sRGB, opaque. None: OR OG OB get the radiance instead.
    """
    while first < last:
        end = first + run_length(material[first:last]) if parts > 1 else last
        row = material[first] if material[first] >= 0 else len(table.floats) - 1
        _shade_run(g, first, end, table.floats[row], lights.ambient, lights.lights[0], exposure, codes)
        first = end


@jit.part
def _shade_run(g, first, last, numbers, radiance, light, exposure, codes):
    """Shade fragments first .. last - 1, all of one material."""
    in_widest_vectors()
    own_red, own_green, own_blue = numbers[RED], numbers[GREEN], numbers[BLUE]
    red, green, blue = radiance[1, 0] * _PI, radiance[1, 1] * _PI, radiance[1, 2] * _PI
    more_red, more_green, more_blue = radiance[0, 0] * _PI - red, radiance[0, 1] * _PI - green, radiance[0, 2] * _PI - blue
    to_x, to_y, to_z = light[ORIGIN], light[ORIGIN + 1], light[ORIGIN + 2]
    light_red, light_green, light_blue = light[COLOR], light[COLOR + 1], light[COLOR + 2]
    for i in range(np.uint64(first), np.uint64(last)):
        x, y, z = g[_NX + i], g[_NY + i], g[_NZ + i]
        scale = g[_FRONT + i] / np.float32(math.sqrt(max(x * x + y * y + z * z, _TINY)))
        x, y, z = x * scale, y * scale, z * scale
        up = _HALF + _HALF * y
        facing = max(_ZERO, x * to_x + y * to_y + z * to_z)
        r = own_red * ((red + more_red * up + facing * light_red) * _INVERSE_PI)
        s = own_green * ((green + more_green * up + facing * light_green) * _INVERSE_PI)
        t = own_blue * ((blue + more_blue * up + facing * light_blue) * _INVERSE_PI)
        if codes is not None:
            codes[i] = pack(srgb_code(r * exposure), srgb_code(s * exposure), srgb_code(t * exposure), _WHOLE)
        else:
            g[_OR + i], g[_OG + i], g[_OB + i] = r, s, t
