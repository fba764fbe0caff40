"""glTF 2.0 and GLB, one file a topic: document, accessors, meshopt, geometry, materials, read; write_materials, write."""
