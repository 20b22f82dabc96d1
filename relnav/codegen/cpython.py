"""Functions of CPython in LLVM's intermediate language: what they look at, what they call.

Nothing of numba: only llvmlite. Objects are looked at where CPython and numpy document that they lie.
"""

from typing import Any

from llvmlite import ir

BYTE, INT, WORD, DOUBLE = ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.DoubleType()
OBJECT = BYTE.as_pointer()

# Offsets of CPython (PyObject, PyVarObject, PyTupleObject, PyBytesObject: what they hold stands behind all else, which
# in tuples since Python 3.14 is the hash too, and of bytes has a closing zero) and of numpy 2 (PyArrayObject_fields).
TYPE, SIZE = 8, 16
ITEMS, BYTES = tuple.__basicsize__, bytes.__basicsize__ - 1
ARRAY = {"data": 16, "dimensions": 24, "shape": 32, "strides": 40, "descr": 56, "flags": 64}


class Writer:
    """Writes one function; `refused` is where it goes when something is not as the code was made for.

    Parameters
    ----------
    module, function
        Of llvmlite's `ir`, the function without a block.
    """

    def __init__(self, module: Any, function: Any) -> None:
        self.module, self.function = module, function
        self.builder = ir.IRBuilder(function.append_basic_block("arguments"))
        self.refused = function.append_basic_block("refused")

    def block(self, name: str = "") -> Any:
        """A block of its own."""
        return self.function.append_basic_block(name)

    def at(self, base: Any, offset: int, kind: Any) -> Any:
        """What stands at a place behind a pointer."""
        place = self.builder.gep(base, [WORD(offset)])
        return self.builder.load(self.builder.bitcast(place, kind.as_pointer()))

    def item(self, whole: Any, k: int) -> Any:
        """An item of a tuple, not counted."""
        return self.at(whole, ITEMS + 8 * k, OBJECT)

    def is_type(self, one: Any, kind: Any) -> Any:
        """Whether an object is of this class and of none derived from it."""
        return self.builder.icmp_unsigned("==", self.at(one, TYPE, OBJECT), kind)

    def demand(self, condition: Any) -> None:
        """Go on where it holds, else refuse."""
        after = self.block()
        self.builder.cbranch(condition, after, self.refused)
        self.builder.position_at_end(after)

    def is_given(self, pointer: Any) -> Any:
        """Whether a pointer is not NULL."""
        return self.builder.icmp_unsigned("!=", pointer, pointer.type(None))

    def outside(self, name: str, kind: Any) -> Any:
        """Pointer to an object of CPython."""
        if name not in self.module.globals:
            ir.GlobalVariable(self.module, kind, name).linkage = "external"
        return self.module.globals[name]

    def counted(self, name: str) -> Any:
        """An object of CPython, to be handed out."""
        one = self.outside(name, BYTE)
        self.python("Py_IncRef", ir.VoidType(), one)
        return one

    def python(self, name: str, kind: Any, *arguments: Any) -> Any:
        """Call a function of CPython."""
        if name not in self.module.globals:
            ir.Function(self.module, ir.FunctionType(kind, [argument.type for argument in arguments]), name)
        return self.builder.call(self.module.globals[name], arguments)
