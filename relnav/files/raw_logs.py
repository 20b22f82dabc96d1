"""Raw logs of a position-sensitive detector: CSV, a row a slot, the beacon's name and its four currents or counts.

Columns: `t_s`, `beacon` (a, b, c or dark), and `current_x1_na, current_x2_na, current_y1_na, current_y2_na` (any unit
of current) or `adc_x1, adc_x2, adc_y1, adc_y2` (converter counts); optionally control and attitude as in a log of
spots. An empty current is missing; one at the converter's end is saturated.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.errors import LogError
from relnav.files.log_columns import ACCELERATION, DELTA_V, QUATERNION, check_quaternions
from relnav.files.logs import MOST, check_size, pieces
from relnav.files.text_table import TextTable, table_of
from relnav.files.units import UNITS, split_unit, to_si
from relnav.files.wording import columns_are, shown
from relnav.sensors.three_beacon.pulses import NAMES

ELECTRODES = ("x1", "x2", "y1", "y2")
CURRENTS = tuple(f"current_{name}" for name in ELECTRODES)
COUNTS = tuple(f"adc_{name}" for name in ELECTRODES)
KIND = {"t": "s"} | dict.fromkeys(CURRENTS, "a") | dict.fromkeys(ACCELERATION, "m_s2") | dict.fromkeys(DELTA_V, "m_s")
KIND |= dict.fromkeys((*COUNTS, *QUATERNION, "beacon"), "")
MAY_BE_EMPTY = (*CURRENTS, *COUNTS)
MOST_SLOTS = 5_000_000


@dataclass(frozen=True)
class RawSlots:
    """A raw log in SI units; `currents_a` or `counts` (n, 4), whichever the log holds, NaN = missing."""

    path: Path
    t_s: Vector
    beacon: Codes
    currents_a: Matrix | None
    counts: Matrix | None
    acceleration_m_s2: Matrix | None
    delta_v_m_s: Matrix | None
    q_cam_from_lvlh: Matrix | None
    metadata: dict[str, str]
    ignored: tuple[str, ...]


def is_raw_log(source: Path | TextTable) -> bool:
    """Whether a log's header names a column `beacon`: a row a slot, not a row an epoch."""
    if isinstance(source, Path) and source.suffix.lower() == ".parquet":
        return False
    try:
        return "beacon" in table_of(source).names
    except LogError:
        return False  # the reader of logs says what is wrong


def read_raw_log(source: Path | TextTable) -> RawSlots:
    """Read a raw log.

    Raises
    ------
    LogError
        Naming file, line and column: for a missing column or unit, a row with a wrong number of cells, a beacon of
        another name, text in a number, an empty cell that is not a current, a count below zero, a time that repeats
        or goes back, a quaternion that is not a rotation.
    """
    table = table_of(source)
    path, metadata = table.path, table.metadata
    places, ignored = _places(table.names, f"{path}:{table.line}")
    parts: list[Matrix] = []
    count, t_before = 0, -math.inf
    for piece in pieces(table.rows()):
        part = _values(piece, table, places)
        _check(part, [number for number, _ in piece], path, places, table.names, t_before)
        t_before, count = float(part[-1, list(places).index("t")]), count + len(part)
        if count > MOST_SLOTS:
            raise LogError(f"{path}: more than {MOST_SLOTS} slots; a raw log is held in memory: cut it in parts")
        parts.append(part)
    if not parts:
        raise LogError(f"{path}: no rows after the header; one row a slot is expected")
    values = np.concatenate(parts)

    def group(bases: tuple[str, ...]) -> Matrix | None:
        if bases[0] not in places:
            return None
        order = list(places)
        return np.stack([to_si(values[:, order.index(base)], places[base][1]) for base in bases], axis=1)

    times, beacons = group(("t",)), group(("beacon",))
    assert times is not None
    assert beacons is not None
    return RawSlots(
        path=path,
        t_s=times[:, 0],
        beacon=beacons[:, 0].astype(np.int64),
        currents_a=group(CURRENTS),
        counts=group(COUNTS),
        acceleration_m_s2=group(ACCELERATION),
        delta_v_m_s=group(DELTA_V),
        q_cam_from_lvlh=group(QUATERNION),
        metadata=metadata,
        ignored=ignored,
    )


def _places(names: list[str], where: str) -> tuple[dict[str, tuple[int, float]], tuple[str, ...]]:
    """Position in a row and factor to SI of each quantity; and the columns of other matters."""
    places: dict[str, tuple[int, float]] = {}
    ignored = []
    for position, name in enumerate(names):
        base, unit = (name, "") if KIND.get(name) == "" else split_unit(name)
        if base not in KIND:
            ignored.append(name)
            continue
        if KIND[base] and (not unit or UNITS[unit][0] != KIND[base]):
            fitting = ", ".join(f"{base}_{other}" for other, (si, _) in UNITS.items() if si == KIND[base])
            came = f"unit '{unit}' does not fit" if unit else "the unit is missing"
            raise LogError(f"{where}: column '{name}': {came}; write one of {fitting}")
        if base in places:
            raise LogError(f"{where}: column '{name}' repeats '{names[places[base][0]]}'; keep one")
        places[base] = (position, UNITS[unit][1] if unit else 1.0)
    if COUNTS[0] in places and CURRENTS[0] in places:
        raise LogError(
            f"{where}: columns of counts (adc_x1) and of currents (current_x1) are both there; keep one kind"
        )
    needed = COUNTS if COUNTS[0] in places else CURRENTS
    for base in ("t", "beacon", *needed):
        if base not in places:
            example = base + {"s": "_s", "a": "_na", "": ""}[KIND[base]]
            raise LogError(f"{where}: column '{example}' is missing; {columns_are(names)}")
    for bases in (CURRENTS, COUNTS, ACCELERATION, DELTA_V, QUATERNION):
        missing = [base for base in bases if base not in places]
        if missing and len(missing) < len(bases):
            raise LogError(f"{where}: column '{missing[0]}' is missing; the others of its group are there")
    return places, tuple(ignored)


def _values(rows: list[tuple[int, str]], table: TextTable, places: dict[str, tuple[int, float]]) -> Matrix:
    """Numbers (n, len(places)) of rows, beacons by number, empty cells NaN."""
    out = np.empty((len(rows), len(places)))
    codes = {name: float(k) for k, name in enumerate(NAMES)}
    order = [(base, place) for base, (place, _) in places.items()]
    for row, (number, line) in enumerate(rows):
        cells = table.cells(number, line)
        for column, (base, place) in enumerate(order):
            if base != "beacon":
                out[row, column] = table.number(cells[place], number, table.names[place])
                continue
            name = cells[place].strip().lower()
            if name not in codes:
                raise LogError(
                    f"{table.path}:{number}: column 'beacon': one of a, b, c, dark is expected; got "
                    f"{shown(repr(cells[place].strip()), 80)}"
                )
            out[row, column] = codes[name]
    return out


def _check(
    values: Matrix,
    numbers: list[int],
    path: Path,
    places: dict[str, tuple[int, float]],
    names: list[str],
    t_before: float,
) -> None:
    for column, (base, (place, _)) in enumerate(places.items()):
        bad = np.flatnonzero(~np.isfinite(values[:, column]))
        if bad.size and base not in MAY_BE_EMPTY:
            raise LogError(
                f"{path}:{numbers[int(bad[0])]}: column '{names[place]}' is empty or not finite; only a current may be"
            )
        if base in MOST:
            si = to_si(values[:, column], places[base][1])
            check_size(si, MOST[base], np.array(numbers, dtype=np.float64), path, names[place])
        bad = np.flatnonzero((values[:, column] < 0.0) | np.isposinf(values[:, column]))
        if bad.size and base in COUNTS:
            row = int(bad[0])
            raise LogError(
                f"{path}:{numbers[row]}: column '{names[place]}': {values[row, column]:g} is no count of a converter; "
                "counts are from 0 up, and a missing one is left empty"
            )
    t = values[:, list(places).index("t")]
    before = np.concatenate([[t_before], t[:-1]])
    late = np.flatnonzero(t <= before)
    if late.size:
        row = int(late[0])
        raise LogError(
            f"{path}:{numbers[row]}: time {t[row]:.15g} s is not after {before[row]:.15g} s of the row before; sort "
            "the log by time and keep one row a slot"
        )
    if QUATERNION[0] in places:
        q = np.stack([values[:, list(places).index(base)] for base in QUATERNION], axis=1)
        check_quaternions(QUATERNION[0][:-2], q, numbers, path)
