"""A track as MCAP: poses that Foxglove draws, with their covariance, and states, as JSON messages with their schemas.

`/relnav/pose` and `/relnav/pose_with_covariance` hold the same pose as a ROS bag does (`ros_bag.poses`): of a marker
track the chaser's port from the target's in target axes, of a beacon track the chaser's centre of mass. A covariance of
a pose is 36 numbers by rows, as ROS defines it: position x, y, z, then the turn about the fixed axes x, y, z of the
frame that the message names, true = exp([turn x]) R for the pose's rotation R.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from relnav.dynamics.in_frame import OWN
from relnav.errors import UsageError
from relnav.files.atomic import replacing
from relnav.files.optional import require
from relnav.files.ros_bag import poses
from relnav.files.tables import framed, relnav_version

NANOSECOND = 1e-9
LAST_S = 1.8e10
"""Its times are nanoseconds of 64 bits."""
NEED = "An MCAP file needs mcap"
_NUMBER, _NUMBERS = {"type": "number"}, {"type": "array", "items": {"type": "number"}}
_INTEGER, _TEXT = {"type": "integer"}, {"type": "string"}


def _object(title: str = "", /, **properties: Any) -> dict[str, Any]:
    return ({"title": title} if title else {}) | {"type": "object", "properties": properties}


_TIME = _object("time", sec=_INTEGER, nsec=_INTEGER)
_QUATERNION = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object(position=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER), orientation=_QUATERNION)
_SIX_BY_SIX = _NUMBERS | {
    "minItems": 36,
    "maxItems": 36,
    "description": "6 x 6 by rows: x, y, z in m, turn about the fixed axes x, y, z of frame_id in rad",
}
POSE = _object("foxglove.PoseInFrame", timestamp=_TIME, frame_id=_TEXT, pose=_POSE)
POSE_WITH_COVARIANCE = _object(
    "geometry_msgs/PoseWithCovarianceStamped",
    header=_object(stamp=_TIME, frame_id=_TEXT),
    pose=_object(pose=_POSE, covariance=_SIX_BY_SIX),
)
STATE = _object(
    "relnav.RelativeState",
    timestamp=_TIME,
    frame_id=_TEXT,
    state=_NUMBERS | {"description": "of the chaser's centre of mass, position m, velocity m/s"},
    covariance=_NUMBERS
    | {
        "description": "by rows, of state; where the target's attitude is estimated 12 x 12, of state, turn rad and "
        "rate rad/s, both in target axes: true = R exp([turn x])"
    },
    q_from_target=_QUATERNION | {"description": "R: v_frame = R v_target, where it is estimated"},
    rate_rad_s=_NUMBERS | {"description": "inertial rate of the target, target axes, where it is estimated"},
    nis=_NUMBER,
    dof=_INTEGER,
    status=_INTEGER,
)
TOPICS = {"/relnav/pose": POSE, "/relnav/pose_with_covariance": POSE_WITH_COVARIANCE, "/relnav/state": STATE}


def check_mcap(settings: dict[str, Any]) -> None:  # noqa: ARG001  (all formats take them)
    """Refuse what cannot be written, before there is a track.

    Raises
    ------
    UsageError
        If mcap is missing.
    """
    require("mcap.writer", "mcap", NEED)


def write_mcap(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write `TOPICS`, a message each an epoch with a state; states in the frame that was asked for.

    Raises
    ------
    UsageError
        If mcap is missing, or a time lies before zero or beyond `LAST_S`, which the format cannot hold.
    """
    writers = require("mcap.writer", "mcap", NEED)
    t = np.asarray(solution.t_s)
    if float(t.min()) < 0.0:
        raise UsageError(f"an MCAP file has times from 0 on; the log begins at {float(t.min()):.9g} s")
    if float(t.max()) > LAST_S:
        raise UsageError(f"an MCAP file has times up to {LAST_S:.4g} s; the log ends at {float(t.max()):.9g} s")
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
            for topic, schema in TOPICS.items()
        }
        for e, stamp, messages in _messages(solution, settings):
            for topic, message in messages.items():
                data = json.dumps(message, allow_nan=False).encode()
                writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, sequence=e, data=data)
        writer.finish()


def _messages(solution: Any, settings: dict[str, Any]) -> Iterator[tuple[int, int, dict[str, dict[str, Any]]]]:
    """Number and time, ns, of each epoch with a state, and what the topics say of it."""
    turned = framed(solution, settings)
    frame, positions, turns, covariances = poses(solution, turned)
    track = solution.in_frame(OWN, model=settings["model"]) if turned is None else turned
    quaternions, rates = track.q_frame_from_target, track.rate_rad_s
    for e in np.flatnonzero(np.isfinite(np.asarray(solution.state)[:, 0])).tolist():
        stamp = round(float(solution.t_s[e]) / NANOSECOND)
        time = {"sec": stamp // 10**9, "nsec": stamp % 10**9}
        pose = {"position": _named("xyz", positions[e]), "orientation": _named("xyzw", turns[e])}
        state = {"timestamp": time, "frame_id": track.frame, "state": track.state[e].tolist()}
        state |= {"covariance": track.covariance[e].ravel().tolist()}
        if quaternions is not None and rates is not None:
            state |= {"q_from_target": _named("xyzw", quaternions[e]), "rate_rad_s": rates[e].tolist()}
        state |= {"dof": int(solution.dof[e]), "status": int(solution.status[e])}
        state |= {"nis": float(solution.nis[e])} if np.isfinite(solution.nis[e]) else {}
        yield (
            e,
            stamp,
            {
                "/relnav/pose": {"timestamp": time, "frame_id": frame, "pose": pose},
                "/relnav/pose_with_covariance": {
                    "header": {"stamp": time, "frame_id": frame},
                    "pose": {"pose": pose, "covariance": covariances[e].ravel().tolist()},
                },
                "/relnav/state": state,
            },
        )


def _named(names: str, values: Any) -> dict[str, float]:
    return dict(zip(names, map(float, values), strict=True))
