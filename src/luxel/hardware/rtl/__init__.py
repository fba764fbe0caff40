"""The hardware colour interpolator (2016) as a circuit in Amaranth: the only importer of amaranth. Needs the extra `hdl`.

`pipeline` has the way operators are put together, `streams` the valid/ready streams around them; `product` and `floats` are arithmetic;
`area`, `reciprocal`, `scan`, `barycentric` and `color` the paper's five modules, `whole` all of them; `simulate`, `cxx` and `verilog` run it
and write it down.
"""

from luxel.errors import ExtraMissingError

try:
    import amaranth  # noqa: F401
except ImportError as missing:
    raise ExtraMissingError("amaranth", "hdl", "the hardware interpolator's circuit") from missing
