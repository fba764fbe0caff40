"""Surface: what a batch of fragments is made of. Evaluates materials, in runs of fragments of the same one."""

from __future__ import annotations

import math

import numpy as np

from luxel.arrays import Array
from luxel.jit import device, inlined
from luxel.raster.channels import (
    CA,
    CB,
    CG,
    CR,
    EMB,
    EMG,
    EMR,
    FRONT,
    FX,
    FY,
    FZ,
    METALLIC,
    MODEL,
    NX,
    NY,
    NZ,
    PITCH,
    ROUGHNESS,
    SHININESS,
    SPB,
    SPG,
    SPR,
)
from luxel.raster.materials import (
    ALPHA,
    BLUE,
    CODE,
    EMISSIVE,
    EMIT,
    EXPONENT,
    GREEN,
    METAL,
    MODEL_MASK,
    MODEL_PBR,
    MODEL_PHONG,
    NEEDS_COLOR,
    NEEDS_FACE,
    RED,
    ROUGH,
    SPECULAR,
    MaterialTable,
)

_ONE = np.float32(1.0)
_TINY = np.float32(1e-30)


@device
def surface(g: Array, material: Array, n: int, table: MaterialTable) -> None:
    """Evaluate the materials of the first `n` fragments of a batch.

    Args:
        g: The batch; see `channels` for what is read and written.
        material: (>= n,) int32, row of each fragment's material in the table, or -1 for the default material.
        n: Fragments.
        table: From `pack_materials`.
    """
    start = 0
    while start < n:
        end = run_end(material, start, n)
        row = material[start] if material[start] >= 0 else len(table.flags) - 1
        evaluate(g[start:], end - start, row, table)
        start = end


@inlined
def run_end(keys: Array, start: int, n: int) -> int:
    """End of the run of equal keys that begins at `start`; quick when it is all that is left."""
    key = keys[start]
    differ = 0
    for i in range(start, n):
        differ += np.int32(keys[i] != key)
    if differ == 0:
        return n
    end = start + 1
    while keys[end] == key:
        end += 1
    return end


@inlined
def evaluate(g: Array, n: int, row: int, table: MaterialTable) -> None:
    """Evaluate one material for the fragments start .. end."""
    flags, code = table.flags[row], table.ints[row, CODE]
    model = code & MODEL_MASK
    fill(g, MODEL, n, np.float32(code))
    tint(g, n, table.floats[row, RED], table.floats[row, GREEN], table.floats[row, BLUE], table.floats[row, ALPHA],
         flags & NEEDS_COLOR != 0)  # fmt: skip
    if model == 0:
        return
    if flags & NEEDS_FACE:
        for i in range(n):
            g[NX + i] = g[FX + i]
            g[NY + i] = g[FY + i]
            g[NZ + i] = g[FZ + i]
    normalise(g, n)
    if code & EMISSIVE:
        for k in range(3):
            fill(g, EMR + k * PITCH, n, table.floats[row, EMIT + k])
    if model == MODEL_PHONG:
        for k in range(4):
            fill(g, SPR + k * PITCH, n, table.floats[row, SPECULAR + k])
    if model == MODEL_PBR:
        fill(g, METALLIC, n, table.floats[row, METAL])
        fill(g, ROUGHNESS, n, table.floats[row, ROUGH])


@device
def fill(g: Array, channel: int, n: int, value: np.float32) -> None:
    """Set one channel of the fragments start .. end."""
    for i in range(n):
        g[channel + i] = value


@inlined
def tint(g: Array, n: int, red: np.float32, green: np.float32, blue: np.float32, alpha: np.float32, colored: bool) -> None:
    """Base colour of the fragments start .. end: the factor, times the vertex colour if there is one."""
    if colored:
        for i in range(n):
            g[CR + i] *= red
            g[CG + i] *= green
            g[CB + i] *= blue
            g[CA + i] *= alpha
    else:
        for i in range(n):
            g[CR + i] = red
            g[CG + i] = green
            g[CB + i] = blue
            g[CA + i] = alpha


@inlined
def normalise(g: Array, n: int) -> None:
    """Make the normal unit length and turn it on back faces; zero stays zero."""
    for i in range(n):
        x, y, z = g[NX + i], g[NY + i], g[NZ + i]
        scale = g[FRONT + i] / np.float32(math.sqrt(max(x * x + y * y + z * z, _TINY)))
        g[NX + i] = x * scale
        g[NY + i] = y * scale
        g[NZ + i] = z * scale
