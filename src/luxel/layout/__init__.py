"""Mesh layout: the order of triangles and vertices that a GPU's caches like, and the measures of it."""

from luxel.layout.cache import acmr, atvr, misses
from luxel.layout.reorder import ORDERS, Ordered, order

__all__ = ["ORDERS", "Ordered", "acmr", "atvr", "misses", "order"]
