"""Marks for functions of plain scalar loops: `kernel` and its kin compile them on the first call, or leave them plain.

Nothing is compiled, and numba is not imported, before a compiled function is needed that is not at hand
(`store`). `RELNAV_JIT=0` in the environment runs the same lines as plain Python (debugging, coverage, and the test that
compiled and plain results agree). What is compiled is kept under a stamp of the whole package's content, because a
compiled function holds the code of all it calls.
"""

import inspect
import logging
import os
import time
import warnings
from collections.abc import Callable
from functools import cache, cached_property, update_wrapper
from types import FunctionType
from typing import Any, ParamSpec, TypeVar, cast

from relnav.codegen import store
from relnav.codegen.trace import LANES, Shape, Trace

P = ParamSpec("P")
R = TypeVar("R")

_SWITCHED_ON = os.environ.get("RELNAV_JIT", "1") != "0"
_LOG = logging.getLogger("relnav")
OBJECT_HEADER = 16
"""Bytes in front of every object of CPython, as finished code knows them (`cpython`): builds without the interpreter's
lock, and for debugging, have more."""


@cache
def _compiler() -> Any | None:
    """The module that compiles, or None when it is switched off, or cannot be used here."""
    if not _SWITCHED_ON:
        return None
    if object.__basicsize__ != OBJECT_HEADER:
        warnings.warn(
            "this Python is built without the interpreter's lock or for debugging, and lays out its objects in another "
            "way than compiled code knows: relnav runs as plain Python, about a hundred times slower",
            RuntimeWarning,
            stacklevel=3,
        )
        return None
    try:
        from relnav.codegen import compiler
    except ImportError as error:
        warnings.warn(
            f"numba cannot be imported ({error}): relnav runs as plain Python, about a hundred times slower",
            RuntimeWarning,
            stacklevel=3,
        )
        return None
    return compiler


class Kernel:
    """A function of scalar loops; numba's form of it is made when Python or another kernel first needs it."""

    def __init__(self, function: Callable[..., Any], form: str = "kernel") -> None:
        """Take the plain lines; form: how it is compiled (`compiler.FORMS`)."""
        update_wrapper(self, function)
        self.py_func, self._form = function, form

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's form, or the plain lines where there is no numba."""
        compiler = _compiler()
        if compiler is None:
            return self.py_func
        _tell_numba(compiler)
        return compiler.dispatcher(self.py_func, self._form)

    def __call__(self, *arguments: Any) -> Any:
        """Run it compiled."""
        return self.dispatcher(*arguments)

    @property
    def _numba_type_(self) -> Any:
        """What other kernels see."""
        return self.dispatcher._numba_type_


class Entry(Kernel):
    """A kernel that Python calls: its finished code is kept in files, and is run without numba.

    It takes numbers, arrays and records, and knows records by their size.
    """

    @cached_property
    def _finished(self) -> dict[str, Callable[..., Any]]:
        loaded = {code.kinds: store.load(code) for code in store.kept(self._name)}
        return {kinds: function for kinds, function in loaded.items() if function is not None}

    @property
    def _name(self) -> str:
        return f"{self.py_func.__module__}.{self.py_func.__qualname__}"

    def __call__(self, *arguments: Any) -> Any:
        """Run its code for arguments of these kinds, compiled now if it is not at hand."""
        for finished in self._finished.values():
            result = finished(*arguments)
            if result is not NotImplemented:
                return result
        result = self.ready(*arguments)(*arguments)
        if result is NotImplemented:
            raise TypeError(f"{self._name} takes aligned arrays of numpy's own class; got {store.kinds_of(arguments)}")
        return result

    def ready(self, *arguments: Any) -> Callable[..., Any]:
        """Its code for arguments of these kinds alone, to be called a million times: NotImplemented for others."""
        kinds = store.kinds_of(arguments)
        if kinds not in self._finished:
            _say_what_takes_long()
            compiler, began = _compiler(), time.monotonic()
            if compiler is None:
                return self.py_func
            code, self._finished[kinds] = compiler.finish(self._name, self.dispatcher, arguments)
            store.save(code)
            _LOG.info("compiled %s in %.1f s", self._name, time.monotonic() - began)
        return self._finished[kinds]


@cache
def _say_what_takes_long() -> None:
    """Once a process, before numba is imported: a minute of silence looks like a fault."""
    _LOG.warning(
        "relnav: compiling for this processor, up to a minute; it is kept, and the next process starts at once"
    )


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a scalar-loop function on its first call; switched off, return it as it is."""
    return _marked(Kernel, function)


def long_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that runs for long when Python calls it: other threads run meanwhile (the lock is released)."""
    return _marked(Kernel, function, "long kernel")


def entry(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that Python calls as part of a filter."""
    return _marked(Entry, function, "entry")


def long_entry(function: Callable[P, R]) -> Callable[P, R]:
    """An entry that runs for long: other threads run meanwhile."""
    return _marked(Entry, function, "long entry")


def shared_entry(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that both Python and other kernels call, and that is long: it is finished once for all of them."""
    return _marked(Entry, function, "shared entry")


def _marked(mark: type[Kernel], function: Callable[P, R], form: str = "kernel") -> Callable[P, R]:
    marked: Any = mark(function, form) if _SWITCHED_ON else function
    return cast("Callable[P, R]", marked)


def ready(function: Callable[P, R], *arguments: Any) -> Callable[P, R]:
    """The code of an entry for arguments of these kinds alone: a call with others answers NotImplemented at once."""
    return function.ready(*arguments) if isinstance(function, Entry) else function


def plain(function: Callable[P, R]) -> Callable[P, R]:
    """The Python lines of a kernel."""
    lines: Callable[P, R] = getattr(function, "py_func", function)
    return lines


def is_at_hand(*functions: Callable[..., Any]) -> bool:
    """Whether finished code of all these entries is at hand: nothing has to be compiled, nor numba imported."""
    return all(isinstance(function, Entry) and bool(function._finished) for function in functions)


def is_compiled() -> bool:
    """Whether kernels run compiled in this process."""
    return _compiler() is not None


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
        _UNTOLD.append((function, function, frozenset()))
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

    _UNTOLD.append((together, function, split))
    return together


_BEFORE: list[Callable[[], None]] = []
"""What is to be told numba besides, when something has to be compiled."""


def before_compiling(tell: Callable[[], None]) -> None:
    """Call `tell` before anything is compiled: it may import numba."""
    _BEFORE.append(tell)


_UNTOLD: list[tuple[Callable[..., Any], Callable[..., Any], frozenset[int]]] = []
"""Straight-line functions that numba has not been told of: name, function, arguments that are side by side."""


def _tell_numba(compiler: Any) -> None:
    """Tell it of the straight-line functions that there are by now, and of what else waits to be told."""
    while _BEFORE:
        _BEFORE.pop()()
    while _UNTOLD:
        name, function, split = _UNTOLD.pop()
        sized = [one for one, shape in STRAIGHT_LINES[function].items() if callable(shape)]

        @cache
        def trace_of(n: int, function: Callable[..., Any] = function) -> Trace:
            return Trace(function, shapes_of(function, n))

        compiler.register(name, function, sized, SIZES[0], trace_of, split)
