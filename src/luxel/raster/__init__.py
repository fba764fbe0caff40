"""The one rasteriser: project, bin, cover, shade, resolve."""
