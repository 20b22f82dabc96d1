"""numba asked once what type a call of one of its own functions has, for arguments of given types.

For each `+` of two floats numba tries every meaning that `+` has, of strings, sets and arrays of dates too, when it
infers types and again when it writes code: nearly a quarter of compilation.
"""

import copy
from typing import Any

from numba.core import types
from numba.core.datamodel import models
from numba.core.registry import cpu_target
from numba.core.typing import Context
from numba.extending import register_model


class _Remembering(types.Function):
    """A function of numba's that remembers what its calls yield."""

    def __init__(self, templates: tuple[Any, ...]) -> None:
        super().__init__(tuple(sorted(templates, key=lambda one: not getattr(one, "of_lanes", False))))
        self._known: dict[tuple[Any, ...], Any] = {}

    def augment(self, other: Any) -> Any:
        """With what else has been registered of it."""
        return types.Function(self.templates).augment(other)

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Signature of a call."""
        if kws:
            return super().get_call_type(context, args, kws)
        if args not in self._known:
            self._known[args] = super().get_call_type(context, args, kws)
        return self._known[args]


register_model(_Remembering)(models.OpaqueModel)


class _Context(Context):
    """numba's knowledge of types, shared with it."""

    def _lookup_global(self, gv: Any) -> Any:
        found = super()._lookup_global(gv)
        if type(found) is not types.Function:
            return found
        if found not in self.remembering:
            self.remembering[found] = _Remembering(tuple(found.templates))
        return self.remembering[found]


def typing_context() -> Any:
    """The context in which kernels are compiled."""
    context = copy.copy(cpu_target.typing_context)
    context.__class__, context.remembering = _Context, {}
    return context
