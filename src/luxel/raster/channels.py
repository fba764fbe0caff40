"""Where the quantities of a batch of fragments lie: a structure of arrays in one flat float32 buffer.

A batch is `g`: float32 (BATCH,). Channel X of fragment i is `g[X + i]`: the names below are the offsets of the rows, constants that
the compiler sees. So it knows that rows never overlap and vectorises loops over fragments without run-time checks. The pitch of the
rows is a little more than FRAGMENTS, because rows that lie a power of two apart would fight for the same lines of the cache.

The driver fills what the features of the materials and lights ask for (see `materials.NEEDS_*`); what is not asked for may hold
anything. Units: metres, radiance W/(m2 sr), irradiance W/m2, all colours linear.
"""

FRAGMENTS = 256
PITCH = FRAGMENTS + 16

# In: interpolated normal, in world space, of any length; out of `surface`: unit shading normal.
NX, NY, NZ = (PITCH * row for row in range(3))
# In: vertex colour, linear RGBA, with NEEDS_COLOR (for Gouraud: the lit colour); out of `surface`: base colour and alpha.
CR, CG, CB, CA = (PITCH * row for row in range(3, 7))
# Out of `light`: outgoing radiance, not premultiplied, and alpha.
OR, OG, OB, OA = (PITCH * row for row in range(7, 11))
# Out of `surface`: a code of `materials`: MODEL_UNLIT, ... plus LIGHTMAPPED.
MODEL = PITCH * 11
# Scratch of `light`: sum of diffuse irradiance; unit vector to the light and its irradiance on the surface per unit of colour.
ER, EG, EB = (PITCH * row for row in range(12, 15))
LX, LY, LZ, LE = (PITCH * row for row in range(15, 19))
# In: world position; unit vector to the eye; 1 seen from the front, -1 from the back (turns the normal).
PX, PY, PZ = (PITCH * row for row in range(19, 22))
VX, VY, VZ = (PITCH * row for row in range(22, 25))
FRONT = PITCH * 25
# Out of `surface`, for phong: specular factor and exponent; for pbr: metallic, roughness.
SPR, SPG, SPB, SHININESS = (PITCH * row for row in range(26, 30))
METALLIC, ROUGHNESS = (PITCH * row for row in range(30, 32))
# Out of `surface`: factor of indirect light, emitted radiance, irradiance E from the lightmap.
OCCLUSION = PITCH * 32
EMR, EMG, EMB = (PITCH * row for row in range(33, 36))
LMR, LMG, LMB = (PITCH * row for row in range(36, 39))
# In: texture coordinates and their derivatives per pixel along x and y.
U0, V0, U0X, V0X, U0Y, V0Y = (PITCH * row for row in range(39, 45))
U1, V1, U1X, V1X, U1Y, V1Y = (PITCH * row for row in range(45, 51))
# In: tangent with handedness (0 if the mesh has none); derivatives of the position per pixel, to build a frame without one.
TX, TY, TZ, TW = (PITCH * row for row in range(51, 55))
DXX, DXY, DXZ = (PITCH * row for row in range(55, 58))
DYX, DYY, DYZ = (PITCH * row for row in range(58, 61))
# In: geometric normal, in world space, of any length, turned to the front by the winding.
FX, FY, FZ = (PITCH * row for row in range(61, 64))

CHANNELS = 64
BATCH = CHANNELS * PITCH
