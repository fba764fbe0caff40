"""The ranks that work together. The only importer of mpi4py.

    from luxel.cluster.comm import world
    comm = world()
    with comm.guard():
        ...

MPI is started only where a launcher (mpiexec, srun) started this process; everywhere else there is one rank, and mpi4py need not be there.
Arrays travel as they are, without pickling. An exception on one rank, inside of `guard` or uncaught, ends all ranks with its message: the
others would wait for it for ever.
"""

from __future__ import annotations

import atexit
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

from luxel.arrays import Array
from luxel.cluster.failure import Witness
from luxel.cluster.launchers import launched, started
from luxel.errors import ExtraMissingError, InputError
from luxel.interrupts import stop_on_signals
from luxel.unfinished import listen

_PATIENCE = 0.002  # seconds of waiting without sleep
_NAP = 0.005
_MOVED = 7  # tag of what `move` sends, apart from what else is under way
_MOST_BYTES = 1 << 30  # of one message: MPI counts in int32


class Comm:
    """One rank alone; what `world` gives without MPI, and what the ranks of MPI offer as well.

    Attributes:
        rank: Of this process, from 0.
        size: Number of ranks.
        neighbours: How many of them share cores with this one, itself included: those of its machine that are not bound to others.
        here: How many are on its machine, and share its memory.
    """

    rank, size, neighbours, here = 0, 1, 1, 1

    def __init__(self) -> None:
        self._sent, self._waited = [0], [0.0]

    @property
    def waited(self) -> float:
        """Seconds that this rank has waited for others, also as one of a part."""
        return self._waited[0]

    @property
    def sent(self) -> int:
        """Bytes of arrays that this rank has sent to others with `move`, `trade`, `exchange` and `pool`, also as one of a part."""
        return self._sent[0]

    def share(self, value: Any) -> Any:
        """Rank 0's value on every rank (by pickle: for what is small)."""
        return value

    def share_array(self, array: Array | None) -> Array:
        """Rank 0's array on every rank."""
        assert array is not None
        return array

    def deal(self, arrays: Sequence[Array] | None) -> Array:
        """Rank 0 has an array for each rank; each gets its own."""
        assert arrays is not None
        return arrays[0]

    def collect(self, array: Array) -> list[Array] | None:
        """Every rank's array, in order, on rank 0; None elsewhere."""
        return [array]

    def exchange(self, arrays: Sequence[Array]) -> list[Array]:
        """All to all: array k of rank r becomes array r of rank k. They share one dtype."""
        return list(arrays)

    def gather(self, value: Any) -> list[Any]:
        """Every rank's value, in order, on all ranks (by pickle: for what is small)."""
        return [value]

    def summed(self, array: Array) -> Array:
        """The sum of all ranks' arrays of integers, which have one shape, on all ranks."""
        return array

    def pool(self, array: Array) -> list[Array]:
        """Every rank's array, in order and flat, on all ranks. They share one dtype."""
        return [array.reshape(-1)]

    def move(self, out: Sequence[tuple[int, Array]], into: Sequence[tuple[int, Array]]) -> None:
        """Send arrays to ranks, and fill arrays, or views of rows that lie together, with what ranks send: both sides know shapes and order."""
        assert not out
        assert not into

    def trade(self, out: Mapping[int, Array], sources: Iterable[int]) -> dict[int, Array]:
        """Send each rank its array (n,) int32, and get one from each of `sources`, which send in the same call."""
        return dict(out)

    def part(self, color: int) -> Comm:
        """The ranks that give the same color, as ranks of their own, in their order; the same ones when it is asked for again."""
        return Comm()

    def spread(self, work: Callable[[int, Array], Array], items: Iterable[tuple[int, Array]]) -> Iterator[Array]:
        """Rank 0 has items, numbers and arrays; `work(number, array)` is done by all ranks in turn, and rank 0 gets the results in order.

        All ranks call this with the same work; the others have no items, and get no results. One item at a time is with each rank.
        """
        return (work(number, array) for number, array in items)

    def share_out(self, count: int) -> list[tuple[int, int]]:
        """(first, last + 1) of each rank, when `count` rows are shared evenly; some get none where there are more ranks than rows."""
        return [(count * rank // self.size, count * (rank + 1) // self.size) for rank in range(self.size)]

    def threads(self, wanted: int | None = None) -> int:
        """How many threads this rank should use: as many as wanted here or by LUXEL_THREADS, or its part of the cores that it may use."""
        from luxel.jit import checked_threads, own_cores

        if wanted is not None or os.environ.get("LUXEL_THREADS"):
            return checked_threads(wanted)
        return max(1, len(own_cores()) // self.neighbours)

    @contextmanager
    def guard(self) -> Iterator[None]:
        """Around work in which ranks wait for each other: an exception inside ends them all."""
        yield


class _MpiRanks(Comm):
    """The ranks of MPI."""

    def __init__(self, mpi: Any, comm: Any, witness: Witness, whole: _MpiRanks | None = None) -> None:
        super().__init__()
        self._mpi, self._comm, self._witness, self._parts = mpi, comm, witness, dict[tuple[int, ...], Comm]()
        self.rank, self.size = comm.Get_rank(), comm.Get_size()
        if whole is not None:
            self.neighbours, self.here, self._sent, self._waited = whole.neighbours, whole.here, whole._sent, whole._waited
            return
        from luxel.jit import own_cores

        machine = comm.Split_type(mpi.COMM_TYPE_SHARED)
        own = own_cores()
        cores, processes = zip(*machine.allgather((own, os.getpid())), strict=True)
        self.neighbours, self.here = sum(not own.isdisjoint(others) for others in cores), machine.Get_size()
        machine.Free()
        witness.know(f"rank {self.rank} of {self.size}", list(processes))

    def _wait(self, ready: Callable[[], bool]) -> None:
        """Until it is: asleep where it takes long, since MPI's own waiting keeps a core busy that others could use."""
        start = time.perf_counter()
        while not ready():
            if (waited := time.perf_counter() - start) > _PATIENCE:
                time.sleep(min(waited / 10, _NAP))
        self._waited[0] += time.perf_counter() - start

    def _together(self) -> None:
        """Until all ranks are here."""
        self._wait(self._comm.Ibarrier().Test)

    def share(self, value: Any) -> Any:
        self._together()
        return self._comm.bcast(value)

    def share_array(self, array: Array | None) -> Array:
        shape, dtype = self.share((array.shape, array.dtype) if array is not None else None)
        out = np.ascontiguousarray(array) if array is not None else np.empty(shape, dtype)
        for part in _pieces(out):
            self._comm.Bcast(_bytes(part))
        return out

    def deal(self, arrays: Sequence[Array] | None) -> Array:
        if arrays is not None:
            for rank in range(1, self.size):
                self._send(arrays[rank], rank)
            return arrays[0]
        return self._receive(0)

    def collect(self, array: Array) -> list[Array] | None:
        if self.rank:
            self._send(array, 0)
            return None
        return [array, *(self._receive(rank) for rank in range(1, self.size))]

    def _send(self, array: Array, rank: int) -> None:
        self._comm.send((array.shape, array.dtype), rank)
        for part in _pieces(np.ascontiguousarray(array)):
            self._comm.Send(_bytes(part), rank)

    def _receive(self, rank: int) -> Array:
        self._wait(lambda: self._comm.iprobe(rank))
        shape, dtype = self._comm.recv(source=rank)
        out = np.empty(shape, dtype)
        for part in _pieces(out):
            self._comm.Recv(_bytes(part), rank)
        return out

    def spread(self, work: Callable[[int, Array], Array], items: Iterable[tuple[int, Array]]) -> Iterator[Array]:
        if self.rank:
            while True:
                self._wait(lambda: self._comm.iprobe(0))
                number = self._comm.recv(source=0)
                if number is None:
                    return
                self._send(work(number, self._receive(0)), 0)
        left = iter(items)
        out: deque[tuple[int, Any]] = deque()  # who has what, in order; rank 0 does its own while the others work

        def give(rank: int) -> None:
            item = next(left, None)
            if item is not None and rank:
                self._comm.send(item[0], rank)
                self._send(item[1], rank)
            if item is not None:
                out.append((rank, None if rank else item))

        for rank in range(self.size):
            give(rank)
        while out:
            rank, own = out.popleft()
            result = work(*own) if rank == 0 else self._receive(rank)
            give(rank)
            yield result
        for rank in range(1, self.size):
            self._comm.send(None, rank)

    def gather(self, value: Any) -> list[Any]:
        self._together()
        return self._comm.allgather(value)

    def summed(self, array: Array) -> Array:
        self._together()
        out = np.empty_like(array)
        self._comm.Allreduce(np.ascontiguousarray(array), out)
        return out

    def pool(self, array: Array) -> list[Array]:
        own, sizes = _bytes(np.ascontiguousarray(array)), np.empty(self.size, np.int64)
        self._wait(self._comm.Iallgather(np.array([own.size]), sizes).Test)
        whole = np.empty(int(sizes.sum()), np.uint8)
        parts = np.split(whole, np.cumsum(sizes)[:-1])
        if len(whole) <= _MOST_BYTES:
            self._wait(self._comm.Iallgatherv(own, [whole, sizes]).Test)
            self._sent[0] += own.size * (self.size - 1)
        else:
            self._to_all([own] * self.size, parts)
        return [part.view(array.dtype) for part in parts]

    def move(self, out: Sequence[tuple[int, Array]], into: Sequence[tuple[int, Array]]) -> None:
        waiting = [self._comm.Irecv(_bytes(part), rank, _MOVED) for rank, array in into for part in _pieces(array)]
        whole = [(rank, part) for rank, array in out for part in _pieces(np.ascontiguousarray(array))]
        waiting += [self._comm.Isend(_bytes(part), rank, _MOVED) for rank, part in whole]
        self._sent[0] += sum(part.nbytes for _, part in whole)
        self._wait(lambda: self._mpi.Request.Testall(waiting))

    def trade(self, out: Mapping[int, Array], sources: Iterable[int]) -> dict[int, Array]:
        lengths = {rank: np.zeros(1, np.int64) for rank in sources}
        self.move([(rank, np.array([len(array)])) for rank, array in out.items()], list(lengths.items()))
        got = {rank: np.empty(int(length[0]), np.int32) for rank, length in lengths.items()}
        self.move(list(out.items()), list(got.items()))
        return got

    def part(self, color: int) -> Comm:
        colors = tuple(self.gather(color))
        if colors not in self._parts:  # on all ranks, or on none; MPI has only so many, and those who hold one never know when all are done with it
            self._parts[colors] = _MpiRanks(self._mpi, self._comm.Split(color, self.rank), self._witness, self)
        return self._parts[colors]

    def exchange(self, arrays: Sequence[Array]) -> list[Array]:
        self._together()
        shapes = self._comm.alltoall([array.shape for array in arrays])
        dtype = arrays[0].dtype
        got = [np.empty(shape, dtype) for shape in shapes]
        self._to_all(arrays, got)
        return got

    def _to_all(self, arrays: Sequence[Array], got: Sequence[Array]) -> None:
        """Send each rank its array, and fill those that come from each; what is empty is not sent."""
        got[self.rank][...] = arrays[self.rank]
        others = [rank for rank in range(self.size) if rank != self.rank]
        self.move([(rank, arrays[rank]) for rank in others], [(rank, got[rank]) for rank in others])

    @contextmanager
    def guard(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:
            if self.size > 1:
                self.end(error)
            raise

    def end(self, error: BaseException) -> None:
        """Say what went wrong, and stop every rank."""
        world = self._mpi.COMM_WORLD

        def stop(code: int) -> None:
            world.Abort(code)
            os._exit(code)  # it may come back, and all is said

        self._witness.end(error, world.Get_rank() == 0, stop)


def _bytes(array: Array) -> Array:
    return array.reshape(-1).view(np.uint8)


def _pieces(array: Array) -> list[Array]:
    """`array` in pieces that MPI can count the bytes of; none, if it is empty."""
    flat = array.reshape(-1)
    assert array.flags.c_contiguous
    step = max(1, _MOST_BYTES // array.itemsize)
    return [flat[start : start + step] for start in range(0, len(flat), step)]


_SLURM = ("start with `srun --mpi=pmi2` or `--mpi=pmix` (`srun --mpi=list` tells what there is), or with the `mpiexec` that came with this MPI, or "
          "build mpi4py against the site's MPI (`pip install --no-binary mpi4py mpi4py`). For processes that have nothing to do with each other, "
          "`unset SLURM_STEP_NUM_TASKS`")  # fmt: skip
_LAUNCHER = "the launcher is another MPI's; start with the `mpiexec` that belongs to the MPI which mpi4py is built against"


@cache
def world() -> Comm:
    """The ranks that this process is one of.

    Raises:
        ExtraMissingError: A launcher started several processes, and mpi4py is not installed: each would do all of the work.
        InputError: A launcher started several, and MPI knows of one only: each would do all of the work.
    """
    if not launched():
        return Comm()
    witness = Witness()
    os.environ.setdefault("MPIR_CVAR_SUPPRESS_ABORT_MESSAGE", "1")  # it would come after ours, and say nothing
    try:
        from mpi4py import MPI
    except ImportError as error:
        raise ExtraMissingError("mpi4py", "mpi", "running under an MPI launcher") from error
    ranks = _MpiRanks(MPI, MPI.COMM_WORLD, witness)
    atexit.register(witness.rest)
    if ranks.size == 1 and started() > 1:
        what, remedy = " ".join(MPI.Get_library_version()[:60].split()[:3]), _SLURM if "SLURM_STEP_NUM_TASKS" in os.environ else _LAUNCHER
        raise InputError(f"this is one of {started()} processes, and {what} takes it for the only one, so each would do all of the work: {remedy}")
    if ranks.size > 1:
        sys.excepthook = lambda kind, error, trace: ranks.end(error)
        stop_on_signals()
        listen(witness.unfinished)
    return ranks
