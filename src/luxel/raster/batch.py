"""How many fragments a batch has: many here; one on a GPU, where this module's place is taken by another (`luxel.cuda.again`)."""

FRAGMENTS = 512
PITCH = FRAGMENTS + 16
"""Elements from row to row: a little more than FRAGMENTS, because rows that lie a power of two apart would fight for the same lines of the cache."""
