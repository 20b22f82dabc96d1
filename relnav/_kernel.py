"""The one file that imports numba: `kernel` compiles a function of plain scalar loops, or leaves it plain Python.

`RELNAV_JIT=0` in the environment runs the same lines as plain Python (debugging, coverage, and the test that
compiled and plain results agree). Compiled code is cached beside the source, in the user's cache folder when the
install is read-only, and not at all when neither can be written. A compiled function holds the code of all it calls,
but numba stamps its cache with the defining file alone; here the stamp is the content of the whole package, so that a
changed callee is never run in its old form.
"""

import os
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from relnav._cache import package_stamp
from relnav._trace import Shape, Trace

P = ParamSpec("P")
R = TypeVar("R")

# Kernels work on the memory that they are given: without reference counts (_nrt) they are a quarter faster.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False, "boundscheck": False, "_nrt": False}


def _numba_njit() -> Any | None:
    """Numba's compiler, or None when it is switched off or cannot be imported."""
    if os.environ.get("RELNAV_JIT", "1") == "0":
        return None
    try:
        from numba import njit
    except ImportError as error:
        warnings.warn(
            f"numba cannot be imported ({error}): relnav runs as plain Python, about a hundred times slower",
            RuntimeWarning,
            stacklevel=3,
        )
        return None
    return njit


_NJIT = _numba_njit()
_STAMP = package_stamp() if _NJIT is not None else ""
_CACHE = True


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a scalar-loop function on its first call; without numba, return it as it is."""
    global _CACHE  # noqa: PLW0603  (one switch for the process: the first refusal settles it, with one warning)
    if _NJIT is None:
        return function
    if _CACHE:
        try:
            compiled = _NJIT(cache=True, **_OPTIONS)(function)
            compiled._cache._cache_file._source_stamp = _STAMP
            cached: Callable[P, R] = compiled
            return cached
        except RuntimeError as error:
            _CACHE = False
            warnings.warn(
                f"no folder for compiled code can be written ({error}): relnav compiles anew in every process; "
                "set NUMBA_CACHE_DIR to a writable folder",
                RuntimeWarning,
                stacklevel=2,
            )
    uncached: Callable[P, R] = _NJIT(**_OPTIONS)(function)
    return uncached


def is_compiled() -> bool:
    """Whether kernels run compiled in this process."""
    return _NJIT is not None


@kernel
def select(condition: bool, a: float, b: float) -> float:
    """`a` where the condition holds, else `b`: a choice without a branch, for `straight_line` functions."""
    return a if condition else b


@kernel
def quotient(a: float, b: float, otherwise: float) -> float:
    """Divide a by b where b > 0, else `otherwise`: a division without a branch, for `straight_line` functions."""
    return a / b if b > 0.0 else otherwise


def only_for(function: Callable[P, R], *arguments: Any) -> Callable[P, R]:
    """A kernel for arguments of the types of these and no others: another call then raises TypeError at once."""
    if _NJIT is not None:
        from numba import typeof

        dispatcher: Any = function
        if not dispatcher.signatures:
            dispatcher.compile(tuple(typeof(argument) for argument in arguments))
        dispatcher.disable_compile()
    return function


STRAIGHT_LINES: dict[Callable[..., Any], dict[str, Shape]] = {}
"""Every straight-line function with the shapes of its arrays: a test holds them equal to their plain Python."""


def straight_line(**shapes: Shape) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function whose branches do not depend on its numbers into straight-line code, when a kernel calls it.

    shapes names every array argument with its size or its pattern of known zeros and ones (`_trace.Shape`); the other
    arguments are floats. It may call functions of its kind, `math.sqrt`, `math.atan2`, `select`, `quotient`, and
    `np.zeros` for scratch. All inputs are read before anything is written. Called from Python it runs as it stands.
    """

    def register(function: Callable[P, R]) -> Callable[P, R]:
        STRAIGHT_LINES[function] = shapes
        if _NJIT is not None:
            _register(function, shapes)
        return function

    return register


def _register(function: Callable[..., Any], shapes: dict[str, Shape]) -> None:
    from numba import types
    from numba.core.typing.templates import AbstractTemplate, infer_global, signature
    from numba.extending import lower_builtin

    traces: list[Trace] = []

    def the_trace() -> Trace:
        if not traces:
            traces.append(Trace(function, shapes))
        return traces[0]

    class Template(AbstractTemplate):  # type: ignore[misc]
        key = function

        def generic(self, arguments: Any, _keywords: Any) -> Any:
            trace = the_trace()
            kinds = [types.boolean if trace.is_condition(place) else types.float64 for place in trace.returns]
            result = types.none if not kinds else kinds[0] if trace.single else types.Tuple(kinds)
            return signature(result, *arguments)

    infer_global(function, types.Function(Template))

    @lower_builtin(function, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
    def lower(context: Any, builder: Any, signed: Any, arguments: Any) -> Any:
        results = _emit(the_trace(), context, builder, signed.args, arguments)
        if not results:
            return context.get_dummy_value()
        if the_trace().single:
            return results[0]
        return context.make_tuple(builder, signed.return_type, results)


def _emit(trace: Trace, context: Any, builder: Any, kinds: Any, arguments: Any) -> list[Any]:
    """Write the operations of a trace as LLVM instructions: all loads before all stores; returns the results."""
    from llvmlite import ir
    from numba import types
    from numba.core import cgutils

    double, byte = ir.DoubleType(), ir.IntType(8)
    values: dict[int, Any] = {}
    arrays: dict[int, Any] = {}

    def pointer(k: int, index: tuple[int, ...]) -> Any:
        if k not in arrays:
            array = context.make_array(kinds[k])(context, builder, arguments[k])
            arrays[k] = builder.bitcast(array.data, byte.as_pointer()), cgutils.unpack_tuple(builder, array.strides)
        base, strides = arrays[k]
        size = ir.Constant(ir.IntType(64), 8 * index[-1])
        for i, stride in zip(index[:-1], strides[:-1], strict=True):
            size = builder.add(size, builder.mul(stride, ir.Constant(ir.IntType(64), i)))
        return builder.bitcast(builder.gep(base, [size]), double.as_pointer())

    def node_value(node: tuple[Any, ...]) -> Any:
        name, operands = node[0], node[1:]
        if name == "argument":
            return context.cast(builder, arguments[operands[0]], kinds[operands[0]], types.float64)
        if name == "entry":
            return builder.load(pointer(operands[0], operands[1:]))
        if name == "constant":
            return ir.Constant(double, operands[0])
        inputs = [values[place] for place in operands]
        if name in ("<", "<=", ">", ">="):
            return builder.fcmp_ordered(name, *inputs)
        if name in ("sqrt", "abs"):
            called = {"sqrt": "llvm.sqrt", "abs": "llvm.fabs"}[name]
            return builder.call(builder.module.declare_intrinsic(called, [double]), inputs)
        if name in ("fma", "fnma", "fms"):
            a, b, c = inputs
            a = builder.fneg(a) if name == "fnma" else a
            c = builder.fneg(c) if name == "fms" else c
            return builder.fma(a, b, c)
        if name == "atan2":
            kind = ir.FunctionType(double, [double, double])
            return builder.call(cgutils.get_or_insert_function(builder.module, kind, "atan2"), inputs)
        written = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "negative": "fneg", "and": "and_"}
        return getattr(builder, written.get(name, name))(*inputs)

    for place in trace.needed():
        values[place] = node_value(trace.nodes[place])
    for k, index, place in trace.stores:
        builder.store(values[place], pointer(k, index))
    return [values[place] for place in trace.returns]
