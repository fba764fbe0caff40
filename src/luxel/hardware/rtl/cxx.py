"""The whole circuit as a program: CXXRTL (Yosys) makes C++ of it, and a compiler a simulation that is some hundred times as fast as Amaranth's."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from luxel import fixed, hardware
from luxel.arrays import Array
from luxel.hardware.rtl import netlist
from luxel.hardware.rtl.whole import COORDINATE_BITS, Interpolator
from luxel.hardware.synthesis import tools

_TRIANGLE, _FRAGMENT = 15, 6  # words of 32 bits


class Drawn(NamedTuple):
    """Fragments in the order in which they left.

    Attributes:
        triangle: (n,) int64, of those that have fragments, counted from 0.
        x, y: (n,) int64, pixels.
        colors: (n, 3) uint32, float24.
        first, clocks: On which clock the first left, and how many it took in all.
    """

    triangle: Array
    x: Array
    y: Array
    colors: Array
    first: int
    clocks: int


class Program:
    """The interpolator, compiled. It is kept in a cache.

    Args:
        coordinate_bits: As in `Interpolator`.
        compiling: Called before it is compiled, if it is not in the cache.
    """

    def __init__(self, coordinate_bits: int = COORDINATE_BITS, compiling: Callable[[], object] | None = None) -> None:
        self.coordinate_bits = coordinate_bits
        self.path = _cache() / f"interpolator-{coordinate_bits}-{_digest()}"
        if not self.path.exists():
            if compiling is not None:
                compiling()
            layouts: list[Any] = []

            def make() -> Interpolator:
                design = Interpolator(coordinate_bits)
                layouts.extend((design.i.payload.shape(), design.o.payload.shape()))
                return design

            units = netlist.units(make, "interpolator")
            driver = _MAIN.replace("@TAKE@", _puts(layouts[0])).replace("@GIVE@", _gets(layouts[1]))
            _compile(units, driver, self.path)

    def draw(self, corners: Array, colors: Array, width: int, height: int, offered: float = 1, taken: float = 1, seed: int = 1) -> Drawn:
        """Send triangles through the circuit.

        Args:
            corners: (m, 3, 2) integers, x and y in 1/256 pixel.
            colors: (m, 3, 3) uint32, float24 words: of each corner, three channels.
            width, height: Of the picture, pixels.
            offered, taken: With which probability there is a triangle at the one end, and a fragment is taken at the other, on a clock.
            seed: For what is random about that.
        """
        m = len(corners)
        words = np.concatenate([np.asarray(corners, np.int64).reshape(m, 6), np.asarray(colors, np.int64).reshape(m, 9)], 1).astype(np.int32)
        arguments = [str(value) for value in (width - 1, height - 1, int(offered * 65536), int(taken * 65536), seed)]
        out = tools.run(str(self.path), arguments, self.path.parent, words.tobytes()).stdout
        found = np.frombuffer(out, np.uint32)
        first, clocks = (int(value) for value in found[-2:])
        rows = found[:-2].reshape(-1, _FRAGMENT)
        place = rows[:, :3].astype(np.int64)
        return Drawn(place[:, 0], place[:, 1], place[:, 2], rows[:, 3:], first, clocks)


@cache
def _digest() -> str:
    """Of all that the circuit is made from: the circuit itself takes seconds to put together."""
    sources = [Path(fixed.__file__), *sorted(Path(hardware.__file__).parent.rglob("*.py"))]
    whole = hashlib.sha256(version("amaranth").encode())
    for path in sources:
        whole.update(path.read_bytes())
    return whole.hexdigest()[:16]


def _cache() -> Path:
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "luxel" / "circuit"
    root.mkdir(parents=True, exist_ok=True)
    return root


def _compile(units: list[netlist.Unit], driver: str, path: Path) -> None:
    """Operators stay modules (but those of one bit), so that each is compiled once: a third of the time, for a program that takes a third more."""
    kept = " ".join(unit.name for unit in units if sum(port.width for port in unit.ports if port.output) > 1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "circuit.il").write_text("\n".join(unit.text for unit in units))
        prepared = f"hierarchy -top interpolator\nproc -noopt\nsetattr -mod -set keep_hierarchy 1 {kept}\nflatten\nopt_clean"
        tools.yosys(f"read_rtlil circuit.il\n{prepared}\nwrite_cxxrtl circuit.cc\n", folder)
        (folder / "main.cc").write_text(driver)
        runtime = tools.share() / "include" / "backends" / "cxxrtl" / "runtime"
        tools.run("c++", ["-std=c++17", "-O1", "-I", str(runtime), "main.cc", "-o", "program"], folder)
        partial = path.with_name(f"{path.name}-{os.getpid()}")
        shutil.move(folder / "program", partial)
        partial.replace(path)


def _puts(layout: Any) -> str:
    """C++ that puts a triangle's words on the input port."""
    return "\n".join(f"            put(top.p_i____payload, {field.offset}, {field.width}, words[{k}]);" for k, (_, field) in enumerate(layout))


def _gets(layout: Any) -> str:
    """C++ that makes a row of what is on the output port."""
    of = {key: f"get(top.p_o____payload, {field.offset}, {field.width})" for key, field in layout}
    return f"            uint32_t row[{_FRAGMENT}] = {{triangle, {', '.join(of[key] for key in 'xyrgb')}}};\n            triangle += {of['last']};"


_MAIN = r"""
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include "circuit.cc"

// Bits of a port, which is an array of 32-bit chunks.
template <class Port> static void put(Port &port, unsigned offset, unsigned width, uint32_t value) {
    for (unsigned bit = 0; bit < width; bit++, offset++) {
        uint32_t one = uint32_t(1) << offset % 32;
        if (value >> bit & 1) port.data[offset / 32] |= one; else port.data[offset / 32] &= ~one;
    }
}

template <class Port> static uint32_t get(const Port &port, unsigned offset, unsigned width) {
    uint64_t low = port.data[offset / 32], high = offset % 32 + width > 32 ? port.data[offset / 32 + 1] : 0;
    return uint32_t((low | high << 32) >> offset % 32 & ((uint64_t(1) << width) - 1));
}

static uint64_t state;
static bool chance(uint32_t of_65536) {  // xorshift
    state ^= state << 13; state ^= state >> 7; state ^= state << 17;
    return (state >> 40 & 65535) < of_65536;
}

int main(int, char **argv) {
    const uint32_t offered = atoi(argv[3]), taken = atoi(argv[4]);
    state = 0x9E3779B97F4A7C15u * (atoi(argv[5]) + 1);
    cxxrtl_design::p_interpolator top;
    top.p_right.set<uint32_t>(atoi(argv[1]));
    top.p_bottom.set<uint32_t>(atoi(argv[2]));
    uint32_t words[15], triangle = 0, first = 0, clocks = 0, quiet = 0;
    bool waiting = false, ended = false;
    while (quiet < 4096) {  // longer than anything stays in the pipelines
        if (!waiting && !ended && chance(offered)) {
            if (fread(words, sizeof words, 1, stdin) == 1) waiting = true; else ended = true;
        }
        if (waiting) {
@TAKE@
        }
        bool take = chance(taken);
        top.p_i____valid.set<bool>(waiting);
        top.p_o____ready.set<bool>(take);
        top.p_clk.set<bool>(false);
        top.step();
        bool accepted = waiting && top.p_i____ready.get<bool>();
        bool left = take && top.p_o____valid.get<bool>();
        if (left) {
            if (!first) first = clocks;
@GIVE@
            fwrite(row, sizeof row, 1, stdout);
        }
        top.p_clk.set<bool>(true);
        top.step();
        if (accepted) waiting = false;
        clocks++;
        quiet = left || waiting || !ended ? 0 : quiet + 1;
    }
    uint32_t end[2] = {first, clocks - quiet};
    fwrite(end, sizeof end, 1, stdout);
}
"""
