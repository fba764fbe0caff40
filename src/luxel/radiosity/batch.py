"""How many rays a packet has, and elements the scratch of a row: many here; one on a GPU, where this module's place is taken by another
(`luxel.cuda.again`)."""

RAYS = 16
ELEMENTS = 128
