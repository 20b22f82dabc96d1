"""A track as a MATLAB file: one struct `track` with a column a field, the covariance, and what it is of."""

from pathlib import Path
from typing import Any

import numpy as np

from relnav.files.atomic import replacing
from relnav.files.data_frames import track_table, unit_of
from relnav.files.tables import framed

LONGEST_NAME = 31
"""Of a field, in MATLAB's files of version 5."""


def write_mat(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write it in format 5, which MATLAB, Octave and Simulink read."""
    from scipy.io import savemat

    turned = framed(solution, settings)
    columns, stated = track_table(solution, turned)
    fields: dict[str, Any] = {
        name: np.asarray(column, dtype=np.float64)[:, None]
        for name, column in columns.items()
        if not name.startswith("cov_")
    }
    assert all(len(name) <= LONGEST_NAME for name in fields)
    fields["covariance"] = np.moveaxis(np.asarray(solution.covariance if turned is None else turned.covariance), 0, 2)
    fields["status"] = np.asarray(solution.status, dtype=np.float64)[:, None]
    fields["units"] = {name: unit_of(name) for name in columns if name in fields}
    fields["about"] = "\n".join(f"{key} = {value}" for key, value in stated.items())
    with replacing(path) as temporary:
        savemat(temporary, {"track": fields}, oned_as="column")
