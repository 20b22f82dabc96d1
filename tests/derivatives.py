"""Derivatives of straight-line functions, found from their lists of operations, to hold those written by hand to.

    by_place = derivative(distances_of, of="out", by="place", place=(3,), out=(2,))

takes the arguments of `distances_of` and returns how the two distances change with the place, (2, 3). For each of them
the list is gone through once, backward (Linnainmaa 1970): the slope of a value, times what an operation does to an
operand, is a part of the operand's slope. Zeros and ones fall away, and nothing is computed twice, as in any trace
(`codegen/trace.py`), so that `operations` is what compiled code of it would cost.
"""

import inspect
import math

import numpy as np

from relnav.codegen.trace import INPUTS, Symbol, Tape, Trace, _entries, _on_symbols

OPERATIONS = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "fma": lambda a, b, c: a * b + c,
    "fnma": lambda a, b, c: c - a * b,
    "fms": lambda a, b, c: a * b - c,
    "negative": lambda a: -a,
    "abs": abs,
    "sqrt": np.sqrt,
    "atan2": math.atan2,  # numpy has one of its own for some processors
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "and": lambda a, b: a and b,
    "select": lambda condition, a, b: a if condition else b,
}


def run(trace, arguments):
    """Do what a trace says, every operation rounded alone, in place; returns the results."""
    values = {}
    with np.errstate(all="ignore"):
        for place in trace.needed():
            name, first, *rest = trace.nodes[place]
            if name in INPUTS:
                value = first if name == "constant" else arguments[first]
                values[place] = np.float64(value[tuple(rest)] if name == "entry" else value)
            else:
                values[place] = OPERATIONS[name](*(values[at] for at in trace.nodes[place][1:]))
    for k, index, place in trace.stores:
        arguments[k][index] = values[place]
    return [values[place] for place in trace.returns]


def operations(trace):
    """Number of arithmetic operations."""
    return sum(trace.nodes[place][0] not in INPUTS for place in trace.needed())


class derivative:  # noqa: N801  (called like a function)
    """Of what a straight-line function writes into the array `of`, by the entries of `by`; shapes: of its arrays.

    at_zero: `by` is known to be zero, and the derivative does not take it.
    """

    def __init__(self, function, of, by, at_zero=False, **shapes):
        own, tape = Tape(), Tape()
        names = list(inspect.signature(function).parameters)
        symbols = _arguments(own, names, shapes)
        variables = symbols[by].ravel().tolist()
        self._names = [name for name in names if name != of and not (at_zero and name == by)]
        given = _arguments(tape, self._names, shapes)
        inputs = [given[name] if name in given else np.zeros(shapes[name]) for name in names]
        self._shape = (math.prod(shapes[of]), len(variables))
        _on_symbols(function, own, {})(*symbols.values())
        values = []
        for node in own.nodes:
            values.append(_value(tape, node, inputs, values))
        stores = []
        for i, result in enumerate(symbols[of].ravel().tolist()):
            slopes = _slopes(own, result.index, tape, values) if isinstance(result, Symbol) else {}
            for j, variable in enumerate(variables):
                stores.append((len(self._names), (i, j), tape._place_of(slopes.get(variable.index, 0.0))))
        self._trace = Trace.__new__(Trace)
        self._trace.nodes, self._trace.stores, self._trace.returns = tape.nodes, stores, []
        self._trace._fuse()
        self.operations = operations(self._trace)

    def __call__(self, *arguments):
        assert len(arguments) == len(self._names), self._names
        out = np.full(self._shape, np.nan)
        run(self._trace, (*arguments, out))
        return out


def _arguments(tape, names, shapes):
    return {n: _entries(tape, k, shapes[n]) if n in shapes else tape.symbol("argument", k) for k, n in enumerate(names)}


def _value(tape, node, inputs, values):
    """What a node of the function is on the tape of the derivative."""
    name, first, *rest = node
    if name in INPUTS:
        return first if name == "constant" else inputs[first][tuple(rest)] if name == "entry" else inputs[first]
    operands = [values[place] for place in node[1:]]
    return tape.select(*operands) if name == "select" else tape.operation(name, *operands)


def _slopes(own, result, tape, values):
    """d(result) / d(node) by the place of the node, on the tape of the derivative."""
    slopes = {result: 1.0}
    for place in range(result, -1, -1):
        name, *operands = own.nodes[place]
        if place in slopes and name not in INPUTS:
            parts = _parts(tape, name, slopes[place], values[place], [values[at] for at in operands])
            for number, sign, part in parts:
                slopes[operands[number]] = tape.operation(sign, slopes.get(operands[number], 0.0), part)
    return slopes


def _parts(tape, name, slope, value, x):
    """What an operation on x, whose value has this slope, adds to the slope of each operand, or takes away."""
    operation = tape.operation
    if name in ("+", "-"):
        return [(0, "+", slope), (1, name, slope)]
    if name == "*":
        return [(0, "+", operation("*", slope, x[1])), (1, "+", operation("*", slope, x[0]))]
    if name == "/":
        part = operation("/", slope, x[1])
        return [(0, "+", part), (1, "-", operation("*", part, value))]
    if name == "negative":
        return [(0, "-", slope)]
    if name == "sqrt":
        return [(0, "+", operation("*", slope, operation("/", 0.5, value)))]
    if name == "abs":
        return [(0, "+", tape.select(operation("<", x[0], 0.0), operation("negative", slope), slope))]
    if name == "atan2":
        part = operation("/", slope, x[0] * x[0] + x[1] * x[1])
        return [(0, "+", part * x[1]), (1, "-", part * x[0])]
    if name == "select":
        return [(1, "+", tape.select(x[0], slope, 0.0)), (2, "+", tape.select(x[0], 0.0, slope))]
    return []


# --- what sensors measure, off by small errors to first order: straight-line functions, independent of the product ----


def turned_by(errors, v):
    """(1 + [errors x]) v."""
    out = np.zeros(3)
    for i in range(3):
        out[i] = v[i] + errors[i - 2] * v[i - 1] - errors[i - 1] * v[i - 2]
    return out


def times(matrix, v):
    """A product (3,)."""
    out = np.zeros(3)
    for i in range(3):
        out[i] = matrix[i, 0] * v[0] + matrix[i, 1] * v[1] + matrix[i, 2] * v[2]
    return out


def unit(v):
    """A direction (3,)."""
    return v * (1.0 / math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))


def seen_light(C_LT, C_BL, C_SB, light, rho, lens, errors):
    """Where a light is in sensor axes; errors (18,): position, target, chaser, mounting (turns), lens, light."""
    seen = times(C_LT, turned_by(errors[3:6], light + errors[15:18])) - rho - errors[0:3]
    arm = turned_by(-errors[6:9], times(C_BL, seen)) - lens - errors[12:15]
    return turned_by(-errors[9:12], times(C_SB, arm))


def spot_of_light(C_LT, C_BL, C_SB, light, rho, lens, f, k, errors, spot):
    """Its spot (2,), by Brown and Conrady's distortion k; errors[18]: of the focal length, of itself."""
    p = seen_light(C_LT, C_BL, C_SB, light, rho, lens, errors)
    x, y = p[0] / p[2], p[1] / p[2]
    r2 = x * x + y * y
    radial = 1.0 + r2 * k[0] + r2 * r2 * k[1] + r2 * r2 * r2 * k[4]
    spot[0] = (1.0 + errors[18]) * f[0] * (x * radial + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x))
    spot[1] = (1.0 + errors[18]) * f[1] * (y * radial + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y)


FRAMES = {"C_LT": (3, 3), "C_BL": (3, 3), "C_SB": (3, 3)}
LIGHT = FRAMES | {"light": (3,), "rho": (3,), "lens": (3,), "f": (2,), "k": (5,), "errors": (19,), "spot": (2,)}


def rays_of_beacons(p, arm, places, errors, g):
    """Invariants of the rays from p to three beacons (3, 3), all in the docking frame.

    errors (15,): turns of the chaser, docking axes, which swing the arm from its centre of mass to the camera; turns of
    the beacons about O; beacons.
    """
    u = np.zeros((3, 3))
    seen_from = p + turned_by(errors[0:3], arm) - arm
    for i in range(3):
        u[i] = unit(turned_by(errors[3:6], places[i]) + errors[6 + 3 * i : 9 + 3 * i] - seen_from)
    difference = u[0] - u[1]
    normal = np.zeros(3)
    for i in range(3):
        normal[i] = u[0, i - 2] * u[1, i - 1] - u[0, i - 1] * u[1, i - 2]
        g[0] = difference[i] * difference[i] + (g[0] if i > 0 else 0.0)
        g[1] = u[2, i] * difference[i] + (g[1] if i > 0 else 0.0)
        g[2] = u[2, i] * normal[i] + (g[2] if i > 0 else 0.0)


def invariants_of_spots(spots, f, g):
    """Invariants of the rays to three spots (3, 2)."""
    u = np.zeros((3, 3))
    for i in range(3):
        u[i, 0], u[i, 1], u[i, 2] = spots[i, 0], spots[i, 1], f
    rays_of_beacons(np.zeros(3), np.zeros(3), u, np.zeros(15), g)


def angles_of_place(p, rae):
    """Range, azimuth and elevation, Cai et al. (1996) eq. (13)."""
    level = math.sqrt(p[0] * p[0] + p[1] * p[1])
    rae[0] = math.sqrt(level * level + p[2] * p[2])
    rae[1], rae[2] = math.atan2(p[1], p[0]), math.atan2(-p[2], level)


def parallel_form(spots, f, a, b, rae):
    """Range, azimuth and elevation by Cai et al. (1996), eqs (4)-(13): k, l, m as printed are T, U and what follows."""
    d, c = spots[0] - spots[1], spots[2] - 0.5 * (spots[0] + spots[1])
    D = d[0] * d[0] + d[1] * d[1]
    T, U = 2.0 * a / b * (c[0] * d[0] + c[1] * d[1]) / D, 2.0 * a / b * (d[0] * c[1] - d[1] * c[0]) / D
    q = U / (1.0 + T * T + U * U)
    z = 2.0 * q / (1.0 + math.sqrt(1.0 - 4.0 * q * q))
    W = (1.0 + z * z) / (1.0 + T * T + U * U)
    x, r, p = math.sqrt(W - z * z), 2.0 * f * a * math.sqrt(W / D), np.zeros(3)
    p[0], p[1], p[2] = r * x, -r * T * W / x, r * z
    angles_of_place(p, rae)


def inertial_attitude(C_BI, C_SB, errors, theta):
    """What errors (6,), chaser's attitude and mounting, turn the sensor's inertial attitude by, sensor axes."""
    before, turned = np.zeros((3, 3)), np.zeros((3, 3))
    for m in range(3):
        before[:, m] = times(C_SB, C_BI[:, m])
        turned[:, m] = turned_by(-errors[3:6], times(C_SB, turned_by(-errors[0:3], C_BI[:, m])))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        twice = 0.0
        for m in range(3):
            twice = twice + turned[j, m] * before[k, m] - turned[k, m] * before[j, m]
        theta[i] = 0.5 * twice


def direction(C_BI, C_SB, line, basis, errors, across):
    """A direction to the sun across the predicted one; errors as of `inertial_attitude`."""
    s = turned_by(-errors[3:6], times(C_SB, turned_by(-errors[0:3], times(C_BI, line))))
    for i in range(2):
        across[i] = basis[0, i] * s[0] + basis[1, i] * s[1] + basis[2, i] * s[2]


def roll_of_field(C_LT, C_BL, C_SB, light, field, rho, lens, errors, psi):
    """Angle of a beacon's polarisation about the line of sight; errors (12,) as of `seen_light`."""
    all_errors = np.zeros(18)
    for i in range(12):
        all_errors[i] = errors[i]
    s = unit(seen_light(C_LT, C_BL, C_SB, light, rho, lens, all_errors))
    all_errors[0:3] = np.zeros(3)
    a = seen_light(C_LT, C_BL, C_SB, field, np.zeros(3), np.zeros(3), all_errors)
    first, second = s * -s[0], np.zeros(3)
    first[0] = first[0] + 1.0
    first = unit(first)
    for i in range(3):
        second[i] = s[i - 2] * first[i - 1] - s[i - 1] * first[i - 2]
    psi[0] = math.atan2(
        a[0] * second[0] + a[1] * second[1] + a[2] * second[2], a[0] * first[0] + a[1] * first[1] + a[2] * first[2]
    )


def port_from_port(C_TL, C_TB, motion, w_T, w_B, turn, d, errors, out):
    """Docking port from port, (12,): place from the target's centre of mass, velocity, attitude error, rate.

    errors (15,): of the target's position, velocity, attitude, rate, and of the chaser's attitude; turn: of
    `lvlh_ccsds`, about -y.
    """
    state, rate = motion + errors[0:6], w_T + errors[9:12]
    moved = state[3:6].copy()
    moved[0], moved[2] = moved[0] - turn * state[2], moved[2] + turn * state[0]
    swing = np.zeros(3)
    for i in range(3):
        swing[i] = w_B[i - 2] * d[i - 1] - w_B[i - 1] * d[i - 2]
    against = -errors[6:9]
    arm = turned_by(against, times(C_TL, state[0:3]) + times(C_TB, turned_by(errors[12:15], d)))
    speed = turned_by(against, times(C_TL, moved) + times(C_TB, turned_by(errors[12:15], swing)))
    tilt, own = times(C_TB, errors[12:15]), turned_by(against, times(C_TB, turned_by(errors[12:15], w_B)))
    carried = turned_by(rate, arm) - arm
    for i in range(3):
        out[i], out[3 + i] = arm[i], speed[i] - carried[i]
        out[6 + i], out[9 + i] = errors[6 + i] - tilt[i], rate[i] - own[i]
