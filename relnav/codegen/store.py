"""Finished machine code: written to files, found again under the stamp of this very package, and loaded without numba.

A file holds one kernel for one kind of arguments, with what it was made for (this package's content, this processor,
this Python) and a digest. What does not fit, or is damaged, is as if it were not there: it is compiled anew. A wheel
carries the files of the filters (`SHIPPED`); what is compiled later is kept in the first folder that can be written.
"""

import hashlib
import json
import os
import sys
import sysconfig
import tempfile
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, NamedTuple

PACKAGE = Path(__file__).resolve().parent.parent
SHIPPED = PACKAGE / "compiled"
"""What the package's own build has compiled (`hatch_build.py`)."""
SUFFIX = ".code"
WITHOUT_KERNELS = ("cli", "files")
"""The two uppermost rooms: what is changed there does not compile anything anew."""

_HELD: list[Any] = []
"""Loaded code: it must outlive every call."""


class Code(NamedTuple):
    """Finished code of one kernel for arguments of these kinds.

    symbol: name of the function that Python calls (`python_call`); needs: what is called outside of the objects, which
    are the kernel's and those that it shares with others.
    """

    name: str
    kinds: str
    symbol: str
    needs: list[str]
    objects: tuple[bytes, ...]


@cache
def package_stamp(*left_out: str) -> str:
    """Digest of every source file of the package, about 10 ms; left_out: rooms that do not matter.

    Only what can be imported counts, and what is gone does not: other processes write and remove files in between.
    """
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(_modules()):
        place = path.relative_to(PACKAGE)
        if place.parts[0] not in left_out:
            try:
                content = path.read_bytes()
            except FileNotFoundError:
                continue
            digest.update(str(place).encode())
            digest.update(content)
    return digest.hexdigest()


def _modules() -> Iterator[Path]:
    """Source files that can be imported; not the locks and copies that editors put beside them."""
    for folder, folders, names in os.walk(PACKAGE):  # a folder that is removed meanwhile is passed over
        folders[:] = [name for name in folders if name.isidentifier() and name != "__pycache__"]
        for name in names:
            stem, ending = os.path.splitext(name)
            if ending == ".py" and stem.isidentifier():
                yield Path(folder, name)


def code_stamp() -> str:
    """Digest of all that compiled code can depend on: imports point down, and no kernel stands in WITHOUT_KERNELS."""
    return package_stamp(*WITHOUT_KERNELS)


@cache
def machine() -> str:
    """Digest of processor and Python: code made for others is not run."""
    from llvmlite import binding

    processor = binding.get_process_triple(), binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    made_for = *processor, str(sysconfig.get_config_var("SOABI")), sys.implementation.cache_tag
    return hashlib.blake2b("\n".join(map(str, made_for)).encode(), digest_size=8).hexdigest()


def kinds_of(arguments: tuple[Any, ...]) -> str:
    """What the arguments of a kernel are, as far as its code depends on it; whether an array is read-only does not."""
    return ", ".join(map(_kind, arguments))


def _kind(argument: Any) -> str:
    dtype = getattr(argument, "dtype", None)
    if dtype is None or not hasattr(argument, "flags"):
        return type(argument).__name__
    item = f"V{dtype.itemsize}" if dtype.fields else dtype.str
    if argument.ndim == 0:
        return item
    flags = argument.flags
    return f"{item}[{argument.ndim}{'C' if flags.c_contiguous else 'F' if flags.f_contiguous else 'A'}]"


@cache
def folder() -> Path | None:
    """Where code is kept: NUMBA_CACHE_DIR, beside the package, or the user's cache; None if none can be written."""
    own = "relnav_" + hashlib.blake2b(str(PACKAGE).encode(), digest_size=8).hexdigest()
    asked, shared = os.environ.get("NUMBA_CACHE_DIR"), os.environ.get("XDG_CACHE_HOME")
    home = os.path.expanduser("~")  # as it is where no home is known: then it is no absolute path
    places = [Path(asked) / own] if asked else []
    places.append(PACKAGE / "__pycache__" / "compiled")
    if shared or os.path.isabs(home):
        places.append(Path(shared or os.path.join(home, ".cache")) / own)
    refused = ""
    for place in places:
        try:
            place.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=place).close()
        except OSError as error:
            refused = refused or str(error)
        else:
            return place
    warnings.warn(
        f"no folder for compiled code can be written ({refused}): relnav compiles anew in every process; "
        "set NUMBA_CACHE_DIR to a writable folder",
        RuntimeWarning,
        stacklevel=2,
    )
    return None


def _path(place: Path, name: str, kinds: str) -> Path:
    digest = hashlib.blake2b(f"{kinds} {machine()}".encode(), digest_size=6).hexdigest()
    return place / f"{name}-{digest}{SUFFIX}"


def save(code: Code, place: Path | None = None) -> None:
    """Write a file of code; a full or read-only disk is no error."""
    place = place or folder()
    if place is None:
        return
    machine_code = b"".join(code.objects)
    header: dict[str, Any] = {"stamp": code_stamp(), "machine": machine(), "digest": _digest(machine_code)}
    header |= {"kinds": code.kinds, "symbol": code.symbol, "needs": code.needs, "sizes": [*map(len, code.objects)]}
    path = _path(place, code.name, code.kinds)
    unfinished = path.with_suffix(f".{os.getpid()}")
    try:
        unfinished.write_bytes(json.dumps(header).encode() + b"\n" + machine_code)
        unfinished.replace(path)
    except OSError:
        unfinished.unlink(missing_ok=True)


def _digest(machine_code: bytes) -> str:
    return hashlib.blake2b(machine_code, digest_size=16).hexdigest()


def _read(path: Path) -> Code | None:
    """A file of code, if it is whole and fits."""
    fitting = code_stamp(), machine()
    try:
        head, _, machine_code = path.read_bytes().partition(b"\n")
        header = json.loads(head)
        fits = (header["stamp"], header["machine"]) == fitting
        if not fits or header["digest"] != _digest(machine_code):
            return None
        ends = [0, *accumulate(header["sizes"])]
        objects = tuple(machine_code[a:b] for a, b in pairwise(ends))
        return Code(path.name.rpartition("-")[0], header["kinds"], header["symbol"], header["needs"], objects)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def kept(name: str) -> list[Code]:
    """All code of a kernel that fits, what was shipped first; of the same kinds of arguments only one."""
    found: dict[str, Code] = {}
    for place in (SHIPPED, folder()):
        try:
            paths = sorted(place.glob(f"{name}-*{SUFFIX}")) if place is not None else []
        except OSError:  # a folder that may not be read
            continue
        for code in map(_read, paths):
            if code is not None:
                found.setdefault(code.kinds, code)
    return list(found.values())


def load(code: Code) -> Callable[..., Any] | None:
    """The function, from a file's code; None if something that it calls is not to be had in this process."""
    address = address_of(code)
    return None if address is None else entry_function(code.name, address)


def address_of(code: Code) -> int | None:
    """Where code stands once it is loaded; None if something that it calls is not to be had in this process."""
    from llvmlite import binding

    start_llvm()
    target = binding.Target.from_triple(binding.get_process_triple())
    engine = binding.create_mcjit_compiler(
        binding.parse_assembly(""), target.create_target_machine(codemodel="jitdefault", jit=True)
    )
    if not all(binding.address_of_symbol(name) for name in code.needs):
        return None
    for one in code.objects:
        engine.add_object_file(binding.ObjectFileRef.from_data(one))
    engine.finalize_object()
    _HELD.append(engine)
    return int(engine.get_function_address(code.symbol))


@cache
def start_llvm() -> None:
    """Make llvmlite ready for this processor."""
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()


ONE_ARGUMENT, FASTCALL, KEYWORDS = 0x0008, 0x0080, 0x0002
"""How CPython calls a function (METH_O, METH_FASTCALL, METH_KEYWORDS)."""


@cache
def _definition(name: str, address: int, flags: int, doc: str | None) -> Any:
    """CPython's PyMethodDef; it must outlive the functions made of it, and is made once."""
    import ctypes

    class Definition(ctypes.Structure):
        _fields_ = (
            ("name", ctypes.c_char_p),
            ("address", ctypes.c_void_p),
            ("flags", ctypes.c_int),
            ("doc", ctypes.c_char_p),
        )

    return Definition(name.encode(), address, flags, None if doc is None else doc.encode())


def python_function(
    name: str, address: int, own: tuple[Any, ...], flags: int = FASTCALL, doc: str | None = None
) -> Callable[..., Any]:
    """Machine code that follows CPython's convention as a function of Python; own: its first argument."""
    import ctypes

    make = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)(
        ("PyCFunction_NewEx", ctypes.pythonapi)
    )
    function: Callable[..., Any] = make(ctypes.addressof(_definition(name, address, flags, doc)), own, None)
    return function


def entry_function(name: str, address: int) -> Callable[..., Any]:
    """Machine code of `python_call` as a function of Python: its own are the classes that it knows."""
    import numpy as np

    return python_function(name.rpartition(".")[2], address, (np.ndarray, np.void))


def at_hand(*names: str) -> bool:
    """Whether there is code of all these kernels: asked before numpy and numba are imported."""
    return all(kept(name) for name in names)
