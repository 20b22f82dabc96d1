"""Optimise a kernel together with all that it calls, once, where numba would do so anew at every level of calls.

numba compiles each function to finished machine code before it links it into its caller, where everything is optimised
and translated again: a formula eight calls deep is optimised eight times. Here a kernel has two faces. The outer one is
what Python calls: it is compiled whole and cached. The inner one is what other kernels see: it is brought as far as
LLVM's intermediate language and handed to its caller as it is, which saves half of all compilation.
"""

import copy
import gc
from collections.abc import Callable
from typing import Any

from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import CPUDispatcher, cpu_target


class _Unfinished(JITCodeLibrary):  # type: ignore[misc]  # numba has no types, here and below
    """Code that is only ever linked into other code."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Leave it as it is; what it calls is linked where it is linked itself."""
        self._raise_if_finalized()
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, _name: str) -> int:
        return 0


class _Whole(JITCodeLibrary):  # type: ignore[misc]
    """Finished code, linked with all that it calls and what that calls."""

    def add_linking_library(self, library: Any) -> None:
        if library not in self._linking_libraries:
            super().add_linking_library(library)
            if isinstance(library, _Unfinished):
                for called in library._linking_libraries:
                    self.add_linking_library(called)


class _Target:
    """numba's processor target with another class of libraries."""

    def __init__(self, library: type[JITCodeLibrary]) -> None:
        numbas = cpu_target.target_context
        generator = copy.copy(numbas.codegen())
        generator._library_class = library
        if library is _Unfinished:
            generator.set_env = lambda _name, _env: None  # it does not run by itself
        self.typing_context = cpu_target.typing_context
        self.target_context = numbas.subtarget(_internal_codegen=generator)
        self.options = cpu_target.options


class _Inner(CPUDispatcher):  # type: ignore[misc]
    """A kernel as other kernels see it."""

    targetdescr = _Target(_Unfinished)


class Outer(CPUDispatcher):  # type: ignore[misc]
    """A kernel as Python sees it."""

    targetdescr = _Target(_Whole)

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], *, shared: bool) -> None:
        """Options as numba's; shared: other kernels link the finished code, instead of compiling it into their own."""
        super().__init__(function, targetoptions={"nopython": True, **options})
        bare = {"nopython": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **options}
        self._inner = self if shared else _Inner(function, targetoptions=bare)

    def compile(self, sig: Any) -> Any:
        """Compile for these types; nothing of what the compiler makes on its way is worth a search for garbage."""
        collects = gc.isenabled()
        gc.disable()
        try:
            return super().compile(sig)
        finally:
            if collects:
                gc.enable()

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self._inner)
