"""What numba is told of straight-line functions: what a call of one yields, and the code to write for it."""

import inspect
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin

from relnav.codegen import lane_functions  # noqa: F401  (tells numba of them)
from relnav.codegen.lanes import BITS, DOUBLES, of_lanes
from relnav.codegen.machine_code import emit, emit_side_by_side
from relnav.codegen.trace import LANES, Trace

TraceOf = Callable[[int], Trace]
"""The trace of a function for n states; n = 0 where it does not depend on them."""


def register(
    name: Any, function: Callable[..., Any], sized: list[str], default: int, trace_of: TraceOf, split: frozenset[int]
) -> None:
    """Tell numba of a straight-line function, which kernels call by `name`.

    sized: its arrays whose shapes depend on the number of states; default: that number where no argument tells; split:
    the arguments that are arrays of LANES cases side by side.
    """
    names = list(inspect.signature(function).parameters)

    def the_trace(kinds: Any) -> Trace:
        places = [names.index(one) for one in sized]
        known = [kinds[k].shape[-1] for k in places if isinstance(kinds[k], types.NestedArray)]
        return trace_of(0 if not places else known[0] if known else default)

    class Template(AbstractTemplate):
        key = name

        def generic(self, arguments: Any, _keywords: Any) -> Any:
            trace = the_trace(arguments)
            for k in split:
                if arguments[k].layout != "C":
                    raise TypeError(f"argument {k + 1} of {function.__name__} side by side has gaps")
            number, condition = (DOUBLES, BITS) if any(map(of_lanes, arguments)) else (types.float64, types.boolean)
            kinds = [condition if trace.is_condition(place) else number for place in trace.returns]
            result = types.none if not kinds else kinds[0] if trace.single else types.Tuple(kinds)
            return signature(result, *arguments)

    infer_global(name, types.Function(Template))

    @lower_builtin(name, types.VarArg(types.Any))
    def lower(context: Any, builder: Any, signed: Any, arguments: Any) -> Any:
        trace = the_trace(signed.args)
        results = _write(trace, context, builder, signed.args, arguments, split)
        if not results:
            return context.get_dummy_value()
        if trace.single:
            return results[0]
        return context.make_tuple(builder, signed.return_type, results)


def _write(trace: Trace, context: Any, builder: Any, kinds: Any, arguments: Any, split: frozenset[int]) -> list[Any]:
    """Write a trace's code for arguments of numba's kinds."""
    byte, word = ir.IntType(8), ir.IntType(64)
    number = DOUBLES if any(map(of_lanes, kinds)) else types.float64
    arrays: dict[int, Any] = {}

    def array(k: int) -> Any:
        if k not in arrays:
            made = context.make_array(kinds[k])(context, builder, arguments[k])
            arrays[k] = builder.bitcast(made.data, byte.as_pointer()), cgutils.unpack_tuple(builder, made.strides)
        return arrays[k]

    def address(k: int, index: tuple[int, ...]) -> Any:
        base, strides = array(k)
        entry = context.get_value_type(kinds[k].dtype)
        size = ir.Constant(word, context.get_abi_sizeof(entry) * index[-1])
        for i, stride in zip(index[:-1], strides[:-1], strict=True):
            size = builder.add(size, builder.mul(stride, ir.Constant(word, i)))
        return builder.bitcast(builder.gep(base, [size]), entry.as_pointer())

    numbers = [
        None if isinstance(kind, types.Array) else context.cast(builder, argument, kind, number)
        for kind, argument in zip(kinds, arguments, strict=True)
    ]
    if not split:
        return emit(trace, builder, numbers, address, context.get_value_type(number))
    lanes = {
        k: [builder.gep(array(k)[0], [ir.Constant(word, 8 * trace.size(k) * lane)]) for lane in range(LANES)]
        for k in split
    }
    emit_side_by_side(trace, builder, numbers, address, lanes)
    return []
