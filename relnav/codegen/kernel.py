"""The one file that imports numba: `kernel` compiles a function of plain scalar loops, or leaves it plain Python.

`RELNAV_JIT=0` in the environment runs the same lines as plain Python (debugging, coverage, and the test that
compiled and plain results agree). Compiled code is cached beside the source, in the user's cache folder when the
install is read-only, and not at all when neither can be written. A compiled function holds the code of all it calls,
but numba stamps its cache with the defining file alone; here the stamp is the content of the whole package, so that a
changed callee is never run in its old form.
"""

import inspect
import os
import warnings
from collections.abc import Callable
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

from relnav.codegen.cache import package_stamp
from relnav.codegen.trace import LANES, Shape, Trace

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
    return _compiled(function, shared=False)


def long_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that runs for long when Python calls it: other threads run meanwhile (the lock is released)."""
    return _compiled(function, shared=False, nogil=True)


def entry(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that both Python and other kernels call: it is finished and cached once for all of them."""
    return _compiled(function, shared=True)


def _compiled(function: Callable[P, R], *, shared: bool, **options: bool) -> Callable[P, R]:
    global _CACHE  # noqa: PLW0603  (one switch for the process: the first refusal settles it, with one warning)
    if _NJIT is None:
        return function
    from relnav.codegen.whole_program import Outer

    compiled: Any = Outer(function, _OPTIONS | options, shared=shared)
    if _CACHE:
        try:
            compiled.enable_caching()
            compiled._cache._cache_file._source_stamp = _STAMP
        except RuntimeError as error:
            _CACHE = False
            warnings.warn(
                f"no folder for compiled code can be written ({error}): relnav compiles anew in every process; "
                "set NUMBA_CACHE_DIR to a writable folder",
                RuntimeWarning,
                stacklevel=3,
            )
    made: Callable[P, R] = compiled
    return made


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that is written out where it is called: for one that returns views of memory by name.

    From Python only `plain` of it can be called.
    """
    if _NJIT is None:
        return function
    put_in: Callable[P, R] = _NJIT(inline="always", **_OPTIONS)(function)
    return put_in


def plain(function: Callable[P, R]) -> Callable[P, R]:
    """The Python lines of a kernel."""
    lines: Callable[P, R] = getattr(function, "py_func", function)
    return lines


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


Sized = Callable[[int], Shape]
"""Shape of an array by the number of states n; its last axis has n entries."""

STRAIGHT_LINES: dict[Callable[..., Any], dict[str, Shape | Sized]] = {}
"""Every straight-line function with the shapes of its arrays: a test holds them equal to their plain Python."""

SIZES = (6, 12)
"""Numbers of states that filters have; where no argument tells (arrays from Python), it is the first."""


def vector(n: int) -> Shape:
    """(n,)."""
    return (n,)


def square(n: int) -> Shape:
    """(n, n)."""
    return (n, n)


def sizes_of(function: Callable[..., Any]) -> tuple[int, ...]:
    """Numbers of states for which a straight-line function is written out; (0,) if it does not depend on them."""
    return SIZES if any(callable(shape) for shape in STRAIGHT_LINES[function].values()) else (0,)


def shapes_of(function: Callable[..., Any], n: int) -> dict[str, Shape]:
    """Shapes of the arrays of a straight-line function for n states."""
    return {name: shape(n) if callable(shape) else shape for name, shape in STRAIGHT_LINES[function].items()}


def straight_line(**shapes: Shape | Sized) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Compile a function whose branches do not depend on its numbers into straight-line code, when a kernel calls it.

    shapes names every array argument with its size or its pattern of known zeros and ones (`trace.Shape`), or with a
    function that gives them for n states: n is then the last axis of the first such argument that is a field of a
    record, whose shape the compiler knows. The other arguments are floats. It may call functions of its kind,
    `math.sqrt`, `math.atan2`, `select`, `quotient`, and `np.zeros` for scratch. All inputs are read before anything is
    written. Called from Python it runs as it stands.
    """

    def register(function: Callable[P, R]) -> Callable[P, R]:
        STRAIGHT_LINES[function] = shapes
        if _NJIT is not None:
            _register(function)
        return function

    return register


def variant(function: Callable[P, R], name: str, **shapes: Shape | Sized) -> Callable[P, R]:
    """The same lines as another straight-line function, with other known zeros and ones in some of its arrays."""
    plain_function: Any = function
    made = FunctionType(plain_function.__code__, plain_function.__globals__, name, plain_function.__defaults__)
    made.__module__, made.__doc__ = plain_function.__module__, plain_function.__doc__
    registered: Callable[P, R] = straight_line(**(STRAIGHT_LINES[function] | shapes))(made)
    return registered


def side_by_side(function: Callable[..., None], *of_each: str) -> Callable[..., None]:
    """A straight-line function of LANES cases at once, one instruction for all, each rounded as when it is alone.

    The arrays named `of_each` have a leading dimension, (LANES, ...), and no gaps; the other arguments hold for all.
    """
    names = list(inspect.signature(function).parameters)
    split = frozenset(names.index(name) for name in of_each)

    def together(*arguments: Any) -> None:
        for lane in range(LANES):
            function(*(value[lane] if k in split else value for k, value in enumerate(arguments)))

    if _NJIT is not None:
        _register(function, together, split)
    return together


def _register(
    function: Callable[..., Any],
    together: Callable[..., None] | None = None,
    split: frozenset[int] = frozenset(),
) -> None:
    """Tell numba what code to write for a call of a straight-line function, or of its side-by-side form."""
    from numba import types
    from numba.core.typing.templates import AbstractTemplate, infer_global, signature
    from numba.extending import lower_builtin

    name: Any = together or function
    names = list(inspect.signature(function).parameters)
    traces: dict[int, Trace] = {}

    def the_trace(kinds: Any) -> Trace:
        sized = [names.index(one) for one, shape in STRAIGHT_LINES[function].items() if callable(shape)]
        known = [kinds[k].shape[-1] for k in sized if isinstance(kinds[k], types.NestedArray)]
        n = 0 if not sized else known[0] if known else SIZES[0]
        if n not in traces:
            traces[n] = Trace(function, shapes_of(function, n))
        return traces[n]

    class Template(AbstractTemplate):  # type: ignore[misc]  # numba has no types
        key = name

        def generic(self, arguments: Any, _keywords: Any) -> Any:
            trace = the_trace(arguments)
            for k in split:
                if arguments[k].layout != "C":
                    raise TypeError(f"argument {k + 1} of {function.__name__} side by side has gaps")
            kinds = [types.boolean if trace.is_condition(place) else types.float64 for place in trace.returns]
            result = types.none if not kinds else kinds[0] if trace.single else types.Tuple(kinds)
            return signature(result, *arguments)

    infer_global(name, types.Function(Template))

    @lower_builtin(name, types.VarArg(types.Any))  # type: ignore[untyped-decorator]  # numba has no types
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
    from llvmlite import ir
    from numba import types
    from numba.core import cgutils

    from relnav.codegen.machine_code import emit, emit_side_by_side

    double, byte, word = ir.DoubleType(), ir.IntType(8), ir.IntType(64)
    arrays: dict[int, Any] = {}

    def array(k: int) -> Any:
        if k not in arrays:
            made = context.make_array(kinds[k])(context, builder, arguments[k])
            arrays[k] = builder.bitcast(made.data, byte.as_pointer()), cgutils.unpack_tuple(builder, made.strides)
        return arrays[k]

    def address(k: int, index: tuple[int, ...]) -> Any:
        base, strides = array(k)
        size = ir.Constant(word, 8 * index[-1])
        for i, stride in zip(index[:-1], strides[:-1], strict=True):
            size = builder.add(size, builder.mul(stride, ir.Constant(word, i)))
        return builder.bitcast(builder.gep(base, [size]), double.as_pointer())

    numbers = [
        None if isinstance(kind, types.Array) else context.cast(builder, argument, kind, types.float64)
        for kind, argument in zip(kinds, arguments, strict=True)
    ]
    if not split:
        return emit(trace, builder, numbers, address)
    lanes = {
        k: [builder.gep(array(k)[0], [ir.Constant(word, 8 * trace.size(k) * lane)]) for lane in range(LANES)]
        for k in split
    }
    emit_side_by_side(trace, builder, numbers, address, lanes)
    return []
