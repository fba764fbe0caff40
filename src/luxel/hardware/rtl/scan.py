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

from luxel.hardware.rtl.floats import chosen
from luxel.hardware.rtl.pipeline import Pipeline, Timed
from luxel.hardware.rtl.setup import BLOCK_LOG2, Sizes
from luxel.hardware.rtl.streams import Early, Fifo, valid_line
from luxel.hardware.rtl.walk import Walk
from luxel.hardware.scan import BLOCK

EDGES = range(3)
_AHEAD = 16
"""Rows that wait for their fragments: enough for several blocks at an edge, of few fragments but eight rows, to pass meanwhile."""


def block_layout(sizes: Sizes) -> data.StructLayout:
    """A block: edge functions at the first pixel of its first row in the bounding box, that pixel, the rows (less one) and columns in the box, and
    whether it is covered wholly; `one` and `two`: whether it is to be walked in one or two steps."""
    edges = {f"{name}{i}": shape for i in EDGES for name, shape in (("e", sizes.edge), ("a", sizes.step), ("b", sizes.step))}
    place = {"x": sizes.pixel, "y": sizes.pixel, "rows": BLOCK_LOG2, "left": BLOCK_LOG2, "right": BLOCK_LOG2}
    return data.StructLayout(edges | sizes.kept() | place | dict.fromkeys(("one", "two", "accepted", "drawn", "last"), 1))


def row_layout(sizes: Sizes) -> data.StructLayout:
    """Fragments side by side: edge functions 1 and 2 at the first, their changes, where it is, and how many follow; `one` and `two` as of blocks."""
    edges = {f"{name}{i}": shape for i in (1, 2) for name, shape in (("e", unsigned(sizes.edge.width)), ("a", sizes.step))}
    fractions = {f"fraction{i}": 8 for i in (1, 2)}
    place = {"x": sizes.pixel, "y": sizes.pixel, "following": BLOCK_LOG2}
    return data.StructLayout(edges | fractions | place | dict.fromkeys(("one", "two", "drawn", "last"), 1))


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
        super().__init__({"i": In(Early(sizes.triangle())), "o": Out(Early(block_layout(sizes)))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.fifo = fifo = Fifo(self.o.payload.shape(), early=True)
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
        triangle = Signal(s.triangle(), name="triangle", reset_less=True)  # e is of this block, below of the next row's first
        across = s.pixel - BLOCK_LOG2
        x, y, columns, rows = (Signal(across, name=name, reset_less=True) for name in ("x", "y", "columns", "rows"))
        top, right, bottom, nearly, nearly_right, nearly_bottom = (  # `nearly`: the last but one
            Signal(name=name, reset_less=True) for name in ("top", "right", "bottom", "nearly", "nearly_right", "nearly_bottom")
        )
        walk = Walk(m, p, self.i, new.one, nearly)
        steps = [f"{name}{i}" for name in ("e", "below") for i in EDGES]
        walk.fetched([(triangle[key], new[key]) for key in s.triangle().members if key not in steps])
        right_then, nearly_right_then = Mux(right, triangle.one_x, nearly_right), Mux(right, triangle.two_x, columns == 2)
        bottom_then, nearly_bottom_then = Mux(right, nearly_bottom, bottom), Mux(right, rows == 2, nearly_bottom)
        turn_next = p.go_next & (Mux(walk.go, Mux(walk.load, new.one_x, right_then), right) | walk.load_next)
        for i in EDGES:
            e, below = triangle[f"e{i}"], triangle[f"below{i}"]
            further = (e + triangle[f"a{i}"].shift_left(BLOCK_LOG2))[: len(e)].as_signed()
            walk.stepped(e, new[f"e{i}"], Mux(right, below, further))
            lower = (below + triangle[f"b{i}"].shift_left(BLOCK_LOG2))[: len(e)].as_signed()
            p.state([(below, Mux(walk.fetch(), new[f"below{i}"], lower))], turn_next)
        with m.If(walk.go & walk.load):
            m.d.sync += [x.eq(new.first_x[BLOCK_LOG2:]), columns.eq(new.more_x), right.eq(new.one_x), nearly_right.eq(new.two_x), top.eq(1)]
            m.d.sync += [y.eq(new.first_y[BLOCK_LOG2:]), rows.eq(new.more_y), bottom.eq(new.one_y), nearly_bottom.eq(new.two_y)]
            m.d.sync += nearly.eq(new.two)
        with m.Elif(walk.go):
            m.d.sync += [right.eq(right_then), nearly_right.eq(nearly_right_then), bottom.eq(bottom_then), nearly_bottom.eq(nearly_bottom_then)]
            m.d.sync += nearly.eq(Mux(right_then, triangle.one_x & nearly_bottom_then, nearly_right_then & bottom_then))
            m.d.sync += [x.eq(x + 1), columns.eq(columns - 1)]
            with m.If(right):
                m.d.sync += [x.eq(triangle.first_x[BLOCK_LOG2:]), columns.eq(triangle.more_x), top.eq(0)]
                m.d.sync += [y.eq(y + 1), rows.eq(rows - 1)]
        shown = {"x": x, "y": y, "right": right, "bottom": bottom, "top": top, "busy": walk.busy}
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
        rows = Timed(rows.value[:BLOCK_LOG2], rows.time)
        made = {
            "x": Timed(Cat(C(0, BLOCK_LOG2), s["x"].value), 0),
            "y": p.step("y", lambda y, skip: Cat(skip, y), s["y"], skipped),
            "rows": rows,
            "one": p.step("one", lambda rows, drawn: (rows == 0) | ~drawn, rows, touched),
            "two": p.step("two", lambda rows, drawn: (rows == 1) & drawn, rows, touched),
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
        super().__init__({"i": In(Early(block_layout(sizes))), "o": Out(Early(row_layout(sizes)))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.fifo = fifo = Fifo(self.o.payload.shape(), _AHEAD, early=True)
        p = Pipeline(fifo.room)
        state, valid = self._walk(m, p)
        found = self._cover(p, state)
        time = max(timed.time for timed in found.values())
        wiring.connect(m, fifo.o, wiring.flipped(self.o))
        row = Signal(row_layout(self.sizes), name="row_found")
        m.d.comb += [row[key].eq(p.at(found[key], time)) for key in found]
        before = valid_line(m, valid, p.go, time - 1)[time - 1] & (p.at(found["drawn"], time - 1) | p.at(found["last"], time - 1))
        self._merge(m, p, row, before, fifo)
        p.into(m)
        return m

    def _walk(self, m: Module, p: Pipeline) -> tuple[dict[str, Timed], Value]:
        """The state: a row of a block, on every clock the next; and whether there is one."""
        block, new = Signal(block_layout(self.sizes), name="block", reset_less=True), self.i.payload
        nearly, final = Signal(reset_less=True), Signal(reset_less=True)  # at the last row but one, at the last
        walk = Walk(m, p, self.i, new.one, nearly)
        steps = {f"e{i}": (block[f"e{i}"] + block[f"b{i}"])[: self.sizes.edge.width].as_signed() for i in EDGES}
        steps |= {"y": block.y + 1, "rows": block.rows - 1}
        for key in block.shape().members:
            if key in steps:
                walk.stepped(block[key], new[key], steps[key])
        walk.fetched([(block[key], new[key]) for key in block.shape().members if key not in steps])
        walk.stepped(nearly, new.two, block.rows == 2)
        walk.stepped(final, new.one, nearly)
        return constants(block_layout(self.sizes), block) | {"final": Timed(final, 0)}, walk.busy

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
        following = p.step("following", lambda first, end: (end - first)[:BLOCK_LOG2], first, end)
        drawn = p.step("drawn", lambda v: v.any(), covered)
        found = {
            "x": p.step("x", lambda x, first: Cat(first, x[BLOCK_LOG2:]), s["x"], first),
            "y": s["y"],
            "following": following,
            "one": p.step("one", lambda n, drawn: (n == 0) | ~drawn, following, drawn),
            "two": p.step("two", lambda n, drawn: (n == 1) & drawn, following, drawn),
            "drawn": drawn,
            "last": p.step("last", lambda last, final: last & final, s["last"], s["final"]),
        }
        for i in (1, 2):
            e = times_added(p, f"e{i}", s[f"e{i}"], s[f"a{i}"], first)
            found[f"e{i}"] = p.step(f"e{i}", lambda e, under: (e + under)[: len(e)], e, s[f"under{i}"])
            found |= {f"a{i}": s[f"a{i}"], f"fraction{i}": s[f"fraction{i}"]}
        return found

    def _merge(self, m: Module, p: Pipeline, row: Any, before: Value, fifo: Fifo) -> None:
        """Keep a row until it is known whether it is the last of its triangle: if empty ones follow, it learns that at their end.

        `before` is whether the row that comes to `row` next has anything to tell.
        """
        kept, waiting = Signal(row.shape(), name="kept", reset_less=True), Signal()
        comes, comes_next, ends = Signal(), Signal(), Signal()
        m.d.comb += [
            comes_next.eq(Mux(p.go, before, comes)),
            ends.eq(comes & ~row.drawn & waiting & ~kept.last),
            fifo.push.eq(p.go & waiting & (kept.last | comes)),
            fifo.data.eq(kept),
            fifo.data.last.eq(kept.last | ends),
        ]
        m.d.sync += comes.eq(comes_next)
        with m.If(p.go):
            m.d.sync += waiting.eq((comes & ~ends) | (waiting & ~kept.last & ~comes))
        p.state([(kept.as_value(), row.as_value())], p.go_next & comes_next)


class Fragments:
    """The walk along rows: made within the pipeline that takes its fragments, and stopped with it."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = sizes

    def walk(self, m: Module, p: Pipeline, i: Any) -> tuple[dict[str, Value], Value]:
        """The fields of a fragment, on every clock the next; and whether there is one."""
        row, new = Signal(row_layout(self.sizes), name="row", reset_less=True), i.payload
        nearly, final = Signal(name="row_nearly", reset_less=True), Signal(name="row_final", reset_less=True)
        walk = Walk(m, p, i, new.one, nearly)
        steps = {f"e{k}": (row[f"e{k}"] + row[f"a{k}"])[: self.sizes.edge.width] for k in (1, 2)}
        steps |= {"x": row.x + 1, "following": row.following - 1}
        for key, step in steps.items():
            walk.stepped(row[key], new[key], step)
        walk.fetched([(row[key], new[key]) for key in row.shape().members if key not in steps])
        walk.stepped(nearly, new.two, row.following == 2)
        walk.stepped(final, new.one, nearly)
        edge = {name: Cat(row[f"fraction{k}"], row[f"e{k}"])[: self.sizes.area] for k, name in ((1, "l_ca"), (2, "l_ab"))}
        return {"x": row.x, "y": row.y, "drawn": row.drawn, "last": row.last & final} | edge, walk.busy


class Scan(wiring.Component):
    """Stream of triangles that are set up in, stream of fragments out."""

    def __init__(self, sizes: Sizes) -> None:
        self.sizes = sizes
        super().__init__({"i": In(Early(sizes.triangle())), "o": Out(stream.Signature(fragment_layout(sizes)))})

    def elaborate(self, platform: Any) -> Module:
        """Amaranth's."""
        m = Module()
        m.submodules.fifo = fifo = Fifo(fragment_layout(self.sizes))
        p = Pipeline(fifo.room)
        rows = connected(m, self.sizes, self.i)
        fragment, valid = Fragments(self.sizes).walk(m, p, rows)
        m.d.comb += [fifo.data[key].eq(value) for key, value in fragment.items()]
        m.d.comb += fifo.push.eq(valid & p.go)
        wiring.connect(m, fifo.o, wiring.flipped(self.o))
        p.into(m)
        return m


def connected(m: Module, sizes: Sizes, triangles: Any) -> Any:
    """The stream of rows of a stream of triangles.

    A triangle is a thousand bits wide, and comes from far: the sender hears that it is taken a clock after, and has the next one two clocks after.
    """
    m.submodules.blocks = blocks = Blocks(sizes)
    m.submodules.rows = rows = Rows(sizes)
    ready, taken, gone = Signal(), Signal(), Signal()
    m.d.comb += [blocks.i.payload.eq(triangles.payload), blocks.i.valid.eq(triangles.valid & ~gone)]
    m.d.comb += [taken.eq(ready & blocks.i.valid), triangles.ready_next.eq(taken)]
    m.d.sync += [ready.eq(blocks.i.ready_next), gone.eq(taken)]
    wiring.connect(m, blocks.o, rows.i)
    return rows.o


def times_added(p: Pipeline, name: str, value: Timed, step: Timed, times: Timed) -> Timed:
    """value + times * step, for `times` of 3 bits, in three steps: choices, and two additions."""
    before = times.time - 1
    thrice = p.step(f"{name}_thrice", lambda s: s + s.shift_left(1), Timed(p.at(step, before), before))
    low, high = p.step(
        f"{name}_low {name}_high",
        lambda s, t, n: (chosen(n[:2], [C(0, t.shape()), s, s.shift_left(1), t]), Mux(n[2], s, 0)),
        step, thrice, times,
    )  # fmt: skip
    whole = p.step(f"{name}_times", lambda l, h: l + h.shift_left(2), low, high)
    return p.step(name, lambda e, v: (e + v)[: len(e)].as_signed(), value, whole)


def lowest(bits: Value) -> Value:
    """The index of the first bit that is 1 (the last one's if none is)."""
    found = C(len(bits) - 1, (len(bits) - 1).bit_length())
    for k in reversed(range(len(bits) - 1)):
        found = Mux(bits[k], k, found)[: (len(bits) - 1).bit_length()]
    return found
