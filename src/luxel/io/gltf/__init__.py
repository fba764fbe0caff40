"""glTF 2.0 and GLB: one file a topic (document, accessors, meshopt, geometry, materials, nodes, write)."""

from luxel.io.gltf.read import load

__all__ = ["load"]
