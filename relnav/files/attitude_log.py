"""A star sensor's log of frames as attitudes in the columns that the navigation filter's log has: q_cam_from_lvlh."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Stack, Vector
from relnav.errors import InputError
from relnav.files.atomic import replacing
from relnav.files.log_columns import QUATERNION
from relnav.files.star_frames import BRIGHTNESS, NOISE, StarFrame, covariances, own_noise, read_star_table, star_frame
from relnav.files.tables import check_format, relnav_version, write_table
from relnav.files.text_table import TextTable
from relnav.files.units import UNITS, split_unit, to_si
from relnav.files.wording import listed
from relnav.geometry.linear_algebra import lengths
from relnav.geometry.orbital_attitude import dcm_cam_from_lvlh
from relnav.geometry.rotation import quaternion_from_dcm

ORBIT_COLUMNS = ("t_s", "x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")
LEAST_RADIUS_KM, MOST_RADIUS_KM, MOST_SPEED_KM_S = 6000.0, 1e6, 15.0
"""Of a state about the Earth: inside it nothing flies, at its surface one escapes with 11.2 km/s."""
SIGMA_COLUMNS = ("sigma_attitude_x_arcsec", "sigma_attitude_y_arcsec", "sigma_attitude_z_arcsec")
INERTIAL = tuple(f"q_cam_from_icrs_{part}" for part in "xyzw")
SPOT_COLUMNS = ("t_s", "x_px", "y_px")


def read_orbit(path: Path) -> Matrix:
    """Target's inertial states (n, 7): t_s, position km, velocity km/s, ICRS axes, in the order of time.

    Raises
    ------
    InputError
        Naming file, line and column of what cannot be read; for times that do not increase.
    """
    table, _, lines = read_star_table(path, ORBIT_COLUMNS, ())
    radius, speed = lengths(table[:, 1:4]), lengths(table[:, 4:])
    wrong = np.flatnonzero(~((radius > LEAST_RADIUS_KM) & (radius < MOST_RADIUS_KM) & (speed < MOST_SPEED_KM_S)))
    if wrong.size:
        row = wrong[0]
        raise InputError(
            f"{path}:{int(lines[row])}: a speed of {speed[row]:.6g} km/s at {radius[row]:.6g} km from the Earth's "
            "centre is no orbit; km and km/s are expected"
        )
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


def read_star_log(
    path: Path, centre_px: ArrayLike = (0.0, 0.0), *, residual_px: float | None = None
) -> list[tuple[float, StarFrame]]:
    """Frames of a log with a column t_s, one row a spot; rows of one time are one frame.

    `centre_px` (2,) is where the image's centre stands in the file's coordinates, `residual_px` as in
    `read_star_frame`.

    Raises
    ------
    InputError
        As `read_star_frame`; for times that go back.
    """
    columns = SPOT_COLUMNS if residual_px is None else (*SPOT_COLUMNS, *NOISE)
    table, given, lines = read_star_table(path, columns, BRIGHTNESS)
    if np.any(np.diff(table[:, 0]) < 0.0):
        raise InputError(f"{path}: t_s goes back; sort the rows by time")
    own = None if residual_px is None else own_noise(covariances(table[:, 3:6], lines, path), residual_px)
    frames = []
    for t in np.unique(table[:, 0]):
        rows = table[:, 0] == t
        noise = None if own is None else own[rows]
        frame = star_frame(path, table[rows, 1:3], centre_px, given, table[rows, len(columns) :], noise)
        frames.append((float(t), frame))
    return frames


def quaternions_in_lvlh(dcm_star_from_icrs: Stack, states: Matrix, dcm_cam_from_star: Matrix | None) -> Matrix:
    """q_cam_from_lvlh (n, 4), scalar last, of attitudes (n, 3, 3) and target states (n, 6); signs without jumps."""
    return _quaternions(dcm_cam_from_lvlh(dcm_star_from_icrs, states[:, :3], states[:, 3:], dcm_cam_from_star))


def quaternions_inertial(dcm_star_from_icrs: Stack, dcm_cam_from_star: Matrix) -> Matrix:
    """q_cam_from_icrs (n, 4), scalar last, of attitudes (n, 3, 3); signs without jumps."""
    return _quaternions(dcm_cam_from_star @ dcm_star_from_icrs)


def _quaternions(dcm: Stack) -> Matrix:
    q = np.array([quaternion_from_dcm(matrix) for matrix in dcm]).reshape(-1, 4)
    for k in range(1, len(q)):
        if q[k] @ q[k - 1] < 0.0:
            q[k] = -q[k]
    return q


def write_attitude_log(path: Path, t_s: Vector, q: Matrix, sigma_rad: Matrix, *, inertial: bool = False) -> None:
    """Write t_s, q_cam_from_lvlh_{x,y,z,w} and the star sensor's 1-sigma about its own axes (.csv or .parquet).

    `inertial` attitudes are q_cam_from_icrs_{x,y,z,w}.
    """
    check_format(path)
    table = [t_s, *q.T, *(np.degrees(sigma_rad) * 3600.0).T]
    frame, name = ("icrs", "icrs") if inertial else ("lvlh_ccsds", "lvlh")
    head = {"relnav": relnav_version(), "frame": frame, "quaternion": f"Hamilton, scalar last, v_cam = R v_{name}"}
    names = INERTIAL if inertial else QUATERNION
    write_table(path, ("t_s", *names, *SIGMA_COLUMNS), iter([table]), head, ())


def join_attitude(log: Path, t_s: Vector, q_cam_from_lvlh: Matrix, out: Path) -> int:
    """Copy a navigation log (CSV) with q_cam_from_lvlh added to every row, between star epochs by great circles.

    Returns
    -------
    Number of rows.

    Raises
    ------
    InputError
        If the log cannot be read, has the columns already, no time, or a row outside the star sensor's times.
    """
    from scipy.spatial.transform import Rotation, Slerp

    if len(t_s) < 2:
        raise InputError(f"{log}: two or more solved star frames are needed to lie on both sides of its rows")
    turn = Slerp(t_s, Rotation.from_quat(q_cam_from_lvlh))
    table = TextTable(log)
    place, factor = _time_column(table)
    count, before = 0, -math.inf
    with replacing(out) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(f"{line}\n" for line in table.head[:-1])
        file.write(",".join([table.head[-1].rstrip(), *QUATERNION]) + "\n")
        for number, line in table.rows():
            t = to_si(table.number(table.cells(number, line)[place], number, table.names[place]), factor)
            if not math.isfinite(t):
                came = "empty or NaN" if math.isnan(t) else "infinite"
                raise InputError(f"{log}:{number}: column '{table.names[place]}' is {came}; only a spot may be missing")
            if not t > before:
                raise InputError(f"{log}:{number}: time {t:.15g} s is not after {before:.15g} s of the row before")
            if not t_s[0] <= t <= t_s[-1]:
                raise InputError(
                    f"{log}:{number}: time {t:.15g} s lies outside the star sensor's attitudes, {t_s[0]:g} to "
                    f"{t_s[-1]:g} s"
                )
            quaternion = turn(t).as_quat(canonical=True).tolist()
            file.write(",".join([line.rstrip(), *map(repr, quaternion)]) + "\n")
            count, before = count + 1, t
    return count


def _time_column(table: TextTable) -> tuple[int, float]:
    """Where the time stands in a row, and its factor to seconds."""
    where = f"{table.path}:{table.line}"
    found = [(k, split_unit(name)[1]) for k, name in enumerate(table.names) if split_unit(name)[0] == "t"]
    if len(found) != 1 or UNITS.get(found[0][1], ("",))[0] != "s":
        raise InputError(f"{where}: a column t_s (or t_ms, t_us) is expected; the columns are {listed(table.names)}")
    if QUATERNION[0] in table.names:
        raise InputError(f"{where}: column '{QUATERNION[0]}' is there already; a log without attitudes is expected")
    return found[0][0], UNITS[found[0][1]][1]
