"""The grids of `luxel.cuda.light_kernels` as loops, over the same threads, compiled for the processor."""

from loops import again, loops

from luxel.cuda import light_kernels

globals().update(loops(light_kernels.__name__, *light_kernels.bodies(again)))
