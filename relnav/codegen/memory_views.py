"""What numba is told of a memory (`memory_layout.py`): a pointer and its counts, and how a part follows from them."""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import lower_builtin, lower_getattr_generic, register_model
from numba.np import numpy_support
from numba.np.arrayobj import populate_array

from relnav.codegen.lanes import DOUBLES, lane_kind
from relnav.codegen.together import RUNS

_LONG, _BYTE = ir.IntType(64), ir.IntType(8)


class MemoryType(types.Type):
    """A memory in compiled code."""

    def __init__(self, layout: Any, lanes: int) -> None:
        self.layout, self.lanes = layout, lanes
        super().__init__(name=f"{layout.memory.__module__}.{layout.memory.__name__} of {lanes}")

    def kind_of(self, name: str) -> Any:
        """Numba's type of a part; None for a name that there is not."""
        part = self.layout.parts.get(name)
        if part is None:
            return None
        dtype = numpy_support.from_dtype(part.dtype) if self.lanes == 1 else lane_kind(part.dtype)
        return dtype if part.shape is None else types.Array(dtype, len(part.shape), "C")


@register_model(MemoryType)
class _Model(models.StructModel):
    def __init__(self, manager: Any, kind: MemoryType) -> None:
        members = [("data", types.CPointer(types.uint8)), *((name, types.int64) for name in kind.layout.counts)]
        super().__init__(manager, kind, members)


@infer_getattr
class _Parts(AttributeTemplate):
    key = MemoryType

    def generic_resolve(self, kind: MemoryType, name: str) -> Any:
        return kind.kind_of(name)


def register(layout: Any) -> None:
    """Tell numba of the views of a layout, which kernels call on their array."""

    class Template(AbstractTemplate):
        key = layout.views

        def generic(self, arguments: Any, _keywords: Any) -> Any:
            return signature(MemoryType(layout, RUNS if arguments[0].dtype == DOUBLES else 1), *arguments)

    infer_global(layout.views, types.Function(Template))

    @lower_builtin(layout.views, types.Array)
    def lower(context: Any, builder: Any, signed: Any, arguments: Any) -> Any:
        block = context.make_array(signed.args[0])(context, builder, arguments[0])
        kind = signed.return_type
        memory = cgutils.create_struct_proxy(kind)(context, builder)
        memory.data = builder.bitcast(block.data, _BYTE.as_pointer())
        for name, path in layout.counts.items():
            _, offset = layout.within(path)
            place = builder.gep(memory.data, [_LONG(offset * kind.lanes)])
            setattr(memory, name, builder.load(builder.bitcast(place, _LONG.as_pointer())))
        return memory._getvalue()


@lower_getattr_generic(MemoryType)
def _part(context: Any, builder: Any, kind: MemoryType, value: Any, name: str) -> Any:
    memory = cgutils.create_struct_proxy(kind)(context, builder, value=value)
    part = kind.layout.parts[name]
    start = builder.mul(_value(builder, memory, part.start), _LONG(8 * kind.lanes))
    place, result = builder.gep(memory.data, [start]), kind.kind_of(name)
    if part.shape is None:
        return builder.bitcast(place, context.get_value_type(result))
    made = context.make_array(result)(context, builder)
    shape = [_value(builder, memory, size) for size in part.shape]
    itemsize = np.dtype(part.dtype).itemsize * kind.lanes
    strides = [_LONG(itemsize)]
    for size in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], size))
    data = builder.bitcast(place, context.get_data_type(result.dtype).as_pointer())
    populate_array(made, data=data, shape=shape, strides=strides, itemsize=_LONG(itemsize), meminfo=None)
    return made._getvalue()


def _value(builder: Any, memory: Any, sizes: dict[tuple[str, ...], int]) -> Any:
    """A polynomial of the memory's counts."""
    total = _LONG(sizes.get((), 0))
    for names, factor in sizes.items():
        if names:
            product = _LONG(factor)
            for name in names:
                product = builder.mul(product, getattr(memory, name))
            total = builder.add(total, product)
    return total
