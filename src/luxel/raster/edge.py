"""Edge functions (Pineda 1988) of snapped triangles, exact in int64, with the top-left rule built in."""

from __future__ import annotations

from luxel import jit


@jit.inlined
def area2(x0, y0, x1, y1, x2, y2):
    """Twice the signed area in fixed point, exact: positive if the front (counter-clockwise before y turned down) is seen."""
    return (x2 - x0) * (y1 - y0) - (x1 - x0) * (y2 - y0)


@jit.inlined
def edge_bias(a, b):
    """0 if samples on the edge with e = a x + b y + c belong to the triangle (left edge, or top edge), else -1."""
    return 0 if a > 0 or (a == 0 and b > 0) else -1


@jit.inlined
def edges(x0, y0, x1, y1, x2, y2, ox, oy):
    """a0 b0 c0 a1 b1 c1 a2 b2 c2 of the edge functions e = a x + b y + c, of positions from (ox, oy); e >= 0 in all three is inside.

    Edge i is opposite corner i. A triangle seen from behind is turned first.
    """
    if area2(x0, y0, x1, y1, x2, y2) < 0:
        x1, y1, x2, y2 = x2, y2, x1, y1
    a0, b0 = y2 - y1, x1 - x2
    a1, b1 = y0 - y2, x2 - x0
    a2, b2 = y1 - y0, x0 - x1
    return (
        a0, b0, a0 * (ox - x1) + b0 * (oy - y1) + edge_bias(a0, b0),
        a1, b1, a1 * (ox - x2) + b1 * (oy - y2) + edge_bias(a1, b1),
        a2, b2, a2 * (ox - x0) + b2 * (oy - y0) + edge_bias(a2, b2),
    )  # fmt: skip
