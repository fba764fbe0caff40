"""Convolution by overlap-save: tiles of a picture are transformed, multiplied by the kernel's spectrum, and transformed back.

The tiling of "Anti-aliasing of triangle rasterisation, and its parallelisation" (2021): a tile reaches beyond what is kept of it by the
kernel's extent, and beyond the picture it holds what the border says, so there are no seams. What differs: the kernel may have any
size below the tile's, what is kept is n + 1 - kw columns (the paper extends the tile by a kernel on both sides where one suffices), and two
real planes ride in one complex transform whichever they are: channels of one tile, or of two.
"""

from __future__ import annotations

import numpy as np

from luxel import jit
from luxel.arrays import Array
from luxel.filter.sums import aligned, all_finite, whole_blocks
from luxel.filter.tile_fft import backward, elements, forward, lanes, twiddles
from luxel.filter.vectors import SUMS, multiply_line, pick_line, put_line


@jit.part
def _gather(part, source, width, channels, channel, y_map, x_map, top, left, size, row, value):
    """A plane of the tile whose corner has the places (top, left) of the maps."""
    strip = (size + 1) * row
    for y in range(size):
        place = y_map[top + y] if top + y < len(y_map) else -1
        base = place * width * channels + channel
        for x in range(0, size, row):
            at, column = (x // row) * strip + y * row, left + x
            if place < 0:
                for i in range(row):
                    part[at + i] = value
                continue
            if column + row <= len(x_map) and x_map[column] >= 0 and x_map[column + row - 1] - x_map[column] == row - 1:
                start = base + x_map[column] * channels
                if start + row * channels <= len(source):
                    pick_line(part, at, source, start, channels)
                    continue
            for i in range(row):
                pixel = x_map[column + i] if column + i < len(x_map) else -1
                part[at + i] = value if pixel < 0 else source[base + pixel * channels]


@jit.part
def _scatter(part, out, height, width, channels, channel, y, x, tall, wide, size, row):
    """What is kept of a plane: its last rows and columns, to the pixels from (y, x) on."""
    strip = (size + 1) * row
    skip_y, skip_x = size - tall, size - wide
    last = min(size, skip_x + width - x)
    for i in range(min(tall, height - y)):
        start = ((y + i) * width + x) * channels + channel - skip_x * channels
        for first in range(skip_x // row * row, last, row):
            at = (first // row) * strip + (skip_y + i) * row
            if skip_x <= first and first + row <= last:
                put_line(out, start + first * channels, channels, part, at)
            else:
                for j in range(max(first, skip_x), min(first + row, last)):
                    out[start + j * channels] = part[at + j - first]


@jit.parallel_kernel
def _overlap_save(queue, workers, source, out, height, width, channels, y_map, x_map, value, tall, wide, across, planes, size, row, factors,
                  kernel_re, kernel_im, scratch, all_offsets, zeros, odd):  # fmt: skip
    me = jit.take(workers)
    own, spare_owner = scratch[me], np.zeros(SUMS * row, scratch.dtype)
    spare, all_offsets, zeros, odd = jit.borrow(spare_owner), jit.borrow(all_offsets), jit.borrow(zeros), jit.borrow(odd)
    re, im = jit.borrow(own[0]), jit.borrow(own[1])
    source, out, y_map, x_map = jit.borrow(source), jit.borrow(out), jit.borrow(y_map), jit.borrow(x_map)
    factors, kernel_re, kernel_im = jit.borrow(factors), jit.borrow(kernel_re), jit.borrow(kernel_im)
    plane = 2 * jit.take(queue)
    while plane < planes:
        for k in range(min(2, planes - plane)):
            tile = (plane + k) // channels
            top, left = tile // across * tall, tile % across * wide
            _gather(im if k else re, source, width, channels, (plane + k) % channels, y_map, x_map, top, left, size, row, value)
        if plane + 1 == planes:
            im[:] = 0  # the odd one out has nothing beside it
        forward(re, im, size, row, factors)
        for at in range(0, len(re), row):
            multiply_line(re, im, at, kernel_re, kernel_im, at)
        backward(re, im, size, row, factors)
        if not (all_finite(re, 0, len(re), all_offsets, zeros, spare) and all_finite(im, 0, len(im), all_offsets, zeros, spare)):
            odd[0] = 1
        for k in range(min(2, planes - plane)):
            tile = (plane + k) // channels
            top, left = tile // across * tall, tile % across * wide
            _scatter(im if k else re, out, height, width, channels, (plane + k) % channels, top, left, tall, wide, size, row)
        plane = 2 * jit.take(queue)
    spare_owner[0] = 0  # it must live until here: borrowing does not keep it


@jit.kernel
def _spectrum(re, im, size, row, factors):
    forward(jit.borrow(re), jit.borrow(im), size, row, jit.borrow(factors))


def _kernel_spectrum(kernel: Array, size: int, dtype: object) -> tuple[Array, Array]:
    """The kernel's transform in the tiles' order, over size^2, so that the backward transform needs no scaling."""
    row = lanes(dtype)
    square = np.zeros((size, size))
    square[: kernel.shape[0], : kernel.shape[1]] = kernel / size**2
    re, im = aligned((elements(size, dtype),), dtype), np.zeros(elements(size, dtype), dtype)  # type: ignore[call-overload]
    strips = re.reshape(size // row, size + 1, row)
    strips[:, :size] = square.reshape(size, size // row, row).swapaxes(0, 1)
    strips[:, size] = 0
    _spectrum(re, im, size, row, twiddles(size, np.dtype(dtype)))  # type: ignore[call-overload]
    return re, im


def overlap_save(image: Array, out: Array, y_map: Array, x_map: Array, kernel: Array, value: float, size: int, threads: int) -> bool:
    """Convolve: out[y, x] = sum of kernel[i, j] extended[y + kh - 1 - i, x + kw - 1 - j].

    Args:
        image, out: (h, w, c), of one dtype, float32 or float64.
        y_map, x_map: From `border_map`: h + kh - 1 and w + kw - 1 places.
        kernel: (kh, kw), both at most `size`.
        value: What stands where the maps say -1.
        size: Of the tiles, one of `tile_fft.SIZES`.
        threads: At most so many.

    Returns:
        Whether all that came out is finite.
    """
    height, width, channels = image.shape
    dtype = image.dtype
    tall, wide = size + 1 - kernel.shape[0], size + 1 - kernel.shape[1]
    down, across = -(-height // tall), -(-width // wide)
    planes = down * across * channels
    threads = max(1, min(threads, -(-planes // 2)))
    scratch = aligned((threads, 2, elements(size, dtype)), dtype)
    odd = np.zeros(1, np.int64)
    scratch[:] = 0  # the strips' spare lines are multiplied and looked at as well
    jit.run(_overlap_save, threads, np.zeros(1, np.int64), image.reshape(-1), out.reshape(-1), height, width, channels, y_map, x_map,
            dtype.type(value), tall, wide, across, planes, size, lanes(dtype), twiddles(size, dtype), *_kernel_spectrum(kernel, size, dtype),
            scratch, *whole_blocks(elements(size, dtype), dtype), odd)  # fmt: skip
    return not odd[0]
