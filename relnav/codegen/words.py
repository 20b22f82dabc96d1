"""Arithmetic of 64-bit words without sign: what wraps, and the upper half of a product, in compiled and plain code.

Random numbers are made of it. Python's own integers do not wrap, numpy's warn; a processor has the whole product of two
words in one instruction, which numba does not offer.
"""

from collections.abc import Callable
from typing import Any

from relnav.codegen.kernel import before_compiling

ALL_ONES = 0xFFFFFFFFFFFFFFFF


def upper_product(a: int, b: int) -> int:
    """Upper 64 bits of the product of two words."""
    return (int(a) * int(b)) >> 64


def lower_product(a: int, b: int) -> int:
    """Lower 64 bits of the product of two words."""
    return (int(a) * int(b)) & ALL_ONES


def wrapped_sum(a: int, b: int) -> int:
    """Lower 64 bits of the sum of two words."""
    return (int(a) + int(b)) & ALL_ONES


def _register(function: Callable[[int, int], int], write: Callable[[Any, Any, Any], Any]) -> None:
    """Tell numba what code stands for a call in a kernel."""
    from numba import types
    from numba.core.typing.templates import AbstractTemplate, infer_global, signature
    from numba.extending import lower_builtin

    class Template(AbstractTemplate):
        key = function

        def generic(self, arguments: Any, _keywords: Any) -> Any:
            return signature(types.uint64, types.uint64, types.uint64) if len(arguments) == 2 else None

    infer_global(function, types.Function(Template))

    @lower_builtin(function, types.uint64, types.uint64)
    def lower(_context: Any, builder: Any, _signed: Any, arguments: Any) -> Any:
        return write(builder, *arguments)


def _write_upper(builder: Any, a: Any, b: Any) -> Any:
    from llvmlite import ir

    wide = ir.IntType(128)
    product = builder.mul(builder.zext(a, wide), builder.zext(b, wide))
    return builder.trunc(builder.lshr(product, ir.Constant(wide, 64)), ir.IntType(64))


def _tell() -> None:
    _register(upper_product, _write_upper)
    _register(lower_product, lambda builder, a, b: builder.mul(a, b))
    _register(wrapped_sum, lambda builder, a, b: builder.add(a, b))


before_compiling(_tell)
