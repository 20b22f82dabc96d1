"""Kernels of SPICE (Acton 1996, Planetary and Space Science 44, 65), written by NAIF's own library through spiceypy.

SPK (`.bsp`): the chaser about the target, J2000 axes, km and km/s, as type 9 of degree 1. Between epochs position and
velocity are each on a straight line: what a filter says of an epoch jumps from the one before by its errors, and a
higher degree, or a curve through positions and velocities (type 13), would swing with the jumps. The line misses the
arc by r (n h)^2 / 8, n the target's mean motion and h the step: 1.5e-7 r at 1 s. In frame `eci` the target's orbit
about the Earth stands beside it; that is smooth, and type 13 of degree 7.

CK (`.bc`): attitudes of the target (with its inertial rate) and of the chaser (as the log has it, without) against
J2000, as type 3. SPICE asks a spacecraft's clock for its times: one that shows the log's seconds is written beside it
(`.tsc`), with names for bodies and frames. No kernel covers a time where the filter had no state.
"""

import math
import os
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.dynamics.ephemeris import seconds_since_j2000
from relnav.dynamics.in_frame import INERTIAL, OWN, lvlh_in_space
from relnav.dynamics.two_body import inertial_orbit
from relnav.errors import UsageError
from relnav.files.atomic import Outputs, replacing
from relnav.files.ccsds import check_attitude, epoch_of, known_epochs, name_of, orientation_of
from relnav.files.models import mission_of
from relnav.files.optional import require

NEED = "A SPICE kernel needs spiceypy"
EARTH, TARGET, CHASER = 399, -9991, -9992
"""NAIF's numbers of bodies; a spacecraft's are negative, and ours are of no mission that NAIF lists."""
BODIES = {"TARGET": TARGET, "CHASER": CHASER}
AXES = "J2000"
TICK_S = 1e-6
CLOSEST_S = 1e-6
"""Of two epochs: TDB as one number is good to 1.2e-7 s in this century."""
LONGEST_ID, LONGEST_PATH = 40, 255
COMMENT_WIDTH = 200
TDB_AMPLITUDE_S, TDB_ECCENTRICITY, TDB_ANOMALY_RAD, TDB_RATE_RAD_S = 1.657e-3, 1.671e-2, 6.239996, 1.99096871e-7


def tdb_minus_tt(tt_s: Any) -> Vector:
    """What SPICE's ephemeris time is ahead of TT seconds since J2000, s.

    The two terms of NAIF's leap second kernels (DELTET/K, EB, M; Moyer 1981, Celestial Mechanics 23, 33), so that a
    reader's `str2et` finds the same number; within 50 us of the series of Fairhead and Bretagnon (1990).
    """
    mean = TDB_ANOMALY_RAD + TDB_RATE_RAD_S * np.asarray(tt_s, dtype=np.float64)
    return np.asarray(TDB_AMPLITUDE_S * np.sin(mean + TDB_ECCENTRICITY * np.sin(mean)))


def check_spk(settings: dict[str, Any]) -> None:
    """Refuse what cannot be written, before there is a track.

    Raises
    ------
    UsageError
        If spiceypy is missing, for another frame, without an epoch or the orbit's orientation.
    """
    require("spiceypy", "spice", NEED)
    if _frame_of(settings) not in INERTIAL:
        raise UsageError(
            f"an SPK holds frames {', '.join(INERTIAL)} (SPICE has none that turns with an orbit); got "
            f"{settings['frame']!r}"
        )
    _zero(settings, "an SPK")
    orientation_of(settings, "an SPK")


def _frame_of(settings: dict[str, Any]) -> str:
    return "eci_relative" if settings["frame"] == OWN else str(settings["frame"])


def check_ck(settings: dict[str, Any]) -> None:
    """Refuse what cannot be written, before there is a track.

    Raises
    ------
    UsageError
        If spiceypy is missing, for a track without attitude or another frame, no epoch or no orientation of the orbit.
    """
    require("spiceypy", "spice", NEED)
    check_attitude(settings, "a CK", ".bsp")
    _zero(settings, "a CK")
    orientation_of(settings, "a CK")


def write_spk(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write the epochs with a state; frame `eci_relative` unless `eci` is asked for.

    Raises
    ------
    UsageError
        Without two states in a row, which SPICE needs between them, and as `check_spk`.
    """
    spice, frame = require("spiceypy", "spice", NEED), _frame_of(settings)
    zero, et, runs = _covered(solution, settings, "an SPK")
    runs = [run for run in runs if len(run) > 1]
    if not runs:
        raise UsageError("an SPK holds two states in a row or more, and this track has none")
    orientation, model = orientation_of(settings, "an SPK"), settings["model"]
    track = solution.in_frame(frame, orientation_deg=orientation, model=model)
    relative = solution.in_frame("eci_relative", orientation_deg=orientation, model=model)
    orbit = mission_of(solution).orbit if model is None else model.orbit
    with replacing(path) as temporary, _kernel(spice.spkopn, spice.dafcls, temporary, path) as handle:
        for run in runs:
            times, state = et[run], 1e-3 * relative.state[run]
            span = AXES, times[0], times[-1], _segment(solution)
            spice.spkw09(handle, CHASER, TARGET, *span, 1, len(run), state, times)
            if frame == "eci":
                t_s = (times - zero) - tdb_minus_tt(times)  # what the rounded times are: a curve through them is smooth
                target = 1e-3 * _target_states(orbit, orientation, t_s)
                spice.spkw13(handle, TARGET, EARTH, *span, min(7, 2 * len(run) - 1), len(run), target, times)
        spice.dafac(handle, _comments(track.metadata, settings))


def write_ck(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write the attitudes at the epochs with a state, and the clock that they are read with as `settings["clock"]`.

    Raises
    ------
    UsageError
        As `check_ck`.
    """
    spice = require("spiceypy", "spice", NEED)
    zero, et, runs = _covered(solution, settings, "a CK")
    orientation, known = orientation_of(settings, "a CK"), np.concatenate(runs)
    t = np.asarray(solution.t_s)
    eci_from_lvlh, said = lvlh_in_space(t[known], solution.mission, orientation)
    eci_from_target = eci_from_lvlh @ solution.dcm_lvlh_from_target[known]
    rate = np.einsum("nij,nj->ni", eci_from_target, solution.rate_rad_s[known])
    eci_from_chaser = eci_from_lvlh @ np.swapaxes(solution.epochs["chaser"][known], 1, 2)
    begin_s = min(0.0, math.floor(t[known[0]]))  # a clock shows no time before its zero
    begin = float(zero + begin_s + tdb_minus_tt(zero + begin_s))
    ticks = (et[known] - begin) / TICK_S
    starts = ticks[np.cumsum([0, *(len(run) for run in runs[:-1])])]
    metadata = {"model": str(solution.model), "target orbit": said}
    with Outputs() as outputs:
        clock = outputs.path(settings["clock"])
        clock.write_text(_clock(begin, begin_s, settings), encoding="ascii")
        with _kernel(spice.ckopn, spice.dafcls, outputs.path(path), path) as handle:
            for body, dcm, spin in ((TARGET, eci_from_target, rate), (CHASER, eci_from_chaser, None)):
                quaternions, told = _quaternions(dcm), spin is not None
                spins = spin if told else np.zeros((len(known), 3))
                head = ticks[0], ticks[-1], 1000 * body, AXES, told, _segment(solution), len(known)
                spice.ckw03(handle, *head, ticks, quaternions, spins, len(starts), starts)
            spice.dafac(handle, _comments(metadata, settings))


def _zero(settings: dict[str, Any], what: str) -> float:
    """TT of the log's t = 0, s since J2000."""
    try:
        return seconds_since_j2000(epoch_of(settings, what).replace(tzinfo=UTC))
    except ValueError as error:
        raise UsageError(f"{what}: {error}") from None


def _covered(solution: Any, settings: dict[str, Any], what: str) -> tuple[float, Vector, list[Codes]]:
    """TT of the log's t = 0, TDB of all epochs, s since J2000; numbers of the epochs with a state, run after run."""
    zero = _zero(settings, what)
    known = known_epochs(solution, what)
    tt = zero + np.asarray(solution.t_s)
    et = tt + tdb_minus_tt(tt)
    if len(known) > 1 and float(np.diff(et[known]).min()) < CLOSEST_S:
        raise UsageError(f"{what}: rows less than a microsecond apart cannot be told apart in it")
    return zero, et, np.split(known, np.flatnonzero(np.diff(known) > 1) + 1)


def _target_states(orbit: Any, orientation_deg: tuple[float, float, float], t_s: Vector) -> Matrix:
    """The target's states about the Earth, m and m/s, (n, 6)."""
    inclination, node, perigee = map(math.radians, orientation_deg)
    shape = orbit.mean_motion_rad_s, orbit.eccentricity, orbit.true_anomaly_rad
    return np.concatenate(inertial_orbit(*shape, (inclination, node, perigee), t_s), axis=1)


def _quaternions(dcm_eci_from_body: Stack) -> Matrix:
    """As SPICE has them: scalar first, of the matrix that takes J2000 components into the body's."""
    turns = Rotation.from_matrix(np.swapaxes(dcm_eci_from_body, 1, 2)).as_quat(canonical=True)
    return np.ascontiguousarray(turns[:, [3, 0, 1, 2]])


def _segment(solution: Any) -> str:
    return name_of(f"relnav {solution.model}")[:LONGEST_ID]


def _comments(metadata: dict[str, str], settings: dict[str, Any]) -> list[str]:
    """Lines for a kernel's comment area."""
    bodies = ", ".join(f"{name} {number}" for name, number in BODIES.items())
    epoch = epoch_of(settings, "a kernel").isoformat()
    stated = {"bodies": bodies, "epoch": f"{epoch} UTC is t = 0 of the log"} | metadata
    lines = ["Written by relnav"]
    for key, value in stated.items():
        lines += textwrap.wrap(name_of(f"{key}: {value}"), COMMENT_WIDTH, subsequent_indent="  ")
    return lines


@contextmanager
def _kernel(opened: Any, close: Any, written: Path, path: Path) -> Iterator[int]:
    """Handle of a new kernel, closed at the end; what SPICE itself refuses is a sentence.

    Raises
    ------
    UsageError
        For a path of which SPICE, without a word, would take the beginning; with SPICE's words for a full disk.
    """
    from spiceypy.utils.exceptions import SpiceyError

    if (length := len(os.fsencode(written))) > LONGEST_PATH:
        raise UsageError(
            f"{path}: SPICE takes paths of {LONGEST_PATH} bytes; with the hidden folder that a file is prepared in, "
            f"this one has {length}: write to a shorter one"
        )
    try:
        handle = opened(str(written), "relnav", 0)
        try:
            yield handle
        finally:
            close(handle)
    except SpiceyError as error:
        raise UsageError(
            f"{path}: SPICE refuses to write it: {' '.join(str(error.long or error.short).split())}"
        ) from None


def _clock(begin_tdb_s: float, begin_s: float, settings: dict[str, Any]) -> str:
    """Text kernel of a clock that counts seconds and microseconds from a time on, and of names."""
    clock, epoch = -TARGET, epoch_of(settings, "a CK").isoformat()
    lines = [
        "KPL/SCLK",
        "",
        f"Written by relnav. Clock {TARGET} shows seconds of the log since t = {begin_s:g} s; t = 0 is",
        f"{epoch} UTC. It goes with TDB, hence with TT to 3.3e-10.",
        "Bodies and frames are named for reading the C-kernel beside it.",
        "",
        "\\begindata",
        "",
        f"SCLK_KERNEL_ID            = ( @{epoch[:19]} )",
        f"SCLK_DATA_TYPE_{clock}       = ( 1 )",
        f"SCLK01_TIME_SYSTEM_{clock}   = ( 1 )",
        f"SCLK01_N_FIELDS_{clock}      = ( 2 )",
        f"SCLK01_MODULI_{clock}        = ( 4294967296 {round(1.0 / TICK_S)} )",
        f"SCLK01_OFFSETS_{clock}       = ( 0 0 )",
        f"SCLK01_OUTPUT_DELIM_{clock}  = ( 1 )",
        f"SCLK_PARTITION_START_{clock} = ( 0 )",
        f"SCLK_PARTITION_END_{clock}   = ( 4294967296000000 )",
        f"SCLK01_COEFFICIENTS_{clock}  = ( 0 {begin_tdb_s:.17g} 1 )",
        "",
    ]
    for name, body in BODIES.items():
        frame = 1000 * body
        lines += [
            f"NAIF_BODY_NAME += '{name}'",
            f"NAIF_BODY_CODE += {body}",
            f"FRAME_{name}_BODY = {frame}",
            f"FRAME_{frame}_NAME = '{name}_BODY'",
            f"FRAME_{frame}_CLASS = 3",
            f"FRAME_{frame}_CLASS_ID = {frame}",
            f"FRAME_{frame}_CENTER = {body}",
            f"CK_{frame}_SCLK = {TARGET}",
            f"CK_{frame}_SPK = {body}",
            "",
        ]
    return "\n".join([*lines, "\\begintext", ""])
