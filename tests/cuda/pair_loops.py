"""The grids of `luxel.cuda.pair_kernels` as loops, over the same threads, compiled for the processor."""

from loops import again, loops

from luxel import jit
from luxel.cuda import pair_kernels
from luxel.radiosity.pairs import make_scratch

globals().update(loops(pair_kernels.__name__, *pair_kernels.bodies(again)))
_pairs = again("luxel.cuda.threads.pairs")
_exchange_plain, _exchange_hidden, _Scratch = _pairs.exchange_plain, _pairs.exchange_hidden, _pairs.Scratch


@jit.kernel
def exchange_plain(n, m, given):
    s = make_scratch()
    scratch = _Scratch(s.a, s.b, s.c, s.blockers, s.found, s.planes, s.bounds, s.terms, s.cells, s.samples, s.pieces, s.counts, s.points, s.part_a,
                       s.part_b, s.parts)  # fmt: skip
    for j in range(m):
        for i in range(n):
            _exchange_plain(i, j, *given, scratch)


@jit.kernel
def exchange_hidden(n, _, given):
    s = make_scratch()
    last, world, wanted, found, room = given
    for i in range(n):
        scratch = _Scratch(s.a, s.b, s.c, room.blockers[i], s.found, s.planes, s.bounds, s.terms, s.cells, s.samples, room.pieces[i], room.counts[i],
                           room.points[i], s.part_a, s.part_b, s.parts)  # fmt: skip
        _exchange_hidden(last, world, wanted, found, scratch)
