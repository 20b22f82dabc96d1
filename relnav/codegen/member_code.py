"""The machine code of `python_members`, written and finished by llvmlite alone."""

from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir

from relnav.codegen import store
from relnav.codegen.cpython import ARRAY, BYTE, BYTES, DOUBLE, INT, ITEMS, OBJECT, SIZE, WORD, Writer

_PAIR = ir.FunctionType(OBJECT, [OBJECT, OBJECT])
_CALL = ir.FunctionType(OBJECT, [OBJECT, OBJECT.as_pointer(), WORD, OBJECT])
_NEW_FROM_DESCR = 94, ir.FunctionType(OBJECT, [OBJECT, OBJECT, INT, OBJECT, OBJECT, OBJECT, INT, OBJECT])
_SET_BASE_OBJECT = 282, ir.FunctionType(INT, [OBJECT, OBJECT])
"""Numbers and types of functions in numpy's table (numpy/__multiarray_api.h)."""
_READ_ONLY = 0x101
"""NPY_ARRAY_C_CONTIGUOUS and NPY_ARRAY_ALIGNED, not NPY_ARRAY_WRITEABLE."""


def finish(symbol: str, form: str, counts: tuple[int, ...]) -> tuple[list[str], tuple[bytes, ...]]:
    """Names of what a function needs from outside, and its machine code."""
    store.start_llvm()
    module = ir.Module(symbol)
    module.triple = binding.get_process_triple()
    kind, write = _FORMS[form]
    write(Writer(module, ir.Function(module, kind, symbol)), *counts)
    needs = [name for name in module.globals if name != symbol]
    machine = binding.Target.from_triple(module.triple).create_target_machine(opt=2, codemodel="jitdefault", jit=True)
    finished = binding.parse_assembly(str(module))
    finished.verify()
    return needs, (machine.emit_object(finished),)


def _write_method(w: Writer, before: int, keywords: int, after: int) -> None:
    """`python_members.method_of`; its own: the class of its first argument, and the function of Python.

    Of the first argument: bound method, entry, record, "_memory", kept, numbers, before, keywords, after.
    """
    of_all, given, count, names = w.function.args
    b = w.builder
    none, first = w.outside("_Py_NoneStruct", BYTE), 6
    look, known_kind, other = (w.block(name) for name in ("look_at_own", "own", "other"))
    b.cbranch(b.icmp_signed(">", count, WORD(0)), look, other)
    b.position_at_end(other)
    b.ret(w.python("PyObject_Vectorcall", OBJECT, w.item(of_all, 1), given, count, names))
    b.position_at_end(look)
    own = b.load(given)
    b.cbranch(w.is_type(own, w.item(of_all, 0)), known_kind, other)
    b.position_at_end(known_kind)
    given, count = b.gep(given, [WORD(1)]), b.sub(count, WORD(1))
    w.demand(b.icmp_unsigned("==", count, WORD(2)))
    handed, told = b.alloca(OBJECT, before + 3 + keywords + after), b.alloca(WORD)
    told_at = before + 2
    for k in range(before):
        b.store(w.item(own, first + k), b.gep(handed, [WORD(k)]))
    for k in range(2):
        b.store(b.load(b.gep(given, [WORD(k)])), b.gep(handed, [WORD(before + k)]))
    for k in range(keywords):
        b.store(none, b.gep(handed, [WORD(told_at + 1 + k)]))
    for k in range(after):
        b.store(w.item(own, first + before + keywords + k), b.gep(handed, [WORD(told_at + 1 + keywords + k)]))
    b.store(WORD(0), told)
    known = [w.item(own, first + before + k) for k in range(keywords)]
    _take_keywords(w, known, given, count, b.gep(handed, [WORD(told_at + 1)]), told)
    number = w.at(b.gep(w.item(own, 5), [b.mul(b.load(told), WORD(8))]), ITEMS, OBJECT)
    b.store(number, b.gep(handed, [WORD(told_at)]))
    all_of_them = WORD(before + 3 + keywords + after)
    answer = w.python("PyObject_Vectorcall", OBJECT, w.item(own, 1), handed, all_of_them, OBJECT(None))
    with b.if_then(b.not_(w.is_given(answer)), likely=False):
        w.python("PyErr_Clear", ir.VoidType())  # the method runs into it again, and knows what to say
        b.branch(w.refused)
    w.python("Py_DecRef", ir.VoidType(), answer)
    w.demand(b.icmp_unsigned("==", answer, w.outside("_Py_TrueStruct", BYTE)))
    kept = w.item(own, 4)
    size = b.mul(w.at(w.at(kept, ARRAY["shape"], OBJECT), 0, WORD), WORD(8))
    memory = w.python("PyBytes_FromStringAndSize", OBJECT, w.at(kept, ARRAY["data"], OBJECT), size)
    _return_if_null(w, memory)
    record = w.python("PyType_GenericAlloc", OBJECT, w.item(own, 2), WORD(0))
    with b.if_then(w.is_given(record)):
        w.python("PyObject_GenericSetAttr", INT, record, w.item(own, 3), memory)
    w.python("Py_DecRef", ir.VoidType(), memory)
    b.ret(record)
    b.position_at_end(w.refused)
    b.ret(w.python("PyObject_Vectorcall", OBJECT, w.item(own, 0), given, count, names))


def _take_keywords(w: Writer, known: list[Any], given: Any, count: Any, handed: Any, told: Any) -> None:
    """What is given under names, each where the entry takes it; refuses a name that is not known by its address."""
    names = w.function.args[3]
    b = w.builder
    begin, look, one, after, done = (w.block(name) for name in ("names", "look", "one", "after", "taken"))
    b.cbranch(w.is_given(names), begin, done)
    b.position_at_end(begin)
    how_many = w.at(names, SIZE, WORD)
    b.branch(look)
    b.position_at_end(look)
    k = b.phi(WORD)
    k.add_incoming(WORD(0), begin)
    b.cbranch(b.icmp_signed("<", k, how_many), one, done)
    b.position_at_end(one)
    name = w.at(b.gep(names, [b.mul(k, WORD(8))]), ITEMS, OBJECT)
    value = b.load(b.gep(given, [b.add(k, count)]))
    is_told = b.icmp_unsigned("!=", value, w.outside("_Py_NoneStruct", BYTE))
    for j, one_known in enumerate(known):
        hit, missed = w.block(), w.block()
        b.cbranch(b.icmp_unsigned("==", name, one_known), hit, missed)
        b.position_at_end(hit)
        b.store(value, b.gep(handed, [WORD(j)]))
        b.store(b.or_(b.load(told), b.select(is_told, WORD(1 << j), WORD(0))), told)
        b.branch(after)
        b.position_at_end(missed)
    b.branch(w.refused)
    b.position_at_end(after)
    k.add_incoming(b.add(k, WORD(1)), after)
    b.branch(look)
    b.position_at_end(done)


def _write_real(w: Writer) -> None:
    """A number of a record; its own: "_memory", the property's function, place."""
    _, record = w.function.args
    b = w.builder
    place = _place(w, 2)
    memory = _memory(w, b.add(place, WORD(8)))
    value = w.at(b.gep(memory, [place]), BYTES, DOUBLE)
    w.python("Py_DecRef", ir.VoidType(), memory)
    b.ret(w.python("PyFloat_FromDouble", OBJECT, value))
    _otherwise(w, record)


def _write_array(w: Writer) -> None:
    """A read-only array on a record's bytes; its own: as of a number, its end, an array like it, numpy's functions."""
    own, record = w.function.args
    b = w.builder
    place, end, like = _place(w, 2), _place(w, 3), w.item(own, 4)
    memory = _memory(w, end)
    functions = b.bitcast(w.python("PyLong_AsVoidPtr", OBJECT, w.item(own, 5)), OBJECT.as_pointer())

    def numpys(function: tuple[int, Any], *arguments: Any) -> Any:
        number, kind = function
        return b.call(b.bitcast(b.load(b.gep(functions, [WORD(number)])), kind.as_pointer()), arguments)

    descr, data = w.at(like, ARRAY["descr"], OBJECT), b.gep(memory, [b.add(place, WORD(BYTES))])
    w.python("Py_IncRef", ir.VoidType(), descr)  # the new array takes it over
    shape, strides = w.at(like, ARRAY["shape"], OBJECT), w.at(like, ARRAY["strides"], OBJECT)
    dimensions, numpys_class = w.at(like, ARRAY["dimensions"], INT), w.at(like, 8, OBJECT)
    made = numpys(_NEW_FROM_DESCR, numpys_class, descr, dimensions, shape, strides, data, INT(_READ_ONLY), OBJECT(None))
    with b.if_then(b.not_(w.is_given(made)), likely=False):
        w.python("Py_DecRef", ir.VoidType(), memory)
        b.ret(made)
    numpys(_SET_BASE_OBJECT, made, memory)  # takes over the memory
    b.ret(made)
    _otherwise(w, record)


def _place(w: Writer, k: int) -> Any:
    return w.python("PyLong_AsLongLong", WORD, w.item(w.function.args[0], k))


def _memory(w: Writer, end: Any) -> Any:
    """A record's bytes, counted, which reach up to `end`; else refused."""
    own, record = w.function.args
    b = w.builder
    memory = w.python("PyObject_GetAttr", OBJECT, record, w.item(own, 0))
    _return_if_null(w, memory)
    right = b.and_(
        w.is_type(memory, w.outside("PyBytes_Type", BYTE)), b.icmp_signed("<=", end, w.at(memory, SIZE, WORD))
    )
    with b.if_then(b.not_(right), likely=False):
        w.python("Py_DecRef", ir.VoidType(), memory)
        b.branch(w.refused)
    return memory


def _otherwise(w: Writer, record: Any) -> None:
    """What is refused goes to the property's function."""
    w.builder.position_at_end(w.refused)
    w.builder.ret(w.python("PyObject_CallOneArg", OBJECT, w.item(w.function.args[0], 1), record))


def _return_if_null(w: Writer, one: Any) -> None:
    """An error of Python's goes to the caller."""
    with w.builder.if_then(w.builder.not_(w.is_given(one)), likely=False):
        w.builder.ret(OBJECT(None))


_FORMS: dict[str, tuple[Any, Callable[..., None]]] = {
    "method": (_CALL, _write_method),
    "real": (_PAIR, _write_real),
    "array": (_PAIR, _write_array),
}
