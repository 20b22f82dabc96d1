"""A solution as a file: the public `write`, whichever filter it comes from."""

import os
from collections.abc import Iterator
from pathlib import Path

from relnav.files.tables import COLUMNS, INTEGERS, Table, check_format, head, rows_of, write_table
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.record import Solution

ROWS_AT_ONCE = 65_536


def write(solution: Solution | PoseSolution, path: str | os.PathLike[str]) -> None:
    """Write a solution as a table, one row an epoch; numbers are exact (read back, they are the same).

    Parameters
    ----------
    solution : Solution or PoseSolution
        From `filter_log`.
    path : str or path
        Ends in `.csv` or `.parquet` (needs pyarrow). Empty cells: no state yet. The file appears whole or not at all.

    Raises
    ------
    UsageError
        For another ending, or a folder that does not exist.
    """
    target = Path(path)
    check_format(target)
    if not isinstance(solution, Solution):
        from relnav.files.marker_logs import write_track  # scipy's rotations, which a beacon log does not need

        write_track([solution], solution.model, target, {"smoothed": "yes"} if solution.smoothed else {})
        return
    stated = head(solution.model, solution.method, solution.smoothed)
    stated |= {key: str(value) for key, value in solution.metadata.items()}
    write_table(target, COLUMNS, _parts(solution), stated, INTEGERS)


def _parts(solution: Solution) -> Iterator[Table]:
    """Part after part: a long solution's covariances are never all in memory."""
    for begin in range(0, len(solution), ROWS_AT_ONCE):
        yield rows_of(solution.part(begin, begin + ROWS_AT_ONCE))
