"""From a scalar-loop function to its straight-line list of operations: the loops run once, on symbols.

A function whose branches do not depend on its numbers does the same operations in the same order every time. Running
it once on symbols writes them down (`trace`); operations on known zeros and ones fall away, and nothing is computed
twice. `kernel.straight_line` turns the list into machine code. A choice that does depend on the numbers is written
`select(condition, a, b)` or `quotient(a, b, otherwise)`; conditions are joined with `&`.
"""

import math
from collections import Counter
from collections.abc import Callable
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np

Shape = tuple[int, ...] | tuple[str, ...] | str
"""Of an array argument: its size, or its rows as text, "1" and "0" for entries known to be that, "*" for the rest."""

LANES = 4
"""Cases that one instruction takes side by side: doubles of a 256-bit register."""

COMPARISONS = ("<", "<=", ">", ">=")
INPUTS = ("argument", "entry", "constant")


class Symbol:
    """One number, or one truth value, of a traced function: its place in the list of operations."""

    __slots__ = ("index", "tape")

    def __init__(self, tape: "Tape", index: int) -> None:
        self.tape, self.index = tape, index

    def __add__(self, other: Any) -> Any:
        return self.tape.operation("+", self, other)

    def __sub__(self, other: Any) -> Any:
        return self.tape.operation("-", self, other)

    def __mul__(self, other: Any) -> Any:
        return self.tape.operation("*", self, other)

    def __truediv__(self, other: Any) -> Any:
        return self.tape.operation("/", self, other)

    def __radd__(self, other: Any) -> Any:
        return self.tape.operation("+", other, self)

    def __rsub__(self, other: Any) -> Any:
        return self.tape.operation("-", other, self)

    def __rmul__(self, other: Any) -> Any:
        return self.tape.operation("*", other, self)

    def __rtruediv__(self, other: Any) -> Any:
        return self.tape.operation("/", other, self)

    def __neg__(self) -> Any:
        return self.tape.operation("negative", self)

    def __abs__(self) -> Any:
        return self.tape.operation("abs", self)

    def __lt__(self, other: Any) -> Any:
        return self.tape.operation("<", self, other)

    def __le__(self, other: Any) -> Any:
        return self.tape.operation("<=", self, other)

    def __gt__(self, other: Any) -> Any:
        return self.tape.operation(">", self, other)

    def __ge__(self, other: Any) -> Any:
        return self.tape.operation(">=", self, other)

    def __and__(self, other: Any) -> Any:
        return self.tape.operation("and", self, other)

    def __bool__(self) -> bool:
        raise TypeError("a straight-line function cannot branch on its numbers: use select(condition, a, b)")


class Tape:
    """The list of operations; a node is (name, operands...), operands are places of earlier nodes."""

    def __init__(self) -> None:
        self.nodes: list[tuple[Any, ...]] = []
        self._known: dict[tuple[Any, ...], int] = {}

    def place(self, *node: Any) -> int:
        """Place of a node, new or the one that is there already."""
        if node not in self._known:
            self._known[node] = len(self.nodes)
            self.nodes.append(node)
        return self._known[node]

    def symbol(self, *node: Any) -> Symbol:
        """Symbol of a node."""
        return Symbol(self, self.place(*node))

    def _place_of(self, value: Any) -> int:
        return value.index if isinstance(value, Symbol) else self.place("constant", float(value))

    def _constant(self, place: int) -> float | None:
        node = self.nodes[place]
        return node[1] if node[0] == "constant" else None

    def operation(self, name: str, *operands: Any) -> Any:
        """The result of an operation: what is known about zeros and ones is used."""
        places = [self._place_of(operand) for operand in operands]
        a = self._constant(places[0])
        b = self._constant(places[1]) if len(places) == 2 else None
        first, second = operands[0], operands[-1]
        if name == "+" and (a == 0.0 or b == 0.0):
            return second if a == 0.0 else first
        if name == "-" and b == 0.0:
            return first
        if name == "-" and a == 0.0:
            return self.operation("negative", second)
        if name == "*" and (a == 0.0 or b == 0.0):
            return 0.0
        if name == "*" and (a == 1.0 or b == 1.0):
            return second if a == 1.0 else first
        if name == "/" and (a == 0.0 or b == 1.0):
            return 0.0 if a == 0.0 else first
        if name in ("+", "*"):
            places.sort()
        return self.symbol(name, *places)

    def select(self, condition: Any, a: Any, b: Any) -> Any:
        """`a` where the condition holds, else `b`."""
        if not isinstance(condition, Symbol):
            return a if condition else b
        return self.symbol("select", condition.index, self._place_of(a), self._place_of(b))

    def quotient(self, a: Any, b: Any, otherwise: Any) -> Any:
        """Divide a by b where b > 0, else `otherwise`."""
        return self.select(b > 0.0, a / b, otherwise)


class Trace:
    """What a function does: `nodes`, the entries it `stores` (argument, index..., place) and the places it `returns`.

    Attributes
    ----------
    nodes : list of tuple
        ("argument", k) and ("entry", k, index...) are inputs; the others are operations on earlier places:
        "fma" a b + c, "fnma" c - a b, "fms" a b - c, rounded once.
    stores : list of (int, tuple of int, int)
        Argument number, index of the entry, place of its new value.
    returns : list of int, or None
        Places of the results; one, several, or no result.
    """

    def __init__(self, function: Callable[..., Any], shapes: dict[str, Shape]) -> None:
        tape = Tape()
        arguments: list[Any] = []
        names = function.__code__.co_varnames[: function.__code__.co_argcount]
        for k, name in enumerate(names):
            shape = shapes.get(name)
            arguments.append(tape.symbol("argument", k) if shape is None else _entries(tape, k, shape))
        self._shapes = {k: a.shape for k, a in enumerate(arguments) if isinstance(a, np.ndarray)}
        before = [a.copy() if isinstance(a, np.ndarray) else None for a in arguments]
        result = _on_symbols(function, tape, {})(*arguments)
        self.single = not isinstance(result, tuple)
        results = () if result is None else (result,) if self.single else result
        self.returns = [tape._place_of(value) for value in results]
        self.stores: list[tuple[int, tuple[int, ...], int]] = []
        for k, (old, new) in enumerate(zip(before, arguments, strict=True)):
            if old is not None:
                self.stores.extend(
                    (k, index, tape._place_of(new[index]))
                    for index in np.ndindex(new.shape)
                    if new[index] is not old[index]
                )
        self.nodes = tape.nodes
        self._fuse()

    def _fuse(self) -> None:
        """Turn a product that is added or subtracted, and used nowhere else, into one operation, rounded once."""
        needed = self.needed()
        used = Counter(place for at in needed for place in self._operands(at))
        used.update([place for _, _, place in self.stores] + self.returns)
        for at in needed:
            name, *operands = self.nodes[at]
            if name not in ("+", "-"):
                continue
            a, b = operands
            for product, other in ((b, a), (a, b)):
                if self.nodes[product][0] == "*" and used[product] == 1:
                    x, y = self.nodes[product][1:]
                    kind = "fma" if name == "+" else ("fnma" if product == b else "fms")
                    self.nodes[at] = (kind, x, y, other)
                    break

    def _operands(self, place: int) -> tuple[int, ...]:
        node = self.nodes[place]
        return () if node[0] in INPUTS else node[1:]

    def size(self, k: int) -> int:
        """Number of entries of an array argument."""
        return math.prod(self._shapes[k])

    def position(self, k: int, index: tuple[int, ...]) -> int:
        """Place of an entry in an array argument without gaps."""
        return int(np.ravel_multi_index(index, self._shapes[k]))

    def is_condition(self, place: int) -> bool:
        """Whether a place holds a truth value."""
        return self.nodes[place][0] in (*COMPARISONS, "and")

    def needed(self) -> list[int]:
        """Places that the results and stores rest on, in order."""
        wanted = {place for _, _, place in self.stores} | set(self.returns)
        for place in range(len(self.nodes) - 1, -1, -1):
            if place in wanted:
                wanted.update(self._operands(place))
        return sorted(wanted)


def _entries(tape: Tape, k: int, shape: Shape) -> np.ndarray[Any, Any]:
    known: np.ndarray[Any, Any]
    if isinstance(shape, str):
        known = np.array(list(shape))
    elif isinstance(shape[0], str):
        known = np.array([list(str(row)) for row in shape])
    else:
        known = np.full(tuple(int(n) for n in shape), "*")
    entries = np.empty(known.shape, dtype=object)
    for index in np.ndindex(known.shape):
        entries[index] = tape.symbol("entry", k, *index) if known[index] == "*" else float(known[index])
    return entries


def _on_symbols(function: Callable[..., Any], tape: Tape, done: dict[Any, Any]) -> Callable[..., Any]:
    """A copy of a function that, with all that it calls, works on symbols."""
    plain: Any = getattr(function, "py_func", function)
    if plain in done:
        copy: Callable[..., Any] = done[plain]
        return copy
    spaces = dict(plain.__globals__)
    done[plain] = FunctionType(plain.__code__, spaces, plain.__name__, plain.__defaults__)
    spaces["math"] = SimpleNamespace(
        sqrt=lambda value: tape.operation("sqrt", value),
        atan2=lambda y, x: tape.operation("atan2", y, x),
        nan=float("nan"),
    )
    spaces["np"] = SimpleNamespace(zeros=lambda size: np.full(size, 0.0, dtype=object))
    spaces |= {"select": tape.select, "quotient": tape.quotient}
    for name in plain.__code__.co_names:
        value = plain.__globals__.get(name)
        if name not in ("select", "quotient") and (hasattr(value, "py_func") or isinstance(value, FunctionType)):
            spaces[name] = _on_symbols(value, tape, done)
    made: Callable[..., Any] = done[plain]
    return made
