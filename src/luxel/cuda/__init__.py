"""The rasteriser on a GPU: grids of threads only; what each thread does comes from `luxel.raster` (see docs/cuda.md)."""
