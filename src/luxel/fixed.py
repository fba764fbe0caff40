"""Fixed-point positions on the screen, which the rasteriser and the model of the hardware share: 8 fraction bits; y points down; pixel (0, 0) is
the top left one."""

from __future__ import annotations

SUBPIXEL_LOG2 = 8
SUBPIXEL = 1 << SUBPIXEL_LOG2

MAX_SIZE = 1 << 15
"""Largest picture side drawn in one piece, pixels; larger pictures are drawn in windows."""

GUARD_LOW = -(MAX_SIZE << SUBPIXEL_LOG2)
GUARD_HIGH = 2 * MAX_SIZE << SUBPIXEL_LOG2
"""Fixed-point coordinates stay between these, or the triangle is clipped. So an edge function is below 2^52: exact in int64 and in float64."""
