"""Numbers of which RUNS stand side by side, as numba's types: of a run each, in its lane (`together.py`).

A kernel is compiled for them of the same lines as for single numbers, one instruction for all lanes, and each lane is
rounded as when it is alone. Where the lines decide by such a number (`if`, `while`, an index, the length of a loop) all
lanes must decide alike. Where they do not, the call returns at once with a status of its own (`agreed_bit`), and so do
those that called it, up to `attempt`.

In memory the lanes of a number are neighbours: what is a double elsewhere is RUNS of them. A record, or a memory
(`memory_views.py`), is as for single numbers, RUNS times as large.
"""

from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typeconv import Conversion
from numba.extending import lower_cast, register_model
from numba.np import numpy_support

from relnav.codegen.together import RUNS

LONG, INT = ir.IntType(64), ir.IntType(32)
DIVIDED = -8
"""Less the lanes, as bits, for which a condition held: what a call returns where it did not hold for all. Numba's own
codes are above."""


class LaneType(types.Type):
    """A number of each lane: "double", "long" or "bit" (a truth value)."""

    def __init__(self, of: str) -> None:
        self.of, self.bitwidth = of, 64 * RUNS
        super().__init__(name=f"{of} of {RUNS} lanes")

    def unify(self, _context: Any, other: Any) -> Any:
        """What may be either: where all lanes have the same number it is one of each lane, too."""
        if self.of == "bit":
            return BITS if isinstance(other, types.Boolean) else None
        return common((self, other))

    def can_convert_from(self, _context: Any, other: Any) -> Any:
        """From what it can be made."""
        if self.of == "bit":
            return Conversion.promote if isinstance(other, types.Boolean) else None
        return Conversion.promote if common((self, other)) == self else None

    def can_convert_to(self, _context: Any, other: Any) -> Any:
        """An index, or the length of a loop: where all lanes agree."""
        return Conversion.unsafe if self.of == "long" and isinstance(other, types.Integer) else None


DOUBLES, LONGS, BITS = LaneType("double"), LaneType("long"), LaneType("bit")
VECTORS = {
    DOUBLES: ir.VectorType(ir.DoubleType(), RUNS),
    LONGS: ir.VectorType(LONG, RUNS),
    BITS: ir.VectorType(ir.IntType(1), RUNS),
}


def is_real(kind: Any) -> bool:
    """Whether a number is a double, or one of each lane."""
    return isinstance(kind, types.Float) or kind == DOUBLES


def common(kinds: Any) -> Any:
    """The numbers of lanes that numbers can all become; None for what is no number."""
    if not all(is_real(kind) or kind == LONGS or isinstance(kind, types.Integer | types.Boolean) for kind in kinds):
        return None
    return DOUBLES if any(map(is_real, kinds)) else LONGS


def of_lanes(kind: Any) -> bool:
    """Whether a number, or an array's entries, are of lanes."""
    return isinstance(getattr(kind, "dtype", kind), LaneType)


@register_model(LaneType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: LaneType) -> None:
        super().__init__(manager, kind, VECTORS[kind])


class LaneRecord(types.Record):
    """A record of which every number is one of each lane."""

    def __init__(self, dtype: Any) -> None:
        self.fields = {}
        for name, (kind, offset, *_) in dtype.fields.items():
            self.fields[name] = types.npytypes._RecordField(lane_kind(kind), offset * RUNS, None, None)
        self.size, self.aligned, self.bitwidth = dtype.itemsize * RUNS, True, dtype.itemsize * RUNS * 8
        types.Type.__init__(self, name=f"{numpy_support.from_dtype(dtype).name} of {RUNS} lanes")


register_model(LaneRecord)(models.RecordModel)


@cache
def lane_kind(dtype: Any) -> Any:
    """Type of a number, a record, or an array of them inside a record, of all lanes."""
    if dtype.subdtype is not None:
        base, shape = dtype.subdtype
        return types.NestedArray(lane_kind(base), shape)
    if dtype.fields:
        return LaneRecord(dtype)
    return {np.dtype(np.float64): DOUBLES, np.dtype(np.int64): LONGS}[dtype]


def spread(builder: Any, value: Any) -> Any:
    """One value in every lane."""
    undefined = ir.Constant(ir.VectorType(value.type, RUNS), ir.Undefined)
    one = builder.insert_element(undefined, value, INT(0))
    return builder.shuffle_vector(one, undefined, ir.Constant(ir.VectorType(INT, RUNS), [0] * RUNS))


def each(builder: Any, make: Any, *vectors: Any) -> Any:
    """A vector of what is made of the entries of vectors, lane by lane."""
    made = [make(*(builder.extract_element(vector, INT(lane)) for vector in vectors)) for lane in range(RUNS)]
    result = ir.Constant(ir.VectorType(made[0].type, RUNS), ir.Undefined)
    for lane, value in enumerate(made):
        result = builder.insert_element(result, value, INT(lane))
    return result


def as_bits(builder: Any, condition: Any) -> Any:
    """The lanes for which a condition holds, as bits of a number."""
    return builder.bitcast(condition, ir.IntType(RUNS))


def agreed_bit(context: Any, builder: Any, condition: Any) -> Any:
    """The truth value on which all lanes agree; where they do not, the function that is written here returns."""
    bits = as_bits(builder, condition)
    every, none = (builder.icmp_unsigned("==", bits, bits.type(value)) for value in (2**RUNS - 1, 0))
    with cgutils.if_unlikely(builder, builder.not_(builder.or_(every, none))):
        context.call_conv._return_errcode_raw(builder, builder.sub(INT(DIVIDED), builder.zext(bits, INT)))
    return every


@lower_cast(types.Float, DOUBLES)
@lower_cast(types.Integer, DOUBLES)
@lower_cast(types.Boolean, DOUBLES)
def _to_doubles(context: Any, builder: Any, kind: Any, _lanes: Any, value: Any) -> Any:
    return spread(builder, context.cast(builder, value, kind, types.float64))


@lower_cast(types.Integer, LONGS)
@lower_cast(types.Boolean, LONGS)
def _to_longs(context: Any, builder: Any, kind: Any, _lanes: Any, value: Any) -> Any:
    return spread(builder, context.cast(builder, value, kind, types.int64))


@lower_cast(types.Boolean, BITS)
def _to_bits(_context: Any, builder: Any, _kind: Any, _lanes: Any, value: Any) -> Any:
    return spread(builder, value)


@lower_cast(LONGS, DOUBLES)
def _longs_to_doubles(_context: Any, builder: Any, _kind: Any, _lanes: Any, value: Any) -> Any:
    return builder.sitofp(value, VECTORS[DOUBLES])


@lower_cast(LONGS, types.Integer)
def _agreed_long(context: Any, builder: Any, _lanes: Any, kind: Any, value: Any) -> Any:
    first = builder.extract_element(value, INT(0))
    agreed_bit(context, builder, builder.icmp_signed("==", value, spread(builder, first)))
    return context.cast(builder, first, types.int64, kind)


@lower_cast(BITS, types.Boolean)
def _agreed(context: Any, builder: Any, _lanes: Any, _kind: Any, value: Any) -> Any:
    return agreed_bit(context, builder, value)
