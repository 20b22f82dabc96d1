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

from relnav.codegen.cpython import ARRAY, BYTE, DOUBLE, INT, OBJECT, TYPE, WORD, Writer

# Offsets of numpy 2 (PyVoidScalarObject, PyArray_Descr).
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
    shape = ir.FunctionType(OBJECT, [OBJECT, OBJECT.as_pointer(), WORD])
    function = ir.Function(module, shape, described.llvm_cpython_wrapper_name)
    _Call(context, module, function).write(callee, described, release_gil)
    _write_reshape(module)
    library.add_ir_module(module)


def _write_reshape(module: Any) -> None:
    """The one function of numba's own library that kernels call: strides of an array in one piece, reshaped."""
    place = WORD.as_pointer()
    shape = ir.FunctionType(INT, [WORD, place, place, WORD, place, place, WORD, INT])
    function = ir.Function(module, shape, "numba_attempt_nocopy_reshape")
    function.linkage = "linkonce_odr"
    builder = ir.IRBuilder(function.append_basic_block())
    _, _, _, count, sizes, strides, itemsize, _ = function.args
    stride = cgutils.alloca_once_value(builder, itemsize)
    with cgutils.for_range_slice(builder, builder.sub(count, WORD(1)), WORD(-1), WORD(-1), inc=False) as (k, _):
        builder.store(builder.load(stride), builder.gep(strides, [k]))
        builder.store(builder.mul(builder.load(stride), builder.load(builder.gep(sizes, [k]))), stride)
    builder.ret(INT(1))


class _Call(Writer):
    """Writes one such function."""

    def __init__(self, context: Any, module: Any, function: Any) -> None:
        super().__init__(module, function)
        self.context, self.failed = context, self.block("failed")

    def write(self, callee: Any, described: Any, release_gil: bool) -> None:
        own, given, count = self.function.args
        self.demand(self.builder.icmp_unsigned("==", count, WORD(len(described.argtypes))))
        values = []
        for k, kind in enumerate(described.argtypes):
            one = self.builder.load(self.builder.gep(given, [WORD(k)]))
            values.append(self.argument(kind, one, own))
        thread = self.python("PyEval_SaveThread", OBJECT) if release_gil else None
        status, result = self.context.call_conv.call_function(
            self.builder, callee, described.restype, described.argtypes, values
        )
        if thread is not None:
            self.python("PyEval_RestoreThread", ir.VoidType(), thread)
        with self.builder.if_then(status.is_error, likely=False):
            error = self.builder.load(self.outside("PyExc_RuntimeError", OBJECT))
            text = cgutils.global_constant(self.module, "text", cgutils.make_bytearray(b"a compiled function failed\0"))
            self.python("PyErr_SetString", ir.VoidType(), error, self.builder.bitcast(text, OBJECT))
            self.builder.branch(self.failed)
        self.builder.ret(self.answer(types.unliteral(described.restype), result))
        self.builder.position_at_end(self.refused)
        self.builder.ret(self.counted("_Py_NotImplementedStruct"))
        self.builder.position_at_end(self.failed)
        self.builder.ret(OBJECT(None))

    def argument(self, kind: Any, one: Any, own: Any) -> Any:
        """The kernel's value of an argument; refuses what is of another kind."""
        if isinstance(kind, types.Array):
            return self.array(kind, one, own)
        if isinstance(kind, types.Record):
            self.demand(self.is_type(one, self.item(own, 1)))
            self.demand_item(kind, self.at(one, _VOID["descr"], OBJECT))
            return self.builder.bitcast(self.at(one, _VOID["data"], OBJECT), self.context.get_value_type(kind))
        if isinstance(kind, types.Float):
            number = self.is_type(one, self.outside("PyFloat_Type", BYTE))
            whole = self.is_type(one, self.outside("PyLong_Type", BYTE))
            self.demand(self.builder.or_(self.builder.or_(number, whole), self.is_a_float(one)))
            value = self.python("PyFloat_AsDouble", DOUBLE, one)
            self.stop_on_error(self.builder.fcmp_ordered("==", value, DOUBLE(-1.0)))
            return self.context.cast(self.builder, value, types.float64, kind)
        if isinstance(kind, types.Boolean):
            true = self.builder.icmp_unsigned("==", one, self.outside("_Py_TrueStruct", BYTE))
            false = self.builder.icmp_unsigned("==", one, self.outside("_Py_FalseStruct", BYTE))
            self.demand(self.builder.or_(true, false))
            return true
        self.demand(self.is_type(one, self.outside("PyLong_Type", BYTE)))
        value = self.python("PyLong_AsLongLong", WORD, one)
        self.stop_on_error(self.builder.icmp_signed("==", value, WORD(-1)))
        return self.context.cast(self.builder, value, types.int64, kind)

    def array(self, kind: Any, one: Any, own: Any) -> Any:
        """An array as numba sees it; of None one without elements."""
        place = cgutils.alloca_once(self.builder, self.context.get_value_type(kind))
        nothing = self.builder.icmp_unsigned("==", one, self.outside("_Py_NoneStruct", BYTE))
        with self.builder.if_else(nothing) as (left_out, given):
            with left_out:
                self.builder.store(
                    self.described(kind, OBJECT(None), [WORD(0)] * kind.ndim, [WORD(0)] * kind.ndim), place
                )
            with given:
                self.demand(self.is_type(one, self.item(own, 0)))
                dimensions = self.at(one, ARRAY["dimensions"], INT)
                self.demand(self.builder.icmp_unsigned("==", dimensions, INT(kind.ndim)))
                flags = self.builder.and_(self.at(one, ARRAY["flags"], INT), INT(_FLAGS[kind.layout]))
                self.demand(self.builder.icmp_unsigned("==", flags, INT(_FLAGS[kind.layout])))
                self.demand_item(kind.dtype, self.at(one, ARRAY["descr"], OBJECT))
                sizes, strides = (
                    [self.at(self.at(one, ARRAY[name], OBJECT), 8 * k, WORD) for k in range(kind.ndim)]
                    for name in ("shape", "strides")
                )
                self.builder.store(self.described(kind, self.at(one, ARRAY["data"], OBJECT), sizes, strides), place)
        return self.builder.load(place)

    def described(self, kind: Any, data: Any, sizes: list[Any], strides: list[Any]) -> Any:
        """Numba's description of an array."""
        made = self.context.make_array(kind)(self.context, self.builder)
        first = self.builder.bitcast(data, self.context.get_data_type(kind.dtype).as_pointer())
        itemsize = WORD(numpy_support.as_dtype(kind.dtype).itemsize)
        populate_array(made, data=first, shape=sizes, strides=strides, itemsize=itemsize, meminfo=None)
        return made._getvalue()

    def demand_item(self, kind: Any, descr: Any) -> None:
        """Refuse elements of another type: records are known by their size."""
        dtype = numpy_support.as_dtype(kind)
        number = np.dtype(np.void).num if dtype.fields else dtype.num
        self.demand(self.builder.icmp_unsigned("==", self.at(descr, _DESCR["number"], INT), INT(number)))
        size = self.at(descr, _DESCR["itemsize"], WORD)
        self.demand(self.builder.icmp_unsigned("==", size, WORD(dtype.itemsize)))
        order = self.at(descr, _DESCR["byteorder"], BYTE)
        native = [self.builder.icmp_unsigned("==", order, BYTE(mark)) for mark in _NATIVE]
        self.demand(self.builder.or_(*native))

    def answer(self, kind: Any, value: Any) -> Any:
        """A result for Python."""
        builder = self.builder
        if isinstance(kind, types.NoneType):
            return self.counted("_Py_NoneStruct")
        if isinstance(kind, types.BaseTuple):
            whole = self.python("PyTuple_New", OBJECT, WORD(len(kind)))
            for k, part in enumerate(kind):
                one = self.answer(types.unliteral(part), builder.extract_value(value, k))
                self.python("PyTuple_SetItem", INT, whole, WORD(k), one)
            return whole
        if isinstance(kind, types.Boolean):
            return self.python("PyBool_FromLong", OBJECT, builder.zext(value, WORD))
        if isinstance(kind, types.Float):
            return self.python("PyFloat_FromDouble", OBJECT, self.context.cast(builder, value, kind, types.float64))
        return self.python("PyLong_FromLongLong", OBJECT, self.context.cast(builder, value, kind, types.int64))

    def is_a_float(self, one: Any) -> Any:
        """Of a class that derives from float, as numpy's is."""
        kind = self.at(one, TYPE, OBJECT)
        derived = self.python("PyType_IsSubtype", INT, kind, self.outside("PyFloat_Type", BYTE))
        return self.builder.icmp_unsigned("!=", derived, INT(0))

    def stop_on_error(self, suspected: Any) -> None:
        with self.builder.if_then(suspected, likely=False):
            after = self.function.append_basic_block()
            raised = self.python("PyErr_Occurred", OBJECT)
            self.builder.cbranch(self.builder.icmp_unsigned("!=", raised, OBJECT(None)), self.failed, after)
            self.builder.position_at_end(after)
