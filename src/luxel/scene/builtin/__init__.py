"""Scenes and shapes made by code."""
