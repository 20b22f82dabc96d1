"""CCSDS Orbit Ephemeris Message with covariance (CCSDS 502.0-B-3, section 5), keyword = value; km and km/s.

The chaser relative to the target (`rsw`, in CCSDS words RTN, with the target as centre), or in inertial axes about the
Earth (`eci`), as the frame says.
"""

from pathlib import Path
from typing import Any

import numpy as np

from relnav.dynamics.in_frame import INERTIAL, OWN
from relnav.errors import UsageError
from relnav.files.atomic import replacing
from relnav.files.ccsds import creation, epoch_of, known_epochs, name_of, orientation_of, stamps

WHERE = {"rsw": ("TARGET", "RTN"), "eci_relative": ("TARGET", "EME2000"), "eci": ("EARTH", "EME2000")}
"""Frame -> CENTER_NAME and REF_FRAME."""


def _frame_of(settings: dict[str, Any]) -> str:
    return "rsw" if settings["frame"] == OWN else str(settings["frame"])


def check_oem(settings: dict[str, Any]) -> None:
    """Refuse what cannot be written, before there is a track.

    Raises
    ------
    UsageError
        For another frame than those of `WHERE`, no epoch, or, for inertial axes, no orientation of the orbit.
    """
    frame = _frame_of(settings)
    if frame not in WHERE:
        raise UsageError(f"an OEM holds frames {', '.join(WHERE)}; got {frame!r}")
    epoch_of(settings, "an OEM")
    if frame in INERTIAL:
        orientation_of(settings, f"an OEM in {frame}")


def write_oem(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write the epochs with a state; frame `rsw` unless another of `WHERE` is asked for."""
    frame, epoch = _frame_of(settings), epoch_of(settings, "an OEM")
    known = known_epochs(solution, "an OEM")
    track = solution.in_frame(frame, orientation_deg=settings["orientation_deg"], model=settings["model"])
    times = stamps(epoch, track.t_s[known], "an OEM")
    center, axes = WHERE[frame]
    lines = [
        "CCSDS_OEM_VERS = 2.0",
        f"CREATION_DATE = {creation()}",
        "ORIGINATOR = RELNAV",
        "META_START",
        *(f"COMMENT {name_of(key)}: {name_of(value)}" for key, value in track.metadata.items()),
        "OBJECT_NAME = CHASER",
        "OBJECT_ID = CHASER",
        f"CENTER_NAME = {center}",
        f"REF_FRAME = {axes}",
        "TIME_SYSTEM = UTC",
        f"START_TIME = {times[0]}",
        f"STOP_TIME = {times[-1]}",
        "META_STOP",
    ]
    for time, state in zip(times, 1e-3 * track.state[known], strict=True):
        lines.append(" ".join([time, *(f"{value:.16e}" for value in state)]))
    lines.append("COVARIANCE_START")
    for time, covariance in zip(times, 1e-6 * track.covariance[known], strict=True):
        lines += [f"EPOCH = {time}", f"COV_REF_FRAME = {axes}"]
        lines += [" ".join(f"{value:.16e}" for value in covariance[row, : row + 1]) for row in range(6)]
    lines.append("COVARIANCE_STOP")
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")
    assert np.all(np.isfinite(track.state[known]))
