"""Module 3 of the hardware paper: scan conversion over 8x8 blocks, of triangles that are set up, to one fragment a clock.

Three stages, with a FIFO between each two. `Blocks` walks the blocks of a bounding box, one a clock, and drops those that some edge function
rejects. `Rows` walks the rows of a block, one a clock: the fragments of a row lie side by side, so a row is a first pixel and a count; rows
without any are dropped. `Fragments` walks the pixels of a row. As a block has eight rows, and a row up to eight pixels, each stage is
mostly ahead of the next, and the last has something to do on every clock.

The last element of a triangle says so (`last`). A triangle without fragments has one that is not `drawn`, which says just that.
"""

from __future__ import annotations

from typing import Any

from amaranth import C, Cat, Module, Mux, Signal, Value, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from luxel.hardware.rtl.pipeline import Pipeline, Timed
from luxel.hardware.rtl.setup import BLOCK_LOG2, Sizes
from luxel.hardware.rtl.streams import Fifo, valid_line
from luxel.hardware.scan import BLOCK

EDGES = range(3)
_AHEAD = 16
"""Rows that wait for their fragments: enough for several blocks at an edge, of few fragments but eight rows, to pass meanwhile."""


def block_layout(sizes: Sizes) -> data.StructLayout:
    """A block: edge functions at the first pixel of its first row in the bounding box, that pixel, the rows and columns in the box, and whether
    it is covered wholly."""
    edges = {f"{name}{i}": shape for i in EDGES for name, shape in (("e", sizes.edge), ("a", sizes.step), ("b", sizes.step))}
    place = {"x": sizes.pixel, "y": sizes.pixel, "rows": BLOCK_LOG2, "left": BLOCK_LOG2, "right": BLOCK_LOG2}
    return data.StructLayout(edges | sizes.kept() | place | {"accepted": 1, "drawn": 1, "last": 1})


def row_layout(sizes: Sizes) -> data.StructLayout:
    """Fragments side by side: edge functions 1 and 2 at the first, their changes, where it is, and how many follow it."""
    edges = {f"{name}{i}": shape for i in (1, 2) for name, shape in (("e", unsigned(sizes.edge.width)), ("a", sizes.step))}
    fractions = {f"fraction{i}": 8 for i in (1, 2)}
    return data.StructLayout(edges | fractions | {"x": sizes.pixel, "y": sizes.pixel, "following": BLOCK_LOG2, "drawn": 1, "last": 1})


def fragment_layout(sizes: Sizes) -> data.StructLayout:
    """A fragment: where it is, and edge functions 1 and 2 there."""
    return data.StructLayout({"x": sizes.pixel, "y": sizes.pixel, "l_ca": sizes.area, "l_ab": sizes.area, "drawn": 1, "last": 1})


def constants(layout: data.StructLayout, payload: Any, *names: str) -> dict[str, Timed]:
    """Fields of a payload at time 0."""
    return {name: Timed(payload[name], 0) for name in names or layout.members}


class Blocks(wiring.Component):
    """Stream of triangles in, stream of touched blocks out."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = sizes
        super().__init__({"i": In(stream.Signature(sizes.triangle())), "o": Out(stream.Signature(block_layout(sizes)))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.fifo = fifo = Fifo(self.o.payload.shape())
        p = Pipeline(fifo.room)
        state = self._walk(m, p)
        tested, touched = self._test(p, state)
        time = max(timed.time for timed in tested.values())
        valid = valid_line(m, state["busy"].value, p.go, time)[time]
        wiring.connect(m, fifo.o, wiring.flipped(self.o))
        m.d.comb += [fifo.data[key].eq(p.at(tested[key], time)) for key in tested]
        m.d.comb += fifo.push.eq(valid & p.go & (p.at(touched, time) | p.at(tested["last"], time)))
        p.into(m)
        return m

    def _walk(self, m: Module, p: Pipeline) -> dict[str, Timed]:
        """The state: a block of a triangle, on every clock the next, from left to right and from top to bottom."""
        s, new = self.sizes, self.i.payload
        triangle = Signal(s.triangle(), name="triangle", reset_less=True)
        e = [Signal(s.edge, name=f"e{i}", reset_less=True) for i in EDGES]
        start = [Signal(s.edge, name=f"start{i}", reset_less=True) for i in EDGES]  # of the row of blocks
        across = s.pixel - BLOCK_LOG2
        x, y, columns, rows, wide = (Signal(across, name=name, reset_less=True) for name in ("x", "y", "columns", "rows", "wide"))
        busy, load = Signal(), Signal(init=1)  # `load`: not busy, or at the last block
        right, bottom, top = (Signal(name=name, reset_less=True) for name in ("right", "bottom", "top"))
        m.d.comb += self.i.ready.eq(p.go & load)
        new_wide, new_high = (Signal(across, name=name) for name in ("new_wide", "new_high"))
        m.d.comb += [
            new_wide.eq(Mux(new.empty, 0, new.last_x[BLOCK_LOG2:] - new.first_x[BLOCK_LOG2:])),
            new_high.eq(Mux(new.empty, 0, new.last_y[BLOCK_LOG2:] - new.first_y[BLOCK_LOG2:])),
        ]
        with m.If(p.go & load):
            m.d.sync += [busy.eq(self.i.valid), triangle.eq(new), top.eq(1), wide.eq(new_wide), columns.eq(new_wide), rows.eq(new_high)]
            m.d.sync += [right.eq(new_wide == 0), bottom.eq(new_high == 0), x.eq(new.first_x[BLOCK_LOG2:]), y.eq(new.first_y[BLOCK_LOG2:])]
            m.d.sync += load.eq(~self.i.valid | ((new_wide == 0) & (new_high == 0)))
            m.d.sync += [register.eq(new[f"e{i}"]) for i in EDGES for register in (e[i], start[i])]
        with m.Elif(p.go):
            steps = [Mux(right, triangle[f"b{i}"], triangle[f"a{i}"]) for i in EDGES]
            following = [(Mux(right, start[i], e[i]) + (steps[i].as_signed().shift_left(BLOCK_LOG2)))[: len(e[i])] for i in EDGES]
            m.d.sync += [e[i].eq(following[i]) for i in EDGES]
            with m.If(right):
                m.d.sync += [start[i].eq(following[i]) for i in EDGES]
                m.d.sync += [x.eq(triangle.first_x[BLOCK_LOG2:]), y.eq(y + 1), columns.eq(wide), right.eq(wide == 0)]
                m.d.sync += [rows.eq(rows - 1), bottom.eq(rows == 1), top.eq(0)]
                m.d.sync += load.eq((wide == 0) & (rows == 1))
            with m.Else():
                m.d.sync += [x.eq(x + 1), columns.eq(columns - 1), right.eq(columns == 1), load.eq((columns == 1) & bottom)]
        shown = {f"e{i}": e[i] for i in EDGES} | {"x": x, "y": y, "right": right, "bottom": bottom, "top": top, "busy": busy}
        left = Signal(name="left")
        m.d.comb += left.eq(x == triangle.first_x[BLOCK_LOG2:])
        return constants(s.triangle(), triangle) | {key: Timed(value, 0) for key, value in (shown | {"leftmost": left}).items()}

    def _test(self, p: Pipeline, s: dict[str, Timed]) -> tuple[dict[str, Timed], Timed]:
        """Blocks as they leave, and whether to keep them."""
        signs = {
            name: [p.step(f"{name}{i}_sign", lambda e, v: (e + v)[-1], s[f"e{i}"], s[f"{name}{i}"]) for i in EDGES]
            for name in ("high", "low")
        }  # fmt: skip
        touched = p.step("touched", lambda empty, *out: ~(empty | Cat(out).any()), s["empty"], *signs["high"])
        accepted = p.step("accepted", lambda *out: ~Cat(out).any(), *signs["low"])
        skipped = p.step("skipped", lambda top, y: Mux(top, y[:BLOCK_LOG2], 0), s["top"], s["first_y"])
        rows = p.step("rows", lambda bottom, y, skip: Mux(bottom, y[:BLOCK_LOG2], BLOCK - 1) - skip, s["bottom"], s["last_y"], skipped)
        made = {
            "x": Timed(Cat(C(0, BLOCK_LOG2), s["x"].value), 0),
            "y": p.step("y", lambda y, skip: Cat(skip, y), s["y"], skipped),
            "rows": Timed(rows.value[:BLOCK_LOG2], rows.time),
            "left": p.step("left", lambda first, x: Mux(first, x[:BLOCK_LOG2], 0), s["leftmost"], s["first_x"]),
            "right": p.step("right", lambda last, x: Mux(last, x[:BLOCK_LOG2], BLOCK - 1), s["right"], s["last_x"]),
            "accepted": accepted, "drawn": touched,
            "last": p.step("last", lambda right, bottom: right & bottom, s["right"], s["bottom"]),
        }  # fmt: skip
        for i in EDGES:
            made |= {f"e{i}": times_added(p, f"e{i}", s[f"e{i}"], s[f"b{i}"], skipped), f"a{i}": s[f"a{i}"], f"b{i}": s[f"b{i}"]}
        return made | {key: s[key] for key in self.sizes.kept()}, touched


class Rows(wiring.Component):
    """Stream of blocks in, stream of rows of fragments out."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = sizes
        super().__init__({"i": In(stream.Signature(block_layout(sizes))), "o": Out(stream.Signature(row_layout(sizes)))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.fifo = fifo = Fifo(self.o.payload.shape(), _AHEAD)
        p = Pipeline(fifo.room)
        state, valid = self._walk(m, p)
        found = self._cover(p, state)
        time = max(timed.time for timed in found.values())
        wiring.connect(m, fifo.o, wiring.flipped(self.o))
        row = Signal(row_layout(self.sizes), name="row_found")
        m.d.comb += [row[key].eq(p.at(found[key], time)) for key in found]
        self._merge(m, p.go, row, valid_line(m, valid, p.go, time)[time], fifo)
        p.into(m)
        return m

    def _walk(self, m: Module, p: Pipeline) -> tuple[dict[str, Timed], Value]:
        """The state: a row of a block, on every clock the next; and whether there is one."""
        block = Signal(block_layout(self.sizes), name="block", reset_less=True)
        busy, load = Signal(), Signal(init=1)  # `load`: not busy, or at the last row
        final = Signal(reset_less=True)
        ends = (self.i.payload.rows == 0) | ~self.i.payload.drawn
        m.d.comb += self.i.ready.eq(p.go & load)
        with m.If(p.go & load):
            m.d.sync += [busy.eq(self.i.valid), block.eq(self.i.payload), final.eq(ends), load.eq(~self.i.valid | ends)]
        with m.Elif(p.go):
            m.d.sync += [block[f"e{i}"].eq(block[f"e{i}"] + block[f"b{i}"]) for i in EDGES]
            m.d.sync += [block.y.eq(block.y + 1), block.rows.eq(block.rows - 1), final.eq(block.rows == 1), load.eq(block.rows == 1)]
        return constants(block_layout(self.sizes), block) | {"final": Timed(final, 0)}, busy

    def _cover(self, p: Pipeline, s: dict[str, Timed]) -> dict[str, Timed]:
        """Which fragments of a row are covered: the signs of three edge functions at eight pixels, by doubling."""
        outside = []
        for i in EDGES:
            values = [s[f"e{i}"]]
            for bit in reversed(range(BLOCK_LOG2)):
                added = [
                    p.step(f"e{i}", lambda e, a, bit=bit: (e + a.shift_left(bit))[: len(e)].as_signed(), e, s[f"a{i}"])
                    for e in values
                ]  # fmt: skip
                kept = [Timed(p.at(e, added[0].time), added[0].time) for e in values]
                values = [e for pair in zip(kept, added) for e in pair]
            outside.append([Timed(e.value[-1], e.time) for e in values])
        columns = p.step("columns", lambda l, r, d: Cat(d & (l <= k) & (k <= r) for k in range(BLOCK)), s["left"], s["right"], s["drawn"])
        covered = p.step(
            "covered",
            lambda columns, accepted, *out: columns & (accepted.replicate(BLOCK) | ~Cat(Cat(out[k::BLOCK]).any() for k in range(BLOCK))),
            columns, s["accepted"], *(sign for edge in outside for sign in edge),
        )  # fmt: skip
        first = p.step("first", lambda v: lowest(v), covered)
        end = p.step("end", lambda v: BLOCK - 1 - lowest(Cat(reversed(v))), covered)
        found = {
            "x": p.step("x", lambda x, first: Cat(first, x[BLOCK_LOG2:]), s["x"], first),
            "y": s["y"],
            "following": p.step("following", lambda first, end: (end - first)[:BLOCK_LOG2], first, end),
            "drawn": p.step("drawn", lambda v: v.any(), covered),
            "last": p.step("last", lambda last, final: last & final, s["last"], s["final"]),
        }
        for i in (1, 2):
            e = times_added(p, f"e{i}", s[f"e{i}"], s[f"a{i}"], first)
            found[f"e{i}"] = p.step(f"e{i}", lambda e, under: (e + under)[: len(e)], e, s[f"under{i}"])
            found |= {f"a{i}": s[f"a{i}"], f"fraction{i}": s[f"fraction{i}"]}
        return found

    def _merge(self, m: Module, go: Value, row: Any, valid: Value, fifo: Fifo) -> None:
        """Keep a row until it is known whether it is the last of its triangle: if empty ones follow, it learns that at their end."""
        kept, waiting = Signal(row.shape(), name="kept", reset_less=True), Signal()
        comes, ends = Signal(), Signal()
        m.d.comb += [
            comes.eq(valid & (row.drawn | row.last)),
            ends.eq(comes & ~row.drawn & waiting & ~kept.last),
            fifo.push.eq(go & waiting & (kept.last | comes)),
            fifo.data.eq(kept),
            fifo.data.last.eq(kept.last | ends),
        ]
        with m.If(go):
            m.d.sync += waiting.eq((comes & ~ends) | (waiting & ~kept.last & ~comes))
            with m.If(comes):
                m.d.sync += kept.eq(row)


class Fragments:
    """The walk along rows: made within the pipeline that takes its fragments, and stopped with it."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = sizes

    def walk(self, m: Module, go: Value, i: Any) -> tuple[dict[str, Value], Value]:
        """The fields of a fragment, on every clock the next; and whether there is one."""
        row = Signal(row_layout(self.sizes), name="row", reset_less=True)
        busy, load = Signal(name="row_busy"), Signal(name="row_load", init=1)  # `load`: not busy, or at the last fragment
        final = Signal(name="row_final", reset_less=True)
        ends = (i.payload.following == 0) | ~i.payload.drawn
        m.d.comb += i.ready.eq(go & load)
        with m.If(go & load):
            m.d.sync += [busy.eq(i.valid), row.eq(i.payload), final.eq(ends), load.eq(~i.valid | ends)]
        with m.Elif(go):
            m.d.sync += [row[f"e{k}"].eq(row[f"e{k}"] + row[f"a{k}"]) for k in (1, 2)]
            m.d.sync += [row.x.eq(row.x + 1), row.following.eq(row.following - 1), final.eq(row.following == 1), load.eq(row.following == 1)]
        edge = {name: Cat(row[f"fraction{k}"], row[f"e{k}"])[: self.sizes.area] for k, name in ((1, "l_ca"), (2, "l_ab"))}
        return {"x": row.x, "y": row.y, "drawn": row.drawn, "last": row.last & final} | edge, busy


class Scan(wiring.Component):
    """Stream of triangles that are set up in, stream of fragments out."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = sizes
        super().__init__({"i": In(stream.Signature(sizes.triangle())), "o": Out(stream.Signature(fragment_layout(sizes)))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.fifo = fifo = Fifo(fragment_layout(self.sizes))
        go = Signal()
        m.d.sync += go.eq(fifo.room)
        rows = connected(m, self.sizes, self.i)
        fragment, valid = Fragments(self.sizes).walk(m, go, rows)
        m.d.comb += [fifo.data[key].eq(value) for key, value in fragment.items()]
        m.d.comb += fifo.push.eq(valid & go)
        wiring.connect(m, fifo.o, wiring.flipped(self.o))
        return m


def connected(m: Module, sizes: Sizes, triangles: Any) -> Any:
    """The stream of rows of a stream of triangles."""
    m.submodules.blocks = blocks = Blocks(sizes)
    m.submodules.rows = rows = Rows(sizes)
    m.d.comb += [blocks.i.payload.eq(triangles.payload), blocks.i.valid.eq(triangles.valid), triangles.ready.eq(blocks.i.ready)]
    wiring.connect(m, blocks.o, rows.i)
    return rows.o


def times_added(p: Pipeline, name: str, value: Timed, step: Timed, times: Timed) -> Timed:
    """value + times * step, for `times` of 3 bits, in three additions."""
    part = p.step(f"{name}_part", lambda s, n: Mux(n[0], s, 0) + Mux(n[1], s.shift_left(1), 0), step, times)
    whole = p.step(f"{name}_times", lambda v, s, n: v + Mux(n[2], s.shift_left(2), 0), part, step, times)
    return p.step(name, lambda e, v: (e + v)[: len(e)].as_signed(), value, whole)


def lowest(bits: Value) -> Value:
    """The index of the first bit that is 1 (the last one's if none is)."""
    found = C(len(bits) - 1, (len(bits) - 1).bit_length())
    for k in reversed(range(len(bits) - 1)):
        found = Mux(bits[k], k, found)[: (len(bits) - 1).bit_length()]
    return found
