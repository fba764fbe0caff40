"""Where the quantities of a batch of fragments lie: a structure of arrays in one flat float32 buffer.

A batch is `g`: float32 (BATCH,). Channel X of fragment i is `g[X + i]`: the names below are the offsets of the rows, constants that
the compiler sees. So it knows that rows never overlap and vectorises loops over fragments without run-time checks.

The driver fills what the features of the materials and lights ask for (`materials.NEEDS_*`, `LightTable.punctual`); what is not
asked for may hold anything. A batch of vertices works as well (Gouraud). Units: metres, radiance W/(m2 sr), irradiance W/m2, all
colours linear.
"""

from luxel.raster.batch import FRAGMENTS as FRAGMENTS
from luxel.raster.batch import PITCH

# In, with NEEDS_NORMAL: interpolated normal, in world space, of any length. Out of `surface`: unit shading normal.
NX, NY, NZ = (PITCH * row for row in range(3))
# In, unless the material is unlit: 1 seen from the front, -1 from the back (turns the normal).
FRONT = PITCH * 3
# In, with NEEDS_COLOR: vertex colour, linear RGBA; for Gouraud the lit colour. Out of `surface`: diffuse (unlit: shown) colour and alpha.
CR, CG, CB, CA = (PITCH * row for row in range(4, 8))
# Out of `light`, in place of them: outgoing radiance, not premultiplied, and alpha.
OR, OG, OB, OA = CR, CG, CB, CA
# Out of `surface`: a code of `materials`: MODEL_UNLIT, ... plus EMISSIVE, OCCLUDED, LIGHTMAPPED.
MODEL = PITCH * 8
# Scratch of `light`: diffuse irradiance; specular radiance; unit vector to the light, and its irradiance per unit of its colour.
ER, EG, EB = (PITCH * row for row in range(9, 12))
SR, SG, SB = (PITCH * row for row in range(12, 15))
LX, LY, LZ, LE = (PITCH * row for row in range(15, 19))
# Scratch of `surface`: a texture's RGBA.
TEXR, TEXG, TEXB, TEXA = LX, LY, LZ, LE
# In, with NEEDS_VIEW: unit vector to the eye. In, with `LightTable.punctual`: world position.
VX, VY, VZ = (PITCH * row for row in range(19, 22))
PX, PY, PZ = (PITCH * row for row in range(22, 25))
# Out of `surface`, phong and pbr: specular colour (Ks; F0), and the exponent (phong) or the roughness (pbr).
SPR, SPG, SPB, SHININESS = (PITCH * row for row in range(25, 29))
ROUGHNESS = SHININESS
METALLIC = PITCH * 29
# Out of `surface`, if MODEL says so: factor of indirect light, emitted radiance, irradiance E from the lightmap.
OCCLUSION = PITCH * 30
EMR, EMG, EMB = (PITCH * row for row in range(31, 34))
LMR, LMG, LMB = (PITCH * row for row in range(34, 37))
# In, with NEEDS_UV0, NEEDS_UV1: texture coordinates and their derivatives per pixel along x and y.
U0, V0, U0X, V0X, U0Y, V0Y = (PITCH * row for row in range(37, 43))
U1, V1, U1X, V1X, U1Y, V1Y = (PITCH * row for row in range(43, 49))
# In, with NEEDS_TANGENT: tangent with handedness (all 0 if the mesh has none); derivatives of the position per pixel, to build a frame.
TX, TY, TZ, TW = (PITCH * row for row in range(49, 53))
DXX, DXY, DXZ = (PITCH * row for row in range(53, 56))
DYX, DYY, DYZ = (PITCH * row for row in range(56, 59))
# In, with NEEDS_FACE: geometric normal, in world space, of any length, turned to the front by the winding.
FX, FY, FZ = (PITCH * row for row in range(59, 62))

# Scratch of `texture`: place and longer axis of the footprint in texture coordinates; lower level, way to the next, probes; the place of
# a probe brought to 0 .. 1 and its weight; the four texels around it, as bits, and where between them.
PLACE_S, PLACE_T, AXIS_S, AXIS_T, LEVEL, BLEND, PROBES = (PITCH * row for row in range(62, 69))
PROBE_S, PROBE_T, WEIGHT, TEXEL0, TEXEL1, TEXEL2, TEXEL3, ALONG, DOWN = (PITCH * row for row in range(69, 78))

CHANNELS = 78
BATCH = CHANNELS * PITCH
