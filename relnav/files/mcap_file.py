"""A track as MCAP: poses that Foxglove draws, and states with covariance, as JSON messages with their schemas."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from relnav.errors import UsageError
from relnav.files.atomic import replacing
from relnav.files.optional import require
from relnav.files.tables import relnav_version

NANOSECOND = 1e-9
_NUMBER, _NUMBERS = {"type": "number"}, {"type": "array", "items": {"type": "number"}}
_TIME = {"type": "object", "title": "time", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_VECTOR = {"type": "object", "properties": dict.fromkeys("xyz", _NUMBER)}
_QUATERNION = {"type": "object", "properties": dict.fromkeys("xyzw", _NUMBER)}
POSE = {
    "type": "object",
    "title": "foxglove.PoseInFrame",
    "properties": {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "pose": {"type": "object", "properties": {"position": _VECTOR, "orientation": _QUATERNION}},
    },
}
STATE = {
    "type": "object",
    "title": "relnav.RelativeState",
    "properties": {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "state": _NUMBERS | {"description": "position m, velocity m/s"},
        "covariance": _NUMBERS | {"description": "of state, 36 numbers by rows"},
        "nis": _NUMBER,
        "dof": {"type": "integer"},
        "status": {"type": "integer"},
    },
}


def write_mcap(solution: Any, path: Path, settings: dict[str, Any]) -> None:  # noqa: ARG001  (all writers take them)
    """Write topics /relnav/pose and /relnav/state; the target's attitude is the pose's where it is estimated.

    Raises
    ------
    UsageError
        If mcap is missing, or a time lies before zero, which the format cannot hold.
    """
    writers = require("mcap.writer", "mcap", "An MCAP file needs mcap")
    t = np.asarray(solution.t_s)
    if float(t.min()) < 0.0:
        raise UsageError(f"an MCAP file has times from 0 on; the log begins at {float(t.min()):.9g} s")
    with replacing(path) as temporary, temporary.open("wb") as file:
        writer = writers.Writer(file)
        writer.start(profile="", library=f"relnav {relnav_version()}")
        channels = {
            topic: writer.register_channel(
                topic=topic,
                message_encoding="json",
                schema_id=writer.register_schema(
                    name=str(schema["title"]), encoding="jsonschema", data=json.dumps(schema).encode()
                ),
            )
            for topic, schema in (("/relnav/pose", POSE), ("/relnav/state", STATE))
        }
        for e in np.flatnonzero(np.isfinite(np.asarray(solution.state)[:, 0])).tolist():
            stamp = round(float(t[e]) / NANOSECOND)
            for topic, message in _messages(solution, e, stamp).items():
                data = json.dumps(message, allow_nan=False).encode()
                writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, sequence=e, data=data)
        writer.finish()


def _messages(solution: Any, e: int, stamp: int) -> dict[str, dict[str, Any]]:
    """What both topics say of an epoch."""
    part = solution.part(e, e + 1)
    head = {"timestamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9}, "frame_id": "lvlh_ccsds"}
    turn = [0.0, 0.0, 0.0, 1.0]
    if hasattr(part, "dcm_lvlh_from_target"):
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_matrix(part.dcm_lvlh_from_target[0]).as_quat(canonical=True).tolist()
    state, nis = part.state[0].tolist(), float(part.nis[0])
    pose = {"position": dict(zip("xyz", state, strict=False)), "orientation": dict(zip("xyzw", turn, strict=True))}
    covariance = part.covariance[0, :6, :6].ravel().tolist()
    said = {"state": state, "covariance": covariance, "dof": int(part.dof[0]), "status": int(part.status[0])}
    said |= {"nis": nis} if np.isfinite(nis) else {}
    return {"/relnav/pose": head | {"pose": pose}, "/relnav/state": head | said}
