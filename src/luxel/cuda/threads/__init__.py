"""What each thread of a grid does: a vertex, a triangle, a pixel. No Numba and no CUDA here: `luxel.cuda.again` compiles these for the GPU.

Everything is drawn from several views at once: arrays have the view as their first axis, and a thread is given its number there.
"""
