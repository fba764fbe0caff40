"""Vectors for circuits, and Verilog in Icarus or Verilator."""

import subprocess
from dataclasses import replace

import numpy as np

from luxel.hardware.float24 import FLOAT24
from luxel.hardware.rtl import netlist
from luxel.hardware.rtl.area import CORNERS
from luxel.hardware.rtl.barycentric import COLORS
from luxel.hardware.rtl.verilog import write
from luxel.hardware.synthesis import ecp5, tools


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


def as_written(design, folder):
    """The Verilog that is for simulators and all tools; the files."""
    write(design, folder)
    return ["-f", f"{design.top}.f"]


def with_hard_multipliers(design, folder):
    """The same with the products' modules as an ECP5 has them: one MULT18X18D each, of which Lattice's description is written down below."""
    files = [path.name for path in write(design, folder)[:-1]]
    hard = ecp5.hard_products(netlist.units(design.make, design.top))
    assert hard
    (folder / "hard.v").write_text("\n".join(ecp5.multiplier(unit) for unit in hard))
    (folder / "dsp.v").write_text(DSP)
    return ["dsp.v", "hard.v", *(name for name in files if name.removesuffix(".v") not in {unit.name for unit in hard})]


def mapped(design, folder):
    """What Yosys makes of it for an ECP5, by Yosys' models of LUTs, carries, flip-flops and memories."""
    ecp5.synthesise(design, folder)
    models = "read_verilog -overwrite -DNO_INCLUDES +/lattice/cells_sim_ecp5.v"
    plain = f"hierarchy -top {design.top}\nproc\nflatten -wb\nclean\nwrite_verilog -noattr mapped.v\n"
    tools.yosys(f"read_json mapped.json\ndelete =$paramod*\n{models}\n{plain}", folder)
    (folder / "dsp.v").write_text(DSP)
    return ["dsp.v", "mapped.v"]


def in_verilog(design, inputs, count, folder, seed=1, files=as_written, simulator="iverilog", **ports):
    """Run a design's Verilog in Icarus or Verilator, with random stalls at both ends; the fields of what leaves."""
    layouts = []

    def make():
        component = design.make()
        layouts.extend((component.i.payload.shape(), component.o.payload.shape()))
        return component

    sources = files(replace(design, make=make), folder)
    total = sum((np.asarray(inputs[key], object) & (1 << f.width) - 1) << f.offset for key, f in layouts[0])
    (folder / "in.hex").write_text("".join(f"{value:x}\n" for value in total))
    wired = "".join(f", .{name}({value})" for name, value in ports.items())
    bench = _BENCH.format(top=design.top, n=len(total), count=count, iw=layouts[0].size, ow=layouts[1].size, ports=wired, seed=seed)
    (folder / "bench.v").write_text(bench)
    if simulator == "verilator":
        tools.run("verilator", ["--binary", "-Wno-fatal", "-Wno-lint", "-CFLAGS", "-O0", "--top-module", "bench", *sources, "bench.v"], folder)
        command = ["obj_dir/Vbench"]
    else:
        tools.run("iverilog", ["-g2005", "-o", "bench.vvp", "-s", "bench", *sources, "bench.v"], folder)
        command = ["vvp", "-n", "bench.vvp"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=120)
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

def _listed(name, count):
    return ", ".join(f"{name}{k}" for k in reversed(range(count)))


DSP = """// The parts of a MULT18X18D that the circuit uses, after Lattice's technical note on the ECP5's sysDSP.
module MULT18X18D(input @A@, input @B@, output @P@, input SIGNEDA, SIGNEDB, SOURCEA, SOURCEB, CLK0, CE0, RST0);
  parameter REG_INPUTA_CLK = "NONE", REG_INPUTA_CE = "CE0", REG_INPUTA_RST = "RST0";
  parameter REG_INPUTB_CLK = "NONE", REG_INPUTB_CE = "CE0", REG_INPUTB_RST = "RST0";
  parameter REG_PIPELINE_CLK = "NONE", REG_PIPELINE_CE = "CE0", REG_PIPELINE_RST = "RST0";
  parameter REG_OUTPUT_CLK = "NONE", REG_OUTPUT_CE = "CE0", REG_OUTPUT_RST = "RST0";
  wire [17:0] a = {@A@}, b = {@B@};
  reg [17:0] a_in, b_in;
  reg [35:0] pipeline, p;
  wire [17:0] a_now = REG_INPUTA_CLK == "CLK0" ? a_in : a, b_now = REG_INPUTB_CLK == "CLK0" ? b_in : b;
  wire [35:0] product = {{18{SIGNEDA & a_now[17]}}, a_now} * {{18{SIGNEDB & b_now[17]}}, b_now};
  wire [35:0] product_now = REG_PIPELINE_CLK == "CLK0" ? pipeline : product;
  always @(posedge CLK0) if (CE0) begin a_in <= a; b_in <= b; pipeline <= product; p <= product_now; end
  assign {@P@} = REG_OUTPUT_CLK == "CLK0" ? p : product_now;
endmodule
""".replace("@A@", _listed("A", 18)).replace("@B@", _listed("B", 18)).replace("@P@", _listed("P", 36))
