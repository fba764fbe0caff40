"""Parallel shading of a triangle."""
