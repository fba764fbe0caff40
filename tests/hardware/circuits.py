"""Vectors for circuits, and Verilog in Icarus."""

import subprocess
from dataclasses import replace

import numpy as np

from luxel.hardware.float24 import FLOAT24
from luxel.hardware.rtl.area import CORNERS
from luxel.hardware.rtl.barycentric import COLORS
from luxel.hardware.rtl.verilog import write
from luxel.hardware.synthesis import tools


def corner_words(f):
    """Zeros (of either sign, and not canonical), the smallest, the largest, one and its neighbours, ties: of both signs."""
    one, unit = f.bias << f.fraction, 1 << f.fraction
    around_one = [one - 1, one, one + 1, one + unit // 2, one + unit - 1, one + (f.fraction + 2) * unit]
    words = [0, 1, unit - 1, unit, unit + 1, *around_one, f.largest - 1, f.largest]
    return np.array(words + [word | 1 << f.bits - 1 for word in words], np.uint32)


def random_words(rng, f, count):
    """Half of them of any exponent, half near one, where sums cancel."""
    words = rng.integers(0, 1 << f.bits, count)
    near = rng.integers(f.bias - 4, f.bias + 5, count) << f.fraction
    mask = (1 << f.exponent) - 1 << f.fraction
    return np.where(rng.random(count) < 0.5, words, words & ~mask | near).astype(np.uint32)


def pairs(rng, f, g, count):
    """All pairs of corner words of two formats, and random ones."""
    a, b = (part.ravel() for part in np.meshgrid(corner_words(f), corner_words(g)))
    return np.concatenate([a, random_words(rng, f, count)]), np.concatenate([b, random_words(rng, g, count)])


def triangles(rng, count, width=60, height=45):
    """(m, 3, 2) small and large, inside and beyond the picture, degenerate, on pixel centres and corners, seen from either side."""
    size = 1 << rng.integers(5, 15, (count, 1, 1))
    corners = rng.integers(-10 * 256, (max(width, height) + 10) * 256, (count, 1, 2)) + rng.integers(-(1 << 14), 1 << 14, (count, 3, 2)) % size
    corners[::5] = corners[::5] // 256 * 256 + 128
    corners[1::7] = corners[1::7] // 2048 * 2048 + 128
    corners[::11, 2] = corners[::11, 1]
    return corners


def colors(rng, count):
    """(m, 3, 3) float24 words in [0, 1]."""
    return FLOAT24.from_float(rng.random((count, 3, 3)))


def columns(corners, words=None):
    """The fields of a stream of triangles."""
    fields = {key: corners[:, k // 2, k % 2] for k, key in enumerate(CORNERS)}
    return fields if words is None else fields | {key: words[:, k // 3, k % 3] for k, key in enumerate(COLORS)}


def in_icarus(design, inputs, count, folder, seed=1, **ports):
    """Run a design's Verilog with random stalls at both ends; the fields of what leaves."""
    layouts = []

    def make():
        component = design.make()
        layouts.extend((component.i.payload.shape(), component.o.payload.shape()))
        return component

    write(replace(design, make=make), folder)
    total = sum((np.asarray(inputs[key], object) & (1 << f.width) - 1) << f.offset for key, f in layouts[0])
    (folder / "in.hex").write_text("".join(f"{value:x}\n" for value in total))
    wired = "".join(f", .{name}({value})" for name, value in ports.items())
    bench = _BENCH.format(top=design.top, n=len(total), count=count, iw=layouts[0].size, ow=layouts[1].size, ports=wired, seed=seed)
    (folder / "bench.v").write_text(bench)
    tools.run("iverilog", ["-g2005", "-o", "bench.vvp", "-s", "bench", "-c", f"{design.top}.f", "bench.v"], folder)
    subprocess.run(["vvp", "-n", "bench.vvp"], cwd=folder, check=True, capture_output=True, timeout=120)
    words = [int(line, 16) for line in (folder / "out.hex").read_text().split()]
    fields = {}
    for key, f in layouts[1]:
        values = [word >> f.offset & (1 << f.width) - 1 for word in words]
        if getattr(f.shape, "signed", False):
            values = [value - (value >> f.width - 1 << f.width) for value in values]
        fields[key] = np.array(values, np.int64)
    return fields


_BENCH = """`timescale 1ns/1ps
module bench;
  reg clk = 0, valid = 0, ready = 0;
  reg [{iw} - 1:0] inputs [0:{n} - 1];
  reg [{iw} - 1:0] payload = 0;
  wire i_ready, o_valid;
  wire [{ow} - 1:0] out;
  integer sent = 0, got = 0, clocks = 0, file, seed = {seed};
  {top} dut(.clk(clk), .rst(1'b0), .i__payload(payload), .i__valid(valid), .i__ready(i_ready),
            .o__payload(out), .o__valid(o_valid), .o__ready(ready){ports});
  initial begin $readmemh("in.hex", inputs); file = $fopen("out.hex"); end
  always #5 clk = ~clk;
  always @(negedge clk) begin
    if (!valid && sent < {n} && $random(seed) % 4 != 0) begin valid = 1; payload = inputs[sent]; end
    ready = $random(seed) % 4 != 0;
  end
  always @(posedge clk) begin
    if (o_valid && ready) begin $fdisplay(file, "%h", out); got = got + 1; end
    if (valid && i_ready) begin sent = sent + 1; valid <= #1 0; end
    clocks = clocks + 1;
    if (got == {count} || clocks == 200000) begin $fclose(file); $finish; end
  end
endmodule
"""
