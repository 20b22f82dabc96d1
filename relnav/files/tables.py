"""A solution as a table: one row an epoch, the columns of the log contract."""

import json
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.dynamics.in_frame import OWN, FramedTrack
from relnav.errors import LogError, UsageError
from relnav.files.atomic import is_stream, replacing
from relnav.files.compiled_text import texts_of, worth_writing
from relnav.files.wording import printable, shown
from relnav.navigation.docking_view import UPPER
from relnav.navigation.record import DIAGONAL, Solution
from relnav.navigation.status import ALARM_TABLE

MOST_JSON_BYTES = 50_000_000
STATE = ("x", "y", "z", "vx", "vy", "vz")
STATE_UNITS = ("m", "m", "m", "m_s", "m_s", "m_s")
STATE_COLUMNS = tuple(f"{name}_{unit}" for name, unit in zip(STATE, STATE_UNITS, strict=True))
DOCKING_COLUMNS = ("range_m", "azimuth_deg", "elevation_deg")
COVARIANCE_COLUMNS = tuple(f"cov_{STATE[i]}_{STATE[j]}" for i, j in zip(*UPPER, strict=True))
COLUMNS = (
    "t_s",
    *STATE_COLUMNS,
    *DOCKING_COLUMNS,
    *(f"sigma_{name}" for name in (*STATE_COLUMNS, *DOCKING_COLUMNS)),
    "nis",
    "dof",
    "accepted",
    "alarm",
    *COVARIANCE_COLUMNS,
)
INTEGERS = tuple(COLUMNS.index(name) for name in ("dof", "accepted", "alarm"))


def relnav_version() -> str:
    """The installed version, or "unknown" when run from files alone."""
    try:
        return version("relnav")
    except PackageNotFoundError:
        return "unknown"


def head(model: str, method: str, smoothed: bool) -> dict[str, str]:
    """Frame, units, model and version, as they head every table."""
    return {
        "relnav": relnav_version(),
        "frame": "lvlh_ccsds: origin target's centre of mass, x V-bar, y = -h, z nadir; velocity in the turning frame",
        "units": "SI; angles in degrees; covariance in SI (m, m/s)",
        "model": model,
        "method": method + (", smoothed" if smoothed else ""),
        "alarm": ALARM_TABLE,
    }


Table = list[Vector] | Matrix
"""Rows as columns: one array (m,) for each, or all as one (columns, m), which is faster for a single row."""


def rows_of(part: Solution, turned: FramedTrack | None = None) -> Table:
    """The columns `COLUMNS` of some epochs; with their states and covariances in another frame, if that is given."""
    view, degrees = part.view, 180.0 / np.pi
    angles, sigma_docking = view[1:3] * degrees, np.sqrt(view[[3, 6, 8]])
    sigma_docking[1:] *= degrees
    state, covariance = part.state, view[9:]
    if turned is not None:
        state, covariance = turned.state, turned.covariance[:, UPPER[0], UPPER[1]].T
    return [
        part.t_s,
        *state.T,
        view[0],
        *angles,
        *np.sqrt(covariance[DIAGONAL]),
        *sigma_docking,
        part.nis,
        part.dof,
        part.accepted,
        part.alarm,
        *covariance,
    ]


def framed(solution: Any, settings: dict[str, Any]) -> FramedTrack | None:
    """The solution in the frame that a format was asked for; None where that is its own."""
    if settings["frame"] == OWN:
        return None
    found: FramedTrack = solution.in_frame(
        settings["frame"], orientation_deg=settings["orientation_deg"], model=settings["model"]
    )
    return found


Writer = Callable[[Path, tuple[str, ...], Iterator[Table], dict[str, str], tuple[int, ...]], None]
"""What writes a table: `write_table`, or `live_track.LineByLine`."""


_NO_JSON = ("", "inf", "-inf")


def _cells(row: tuple[float, ...], integers: tuple[int, ...]) -> list[str]:
    cells = ["" if value != value else repr(value) for value in row]
    for index in integers:
        cells[index] = str(int(row[index]))
    return cells


def head_text(ending: str, columns: tuple[str, ...], stated: dict[str, str]) -> str:
    """What stands before the rows: of .csv what is stated and the columns, of .jsonl nothing."""
    if ending == ".jsonl":
        return ""
    comments = (f"# {printable(key)} = {printable(value)}\n" for key, value in stated.items())
    return "".join([*comments, ",".join(columns), "\n"])


def rows_text(
    ending: str, columns: tuple[str, ...], part: Table, integers: tuple[int, ...]
) -> Iterator[bytes | memoryview]:
    """The rows of a table as lines of .csv, or of .jsonl: an object a row, null where a cell is empty or infinite.

    To be written before the next piece is asked for (`texts_of`).
    """
    texts: Iterator[bytes | memoryview]
    texts = texts_of(part, integers) if worth_writing(len(part) * len(part[0])) else _texts_of(part, integers)
    if ending != ".jsonl":
        yield from texts
        return
    names = [f'"{name}": ' for name in columns]
    for text in texts:
        for line in str(text, "ascii").split("\n")[:-1]:
            cells = line.split(",")
            if not all(cells) or "inf" in line:
                cells = ["null" if cell in _NO_JSON else cell for cell in cells]
            yield ("{" + ", ".join(map(add, names, cells)) + "}\n").encode()


def _texts_of(part: Table, integers: tuple[int, ...]) -> Iterator[bytes]:
    """As `texts_of`, by Python."""
    for row in zip(*(column.tolist() for column in part), strict=True):
        yield (",".join(_cells(row, integers)) + "\n").encode()


def write_table(
    path: Path, columns: tuple[str, ...], parts: Iterator[Table], stated: dict[str, str], integers: tuple[int, ...]
) -> None:
    """Write rows, part after part, as CSV, JSON lines or Parquet by the file's ending; whole or not at all."""
    with replacing(path, ".csv") as temporary:
        if path.suffix.lower() == ".parquet":
            from relnav.files.parquet import write_parquet

            write_parquet(temporary, columns, parts, stated, integers)
            return
        with temporary.open("wb") as file:
            ending = ".jsonl" if path.suffix.lower() == ".jsonl" else ".csv"
            file.write(head_text(ending, columns, stated).encode())
            for part in parts:
                file.writelines(rows_text(ending, columns, part, integers))


TABLES, TRACKS = (".csv", ".parquet"), (".csv", ".jsonl", ".parquet")
"""Endings of tables that are read again, and of those that are not only."""


def check_format(path: Path, endings: tuple[str, ...] = TABLES, others: Iterable[str] = ()) -> None:
    """Refuse a table of a kind that cannot be written; a pipe without an ending is given CSV.

    `others` are endings of what is no table, which could be written instead.

    Raises
    ------
    UsageError
        Naming the endings that can.
    """
    if path.suffix.lower() not in endings and not (path.suffix == "" and is_stream(path)):
        beside = f", other formats in {_either(others)}" if others else ""
        raise UsageError(f"{path}: a table ends in {_either(endings)}{beside}; got '{path.suffix}'")
    if path.suffix.lower() == ".parquet":
        from relnav.files.parquet import require_pyarrow

        require_pyarrow()


def _either(endings: Iterable[str]) -> str:
    *first, last = endings
    return f"{', '.join(first)} or {last}"


def read_json(path: Path, kind: str) -> Any:
    """What a JSON file holds; `kind` ("a calibration file") says in the message what it should have been.

    Raises
    ------
    LogError
        For what is none.
    """
    with path.open("rb") as file:
        content = file.read(MOST_JSON_BYTES + 1)
    if len(content) > MOST_JSON_BYTES:
        raise LogError(f"{path}: larger than {MOST_JSON_BYTES // 1_000_000} MB, so not {kind}")
    try:
        return json.loads(content.decode())
    except (ValueError, RecursionError) as error:
        raise LogError(f"{path}: not readable as JSON, so not {kind}: {shown(error)}") from error


def write_json(value: dict[str, Any], path: Path) -> None:
    """Write one JSON object; NaN becomes null."""

    def plain(item: Any) -> Any:
        if isinstance(item, dict):
            return {key: plain(entry) for key, entry in item.items()}
        if isinstance(item, list | tuple):
            return [plain(entry) for entry in item]
        return None if isinstance(item, float) and not np.isfinite(item) else item

    with replacing(path) as temporary:
        temporary.write_text(json.dumps(plain(value), indent=2) + "\n", encoding="utf-8")
