"""Run by the tests under mpiexec: each function is called on every rank, and checks itself on rank 0 against one rank."""

import sys
import time

import numpy as np

from luxel.cluster import comm as comm_of
from luxel.cluster import fft
from luxel.cluster.comm import Comm, world
from luxel.errors import InputError
from luxel.filter.borders import BORDERS
from luxel.filter.filters import apply, make_filter
from luxel.filter.streamed import Job, filtered_bands

SHAPES = [(1, 1), (2, 3), (3, 1), (7, 5), (16, 16), (30, 31), (64, 48)]


def messages(comm: Comm) -> None:
    assert comm.share({"a": 1} if comm.rank == 0 else None) == {"a": 1}
    for array in (np.arange(12.0).reshape(3, 4).T, np.zeros((0, 3), np.uint8)):
        assert np.array_equal(comm.share_array(array if comm.rank == 0 else None), array)
    own = comm.deal([np.full((k, 2), k) for k in range(comm.size)] if comm.rank == 0 else None)
    assert np.array_equal(own, np.full((comm.rank, 2), comm.rank))
    parts = comm.collect(own.astype(np.float32))
    assert (parts is None) == (comm.rank > 0)
    if parts is not None:
        assert [len(part) for part in parts] == list(range(comm.size))
    got = comm.exchange([np.full((comm.rank, k), 10 * comm.rank + k) for k in range(comm.size)])
    for k, array in enumerate(got):
        assert np.array_equal(array, np.full((k, comm.rank), 10 * k + comm.rank))
    assert comm.neighbours == comm.size  # all on this machine
    assert comm.threads(3) == 3
    assert comm.threads() == 1  # LUXEL_THREADS
    for count in (0, 1, comm.size - 1, 100):
        shares = comm.share_out(count)
        assert [first for first, _ in shares[1:]] == [last for _, last in shares[:-1]]
        assert (shares[0][0], shares[-1][1]) == (0, count)


def pieces(comm: Comm) -> None:
    """The same messages, none of which may have more than a few bytes; and parts that are asked for again."""
    comm_of._MOST_BYTES, most = 40, comm_of._MOST_BYTES
    messages(comm)
    for lengths in (range(comm.size), [30] * comm.size):
        own = np.arange(list(lengths)[comm.rank], dtype=np.float64) + 100 * comm.rank
        for k, array in enumerate(comm.pool(own)):
            assert np.array_equal(array, np.arange(list(lengths)[k]) + 100.0 * k)
    comm_of._MOST_BYTES = most
    odd = comm.part(comm.rank % 2)
    assert (odd.rank, odd.size) == (comm.rank // 2, (comm.size + 1 - comm.rank % 2) // 2)
    if comm.size > 1:
        assert comm.part(comm.rank % 2) is odd
        assert all(comm.part(comm.rank % 2 + 2 * k).size == odd.size for k in range(3))


def transforms(comm: Comm) -> None:
    for shape in SHAPES:
        for kind, near in ((np.float32, 2e-6), (np.float64, 1e-14), (np.complex128, 1e-14)):
            rng = np.random.default_rng(shape[0])
            image = (rng.random(shape) + (1j * rng.random(shape) if kind is np.complex128 else 0)).astype(kind)
            first, last = comm.share_out(shape[0])[comm.rank]
            spectrum = fft.fft2(image[first:last], shape, comm, 1)
            left, right = comm.share_out(shape[1])[comm.rank]
            assert spectrum.shape == (shape[0], right - left)
            assert np.abs(spectrum - np.fft.fft2(image)[:, left:right]).max(initial=0) <= near * image.size
            assert (spectrum.dtype == np.complex64) == (kind is np.float32)
            back = fft.ifft2(spectrum, shape, comm, 1)
            assert np.abs(back - image[first:last]).max(initial=0) <= 10 * near
            whole = fft.dft2(image if comm.rank == 0 else None, comm)
            if whole is not None:
                assert np.abs(whole - np.fft.fft2(image)).max() <= near * image.size * 4
            inverse = fft.dft2(whole, comm, threads=2, inverse=True)
            if inverse is not None:
                assert np.abs(inverse - image).max() <= 100 * near


def filters(comm: Comm) -> None:
    kernel = np.random.default_rng(1).random((5, 9))
    for options in ({"gaussian": 1.5}, {"ideal": 0.2}, {"butterworth": (0.2, 3)}, {"kernel": kernel / kernel.sum()}):
        chosen = make_filter(**options)
        for shape in ((1, 1, 1), (3, 40, 4), (45, 33, 3)):
            image = np.random.default_rng(2).random(shape)
            for border in BORDERS:
                out = fft.lowpass(image if comm.rank == 0 else None, chosen if comm.rank == 0 else None, comm, border, 0.3, threads=1)
                assert (out is None) == (comm.rank > 0)
                if out is not None:
                    assert np.abs(out - apply(image, chosen, border, 0.3, "auto", 1)).max() < 1e-13, (options, shape, border)


def bands(comm: Comm) -> None:
    """Pictures on disk: every rank filters bands of them, with one rank's result, and says which row of the picture is no number."""
    asked: list[int] = []
    for count in (0, 1, comm.size, 3 * comm.size + 1):
        items = ((k, np.full((k, 2), k, np.uint16)) for k in range(count)) if comm.rank == 0 else ()
        out = list(comm.spread(lambda number, array: asked.append(number) or array.astype(np.float32) + comm.rank - number, items))
        assert [len(array) for array in out] == (list(range(count)) if comm.rank == 0 else [])
        assert comm.size == 1 or len(asked) <= 4 * comm.size  # all of them work
        assert all((array == k % comm.size).all() for k, array in enumerate(out))
    kernel = np.random.default_rng(1).random((5, 9))
    for options in ({"gaussian": 1.5}, {"ideal": 0.2}, {"butterworth": (0.2, 3)}, {"kernel": kernel / kernel.sum()}):
        for border in BORDERS:
            for dtype in (np.uint8, np.float32):
                image = np.random.default_rng(2).random((150, 40, 3)).astype(np.float32)
                image = image if dtype is np.float32 else (255 * image).astype(np.uint8)
                job = Job(image.shape, image.dtype, make_filter(**options), border, 0.3, memory=1 << 13, bands=2 * comm.size)
                own = list(filtered_bands(image if comm.rank == 0 else None, job, lambda done: None, comm.spread))
                if comm.rank == 0:
                    assert len(own) > 1
                    one = np.concatenate(list(filtered_bands(image, job, lambda done: None)))
                    assert np.array_equal(np.concatenate(own), one), (options, border, dtype)


def odd(comm: Comm) -> None:
    """A number that is none, in the middle of a picture."""
    image = np.zeros((200, 30, 1))
    image[150, 7] = np.nan
    fft.lowpass(image if comm.rank == 0 else None, make_filter(gaussian=2.0) if comm.rank == 0 else None, comm)


def fails(comm: Comm) -> None:
    """The last rank fails; the others wait for it."""
    if comm.rank == comm.size - 1:
        raise InputError("the last rank has had enough of \udcff")  # a name that no text can hold
    comm.share(1)
    comm.collect(np.zeros(3))
    comm.deal([np.zeros(1)] * comm.size if comm.rank == 0 else None)
    while True:
        comm.exchange([np.zeros(1)] * comm.size)
        time.sleep(0.01)


if __name__ == "__main__":
    comm = world()
    name = sys.argv[1]
    if name == "uncaught":
        fails(comm)
    else:
        with comm.guard():
            for each in name.split(","):
                globals()[each](comm)
        if comm.rank == 0:
            print(f"{name}: {comm.size} ranks agree")
