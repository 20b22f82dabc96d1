"""What numba is told of functions of numbers of lanes (`lanes.py`): operators, Python's and math's functions, ours.

They are asked before those of single numbers (`call_types.py`): a whole number of each lane could be taken for one,
where all lanes agree.
"""

import math
import operator
from collections.abc import Callable
from itertools import product
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin
from numba.np import numpy_support
from numba.np.arrayobj import populate_array

from relnav.codegen.lanes import (
    BITS,
    DIVIDED,
    DOUBLES,
    INT,
    LONG,
    LONGS,
    VECTORS,
    LaneType,
    agreed_bit,
    as_bits,
    common,
    each,
    lane_kind,
    of_lanes,
)
from relnav.codegen.together import RUNS, anywhere, attempt, held, lanes_of, select

Kinds = Callable[[Any], Any]
"""From the types of inputs that of all of them, as the code wants them, and that of the result; or None."""
Write = Callable[[Any, Any, Any, Any], Any]
"""Code for a context, a builder, the type of the inputs, and the inputs."""


class _Template(AbstractTemplate):
    of_lanes = True


def _same(kinds: Any) -> Any:
    number = common(kinds)
    return None if number is None else (number, number)


def _real(kinds: Any) -> Any:
    return None if common(kinds) is None else (DOUBLES, DOUBLES)


def _rounding(kinds: Any) -> Any:
    return None if common(kinds) is None else (DOUBLES, LONGS)


def _compared(kinds: Any) -> Any:
    number = common(kinds)
    return None if number is None else (number, BITS)


def _whole(kinds: Any) -> Any:
    return (LONGS, LONGS) if common(kinds) == LONGS else None


def _logical(kinds: Any) -> Any:
    if all(kind == BITS or isinstance(kind, types.Boolean) for kind in kinds):
        return BITS, BITS
    return _whole(kinds)


def _negation(kinds: Any) -> Any:
    return (BITS, BITS) if kinds == (BITS,) else None


def _decision(kinds: Any) -> Any:
    return (BITS, types.boolean) if kinds == (BITS,) else None


def _function(name: Any, kinds_of: Kinds, write: Write) -> None:
    """Tell numba of a function of one to three numbers, some of them of lanes."""

    @infer_global(name)
    class Template(_Template):
        key = name

        def generic(self, arguments: Any, keywords: Any) -> Any:
            if keywords or not any(isinstance(kind, LaneType) for kind in arguments):
                return None
            found = kinds_of(arguments)
            return None if found is None else signature(found[1], *[found[0]] * len(arguments))

    for kind, count in product(VECTORS, (1, 2, 3)):

        @lower_builtin(name, *[kind] * count)
        def lower(context: Any, builder: Any, signed: Any, inputs: Any) -> Any:
            return write(context, builder, signed.args[0], inputs)


def _instruction(of_doubles: str, of_longs: str) -> Write:
    return lambda _context, builder, kind, inputs: getattr(builder, of_doubles if kind == DOUBLES else of_longs)(
        *inputs
    )


def _comparison(sign: str) -> Write:
    def write(_context: Any, builder: Any, kind: Any, inputs: Any) -> Any:
        if kind == LONGS:
            return builder.icmp_signed(sign, *inputs)
        return (builder.fcmp_unordered if sign == "!=" else builder.fcmp_ordered)(sign, *inputs)

    return write


def _of_vectors(name: str) -> Write:
    """One of LLVM's own functions."""

    def write(_context: Any, builder: Any, kind: Any, inputs: Any) -> Any:
        shape = ir.FunctionType(VECTORS[kind], [VECTORS[kind]] * len(inputs))
        function = cgutils.get_or_insert_function(builder.module, shape, f"llvm.{name}.v{RUNS}f64")
        return builder.call(function, inputs)

    return write


def _rounded(name: str) -> Write:
    """`math.floor` and its kin: their results are whole numbers."""
    real = _of_vectors(name)
    return lambda context, builder, kind, inputs: builder.fptosi(real(context, builder, kind, inputs), VECTORS[LONGS])


def _by_lane(function: Any) -> Write:
    """A function of numba's own, called for one lane after the other."""

    def write(context: Any, builder: Any, kind: Any, inputs: Any) -> Any:
        number = types.float64 if kind == DOUBLES else types.int64
        called = context.get_function(function, signature(number, *[number] * len(inputs)))
        return each(builder, lambda *values: called(builder, values), *inputs)

    return write


def _absolute(context: Any, builder: Any, kind: Any, inputs: Any) -> Any:
    if kind == DOUBLES:
        return _of_vectors("fabs")(context, builder, kind, inputs)
    negative = builder.icmp_signed("<", inputs[0], ir.Constant(VECTORS[LONGS], [0] * RUNS))
    return builder.select(negative, builder.neg(inputs[0]), inputs[0])


def _extreme(sign: str) -> Write:
    """`max` and `min`: where one of two is no number, the first, as in Python."""

    def write(_context: Any, builder: Any, kind: Any, inputs: Any) -> Any:
        compare, best = builder.fcmp_ordered if kind == DOUBLES else builder.icmp_signed, inputs[0]
        for other in inputs[1:]:
            best = builder.select(compare(sign, other, best), other, best)
        return best

    return write


def _decided(context: Any, builder: Any, _kind: Any, inputs: Any) -> Any:
    return agreed_bit(context, builder, inputs[0])


for _names, _instructions in (
    ((operator.add, operator.iadd), ("fadd", "add")),
    ((operator.sub, operator.isub), ("fsub", "sub")),
    ((operator.mul, operator.imul), ("fmul", "mul")),
):
    for _name in _names:
        _function(_name, _same, _instruction(*_instructions))
for _name in (operator.truediv, operator.itruediv):
    _function(_name, _real, _instruction("fdiv", "fdiv"))
for _name in (operator.mod, operator.floordiv):
    _function(_name, _whole, _by_lane(_name))
for _called, _sign in (("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "=="), ("ne", "!=")):
    _function(getattr(operator, _called), _compared, _comparison(_sign))
for _called, _sign in (("and_", "and_"), ("iand", "and_"), ("or_", "or_"), ("ior", "or_")):
    _function(getattr(operator, _called), _logical, _instruction(_sign, _sign))
_function(operator.not_, _negation, lambda _context, builder, _kind, inputs: builder.not_(*inputs))
_function(operator.neg, _same, _instruction("fneg", "neg"))
_function(abs, _same, _absolute)
_function(max, _same, _extreme(">"))
_function(min, _same, _extreme("<"))
_function(math.sqrt, _real, _of_vectors("sqrt"))
_function(math.fabs, _real, _of_vectors("fabs"))
_function(math.floor, _rounding, _rounded("floor"))
_function(math.ceil, _rounding, _rounded("ceil"))
for _of_math in ("log", "exp", "sin", "cos", "acos", "atan2"):
    _function(getattr(math, _of_math), _real, _by_lane(getattr(math, _of_math)))
_function(bool, _decision, _decided)
_function(int, _rounding, lambda _context, builder, _kind, inputs: builder.fptosi(*inputs, VECTORS[LONGS]))
_function(float, _real, lambda _context, _builder, _kind, inputs: inputs[0])


@infer_global(operator.pow)
class _Power(_Template):
    key = operator.pow

    def generic(self, arguments: Any, _keywords: Any) -> Any:
        base, exponent = arguments
        known = base == DOUBLES and isinstance(exponent, types.IntegerLiteral) and exponent.literal_value > 0
        return signature(DOUBLES, DOUBLES, exponent) if known else None


@lower_builtin(operator.pow, DOUBLES, types.IntegerLiteral)
def _power(_context: Any, builder: Any, signed: Any, inputs: Any) -> Any:
    value, exponent, result = inputs[0], signed.args[1].literal_value, None
    while exponent:  # by squaring, as numba does for single numbers
        if exponent & 1:
            result = value if result is None else builder.fmul(result, value)
        exponent >>= 1
        value = builder.fmul(value, value)
    return result


@infer_global(range)
class _Range(_Template):
    key = range

    def generic(self, arguments: Any, _keywords: Any) -> Any:
        if not any(kind == LONGS for kind in arguments):
            return None
        return signature(types.range_state64_type, *[types.int64] * len(arguments))


def _agreed_index(index: Any) -> Any:
    """An index where every number of lanes has become one; None if there is none in it."""
    if index == LONGS:
        return types.int64
    if isinstance(index, types.BaseTuple) and any(kind == LONGS for kind in index):
        return types.Tuple([types.int64 if kind == LONGS else kind for kind in index])
    return None


def _indexed(name: Any) -> None:
    @infer_global(name)
    class Template(_Template):
        key = name

        def generic(self, arguments: Any, _keywords: Any) -> Any:
            array, index, *value = arguments
            agreed = _agreed_index(index)
            if agreed is None or not isinstance(array, types.Array):
                return None
            if name is operator.getitem and index == LONGS and array.ndim == 1 and array.dtype == DOUBLES:
                return signature(DOUBLES, array, LONGS)
            return self.context.resolve_function_type(name, (array, agreed, *value), {})


_indexed(operator.getitem)
_indexed(operator.setitem)


@lower_builtin(operator.getitem, types.Array, LONGS)
def _gathered(context: Any, builder: Any, signed: Any, inputs: Any) -> Any:
    """Each lane's number of an array (n,), where it has an index of its own."""
    array = context.make_array(signed.args[0])(context, builder, inputs[0])
    (size,), (stride,) = cgutils.unpack_tuple(builder, array.shape), cgutils.unpack_tuple(builder, array.strides)
    first = builder.bitcast(array.data, ir.IntType(8).as_pointer())

    def one(index: Any, lane: Any) -> Any:
        from_end = builder.icmp_signed("<", index, LONG(0))
        place = builder.mul(builder.select(from_end, builder.add(index, size), index), stride)
        number = builder.gep(first, [builder.add(place, lane)])
        return builder.load(builder.bitcast(number, ir.DoubleType().as_pointer()))

    lanes = ir.Constant(VECTORS[LONGS], [8 * lane for lane in range(RUNS)])
    return each(builder, one, inputs[1], lanes)


@infer_global(select)
class _Select(_Template):
    key = select

    def generic(self, arguments: Any, _keywords: Any) -> Any:
        condition, *values = arguments
        if condition == BITS or any(map(of_lanes, values)):
            number = common(values)
            return None if number is None else signature(number, BITS, number, number)
        number = self.context.unify_types(*values)
        return signature(number, types.boolean, number, number)


@lower_builtin(select, types.Any, types.Any, types.Any)
def _lower_select(_context: Any, builder: Any, _signed: Any, inputs: Any) -> Any:
    return builder.select(*inputs)


@infer_global(anywhere)
class _Anywhere(_Template):
    key = anywhere

    def generic(self, arguments: Any, _keywords: Any) -> Any:
        return signature(types.boolean, *arguments)


@lower_builtin(anywhere, types.Any)
def _lower_anywhere(_context: Any, builder: Any, signed: Any, inputs: Any) -> Any:
    if signed.args[0] != BITS:
        return inputs[0]
    bits = as_bits(builder, inputs[0])
    return builder.icmp_unsigned("!=", bits, bits.type(0))


@infer_global(held)
class _Held(_Template):
    key = held

    def generic(self, arguments: Any, _keywords: Any) -> Any:
        return signature(BITS if arguments[0] == BITS else types.literal(True), *arguments)


@lower_builtin(held, types.Any)
def _lower_held(context: Any, _builder: Any, signed: Any, inputs: Any) -> Any:
    return inputs[0] if signed.args[0] == BITS else context.get_constant(types.boolean, True)


@infer_global(lanes_of)
class _LanesOf(_Template):
    key = lanes_of

    def generic(self, arguments: Any, _keywords: Any) -> Any:
        (array,) = arguments
        return signature(types.Array(lane_kind(numpy_support.as_dtype(array.dtype)), array.ndim - 1, "C"), array)


@lower_builtin(lanes_of, types.Array)
def _lower_lanes_of(context: Any, builder: Any, signed: Any, inputs: Any) -> Any:
    kind = signed.return_type
    given = context.make_array(signed.args[0])(context, builder, inputs[0])
    made = context.make_array(kind)(context, builder)
    data = builder.bitcast(given.data, VECTORS[kind.dtype].as_pointer())
    shape, strides = (cgutils.unpack_tuple(builder, whole)[:-1] for whole in (given.shape, given.strides))
    populate_array(made, data=data, shape=shape, strides=strides, itemsize=LONG(8 * RUNS), meminfo=None)
    return made._getvalue()


def _inner(function: Any) -> Any:
    """A kernel as other kernels see it, of which no finished code is shared."""
    return getattr(function.dispatcher, "inner", function.dispatcher)


@infer_global(attempt)
class _Attempt(_Template):
    key = attempt

    def generic(self, arguments: Any, _keywords: Any) -> Any:
        function, *kinds = arguments
        called = types.Dispatcher(_inner(function)).get_call_type(self.context, tuple(kinds), {})
        return signature(types.Tuple((types.int64, called.return_type)), function, *called.args)


@lower_builtin(attempt, types.VarArg(types.Any))
def _lower_attempt(context: Any, builder: Any, signed: Any, inputs: Any) -> Any:
    function, *kinds = signed.args
    compiled = _inner(function).overloads[tuple(kinds)]
    called = signature(signed.return_type[1], *kinds)
    context.add_linking_libs([compiled.library])
    status, value = context.call_internal_no_propagate(builder, compiled.fndesc, called, inputs[1:])
    divided = builder.sext(builder.sub(INT(DIVIDED), status.code), LONG)
    return context.make_tuple(builder, signed.return_type, (builder.select(status.is_ok, LONG(0), divided), value))
