"""A campaign's folder: what is flown, a Parquet file a batch, and from these the table of all runs."""

import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from relnav.accuracy.campaign_plan import Batch, Plan, fly_batch
from relnav.accuracy.run_figures import RunStatus
from relnav.arrays import Codes, Vector
from relnav.codegen.store import package_stamp
from relnav.errors import InputError, UsageError
from relnav.files.atomic import PART, replacing
from relnav.files.parquet import require_pyarrow
from relnav.files.scenarios import plain
from relnav.files.sealed import UnsealedError, check_sealed, write_sealed
from relnav.files.tables import read_json, relnav_version, write_json
from relnav.files.wording import shown

DESCRIPTION, RUNS, FAILED = "campaign.json", "runs", "failed.parquet"


def pyarrow_for_campaigns() -> Any:
    """The pyarrow package; UsageError with the line that installs it, for which a campaign has no other way."""
    return require_pyarrow("the runs of a campaign are a table of pyarrow", "")


def description(plan: Plan) -> dict[str, Any]:
    """What a campaign flies, as plain values: the same content gives the same figures."""
    model = {key: value for key, value in plain(plan.model).items() if key not in ("provenance", "path", "title")}
    return {
        "relnav": relnav_version(),
        "code": package_stamp(),
        "model": _finite(model),
        "scenario": _finite(plain(plan.scenario)),
        "method": plan.method,
        "seed": plan.seed,
        "runs": plan.runs,
        "batch": plan.batch,
    } | ({"design": plan.design} if plan.design else {})


def _finite(value: Any) -> Any:
    """Words for what JSON cannot write."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def name_of(described: dict[str, Any]) -> str:
    """Digest of what a campaign flies."""
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def open_folder(folder: Path, plan: Plan) -> None:
    """Make a campaign's folder, or see that the one that is there is this campaign's.

    Raises
    ------
    UsageError
        If it holds another campaign, with the first difference; or is no folder.
    """
    pyarrow_for_campaigns()
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder}: is a file; a campaign needs a folder of its own")
    file, own = folder / DESCRIPTION, description(plan)
    if file.is_file():
        there = read_json(file, "a campaign's description")
        if (difference := _difference(there, own)) is not None:
            raise UsageError(f"{folder}: holds another campaign: {difference}; go on with that, or name another folder")
    elif folder.is_dir() and any(entry.suffix == ".parquet" for entry in folder.glob(f"{RUNS}/*")):
        raise UsageError(f"{folder}: holds runs but no {DESCRIPTION} that says of what; name another folder")
    (folder / RUNS).mkdir(parents=True, exist_ok=True)
    if not file.is_file():
        write_json(own, file)


def _difference(there: Any, own: Any, where: str = "") -> str | None:
    """The first value that differs, in words; None if none does."""
    if isinstance(there, dict) and isinstance(own, dict):
        for key in [*own, *(key for key in there if key not in own)]:
            place = f"{where}.{key}" if where else key
            if (found := _difference(there.get(key), own.get(key), place)) is not None:
                return found
        return None
    if there == own:
        return None
    if where == "code":
        return "it was flown by other code of relnav"
    return f"{where} is {shown(there, 60)} there and {shown(own, 60)} here"


def part_of(folder: Path, start: int) -> Path:
    """File of the batch that begins with this run."""
    return folder / RUNS / f"part-{start:012d}.parquet"


@dataclass(frozen=True)
class Cut:
    """How a campaign is cut, as its description says it: number of runs, and the first run of every batch."""

    runs: int
    starts: range


def missing(folder: Path, plan: Plan | Cut) -> list[int]:
    """First runs of the batches that are not there yet, or beside which a killed program left its hidden folder."""
    there = {path.name for path in (folder / RUNS).iterdir()}
    names = {start: part_of(folder, start).name for start in plan.starts}
    return [start for start, name in names.items() if name not in there or f".{name}.{PART}" in there]


def table_of(plan: Plan, batch: Batch) -> Any:
    """A batch as a pyarrow table."""
    pyarrow = require_pyarrow()
    arrays = [
        pyarrow.array(batch.run, pyarrow.int64()),
        pyarrow.array(batch.status, pyarrow.int8()),
        pyarrow.array(batch.reasons, pyarrow.string()),
        *(pyarrow.array(np.ascontiguousarray(column)) for column in batch.figures.T),
    ]
    return pyarrow.Table.from_arrays(arrays, names=["run", "status", "reason", *plan.columns])


def write_batch(plan: Plan, folder: str, runs: range) -> int:
    """Fly a batch and write its file, which then is there whole; returns the number of runs.

    The bytes depend on the campaign alone: no time, place or compression is in them.
    """
    write_flown(plan, Path(folder), fly_batch(plan, runs))
    return len(runs)


def write_flown(plan: Plan, folder: Path, batch: Batch) -> None:
    """Write the file of a batch that was flown."""
    _write(table_of(plan, batch), part_of(folder, int(batch.run[0])))


def failed_batch(plan: Plan, run: int, reason: str) -> Batch:
    """A run that could not be flown."""
    figures = np.full((1, len(plan.columns)), math.nan)
    return Batch(np.array([run]), np.array([int(RunStatus.FAILED)]), (reason,), figures)


def join_batches(pieces: Sequence[Batch]) -> Batch:
    """Pieces of a batch as one, in the order of runs."""
    ordered = sorted(pieces, key=lambda piece: int(piece.run[0]))
    return Batch(
        np.concatenate([piece.run for piece in ordered]),
        np.concatenate([piece.status for piece in ordered]),
        tuple(reason for piece in ordered for reason in piece.reasons),
        np.concatenate([piece.figures for piece in ordered]),
    )


def _write(table: Any, path: Path) -> None:
    with replacing(path) as temporary:
        write_sealed(table, temporary)


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: damaged: {shown(error)}; delete it and go on with the campaign")


class Runs:
    """The runs of a finished campaign, read column by column: a million of them need no more memory than one column.

    Attributes
    ----------
    folder : path
        Of the campaign.
    """

    def __init__(self, folder: Path, plan: Plan | Cut) -> None:
        self.folder = folder
        self._parts, self._runs = [part_of(folder, start) for start in plan.starts], plan.runs
        self._whole: set[Path] = set()

    def _tables(self, names: Sequence[str] | None = None, *, in_place: bool = False) -> Iterator[Any]:
        """A table of each part: these columns of it, or all; read, or mapped into memory.

        Raises
        ------
        InputError
            Naming the first part that is damaged. A part is looked at once, before anything in it is used.
        """
        pyarrow = require_pyarrow()
        from pyarrow import parquet

        for path in self._parts:
            try:
                if path not in self._whole:
                    check_sealed(path)
                    self._whole.add(path)
                file = parquet.ParquetFile(path, memory_map=in_place, pre_buffer=False)
                table = file.read(columns=None if names is None else list(names), use_threads=False)
            except (pyarrow.ArrowException, OSError, UnicodeDecodeError, UnsealedError) as error:
                raise _damaged(path, error) from error
            yield table.replace_schema_metadata()  # its digest is the file's, not the table's

    def read(self, names: Sequence[str]) -> dict[str, Vector]:
        """Figures of all runs, in their order."""
        out = {name: np.empty(self._runs) for name in names}
        at = 0
        for table in self._tables(names):
            for name in names:
                out[name][at : at + len(table)] = table.column(name).to_numpy()
            at += len(table)
        return out

    def columns(self) -> set[str]:
        """Names of the columns."""
        return set(next(self._tables()).column_names)

    def status(self) -> Codes:
        """RunStatus of all runs."""
        return self.read(["status"])["status"].astype(np.int64)

    def failed(self) -> Any:
        """Table of the runs that failed: run, reason."""
        pyarrow = require_pyarrow()
        from pyarrow import compute

        parts = [
            table.filter(compute.equal(table["status"], int(RunStatus.FAILED))).select(["run", "reason"])
            for table in self._tables(["run", "status", "reason"])
        ]
        return pyarrow.concat_tables(parts)

    def table(self) -> Any:
        """All of it as one pyarrow table, which is read in place."""
        return require_pyarrow().concat_tables(list(self._tables(in_place=True)))


def write_failed(folder: Path, failed: Any) -> None:
    """Write the runs that failed with their reasons; no file if there are none."""
    if len(failed):
        _write(failed, folder / FAILED)
    else:
        (folder / FAILED).unlink(missing_ok=True)
