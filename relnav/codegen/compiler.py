"""numba at work: from a function of scalar loops to machine code. Imported when something has to be compiled."""

from collections.abc import Callable
from typing import Any

from numba import typeof, types

from relnav.codegen import lowering, store
from relnav.codegen.python_call import takes
from relnav.codegen.whole_program import Outer, PythonEntry, SharedEntry, objects_of

# Kernels work on the memory that they are given: without reference counts (_nrt) they are a quarter faster.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": False, "boundscheck": False, "_nrt": False}
register = lowering.register

FORMS = ("kernel", "long kernel", "entry", "long entry", "shared entry")


def dispatcher(function: Callable[..., Any], form: str) -> Any:
    """Numba's form of a function."""
    options = OPTIONS | {"nogil": form.startswith("long")}
    if form in ("entry", "long entry"):  # its finished code is kept by us
        return PythonEntry(function, options, shared=False)
    compiled = (SharedEntry if form == "shared entry" else Outer)(function, options, shared=form == "shared entry")
    if store.folder() is not None:
        compiled.enable_caching()
    return compiled


def finish(name: str, compiled: Any, arguments: tuple[Any, ...]) -> tuple[store.Code, Callable[..., Any]]:
    """Finished code for arguments of these kinds, to be kept, and the function as Python calls it."""
    kinds = tuple(_writable(typeof(argument)) for argument in arguments)
    if not takes(kinds):
        raise TypeError(f"{name} takes numbers, arrays and records; got {kinds}")
    compiled.compile(kinds)
    result = compiled.overloads[kinds]
    library, symbol = result.library, result.fndesc.llvm_cpython_wrapper_name
    objects, needs = objects_of(library)
    code = store.Code(name, store.kinds_of(arguments), symbol, needs, objects)
    return code, store.entry_function(name, library.get_pointer_to_function(symbol))


def _writable(kind: Any) -> Any:
    return types.Array(kind.dtype, kind.ndim, kind.layout) if isinstance(kind, types.Array) else kind
