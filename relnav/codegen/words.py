"""Arithmetic of 64-bit words without sign: what wraps, and the upper half of a product, in compiled and plain code.

Random numbers are made of it. Python's own integers do not wrap, numpy's warn; a processor has the whole product of two
words in one instruction, which numba does not offer.
"""

from collections.abc import Callable
from typing import Any

from relnav.codegen.kernel import before_compiling

ALL_ONES = 0xFFFFFFFFFFFFFFFF


def whole_product(a: int, b: int) -> tuple[int, int]:
    """Upper and lower 64 bits of the product of two words."""
    product = int(a) * int(b)
    return product >> 64, product & ALL_ONES


def wrapped_sum(a: int, b: int) -> int:
    """Lower 64 bits of the sum of two words."""
    return (int(a) + int(b)) & ALL_ONES


def _register(function: Callable[[int, int], Any], words: int, write: Callable[[Any, Any, Any, Any], Any]) -> None:
    """Tell numba what code stands for a call in a kernel, whose result are so many words."""
    from numba import types
    from numba.core.typing.templates import AbstractTemplate, infer_global, signature
    from numba.extending import lower_builtin

    result = types.uint64 if words == 1 else types.UniTuple(types.uint64, words)

    class Template(AbstractTemplate):
        key = function

        def generic(self, arguments: Any, _keywords: Any) -> Any:
            return signature(result, types.uint64, types.uint64) if len(arguments) == 2 else None

    infer_global(function, types.Function(Template))

    @lower_builtin(function, types.uint64, types.uint64)
    def lower(context: Any, builder: Any, _signed: Any, arguments: Any) -> Any:
        return write(context, builder, *arguments)


def _write_product(context: Any, builder: Any, a: Any, b: Any) -> Any:
    from llvmlite import ir
    from numba import types

    wide, word = ir.IntType(128), ir.IntType(64)
    product = builder.mul(builder.zext(a, wide), builder.zext(b, wide))
    upper = builder.trunc(builder.lshr(product, ir.Constant(wide, 64)), word)
    return context.make_tuple(builder, types.UniTuple(types.uint64, 2), (upper, builder.trunc(product, word)))


def _tell() -> None:
    _register(whole_product, 2, _write_product)
    _register(wrapped_sum, 1, lambda _context, builder, a, b: builder.add(a, b))


before_compiling(_tell)
