"""The face of a finished kernel toward Python: METH_FASTCALL, 0.1 us, and nothing of numba at run time.

Written in LLVM's intermediate language beside the kernel and finished with it. Arguments are looked at where CPython
and numpy document that they lie; where one is not of the kind that the code was made for the call answers
NotImplemented, and the caller compiles (`kernel.Entry`). Whether an array may be written is not asked.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.np import numpy_support
from numba.np.arrayobj import populate_array

_BYTE, _INT, _WORD, _DOUBLE = ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.DoubleType()
_OBJECT = _BYTE.as_pointer()

# Offsets of numpy 2 (PyArrayObject_fields, PyVoidScalarObject, PyArray_Descr) and of CPython (PyObject, PyTupleObject:
# items stand behind all else, which since Python 3.14 is the hash too).
_TYPE, _TUPLE_ITEM = 8, tuple.__basicsize__
_ARRAY = {"data": 16, "dimensions": 24, "shape": 32, "strides": 40, "descr": 56, "flags": 64}
_VOID = {"data": 24, "descr": 32}
_DESCR = {"byteorder": 26, "number": 28, "itemsize": 40}
_FLAGS = {"C": 0x101, "F": 0x102, "A": 0x100}  # NPY_ARRAY_ALIGNED, and in one piece
_NATIVE = (ord("="), ord("|"))


def takes(kinds: Any) -> bool:
    """Whether arguments of numba's kinds can come from Python here."""
    return all(
        isinstance(kind, types.Record | types.Array | types.Float | types.Boolean | types.Integer) for kind in kinds
    )


def write_python_call(
    context: Any, library: Any, described: Any, *_others: Any, release_gil: bool = False, **_more: Any
) -> None:
    """Add the function that Python calls to a kernel's library; in place of numba's `create_cpython_wrapper`."""
    module = context.create_module("python_call")
    callee = ir.Function(
        module, context.call_conv.get_function_type(described.restype, described.argtypes), described.llvm_func_name
    )
    shape = ir.FunctionType(_OBJECT, [_OBJECT, _OBJECT.as_pointer(), _WORD])
    function = ir.Function(module, shape, described.llvm_cpython_wrapper_name)
    _Call(context, module, function).write(callee, described, release_gil)
    _write_reshape(module)
    library.add_ir_module(module)


def _write_reshape(module: Any) -> None:
    """The one function of numba's own library that kernels call: strides of an array in one piece, reshaped."""
    place = _WORD.as_pointer()
    shape = ir.FunctionType(_INT, [_WORD, place, place, _WORD, place, place, _WORD, _INT])
    function = ir.Function(module, shape, "numba_attempt_nocopy_reshape")
    function.linkage = "linkonce_odr"
    builder = ir.IRBuilder(function.append_basic_block())
    _, _, _, count, sizes, strides, itemsize, _ = function.args
    stride = cgutils.alloca_once_value(builder, itemsize)
    with cgutils.for_range_slice(builder, builder.sub(count, _WORD(1)), _WORD(-1), _WORD(-1), inc=False) as (k, _):
        builder.store(builder.load(stride), builder.gep(strides, [k]))
        builder.store(builder.mul(builder.load(stride), builder.load(builder.gep(sizes, [k]))), stride)
    builder.ret(_INT(1))


class _Call:
    """Writes one such function."""

    def __init__(self, context: Any, module: Any, function: Any) -> None:
        self.context, self.module, self.function = context, module, function
        self.builder = ir.IRBuilder(function.append_basic_block("arguments"))
        self.refused = function.append_basic_block("refused")
        self.failed = function.append_basic_block("failed")

    def write(self, callee: Any, described: Any, release_gil: bool) -> None:
        own, given, count = self.function.args
        self.demand(self.builder.icmp_unsigned("==", count, _WORD(len(described.argtypes))))
        values = []
        for k, kind in enumerate(described.argtypes):
            one = self.builder.load(self.builder.gep(given, [_WORD(k)]))
            values.append(self.argument(kind, one, own))
        thread = self.python("PyEval_SaveThread", _OBJECT) if release_gil else None
        status, result = self.context.call_conv.call_function(
            self.builder, callee, described.restype, described.argtypes, values
        )
        if thread is not None:
            self.python("PyEval_RestoreThread", ir.VoidType(), thread)
        with self.builder.if_then(status.is_error, likely=False):
            error = self.builder.load(self.outside("PyExc_RuntimeError", _OBJECT))
            text = cgutils.global_constant(self.module, "text", cgutils.make_bytearray(b"a compiled function failed\0"))
            self.python("PyErr_SetString", ir.VoidType(), error, self.builder.bitcast(text, _OBJECT))
            self.builder.branch(self.failed)
        self.builder.ret(self.answer(types.unliteral(described.restype), result))
        self.builder.position_at_end(self.refused)
        self.builder.ret(self.counted("_Py_NotImplementedStruct"))
        self.builder.position_at_end(self.failed)
        self.builder.ret(_OBJECT(None))

    def argument(self, kind: Any, one: Any, own: Any) -> Any:
        """The kernel's value of an argument; refuses what is of another kind."""
        if isinstance(kind, types.Array):
            return self.array(kind, one, own)
        if isinstance(kind, types.Record):
            self.demand(self.is_type(one, self.at(own, _TUPLE_ITEM + 8, _OBJECT)))
            self.demand_item(kind, self.at(one, _VOID["descr"], _OBJECT))
            return self.builder.bitcast(self.at(one, _VOID["data"], _OBJECT), self.context.get_value_type(kind))
        if isinstance(kind, types.Float):
            number = self.is_type(one, self.outside("PyFloat_Type", _BYTE))
            whole = self.is_type(one, self.outside("PyLong_Type", _BYTE))
            self.demand(self.builder.or_(self.builder.or_(number, whole), self.is_a_float(one)))
            value = self.python("PyFloat_AsDouble", _DOUBLE, one)
            self.stop_on_error(self.builder.fcmp_ordered("==", value, _DOUBLE(-1.0)))
            return self.context.cast(self.builder, value, types.float64, kind)
        if isinstance(kind, types.Boolean):
            true = self.builder.icmp_unsigned("==", one, self.outside("_Py_TrueStruct", _BYTE))
            false = self.builder.icmp_unsigned("==", one, self.outside("_Py_FalseStruct", _BYTE))
            self.demand(self.builder.or_(true, false))
            return true
        self.demand(self.is_type(one, self.outside("PyLong_Type", _BYTE)))
        value = self.python("PyLong_AsLongLong", _WORD, one)
        self.stop_on_error(self.builder.icmp_signed("==", value, _WORD(-1)))
        return self.context.cast(self.builder, value, types.int64, kind)

    def array(self, kind: Any, one: Any, own: Any) -> Any:
        """An array as numba sees it; of None one without elements."""
        place = cgutils.alloca_once(self.builder, self.context.get_value_type(kind))
        nothing = self.builder.icmp_unsigned("==", one, self.outside("_Py_NoneStruct", _BYTE))
        with self.builder.if_else(nothing) as (left_out, given):
            with left_out:
                self.builder.store(
                    self.described(kind, _OBJECT(None), [_WORD(0)] * kind.ndim, [_WORD(0)] * kind.ndim), place
                )
            with given:
                self.demand(self.is_type(one, self.at(own, _TUPLE_ITEM, _OBJECT)))
                dimensions = self.at(one, _ARRAY["dimensions"], _INT)
                self.demand(self.builder.icmp_unsigned("==", dimensions, _INT(kind.ndim)))
                flags = self.builder.and_(self.at(one, _ARRAY["flags"], _INT), _INT(_FLAGS[kind.layout]))
                self.demand(self.builder.icmp_unsigned("==", flags, _INT(_FLAGS[kind.layout])))
                self.demand_item(kind.dtype, self.at(one, _ARRAY["descr"], _OBJECT))
                sizes, strides = (
                    [self.at(self.at(one, _ARRAY[name], _OBJECT), 8 * k, _WORD) for k in range(kind.ndim)]
                    for name in ("shape", "strides")
                )
                self.builder.store(self.described(kind, self.at(one, _ARRAY["data"], _OBJECT), sizes, strides), place)
        return self.builder.load(place)

    def described(self, kind: Any, data: Any, sizes: list[Any], strides: list[Any]) -> Any:
        """Numba's description of an array."""
        made = self.context.make_array(kind)(self.context, self.builder)
        first = self.builder.bitcast(data, self.context.get_data_type(kind.dtype).as_pointer())
        itemsize = _WORD(numpy_support.as_dtype(kind.dtype).itemsize)
        populate_array(made, data=first, shape=sizes, strides=strides, itemsize=itemsize, meminfo=None)
        return made._getvalue()

    def demand_item(self, kind: Any, descr: Any) -> None:
        """Refuse elements of another type: records are known by their size."""
        dtype = numpy_support.as_dtype(kind)
        number = np.dtype(np.void).num if dtype.fields else dtype.num
        self.demand(self.builder.icmp_unsigned("==", self.at(descr, _DESCR["number"], _INT), _INT(number)))
        size = self.at(descr, _DESCR["itemsize"], _WORD)
        self.demand(self.builder.icmp_unsigned("==", size, _WORD(dtype.itemsize)))
        order = self.at(descr, _DESCR["byteorder"], _BYTE)
        native = [self.builder.icmp_unsigned("==", order, _BYTE(mark)) for mark in _NATIVE]
        self.demand(self.builder.or_(*native))

    def answer(self, kind: Any, value: Any) -> Any:
        """A result for Python."""
        builder = self.builder
        if isinstance(kind, types.NoneType):
            return self.counted("_Py_NoneStruct")
        if isinstance(kind, types.BaseTuple):
            whole = self.python("PyTuple_New", _OBJECT, _WORD(len(kind)))
            for k, part in enumerate(kind):
                one = self.answer(types.unliteral(part), builder.extract_value(value, k))
                self.python("PyTuple_SetItem", _INT, whole, _WORD(k), one)
            return whole
        if isinstance(kind, types.Boolean):
            return self.python("PyBool_FromLong", _OBJECT, builder.zext(value, _WORD))
        if isinstance(kind, types.Float):
            return self.python("PyFloat_FromDouble", _OBJECT, self.context.cast(builder, value, kind, types.float64))
        return self.python("PyLong_FromLongLong", _OBJECT, self.context.cast(builder, value, kind, types.int64))

    def at(self, base: Any, offset: int, kind: Any) -> Any:
        """What stands at a place behind a pointer."""
        place = self.builder.gep(base, [_WORD(offset)])
        return self.builder.load(self.builder.bitcast(place, kind.as_pointer()))

    def is_type(self, one: Any, kind: Any) -> Any:
        return self.builder.icmp_unsigned("==", self.at(one, _TYPE, _OBJECT), kind)

    def is_a_float(self, one: Any) -> Any:
        """Of a class that derives from float, as numpy's is."""
        kind = self.at(one, _TYPE, _OBJECT)
        derived = self.python("PyType_IsSubtype", _INT, kind, self.outside("PyFloat_Type", _BYTE))
        return self.builder.icmp_unsigned("!=", derived, _INT(0))

    def demand(self, condition: Any) -> None:
        """Go on where it holds, else refuse."""
        after = self.function.append_basic_block()
        self.builder.cbranch(condition, after, self.refused)
        self.builder.position_at_end(after)

    def stop_on_error(self, suspected: Any) -> None:
        with self.builder.if_then(suspected, likely=False):
            after = self.function.append_basic_block()
            raised = self.python("PyErr_Occurred", _OBJECT)
            self.builder.cbranch(self.builder.icmp_unsigned("!=", raised, _OBJECT(None)), self.failed, after)
            self.builder.position_at_end(after)

    def outside(self, name: str, kind: Any) -> Any:
        """Pointer to an object of CPython."""
        if name not in self.module.globals:
            ir.GlobalVariable(self.module, kind, name).linkage = "external"
        return self.module.globals[name]

    def counted(self, name: str) -> Any:
        one = self.outside(name, _BYTE)
        self.python("Py_IncRef", ir.VoidType(), one)
        return one

    def python(self, name: str, kind: Any, *arguments: Any) -> Any:
        """Call a function of CPython."""
        signature = ir.FunctionType(kind, [argument.type for argument in arguments])
        return self.builder.call(cgutils.get_or_insert_function(self.module, signature, name), arguments)
