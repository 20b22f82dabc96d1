"""Numbers as decimal text and back, compiled: what Python's `repr` and `float` give, digit for digit and bit for bit.

Both ways a number is multiplied by a power of ten to twice the precision of a float (a sum of two floats, Dekker 1971,
"A floating-point technique for extending the available precision"). The error of that is far below the distance at
which a digit or a last bit could turn out otherwise; where it is not (a tie, a number of extreme size), the caller is
told to ask Python.
"""

import math
from functools import cache

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import entry, kernel

Text = np.typing.NDArray[np.uint8]

LOWEST_POWER = -280
SMALLEST, LARGEST = 1e-250, 1e250
"""Sizes of numbers that are handled here, zero besides."""
LONGEST_NUMBER = 25
"""Characters of a number, and the comma or line end behind it."""
MOST_DIGITS = 18
"""Of a number that is read here: it fits 64 bits."""
ASK = -1
"""Python is to be asked."""

_SPLIT = 134217729.0  # 2^27 + 1
_NEXT = 2.0**-53 * (1.0 + 2.0**-52)
"""x + fl(_NEXT x) is the float after x (Rump, Zimmermann, Boldo, Melquiond 2009, "Computing predecessor and successor
in rounding to nearest")."""
_CLOSE = 1e-9
_LONGER = 2
_EXACT_POWER, _EXACT_INTEGER = 22, 2**53
_UNSURE = 2.0**-95
_COMMA, _LINE_END, _SPACE, _TAB, _QUOTE, _HASH, _POINT, _PLUS, _MINUS, _ZERO = b',\n \t"#.+-0'
_E, _N, _A, _LOWER = b"ena "


@cache
def powers_of_ten() -> Matrix:
    """10^k from k = LOWEST_POWER on as sums of two floats, (561, 2)."""
    table = np.empty((1 - 2 * LOWEST_POWER, 2))
    for row in range(len(table)):
        k = row + LOWEST_POWER
        table[row, 0] = float(f"1e{k}")
        numerator, denominator = table[row, 0].as_integer_ratio()
        up, down = 10 ** max(k, 0), 10 ** max(-k, 0)
        table[row, 1] = (up * denominator - numerator * down) / (down * denominator)
    return table


@kernel
def product_error(a: float, b: float, product: float) -> float:
    """A b less its rounded value, exactly."""
    p, q = _SPLIT * a, _SPLIT * b
    a_high, b_high = p - (p - a), q - (q - b)
    a_low, b_low = a - a_high, b - b_high
    return ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


@kernel
def scaled(size: float, k: int, powers: Matrix) -> tuple[float, float]:
    """Size 10^k as a sum of two floats."""
    power, more = powers[k - LOWEST_POWER, 0], powers[k - LOWEST_POWER, 1]
    high = size * power
    return high, product_error(size, power, high) + size * more


@kernel
def _shorter(whole: int, part: float, unit: int, above: float, below: float) -> tuple[int, int]:
    """The multiple of `unit` nearest to whole + part, if that is read back as the same number.

    above, below: half the way to the next floats. Then whether it is: 1, _LONGER, or 0 where Python must be asked. A
    unit that stands in the call is divided by as a constant, in a third of the time.
    """
    left = whole // unit
    rest = (whole - unit * left) + part
    up = 2.0 * rest > unit
    off, most = (unit - rest, above) if up else (rest, below)
    if abs(2.0 * rest - unit) < _CLOSE * unit and off < 2.0 * above:
        return 0, 0
    if off < most * (1.0 - _CLOSE):
        return (left + (1 if up else 0)) * unit, 1
    if off < most * (1.0 + _CLOSE) or (below < above and unit - rest < 2.0 * above):
        return 0, 0
    return 0, _LONGER


@kernel
def seventeen_digits(size: float, powers: Matrix) -> tuple[int, int, int]:
    """The shortest decimal that is read back as `size`: an integer of 17 digits N (its end may be zeros), and e.

    size = N 10^(e - 16), N from 1e16 on; third is False where Python must be asked. Of decimals with as few digits as
    any that is read back the nearest is taken. 15 digits always survive the way into a float and back, so there are
    three lengths to try: 15, 16 and 17.
    """
    e = math.floor(math.log10(size))  # or one off, where size is near a power of ten
    high, low = scaled(size, 16 - e, powers)
    if high > 1e17 or (high == 1e17 and low >= 0.0):
        e += 1
        high, low = scaled(size, 16 - e, powers)
    elif high < 1e16 or (high == 1e16 and low < 0.0):
        e -= 1
        high, low = scaled(size, 16 - e, powers)
    down = math.floor(low)
    whole, part = int(high) + int(down), low - down
    step = _NEXT * size
    scale = 0.5 * powers[16 - e - LOWEST_POWER, 0]
    above, below = scale * ((size + step) - size), scale * (size - (size - step))  # half the way to the next float
    uneven = below < above
    n, known = _shorter(whole, part, 100, above, below)
    if known == _LONGER:
        n, known = _shorter(whole, part, 10, above, below)
    if known != _LONGER:
        return n, e, known
    if uneven or abs(part - 0.5) < _CLOSE:
        return 0, 0, 0
    return whole + (1 if part > 0.5 else 0), e, 1


@cache
def groups_of_digits() -> Text:
    """The characters of 0 to 9999, four each, (10000, 4): a division for each of them takes longer than the rest."""
    return np.array([list(b"%04d" % n) for n in range(10_000)], dtype=np.uint8)


@kernel
def put_digits(n: int, count: int, point: int, groups: Text, out: Text, at: int) -> int:
    """Write `count` digits of n, with a point after so many of them unless that is at an end; the place behind."""
    inside = 0 < point < count
    first = at + 1 if inside else at
    place = first + count
    while place - first >= 4:
        rest = n // 10_000
        four = groups[n - 10_000 * rest]
        place -= 4
        out[place], out[place + 1], out[place + 2], out[place + 3] = four[0], four[1], four[2], four[3]
        n = rest
    if place > first:
        four = groups[n]
        for k in range(place - first):
            out[first + k] = four[4 - (place - first) + k]
    if inside:
        for k in range(point):
            out[at + k] = out[first + k]
        out[at + point] = _POINT
    return first + count


@kernel
def put_number(x: float, powers: Matrix, groups: Text, out: Text, at: int) -> int:
    """Write a number as `repr` does, NaN as nothing; the place behind, or ASK."""
    if x != x:
        return at
    if math.copysign(1.0, x) < 0.0:
        out[at] = _MINUS
        at += 1
    size = abs(x)
    n, e, sure = 0, 0, 1
    if size != 0.0:
        if not SMALLEST <= size < LARGEST:
            return ASK
        n, e, sure = seventeen_digits(size, powers)
    if sure == 0:
        return ASK
    if n >= 10**17:
        n, e = n // 10, e + 1
    count = 17
    if n % 100 == 0:
        n, count = n // 100, 15
        if n % 1000000 == 0:
            n, count = n // 1000000, 9
    while count > 1 and n % 10 == 0:
        n //= 10
        count -= 1
    if -4 <= e < 0:
        out[at], out[at + 1] = _ZERO, _POINT
        at += 2
        for _ in range(-1 - e):
            out[at] = _ZERO
            at += 1
        return put_digits(n, count, 0, groups, out, at)
    if 0 <= e < 16:
        at = put_digits(n, count, e + 1, groups, out, at)
        if count > e + 1:
            return at
        for _ in range(e + 1 - count):
            out[at] = _ZERO
            at += 1
        out[at], out[at + 1] = _POINT, _ZERO
        return at + 2
    at = put_digits(n, count, 1, groups, out, at)
    out[at], out[at + 1] = _E, _MINUS if e < 0 else _PLUS
    size_of_e = abs(e)
    return put_digits(size_of_e, 3 if size_of_e >= 100 else 2, 0, groups, out, at + 2)


@entry
def write_rows(table: Matrix, whole: Codes, powers: Matrix, groups: Text, out: Text, state: Codes) -> bool:
    """Write rows of numbers, separated by commas, each ended by a line end; True when all are written.

    table (n, m); whole (m,): 1 for a column of integers; powers and groups: `powers_of_ten` and
    `groups_of_digits`. out: room for LONGEST_NUMBER characters a number. state (3,): row and column to go on with, and
    the place in out. False: Python is to write the number there, without what separates it, and to call again, the
    column one farther.
    """
    at = state[2]
    for row in range(state[0], table.shape[0]):
        for column in range(state[1] if row == state[0] else 0, table.shape[1] + 1):
            if column > 0:
                out[at] = _COMMA if column < table.shape[1] else _LINE_END
                at += 1
            if column == table.shape[1]:
                break
            x = table[row, column]
            if whole[column] == 1 and abs(x) < 1e9:
                n = int(abs(x))
                digits, least = 1, 10
                while n >= least:
                    digits, least = digits + 1, 10 * least
                if x < 0.0 and n > 0:
                    out[at] = _MINUS
                    at += 1
                at = put_digits(n, digits, 0, groups, out, at)
                continue
            behind = ASK if whole[column] == 1 else put_number(x, powers, groups, out, at)
            if behind == ASK:
                state[0], state[1], state[2] = row, column, at
                return False
            at = behind
    state[0], state[1], state[2] = table.shape[0], 0, at
    return True


@kernel
def decimal(n: int, q: int, powers: Matrix) -> float:
    """The float nearest to n 10^q, n from 1 to 10^18; NaN where Python must be asked."""
    if n < _EXACT_INTEGER and -_EXACT_POWER <= q <= _EXACT_POWER:
        power = float(powers[abs(q) - LOWEST_POWER, 0])
        return n * power if q >= 0 else n / power
    if not LOWEST_POWER < q < -LOWEST_POWER:
        return math.nan
    high, low = powers[q - LOWEST_POWER, 0], powers[q - LOWEST_POWER, 1]
    whole = float(n)
    rest = float(n - int(whole))
    product = whole * high
    more = product_error(whole, high, product) + (whole * low + rest * high)
    unsure = product * _UNSURE
    lower, upper = float(product + (more - unsure)), float(product + (more + unsure))
    return lower if lower == upper and SMALLEST <= lower < LARGEST else math.nan


@kernel
def take_number(text: Text, at: int, powers: Matrix, out: Vector) -> int:
    """Read the number of a cell into out (1,); the place of the comma or line end behind it, or ASK.

    An empty cell and `nan` are NaN. The text ends in a line end.
    """
    while text[at] == _SPACE or text[at] == _TAB:
        at += 1
    negative = text[at] == _MINUS
    if negative or text[at] == _PLUS:
        at += 1
    begin, n, digits, behind_point, point = at, 0, 0, 0, False
    while True:
        c = int(text[at])
        if _ZERO <= c < _ZERO + 10:
            n = 10 * n + (c - _ZERO)
            digits += 1 if n > 0 else 0
            if digits > MOST_DIGITS:
                return ASK
            behind_point += 1 if point else 0
        elif c == _POINT and not point:
            point = True
        else:
            break
        at += 1
    seen, q = at - begin - (1 if point else 0), -behind_point
    if seen > 0 and text[at] | _LOWER == _E:
        at += 1
        down = text[at] == _MINUS
        if down or text[at] == _PLUS:
            at += 1
        first, exponent = at, 0
        while _ZERO <= text[at] < _ZERO + 10 and at < first + 5:
            exponent = 10 * exponent + (int(text[at]) - _ZERO)
            at += 1
        if at == first:
            return ASK
        q += -exponent if down else exponent
    elif at == begin and text[at] | _LOWER == _N:
        if text[at + 1] | _LOWER != _A or text[at + 2] | _LOWER != _N:
            return ASK
        at += 3
        n = -1
    while text[at] == _SPACE or text[at] == _TAB:
        at += 1
    if text[at] != _COMMA and text[at] != _LINE_END:
        return ASK
    if seen == 0 and n == 0 and (point or text[begin - 1] == _MINUS or text[begin - 1] == _PLUS):
        return ASK  # a sign or a point alone
    x = math.nan if n < 0 or seen == 0 else 0.0 if n == 0 else decimal(n, q, powers)
    if n > 0 and x != x:
        return ASK
    out[0] = -x if negative else x
    return at


@entry
def read_rows(text: Text, column: Codes, powers: Matrix, out: Matrix, lines: Codes, ask: Codes, state: Codes) -> bool:
    """Read rows of numbers; False, and nothing is done, where the text is not as simple as that.

    text: whole lines, each ended by a line end; column (cells,): where the cell of a row goes in out (rows, k), -1 for
    nowhere. lines (rows,): number of the line of each row. ask (most, 4): row, column, begin and end of what Python is
    to be asked for. state (5,), in and out: place in text, number of the line there, line of the last row before;
    out: rows read, and entries of ask. Blank lines and comments are passed over.
    """
    at, line, last, rows, asked = int(state[0]), int(state[1]), int(state[2]), 0, 0
    cells, size = column.shape[0], text.shape[0]
    while at < size and rows < out.shape[0]:
        first = at
        while text[first] == _SPACE or text[first] == _TAB:
            first += 1
        if text[first] == _LINE_END or text[first] == _HASH:
            while text[first] != _LINE_END:
                first += 1
            at, line = first + 1, line + 1
            continue
        for cell in range(cells):
            begin, behind, target = at, ASK, column[cell]
            if target >= 0:
                behind = take_number(text, at, powers, out[rows, target : target + 1])
            if behind == ASK:
                behind = at
                while text[behind] != _COMMA and text[behind] != _LINE_END:
                    c = text[behind]
                    if (c < _SPACE and c != _TAB) or c > 126 or c == _QUOTE:
                        return False
                    behind += 1
                if target >= 0:
                    if asked == ask.shape[0]:
                        return False
                    ask[asked, 0], ask[asked, 1], ask[asked, 2], ask[asked, 3] = rows, target, begin, behind
                    asked += 1
            if (text[behind] == _LINE_END) != (cell == cells - 1):
                return False
            at = behind + 1
        lines[rows], last = line, line
        rows, line = rows + 1, line + 1
    state[0], state[1], state[2], state[3], state[4] = at, line, last, rows, asked
    return True
