"""The hardware colour interpolator (2016): a model, bit for bit, of a circuit that colours a triangle's fragments.

`float24` is its number format, `reciprocal` its division, `scan` its scan conversion, `interpolator` the whole. The circuit itself is in
`luxel.hardware.rtl` (`pip install 'luxel[hdl]'`).
"""
