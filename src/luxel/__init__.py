"""luxel: a triangle scene from file to lit picture, without a display, a driver or a GPU."""

__version__ = "0.1.0"
