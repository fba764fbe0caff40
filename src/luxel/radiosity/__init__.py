"""Radiosity: diffuse light baked into lightmaps, one file a stage."""
