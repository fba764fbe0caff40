"""What threads need of the machine beyond arithmetic: operations on shared memory that no other thread can come between.

These are for one thread after the other; `luxel.cuda.primitives` has the GPU's in their place.
"""

from __future__ import annotations

from luxel.jit import part


@part
def keep_least(values, i, value):
    """values[i] = min(values[i], value)."""
    values[i] = min(values[i], value)


@part
def keep_most(values, i, value):
    """values[i] = max(values[i], value)."""
    values[i] = max(values[i], value)


@part
def add(values, i, value):
    """values[i] += value; returns what was there before."""
    before = values[i]
    values[i] = before + value
    return before
