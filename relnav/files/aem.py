"""CCSDS Attitude Ephemeris Message (CCSDS 504.0-B-2, section 4), keyword = value: attitude of the target in space.

`q_lvlh_from_target` of a marker track with the orbit's orientation makes the attitude of the target's axes against
inertial ones. The standard's quaternion is that of the turn which takes the axes of A to those of B: x_B = M x_A with M
= [[q1^2 - q2^2 - q3^2 + qc^2, 2 (q1 q2 + q3 qc), 2 (q1 q3 - q2 qc)], ...] (annex on conversions), the transpose of what
scipy makes of the same four numbers.
"""

from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from relnav.dynamics.in_frame import lvlh_in_space
from relnav.files.atomic import replacing
from relnav.files.ccsds import check_attitude, creation, epoch_of, known_epochs, name_of, orientation_of, stamps


def check_aem(settings: dict[str, Any]) -> None:
    """Refuse what cannot be written, before there is a track.

    Raises
    ------
    UsageError
        For a track without attitudes, another frame, no epoch, or no orientation of the orbit.
    """
    check_attitude(settings, "an AEM", ".oem")
    epoch_of(settings, "an AEM")
    orientation_of(settings, "an AEM")


def write_aem(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write the target's attitude at the epochs with a state: EME2000 to SC_BODY_1, scalar last."""
    epoch, known = epoch_of(settings, "an AEM"), known_epochs(solution, "an AEM")
    orbit, said = lvlh_in_space(solution.t_s[known], solution.mission, orientation_of(settings, "an AEM"))
    eci_from_target = orbit @ solution.dcm_lvlh_from_target[known]
    quaternions = Rotation.from_matrix(eci_from_target).as_quat(canonical=True)
    times = stamps(epoch, solution.t_s[known], "an AEM")
    lines = [
        "CCSDS_AEM_VERS = 2.0",
        f"CREATION_DATE = {creation()}",
        "ORIGINATOR = RELNAV",
        "META_START",
        f"COMMENT model: {name_of(solution.model)}; target orbit: {name_of(said)}",
        "COMMENT q1 q2 q3 qc of the turn of axes from A to B: x_B = M x_A with M12 = 2 (q1 q2 + q3 qc)",
        "OBJECT_NAME = TARGET",
        "OBJECT_ID = TARGET",
        "CENTER_NAME = EARTH",
        "REF_FRAME_A = EME2000",
        "REF_FRAME_B = SC_BODY_1",
        "TIME_SYSTEM = UTC",
        f"START_TIME = {times[0]}",
        f"STOP_TIME = {times[-1]}",
        "ATTITUDE_TYPE = QUATERNION",
        "META_STOP",
        "DATA_START",
        *(
            " ".join([time, *(f"{value:.16f}" for value in quaternion)])
            for time, quaternion in zip(times, quaternions, strict=True)
        ),
        "DATA_STOP",
    ]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")
