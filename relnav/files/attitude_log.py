"""A star sensor's log of frames as attitudes in the columns that the navigation filter's log has: q_cam_from_lvlh."""

import csv
import math
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.errors import InputError
from relnav.files.atomic import replacing
from relnav.files.log_columns import QUATERNION
from relnav.files.star_frames import StarFrame, read_star_table
from relnav.files.tables import check_format, relnav_version, write_table
from relnav.geometry.orbital_attitude import dcm_cam_from_lvlh
from relnav.geometry.rotation import quaternion_from_dcm

ORBIT_COLUMNS = ("t_s", "x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")
SIGMA_COLUMNS = ("sigma_attitude_x_arcsec", "sigma_attitude_y_arcsec", "sigma_attitude_z_arcsec")
SPOT_COLUMNS = ("t_s", "x_px", "y_px")


def read_orbit(path: Path) -> Matrix:
    """Target's inertial states (n, 7): t_s, position km, velocity km/s, ICRS axes, in the order of time.

    Raises
    ------
    InputError
        Naming file, line and column of what cannot be read; for times that do not increase.
    """
    table, _ = read_star_table(path, ORBIT_COLUMNS, ())
    if len(table) == 0 or np.any(np.diff(table[:, 0]) <= 0.0):
        raise InputError(f"{path}: one row or more with times that increase are expected")
    return table


def states_at(orbit: Matrix, t_s: Vector, path: Path) -> Matrix:
    """States (m, 6) km, km/s at times within the orbit's, by cubic Hermite interpolation of position and velocity.

    Raises
    ------
    InputError
        For a time outside.
    """
    outside = (t_s < orbit[0, 0]) | (t_s > orbit[-1, 0])
    if np.any(outside):
        late = float(t_s[outside][0])
        raise InputError(f"{path}: covers {orbit[0, 0]:g} to {orbit[-1, 0]:g} s; a frame was taken at {late:g} s")
    if len(orbit) == 1:
        return np.repeat(orbit[:, 1:], len(t_s), axis=0)
    from scipy.interpolate import CubicHermiteSpline

    spline = CubicHermiteSpline(orbit[:, 0], orbit[:, 1:4], orbit[:, 4:])
    states: Matrix = np.concatenate([spline(t_s), spline.derivative()(t_s)], axis=1)
    return states


def read_star_log(path: Path) -> list[tuple[float, StarFrame]]:
    """Frames of a log with a column t_s, one row a spot; rows of one time are one frame.

    Raises
    ------
    InputError
        As `read_star_frame`; for times that go back.
    """
    table, brightness = read_star_table(path, SPOT_COLUMNS, ("flux", "magnitude"))
    if np.any(np.diff(table[:, 0]) < 0.0):
        raise InputError(f"{path}: t_s goes back; sort the rows by time")
    frames = []
    for t in np.unique(table[:, 0]):
        rows = table[table[:, 0] == t]
        given = rows[:, 3] if brightness else None
        frames.append(
            (
                float(t),
                StarFrame(
                    path,
                    np.ascontiguousarray(rows[:, 1:3]),
                    given if brightness == "flux" else None,
                    given if brightness == "magnitude" else None,
                ),
            )
        )
    return frames


def quaternions_in_lvlh(dcm_star_from_icrs: Stack, states: Matrix, dcm_cam_from_star: Matrix | None) -> Matrix:
    """q_cam_from_lvlh (n, 4), scalar last, of attitudes (n, 3, 3) and target states (n, 6); signs without jumps."""
    dcm = dcm_cam_from_lvlh(dcm_star_from_icrs, states[:, :3], states[:, 3:], dcm_cam_from_star)
    q = np.array([quaternion_from_dcm(matrix) for matrix in dcm]).reshape(-1, 4)
    for k in range(1, len(q)):
        if q[k] @ q[k - 1] < 0.0:
            q[k] = -q[k]
    return q


def write_attitude_log(path: Path, t_s: Vector, q_cam_from_lvlh: Matrix, sigma_rad: Matrix) -> None:
    """Write t_s, q_cam_from_lvlh_{x,y,z,w} and the star sensor's 1-sigma about its own axes (.csv or .parquet)."""
    check_format(path)
    table = [t_s, *q_cam_from_lvlh.T, *(np.degrees(sigma_rad) * 3600.0).T]
    head = {"relnav": relnav_version(), "frame": "lvlh_ccsds", "quaternion": "Hamilton, scalar last, v_cam = R v_lvlh"}
    write_table(path, ("t_s", *QUATERNION, *SIGMA_COLUMNS), iter([table]), head, ())


def _time(line: str, column: int, where: str) -> float:
    """The time in a row of a log; InputError if there is none."""
    cells = next(csv.reader([line]))
    cell = cells[column].strip() if column < len(cells) else ""
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: column 't_s' is {cell!r}; a time in seconds is expected")
    return value


def join_attitude(log: Path, t_s: Vector, q_cam_from_lvlh: Matrix, out: Path) -> int:
    """Copy a navigation log (CSV) with q_cam_from_lvlh added to every row, between star epochs by great circles.

    Returns
    -------
    Number of rows.

    Raises
    ------
    InputError
        If the log has the columns already, no t_s, or rows outside the star sensor's times.
    """
    from scipy.spatial.transform import Rotation, Slerp

    if len(t_s) < 2:
        raise InputError(f"{log}: two or more solved star frames are needed to lie on both sides of its rows")
    turn = Slerp(t_s, Rotation.from_quat(q_cam_from_lvlh))
    try:
        text = log.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{log}: not a text file in UTF-8; a CSV log is expected") from error
    head = next((k for k, line in enumerate(text) if line.strip() and not line.lstrip().startswith("#")), None)
    names = [] if head is None else [name.strip() for name in next(csv.reader([text[head]]))]
    if head is None or "t_s" not in names or QUATERNION[0] in names:
        raise InputError(f"{log}: a log with a column t_s and without q_cam_from_lvlh is expected")
    numbered = [(number, line) for number, line in enumerate(text[head + 1 :], start=head + 2) if line.strip()]
    times = np.array([_time(line, names.index("t_s"), f"{log}:{number}") for number, line in numbered])
    rows = [line for _, line in numbered]
    if len(times) and (times.min() < t_s[0] or times.max() > t_s[-1]):
        raise InputError(
            f"{log}: its rows reach from {times.min():g} to {times.max():g} s, the star sensor's attitudes from "
            f"{t_s[0]:g} to {t_s[-1]:g} s"
        )
    q = turn(times).as_quat(canonical=True) if len(times) else np.empty((0, 4))
    with replacing(out) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(f"{line}\n" for line in text[:head])
        file.write(",".join([text[head].rstrip(), *QUATERNION]) + "\n")
        for line, quaternion in zip(rows, q.tolist(), strict=True):
            file.write(",".join([line.rstrip(), *(repr(value) for value in quaternion)]) + "\n")
    return len(rows)


def write_attitudes(
    out: Path, t_s: Vector, q_cam_from_lvlh: Matrix, sigma_rad: Matrix, log: Path | None, joined: Path | None
) -> int:
    """`write_attitude_log`, and `join_attitude` if there is a log: both files or none; rows of the joined one."""
    with ExitStack() as outputs:
        write_attitude_log(outputs.enter_context(replacing(out)), t_s, q_cam_from_lvlh, sigma_rad)
        if log is None or joined is None:
            return 0
        return join_attitude(log, t_s, q_cam_from_lvlh, outputs.enter_context(replacing(joined)))
