"""From a traced list of operations to LLVM instructions, for one case or for LANES cases side by side."""

from collections.abc import Callable
from typing import Any

from llvmlite import ir

from relnav.codegen.trace import COMPARISONS, LANES, Trace

Address = Callable[[int, tuple[int, ...]], Any]
"""LLVM pointer of an entry: argument number, index."""

_WORD = ir.IntType(32)
_WRITTEN = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "negative": "fneg", "and": "and_", "select": "select"}


def emit(trace: Trace, builder: Any, arguments: list[Any], address: Address, number: Any) -> list[Any]:
    """Write the operations of a trace: all loads before all stores. Returns the results.

    arguments: LLVM numbers, None for arrays; number: double, or a vector of them, one a lane.
    """
    values: dict[int, Any] = {}
    for place in trace.needed():
        name, *operands = trace.nodes[place]
        if name == "entry":
            value = builder.load(address(operands[0], tuple(operands[1:])))
            values[place] = value if value.type == number else _joined(builder, [value], number)
        elif name == "argument":
            values[place] = arguments[operands[0]]
        else:
            values[place] = _operation(builder, number, name, operands, values)
    for k, index, place in trace.stores:
        builder.store(values[place], address(k, index))
    return [values[place] for place in trace.returns]


def emit_side_by_side(
    trace: Trace, builder: Any, arguments: list[Any], address: Address, lanes: dict[int, list[Any]]
) -> None:
    """Write the operations of a trace as operations on vectors, one case a lane.

    lanes: for each argument with one array a case, the LLVM byte pointers of these arrays, without gaps; the other
    arguments hold for all.
    """
    vector = ir.VectorType(ir.DoubleType(), LANES)
    values: dict[int, Any] = {}
    for k, pointers in lanes.items():
        places = {
            trace.position(k, trace.nodes[place][2:]): place
            for place in trace.needed()
            if trace.nodes[place][:2] == ("entry", k)
        }
        for start, whole in _pieces(places):
            if whole:
                rows = _transposed(builder, [builder.load(_at(builder, p, start, vector), align=8) for p in pointers])
                values |= {places[start + i]: row for i, row in enumerate(rows)}
            else:
                one = [builder.load(_at(builder, p, start, ir.DoubleType())) for p in pointers]
                values[places[start]] = _joined(builder, one)
    for place in trace.needed():
        name, *operands = trace.nodes[place]
        if place in values:
            continue
        if name == "entry":
            values[place] = _joined(builder, [builder.load(address(operands[0], tuple(operands[1:])))])
        elif name == "argument":
            values[place] = _joined(builder, [arguments[operands[0]]])
        else:
            values[place] = _operation(builder, vector, name, operands, values)
    for k, pointers in lanes.items():
        stored = {trace.position(k, index): values[place] for number, index, place in trace.stores if number == k}
        for start, whole in _pieces(stored):
            if whole:
                for p, row in zip(
                    pointers, _transposed(builder, [stored[start + i] for i in range(LANES)]), strict=True
                ):
                    builder.store(row, _at(builder, p, start, vector), align=8)
            else:
                for lane, p in enumerate(pointers):
                    one = builder.extract_element(stored[start], _WORD(lane))
                    builder.store(one, _at(builder, p, start, ir.DoubleType()))


def _operation(builder: Any, number: Any, name: str, operands: list[Any], values: dict[int, Any]) -> Any:
    """One operation on doubles, or on vectors of them."""
    lanes = number.count if isinstance(number, ir.VectorType) else 0
    if name == "constant":
        return ir.Constant(number, [operands[0]] * lanes if lanes else operands[0])
    inputs = [values[place] for place in operands]
    if name in COMPARISONS:
        return builder.fcmp_ordered(name, *inputs)
    if name in ("fnma", "fms"):
        at = 0 if name == "fnma" else 2
        inputs[at] = builder.fneg(inputs[at])
    called = {"sqrt": "llvm.sqrt", "abs": "llvm.fabs", "fma": "llvm.fma", "fnma": "llvm.fma", "fms": "llvm.fma"}
    if name in called:
        symbol = f"{called[name]}.{f'v{lanes}' if lanes else ''}f64"
        return builder.call(_declared(builder, symbol, number, len(inputs)), inputs)
    if name == "atan2":  # of the C library, which knows no vectors
        function = _declared(builder, name, ir.DoubleType(), 2)
        if not lanes:
            return builder.call(function, inputs)
        each = [[builder.extract_element(one, _WORD(lane)) for one in inputs] for lane in range(lanes)]
        return _joined(builder, [builder.call(function, one) for one in each], number)
    return getattr(builder, _WRITTEN[name])(*inputs)


def _declared(builder: Any, symbol: str, number: Any, count: int) -> Any:
    """A function of so many numbers."""
    kind = ir.FunctionType(number, [number] * count)
    return builder.module.globals.get(symbol) or ir.Function(builder.module, kind, symbol)


def _pieces(entries: dict[int, Any]) -> list[tuple[int, bool]]:
    """Positions of entries in pieces: (first of LANES in a row, True) or (single, False)."""
    pieces, end = [], -1
    for start in sorted(entries):
        if start < end:
            continue
        whole = all(start + i in entries for i in range(LANES))
        pieces.append((start, whole))
        end = start + (LANES if whole else 1)
    return pieces


def _at(builder: Any, pointer: Any, position: int, kind: Any) -> Any:
    """Pointer of that kind to the position-th double behind a byte pointer."""
    return builder.bitcast(builder.gep(pointer, [ir.Constant(ir.IntType(64), 8 * position)]), kind.as_pointer())


def _joined(builder: Any, values: list[Any], vector: Any = None) -> Any:
    """A vector of LANES doubles, or of one double in every lane of it."""
    vector = vector or ir.VectorType(ir.DoubleType(), LANES)
    undefined = ir.Constant(vector, ir.Undefined)
    joined = undefined
    for lane, value in enumerate(values):
        joined = builder.insert_element(joined, value, _WORD(lane))
    if len(values) == 1:
        first = ir.Constant(ir.VectorType(_WORD, vector.count), [0] * vector.count)
        joined = builder.shuffle_vector(joined, undefined, first)
    return joined


def _mask(places: list[int]) -> Any:
    return ir.Constant(ir.VectorType(_WORD, LANES), places)


def _transposed(builder: Any, rows: list[Any]) -> list[Any]:
    """LANES vectors, rows and columns exchanged: first inside blocks of two, then of four."""
    rows, half = list(rows), 1
    while half < LANES:
        low = _mask([k + LANES - half if k & half else k for k in range(LANES)])
        high = _mask([k + LANES if k & half else k + half for k in range(LANES)])
        for i in range(LANES):
            if not i & half:
                one, other = rows[i], rows[i + half]
                rows[i] = builder.shuffle_vector(one, other, low)
                rows[i + half] = builder.shuffle_vector(one, other, high)
        half *= 2
    return rows
