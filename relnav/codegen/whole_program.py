"""Optimise a kernel together with all that it calls, once, where numba would do so anew at every level of calls.

numba compiles each function to finished machine code before it links it into its caller, where everything is optimised
and translated again: a formula eight calls deep is optimised eight times. Here a kernel has two faces. The outer one is
what Python calls: it is compiled whole and cached. The inner one is what other kernels see: it is brought as far as
LLVM's intermediate language and handed to its caller as it is, which saves half of all compilation.
"""

import copy
import gc
import hashlib
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from numba.core import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import CPUDispatcher, cpu_target

from relnav.codegen import store
from relnav.codegen.call_types import typing_context
from relnav.codegen.lanes import of_lanes
from relnav.codegen.passes import KernelCompiler
from relnav.codegen.python_call import write_python_call

_TYPING = typing_context()


class _Unfinished(JITCodeLibrary):
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


class _Whole(JITCodeLibrary):
    """Finished code, linked with all that it calls and what that calls."""

    is_shared = False

    def add_linking_library(self, library: Any) -> None:
        if library not in self._linking_libraries:
            super().add_linking_library(library)
            if isinstance(library, _Unfinished):
                for called in library._linking_libraries:
                    self.add_linking_library(called)

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()  # without numba's pass before, for reference counts
        passes.run(self._final_module, builder)

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        library = super()._unserialize(codegen, state)
        _, kind, data = state
        if kind == "object":  # numba forgets it when it is loaded, and our files want it
            library._compiled_object = data[0]
        return library


class _Caller(_Whole):
    """The same, but that finished code which it calls stays outside, and is not optimised and translated again."""

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self.outside: list[_Whole] = []

    def add_linking_library(self, library: Any) -> None:
        if not getattr(library, "is_shared", False):
            super().add_linking_library(library)
        elif library not in self.outside:
            library._ensure_finalized()
            self.outside.append(library)


def _nothing() -> None:
    """What is there already is not loaded again."""


class _Target:
    """numba's processor target with another class of libraries, and with our calls from Python if asked for."""

    def __init__(self, library: type[JITCodeLibrary], *, own_calls: bool = False) -> None:
        numbas = cpu_target.target_context
        generator = copy.copy(numbas.codegen())
        generator._library_class = library
        if library is _Unfinished:
            generator.set_env = lambda _name, _env: None  # it does not run by itself
        self.typing_context = _TYPING
        numbas.refresh()
        self.target_context = numbas.subtarget(
            _internal_codegen=generator,
            typing_context=_TYPING,
            load_additional_registries=_nothing,  # just done; numba would look at all of them at every call
        )
        if own_calls:
            self.target_context.create_cpython_wrapper = partial(write_python_call, self.target_context)
        self.options = cpu_target.options


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=8).digest()


class _Place(_CacheLocator):
    """numba's files lie in our folder, under our stamp too: numba's own is that of the defining file alone."""

    def __init__(self, function: Callable[..., Any], file: Path) -> None:
        self._line, self._file = function.__code__.co_firstlineno, file

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> "_Place | None":
        return cls(function, Path(file)) if Path(file).is_file() else None

    def get_cache_path(self) -> str:
        return str(store.folder())

    def get_source_stamp(self) -> tuple[str, bytes]:
        return store.code_stamp(), _digest(self._file.read_bytes())

    def get_disambiguator(self) -> str:
        return f"{_digest(bytes(self._file)).hex()}-{self._line}"


class _Files(CompileResultCacheImpl):
    _locator_classes = (_Place,)


class _Cache(FunctionCache):
    """A damaged file is as if it were not there, and a full disk is no error."""

    _impl_class = _Files

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever unpickling half a file raises
            self._start_anew()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)

    def _start_anew(self) -> None:
        with suppress(OSError):
            self.flush()


class _Inner(CPUDispatcher):
    """A kernel as other kernels see it."""

    targetdescr = _Target(_Unfinished)


class Outer(CPUDispatcher):
    """A kernel as Python sees it."""

    targetdescr = _Target(_Whole)
    _more: ClassVar[dict[str, bool]] = {}

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], *, shared: bool) -> None:
        """Options as numba's; shared: other kernels link the finished code, instead of compiling it into their own."""
        super().__init__(
            function, targetoptions={"nopython": True, **self._more, **options}, pipeline_class=KernelCompiler
        )
        bare = {"nopython": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **options}
        self.inner = _Inner(function, targetoptions=bare, pipeline_class=KernelCompiler)
        self._shared = shared

    def compile(self, sig: Any) -> Any:
        """Compile for these types; nothing of what the compiler makes on its way is worth a search for garbage."""
        collects = gc.isenabled()
        gc.disable()
        try:
            return super().compile(sig)
        finally:
            if collects:
                gc.enable()

    def enable_caching(self) -> None:
        """Keep what is compiled in our folder; not a function that stands in no file."""
        with suppress(RuntimeError):
            self._cache = _Cache(self.py_func)

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self if self._shared else self.inner)


class SharedEntry(Outer):
    """The same, called from Python by `python_call`: not through numba's dispatcher."""

    targetdescr = _Target(_Whole, own_calls=True)
    _more: ClassVar[dict[str, bool]] = {"no_cfunc_wrapper": True}

    def compile(self, sig: Any) -> Any:
        """Compile, or find in a file, for these types."""
        compiled = super().compile(sig)
        for result in self.overloads.values():
            result.library.is_shared = self._shared
        return compiled

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """How other kernels call it: with numbers of lanes as what they compile into their own code."""
        if any(map(of_lanes, args)):
            return self.inner.get_call_template(args, kws)
        return super().get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """What they call."""
        return self.inner.get_overload(sig) if any(map(of_lanes, sig)) else super().get_overload(sig)


class PythonEntry(SharedEntry):
    """The same, calling what is shared where it stands."""

    targetdescr = _Target(_Caller, own_calls=True)


def objects_of(library: Any) -> tuple[tuple[bytes, ...], list[str]]:
    """Machine code of a finished library and of what it calls outside, and the names of all that these need."""
    objects: list[bytes] = []
    needed: set[str] = set()
    defined: set[str] = set()
    for one in (library, *getattr(library, "outside", ())):
        objects.append(one._get_compiled_object())
        module = one._final_module
        if not list(module.functions):  # numba read it from a file, where only another caller needed it
            module = one._get_module_for_linking()
        for function in module.functions:
            (needed if function.is_declaration else defined).add(function.name)
    return tuple(objects), sorted(name for name in needed - defined if "." not in name)
