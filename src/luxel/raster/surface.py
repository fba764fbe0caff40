"""Surface: what a batch of fragments is made of. Evaluates materials, in runs of fragments of the same one.

What `light` gets is the same for all materials: a diffuse colour, a specular colour (F0 of glTF's model, Ks of Blinn-Phong), a
roughness or an exponent, and a unit normal. glTF, Appendix B: diffuse = base * (1 - metallic), F0 = lerp(0.04, base, metallic).
Blinn-Phong without a Ks takes the same with half the metallic, because it has no mirror image of the surroundings to show, in which
metals would not be black; its exponent is 2 / roughness^4 - 2.
"""

from __future__ import annotations

import math

import numpy as np

from luxel.arrays import Array
from luxel.jit import part
from luxel.raster.channels import (
    CA,
    CB,
    CG,
    CR,
    DXX,
    DXY,
    DXZ,
    DYX,
    DYY,
    DYZ,
    EMB,
    EMG,
    EMR,
    FRONT,
    FX,
    FY,
    FZ,
    LMB,
    LMG,
    LMR,
    METALLIC,
    MODEL,
    NX,
    NY,
    NZ,
    OCCLUSION,
    PITCH,
    ROUGHNESS,
    SHININESS,
    SPB,
    SPG,
    SPR,
    TEXA,
    TEXB,
    TEXG,
    TEXR,
    TW,
    TX,
    TY,
    TZ,
    U0,
    U1,
)
from luxel.raster.materials import (
    ALPHA,
    ALPHA_BLEND,
    BASE_SLOT,
    BLUE,
    CODE,
    DERIVED,
    EMISSIVE_SLOT,
    EMIT,
    GLOSS,
    GREEN,
    LEAST_ROUGHNESS,
    LIGHTMAP_SCALE,
    METAL,
    MODEL_LAMBERT,
    MODEL_MASK,
    MODEL_PBR,
    MODEL_PHONG,
    MODEL_UNLIT,
    NEEDS_COLOR,
    NEEDS_FACE,
    NORMAL_SCALE,
    NORMAL_SLOT,
    OCCLUSION_SLOT,
    OCCLUSION_STRENGTH,
    RED,
    ROUGHNESS_SLOT,
    SLOTS,
    SPECULAR,
    TEXCOORD,
    TEXTURE,
    TRANSFORMS,
    MaterialTable,
)
from luxel.raster.texture import alpha_at, fetch

_ZERO, _HALF, _ONE, _TWO, _TINY = (np.float32(x) for x in (0, 0.5, 1, 2, 1e-30))
_DIELECTRIC, _SMOOTHEST = np.float32(0.04), np.float32(LEAST_ROUGHNESS)


@part
def surface(g: Array, material: Array, n: int, table: MaterialTable, rich: bool | None = True) -> None:
    """Evaluate the materials of the first `n` fragments of a batch.

    Args:
        g: The batch; see `channels` for what is read and written.
        material: (>= n,) int32, row of each fragment's material in the table, or -1 for the default material.
        n: Fragments.
        table: From `pack_materials`.
        rich: None for a table that is not `MaterialTable.rich`: what textures and metals need is then not even compiled.
    """
    start = 0
    while start < n:
        end = start + run_length(material[start:n])
        row = material[start] if material[start] >= 0 else len(table.flags) - 1
        evaluate(g[start:], end - start, row, table, rich)
        start = end


@part
def run_length(keys: Array) -> int:
    """How many keys (int32 or float32) at the beginning are equal; quick when all are."""
    differ = np.int32(0)
    for i in range(len(keys)):
        differ = np.int32(differ | np.int32(keys[i] != keys[0]))
    length = len(keys)
    if differ:
        length = 1
        while keys[length] == keys[0]:
            length += 1
    return length


@part
def evaluate(g: Array, n: int, row: int, table: MaterialTable, rich: bool | None) -> None:
    """Evaluate one material for the first `n` fragments."""
    flags, code = table.flags[row], table.ints[row, CODE]
    base(g, n, table.floats[row], flags & NEEDS_COLOR != 0, np.float32(code))
    if code & MODEL_MASK != MODEL_UNLIT:
        if flags & NEEDS_FACE:
            for i in range(n):
                g[NX + i] = g[FX + i]
                g[NY + i] = g[FY + i]
                g[NZ + i] = g[FZ + i]
        normalise(g, n)
    if code != MODEL_LAMBERT:
        constants(g, n, table.floats[row])
    if rich is not None:
        textures(g, n, row, table)
    if code & MODEL_MASK == MODEL_PBR or (code & MODEL_MASK == MODEL_PHONG and table.ints[row, DERIVED]):
        metal(g, n, code & MODEL_MASK == MODEL_PHONG)
    if flags & ALPHA_BLEND == 0:  # OPAQUE ignores alpha, and what MASK keeps is whole
        for i in range(n):
            g[CA + i] = _ONE


@part
def textures(g: Array, n: int, row: int, table: MaterialTable) -> None:
    """Use the textures of one material."""
    for slot in range(len(SLOTS)):
        which = table.ints[row, TEXTURE + slot]
        if which >= 0:
            first = TRANSFORMS + 6 * slot
            transform = table.floats[row, first : first + 6]
            uv = U1 if table.ints[row, TEXCOORD + slot] else U0
            fetch(g, n, table.textures[which], table.levels[which], table.texels, table.radiance, uv, transform)
            if slot == NORMAL_SLOT:
                bend(g, n, g[uv:], transform, table.floats[row, NORMAL_SCALE])
            else:
                apply(g, n, slot, table.floats[row])


@part
def base(g: Array, n: int, numbers: Array, colored: bool, code: np.float32) -> None:
    """The model, and the base colour: the factor, times the vertex colour if there is one."""
    red, green, blue, alpha = numbers[RED], numbers[GREEN], numbers[BLUE], numbers[ALPHA]
    if colored:
        for i in range(n):
            g[CR + i] *= red
            g[CG + i] *= green
            g[CB + i] *= blue
            g[CA + i] *= alpha
            g[MODEL + i] = code
    else:
        for i in range(n):
            g[CR + i] = red
            g[CG + i] = green
            g[CB + i] = blue
            g[CA + i] = alpha
            g[MODEL + i] = code


@part
def normalise(g: Array, n: int) -> None:
    """Make the normal unit length and turn it on back faces; zero stays zero."""
    for i in range(n):
        x, y, z = g[NX + i], g[NY + i], g[NZ + i]
        scale = g[FRONT + i] / np.float32(math.sqrt(max(x * x + y * y + z * z, _TINY)))
        g[NX + i] = x * scale
        g[NY + i] = y * scale
        g[NZ + i] = z * scale


@part
def bend(g: Array, n: int, uv: Array, transform: Array, strength: np.float32) -> None:
    """Apply the normal map in TEXR TEXG TEXB to the unit normal.

    The frame is the mesh's tangent, or else, per fragment, the directions on the surface in which u grows and v falls (+Y of a
    normal map is up in the picture); so mirrored coordinates need no sign. On back faces the whole frame is turned.
    """
    a, b, d, e = transform[0], transform[1], transform[3], transform[4]
    for i in range(n):
        front = g[FRONT + i]
        nx, ny, nz = g[NX + i] * front, g[NY + i] * front, g[NZ + i] * front
        ux, vx, uy, vy = uv[2 * PITCH + i], uv[3 * PITCH + i], uv[4 * PITCH + i], uv[5 * PITCH + i]
        ux, vx, uy, vy = a * ux + b * vx, d * ux + e * vx, a * uy + b * vy, d * uy + e * vy
        # n x dP/dx and dP/dy x n are the gradients of the pixel's y and x on the surface, times the triple product, whose sign
        # tells on which side of the surface x turns into y: -front, unless the normal disagrees with the winding.
        px, py, pz = g[DXX + i], g[DXY + i], g[DXZ + i]
        qx, qy, qz = g[DYX + i], g[DYY + i], g[DYZ + i]
        yx, yy, yz = ny * pz - nz * py, nz * px - nx * pz, nx * py - ny * px
        xx, xy, xz = qy * nz - qz * ny, qz * nx - qx * nz, qx * ny - qy * nx
        turn = xx * px + xy * py + xz * pz
        tx, ty, tz = xx * ux + yx * uy, xy * ux + yy * uy, xz * ux + yz * uy
        bx, by, bz = xx * vx + yx * vy, xy * vx + yy * vy, xz * vx + yz * vy
        size = max(tx * tx + ty * ty + tz * tz, bx * bx + by * by + bz * bz)
        scale = (-front if turn * front <= _ZERO else front) / np.float32(math.sqrt(max(size, _TINY)))
        own, w = g[TW + i] != _ZERO, g[TW + i]
        tx, ty, tz = g[TX + i] if own else tx * scale, g[TY + i] if own else ty * scale, g[TZ + i] if own else tz * scale
        bx = (ny * tz - nz * ty) * w if own else -bx * scale
        by = (nz * tx - nx * tz) * w if own else -by * scale
        bz = (nx * ty - ny * tx) * w if own else -bz * scale
        x, y, z = (_TWO * g[TEXR + i] - _ONE) * strength, (_TWO * g[TEXG + i] - _ONE) * strength, _TWO * g[TEXB + i] - _ONE
        nx, ny, nz = tx * x + bx * y + nx * z, ty * x + by * y + ny * z, tz * x + bz * y + nz * z
        scale = front / np.float32(math.sqrt(max(nx * nx + ny * ny + nz * nz, _TINY)))
        g[NX + i] = nx * scale
        g[NY + i] = ny * scale
        g[NZ + i] = nz * scale


@part
def constants(g: Array, n: int, numbers: Array) -> None:
    """What a material says without textures."""
    for i in range(n):
        g[SPR + i] = numbers[SPECULAR]
        g[SPG + i] = numbers[SPECULAR + 1]
        g[SPB + i] = numbers[SPECULAR + 2]
        g[METALLIC + i] = numbers[METAL]
        g[ROUGHNESS + i] = numbers[GLOSS]
        g[OCCLUSION + i] = _ONE
        g[EMR + i] = numbers[EMIT]
        g[EMG + i] = numbers[EMIT + 1]
        g[EMB + i] = numbers[EMIT + 2]


@part
def apply(g: Array, n: int, slot: int, numbers: Array) -> None:
    """Use the texture in TEXR TEXG TEXB TEXA."""
    if slot == BASE_SLOT:
        for i in range(n):
            g[CR + i] *= g[TEXR + i]
            g[CG + i] *= g[TEXG + i]
            g[CB + i] *= g[TEXB + i]
            g[CA + i] *= g[TEXA + i]
    elif slot == ROUGHNESS_SLOT:
        for i in range(n):
            g[METALLIC + i] *= g[TEXB + i]
            g[ROUGHNESS + i] = max(_SMOOTHEST, g[ROUGHNESS + i] * g[TEXG + i])
    elif slot == OCCLUSION_SLOT:
        strength = numbers[OCCLUSION_STRENGTH]
        for i in range(n):
            g[OCCLUSION + i] = _ONE + strength * (g[TEXR + i] - _ONE)
    elif slot == EMISSIVE_SLOT:
        for i in range(n):
            g[EMR + i] *= g[TEXR + i]
            g[EMG + i] *= g[TEXG + i]
            g[EMB + i] *= g[TEXB + i]
    else:
        scale = numbers[LIGHTMAP_SCALE]
        for i in range(n):
            g[LMR + i] = scale * g[TEXR + i]
            g[LMG + i] = scale * g[TEXG + i]
            g[LMB + i] = scale * g[TEXB + i]


@part
def metal(g: Array, n: int, phong: bool) -> None:
    """Split the base colour into diffuse and specular by the metallic part; for Blinn-Phong, turn the roughness into an exponent."""
    share = _HALF if phong else _ONE
    for i in range(n):
        metallic = g[METALLIC + i] * share
        dielectric = _DIELECTRIC - _DIELECTRIC * metallic
        g[SPR + i] = dielectric + g[CR + i] * metallic
        g[SPG + i] = dielectric + g[CG + i] * metallic
        g[SPB + i] = dielectric + g[CB + i] * metallic
        g[CR + i] -= g[CR + i] * metallic
        g[CG + i] -= g[CG + i] * metallic
        g[CB + i] -= g[CB + i] * metallic
    if phong:
        for i in range(n):
            square = g[ROUGHNESS + i] * g[ROUGHNESS + i]
            g[SHININESS + i] = _TWO / (square * square) - _TWO


@part
def mask_alpha(table: MaterialTable, row: int, u0: np.float32, v0: np.float32, u1: np.float32, v1: np.float32) -> np.float32:
    """Alpha of a material at texture coordinates, for MASK in coverage; to be multiplied by the vertex colour's alpha.

    From level 0 of the base colour texture: bilinear, or nearest if the texture asks for it. `row` must not be negative.
    """
    alpha = table.floats[row, ALPHA]
    which = table.ints[row, TEXTURE + BASE_SLOT]
    if which < 0:
        return alpha
    u, v = (u1, v1) if table.ints[row, TEXCOORD + BASE_SLOT] else (u0, v0)
    t = table.floats[row, TRANSFORMS : TRANSFORMS + 6]
    s, t = t[0] * u + t[1] * v + t[2], t[3] * u + t[4] * v + t[5]
    return alpha * alpha_at(table.textures[which], table.levels[which], table.texels, table.radiance, s, t)
