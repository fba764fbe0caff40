"""Vectors in LLVM's instructions: the steps that kernels written in them share (`raster.lanes`, `raster.rows`, `filter.vectors`).

`data` is a pointer to the elements of an array, `index` a place in it. Vectors begin at any element. LLVM lowers any width to what the machine has.
"""

from __future__ import annotations

from typing import Any

from luxel.jit import ir

FLOAT, DOUBLE, INT, BIT, LONG = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(1), ir.IntType(64)
_BYTES = {str(FLOAT): 4, str(DOUBLE): 8, str(INT): 4}


def splat(builder: Any, value: Any, vector: Any) -> Any:
    """A vector of one value."""
    nothing = ir.Constant(vector, ir.Undefined)
    one = builder.insert_element(nothing, value, ir.Constant(INT, 0))
    return builder.shuffle_vector(one, nothing, ir.Constant(ir.VectorType(INT, vector.count), [0] * vector.count))


def load(builder: Any, data: Any, index: Any, vector: Any) -> Any:
    """The vector from element `index` on."""
    loaded = builder.load(_place(builder, data, index, vector))
    loaded.align = _bytes(vector)
    return loaded


def store(builder: Any, value: Any, data: Any, index: Any) -> None:
    """Store a vector from element `index` on."""
    builder.store(value, _place(builder, data, index, value.type), align=_bytes(value.type))


def store_where(builder: Any, mask: Any, value: Any, data: Any, index: Any) -> None:
    """Store the lanes of a vector where `mask`, and leave alone (unread, unwritten) what lies in the others."""
    vector = value.type
    kind = ir.FunctionType(ir.VoidType(), [vector, vector.as_pointer(), INT, mask.type])
    function = _function(builder, f"llvm.masked.store.{_spelt(vector)}.p0", kind)
    builder.call(function, [value, _place(builder, data, index, vector), ir.Constant(INT, _bytes(vector)), mask])


def multiply_add(builder: Any, a: Any, b: Any, c: Any) -> Any:
    """a * b + c, fused where the machine can."""
    vector = a.type
    return builder.call(_function(builder, f"llvm.fmuladd.{_spelt(vector)}", ir.FunctionType(vector, [vector] * 3)), [a, b, c])


def _place(builder: Any, data: Any, index: Any, vector: Any) -> Any:
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _bytes(vector: Any) -> int:
    return _BYTES[str(vector.element)]


def _spelt(vector: Any) -> str:
    """As LLVM names its functions for vectors: v16f32."""
    letter = "i" if isinstance(vector.element, ir.IntType) else "f"
    return f"v{vector.count}{letter}{8 * _bytes(vector)}"


def _function(builder: Any, name: str, kind: Any) -> Any:
    return builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
