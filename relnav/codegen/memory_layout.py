"""A memory: one array of numbers that crosses from Python, and the names under which its parts are seen.

One array crosses from Python into compiled code in 0.2 us; ten would cost a microsecond. Inside, its parts have names:
first a record of all that has a fixed size, then arrays whose length depends on the model, one behind the other. In
compiled code such a memory is a pointer and its counts, and a part costs a sum when it is asked for
(`memory_views.py`): a kernel that hands it on hands on three numbers, not two hundred, a seventh of all compilation.
"""

import math
import re
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar, get_type_hints

import numpy as np

from relnav.codegen.kernel import before_compiling

M = TypeVar("M")
Block = np.ndarray[Any, Any]
"""The array, (length,) float64."""

Size = int | str
"""A number, or a multiple of a count: "n", "2n"."""
Polynomial = dict[tuple[str, ...], int]
"""Factor of each product of counts; () is of the number alone."""

WORD = 8
"""Bytes of a number."""


class Part(NamedTuple):
    """A part of a memory: of which elements (float64 or a record), of which shape, and where it begins, in numbers.

    A record of the fixed part has shape None.
    """

    dtype: Any
    shape: tuple[Polynomial, ...] | None
    start: Polynomial


class Layout(Generic[M]):
    """Where the parts of a memory stand."""

    def __init__(self, memory: type[M], fixed: Any, counts: dict[str, str], within: dict[str, str]) -> None:
        """Take the parts in their order.

        memory: a named tuple of all parts, `fixed` among them, and those behind it with their shapes:
        Annotated[Matrix, "2n", 3] of numbers or Annotated[Record, dtype, "n"] of records; fixed: dtype of the record in
        front; counts: where in that record each count stands ("kept.clock.beacons"); within: records of it under a name
        of their own.
        """
        self.memory, self.fixed, self.counts = memory, fixed, counts
        self.parts: dict[str, Part] = {}
        self.length: Polynomial = {(): fixed.itemsize // WORD}
        for name, hint in get_type_hints(memory, include_extras=True).items():
            shape = getattr(hint, "__metadata__", None)
            if shape is None:
                dtype, offset = self.within("" if name == "fixed" else within.get(name, name))
                self.parts[name] = Part(dtype, None, {(): offset // WORD})
                continue
            of_records = isinstance(shape[0], np.dtype)
            dtype = shape[0] if of_records else np.dtype(np.float64)
            sizes = shape[1:] if of_records else shape
            shape_of = tuple(map(_polynomial, sizes))
            self.parts[name] = Part(dtype, shape_of, dict(self.length))
            product, factor = _product(shape_of)
            self.length[product] = self.length.get(product, 0) + factor * dtype.itemsize // WORD
        self.views = self._reader()
        before_compiling(self._tell_numba)

    def new(self, **counts: int) -> Block:
        """Zeros, (length,), with the counts written."""
        block = np.zeros(value_of(self.length, counts))
        fixed = block[: self.fixed.itemsize // WORD].view(self.fixed)[0]
        for name, path in self.counts.items():
            *records, last = path.split(".")
            _record(fixed, records)[last] = counts[name]
        return block

    def between(self, block: Block, first: str, behind: str) -> tuple[int, int]:
        """Where two parts of a memory begin, in numbers."""
        counts = {name: int(self._field(block, path)) for name, path in self.counts.items()}
        return value_of(self.parts[first].start, counts), value_of(self.parts[behind].start, counts)

    def _field(self, block: Block, path: str) -> Any:
        return _record(block[: self.fixed.itemsize // WORD].view(self.fixed)[0], path.split("."))

    def within(self, path: str) -> tuple[Any, int]:
        """Type of a field of the fixed record, and the byte where it begins."""
        dtype, offset = self.fixed, 0
        for name in filter(None, path.split(".")):
            dtype, at = dtype.fields[name][:2]
            offset += at
        return dtype, offset

    def _places(self, counts: dict[str, int]) -> list[tuple[slice, Any, tuple[int, ...] | None]]:
        """Of each part: its numbers, its type if it is of records, and its shape."""
        places = []
        for part in self.parts.values():
            start = value_of(part.start, counts)
            shape = None if part.shape is None else tuple(value_of(size, counts) for size in part.shape)
            end = start + math.prod(shape or ()) * part.dtype.itemsize // WORD
            places.append((slice(start, end), part.dtype if part.dtype.fields else None, shape))
        return places

    def _reader(self) -> Callable[[Block], M]:
        """The memory by names, from Python; numba is told what stands for it in compiled code."""
        places: dict[tuple[int, ...], list[tuple[slice, Any, tuple[int, ...] | None]]] = {}
        paths = [path.split(".") for path in self.counts.values()]

        def views(block: Block) -> M:
            fixed = block[: self.fixed.itemsize // WORD].view(self.fixed)[0]
            counts = tuple(int(_record(fixed, path)) for path in paths)
            if counts not in places:
                places[counts] = self._places(dict(zip(self.counts, counts, strict=True)))
            found = []
            for place, dtype, shape in places[counts]:
                if dtype is None:
                    found.append(block[place].reshape(shape))
                else:
                    found.append(block[place].view(dtype) if shape else block[place].view(dtype)[0])
            return self.memory(*found)

        return views

    def _tell_numba(self) -> None:
        from relnav.codegen.memory_views import register

        register(self)


def _polynomial(size: Size) -> Polynomial:
    """Of one size."""
    if isinstance(size, int):
        return {(): size}
    found = re.fullmatch(r"(\d*)([a-z])", size)
    assert found is not None, size
    return {(found[2],): int(found[1] or 1)}


def _product(sizes: tuple[Polynomial, ...]) -> tuple[tuple[str, ...], int]:
    """The product of counts that sizes of one term make, and its factor."""
    names = tuple(sorted(name for size in sizes for term in size for name in term))
    return names, math.prod(factor for size in sizes for factor in size.values())


def value_of(sizes: Polynomial, counts: dict[str, int]) -> int:
    """A polynomial's value."""
    return sum(factor * math.prod(counts[name] for name in names) for names, factor in sizes.items())


def _record(record: Any, path: list[str]) -> Any:
    for name in path:
        record = record[name]
    return record
