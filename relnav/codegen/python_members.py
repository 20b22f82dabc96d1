"""Members of Python's classes in machine code: a method that is one call of an entry, and what is read from bytes.

What a caller does at every epoch, the call and three reads, takes as long in Python as the compiled filter in between.
Each is a function in CPython's own convention, made of LLVM's intermediate language, that does the usual case alone:
whatever else comes goes to the method or property of Python that it stands for, whose answer is the same.
"""

import inspect
import math
import sys
from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import cache
from types import MethodType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from relnav.codegen import store

MEMORY = sys.intern("_memory")
"""Attribute of a record that holds its bytes."""


def method_of(
    method: Callable[..., Any],
    entry: Callable[..., Any],
    *,
    before: Sequence[Any],
    keywords: Sequence[str],
    after: Sequence[Any],
    kept: NDArray[Any],
    record: type,
) -> Callable[..., Any] | None:
    """A bound method that calls an entry and makes a record of what it has written; None if it cannot be.

    Parameters
    ----------
    method : callable
        The same in Python, bound: it is called where the arguments are not two and some of the keywords, or where the
        entry answers anything but True.
    entry : callable
        Called with `before`, the two arguments, a number whose bit k is set where the k-th of `keywords` is not None,
        what is given for each of them, and `after`.
    before, after : sequence
        What stays the same from call to call.
    keywords : sequence of str
        Those of the method's keyword arguments that the entry takes.
    kept : (n,)
        In one piece: the bytes of a record after the call.
    record : type
        Its `MEMORY` is set, and `__init__` not called.
    """
    names = tuple(map(sys.intern, keywords))
    address = _address("method", len(before), len(names), len(after))
    if address is None:
        return None
    numbers = tuple(range(1 << len(names)))
    own = _Own((method, entry, record, MEMORY, kept, numbers, *before, *names, *after))
    return MethodType(_unbound(method.__func__, address), own)  # type: ignore[attr-defined]  # bound methods have it


class _Own(tuple[Any, ...]):
    """What such a method is bound to; copied or pickled, and to whoever asks, it is the object whose method it is."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return _same, (self[0].__self__,)

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        copied = deepcopy(self[0].__self__, memo)
        return getattr(copied, self[0].__name__).__self__

    def __getattr__(self, name: str) -> Any:
        return getattr(self[0].__self__, name)

    def __repr__(self) -> str:
        return repr(self[0].__self__)


def _same(one: Any) -> Any:
    return one


@cache
def _unbound(function: Callable[..., Any], address: int) -> Callable[..., Any]:
    """The machine code as a function that is bound to an `_Own`; with anything else it is the function of Python."""
    of = type(function.__qualname__.rpartition(".")[0], (tuple,), {"__slots__": ()})  # in whose name it is printed
    own, doc = of((_Own, function)), _shown(function)
    return store.python_function(function.__name__, address, own, store.FASTCALL | store.KEYWORDS, doc)


@cache
def _shown(function: Callable[..., Any]) -> str:
    """Signature and docstring as CPython takes them apart again for `help` and `inspect`."""
    parameters = [one.replace(annotation=one.empty) for one in inspect.signature(function).parameters.values()]
    signature = str(inspect.Signature(parameters)).replace("(self", "($own, self", 1)
    return f"{function.__name__}{signature}\n--\n\n{inspect.getdoc(function)}"


@cache
def read_by_machine_code(record: type) -> None:
    """Let properties of a class read its bytes without Python, if that can be.

    Parameters
    ----------
    record : type
        Its `MEMORY` are bytes, and its `PLACES` a dict: property -> place of what it reads, and the shape of that, all
        of it float64: () is a number, anything else a read-only array on the bytes.
    """
    real, array = _address("real"), _address("array")
    if real is None or array is None:
        return
    places: dict[str, tuple[int, tuple[int, ...]]] = vars(record)["PLACES"]
    for name, (place, shape) in places.items():
        in_python = vars(record)[name]
        own: tuple[Any, ...] = MEMORY, in_python.fget, place
        if shape:
            own = *own, place + 8 * math.prod(shape), np.empty(shape), _array_functions()
        getter = store.python_function(name, array if shape else real, own, store.ONE_ARGUMENT)
        setattr(record, name, property(getter, doc=in_python.__doc__))


@cache
def _array_functions() -> int:
    """Address of numpy's table of C functions: the numbers of those that are called are part of its stable ABI."""
    import ctypes

    from numpy._core import multiarray

    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    return int(pointer(multiarray._ARRAY_API, None))


@cache
def _address(form: str, *counts: int) -> int | None:
    """Where a function stands, compiled and kept if it is not at hand; None if what it calls is not to be had."""
    symbol = "_".join(map(str, ("relnav", form, *counts)))
    name = f"{__name__}.{symbol}"
    kept = store.kept(name)
    if kept:
        return store.address_of(kept[0])
    from relnav.codegen import member_code

    code = store.Code(name, "", symbol, *member_code.finish(symbol, form, counts))
    store.save(code)
    return store.address_of(code)
