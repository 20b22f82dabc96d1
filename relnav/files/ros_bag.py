"""ROS bags: a log read from one, and a track written as geometry_msgs/PoseWithCovarianceStamped (extra `ros`).

A message is a row of a log. Its numbers are columns by the names of its fields (`spot_a_x_um` of a message type of your
own), or by the names that it carries itself, as a sensor_msgs/JointState does (`name`, `position`); `t_s`, where there
is none, is the stamp of its header.
"""

from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack
from relnav.dynamics.in_frame import OWN, FramedTrack
from relnav.errors import LogError, UsageError
from relnav.files.atomic import replacing
from relnav.files.optional import require
from relnav.files.tables import framed
from relnav.files.text_table import MOST_ROWS
from relnav.files.wording import listed, shown

TOPIC = "/relnav/pose"
UNKNOWN_TURN_RAD2 = 1e6
"""Variance of an attitude that is not estimated: a message has no word for that."""
LAST_S = 2**31 - 1
MOST_TOPICS = 8
"""Listed where none has spots; a sentence with more would not be read."""
_POSE = [0, 1, 2, 6, 7, 8]
_OTHER_SIGN = np.diag([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: of ROS 2 a folder with its metadata, of ROS 1 a file .bag."""
    return (path / "metadata.yaml").is_file() or (path.suffix.lower() == ".bag" and path.is_file())


class BagRows:
    """The rows of a bag's log as a table in memory: its `source`, `columns`, and each column by its name."""

    def __init__(self, source: Path, columns: dict[str, list[float]]) -> None:
        self.source, self.columns, self._values = source, list(columns), columns

    def __getitem__(self, name: str) -> Any:
        return np.array(self._values[name])

    def __len__(self) -> int:
        return len(self._values[self.columns[0]])


def read_bag(path: Path) -> BagRows:
    """The log in a bag: the messages of the one topic that names spots.

    Raises
    ------
    LogError
        For a bag that cannot be read, that holds no spots, or spots under several topics.
    UsageError
        If rosbags is missing.
    """
    require("rosbags", "ros", "A ROS bag needs rosbags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            return BagRows(path, _columns(path, reader))
    except LogError:
        raise
    except Exception as error:  # a damaged bag ends in errors of sqlite, of the decoder, of the text's parser
        raise LogError(f"{path}: not a readable ROS bag: {shown(error)}") from error


def _columns(path: Path, reader: Any) -> dict[str, list[float]]:
    """Name -> values of the topic that names spots. Of any other topic it does not matter what cannot be read."""
    found: dict[str, dict[str, list[float]]] = {}
    others: dict[str, str] = {}
    count: dict[str, int] = defaultdict(int)
    for connection, _, raw in reader.messages():
        topic = connection.topic
        count[topic] += 1
        if others.get(topic):
            continue
        try:
            row = _row(reader, connection, raw)
        except ValueError as error:
            if topic in found:
                raise LogError(f"{path}: message {count[topic]} of {shown(topic)}: {error}") from error
            others[topic] = f"{shown(topic, 80)} ({error})"
            continue
        if topic not in found:
            if not any(name.startswith("spot_") for name in row or ()):
                others[topic] = "" if row is None else shown(topic, 80)
                continue
            others.pop(topic, None)
            found[topic] = defaultdict(list)
        columns = found[topic]
        if row is None or (columns and row.keys() != columns.keys()):
            raise LogError(f"{path}: message {count[topic]} of {shown(topic)} has other fields than the one before")
        for name, value in row.items():
            columns[name].append(value)
        if len(columns[name]) > MOST_ROWS:
            raise LogError(f"{path}: more than {MOST_ROWS} messages of {shown(topic)}; split the bag in time")
    if len(found) != 1:
        told = [words or f"{shown(topic, 80)} (no message names anything)" for topic, words in others.items()]
        what = f"spots under {listed(found)}; keep one topic" if found else f"no spots; its topics are {_few(told)}"
        raise LogError(f"{path}: {what}: a log has columns t_s, spot_a_x_um, ... (docs/live.md)")
    return dict(next(iter(found.values())))


def _few(words: list[str]) -> str:
    """After commas; those first of which something is said, in brackets."""
    ordered = sorted(words, key=lambda one: not one.endswith(")"))
    return ", ".join(ordered[:MOST_TOPICS]) + (f" and {len(words) - MOST_TOPICS} more" if words[MOST_TOPICS:] else "")


def _row(reader: Any, connection: Any, raw: bytes) -> dict[str, float] | None:
    """The numbers of a message as the bag has it; None for a JointState without any names.

    Raises
    ------
    ValueError
        Saying why it cannot be read.
    """
    try:
        message = reader.deserialize(raw, connection.msgtype)
    except KeyError as error:
        raise ValueError(
            f"the bag does not hold its type {shown(connection.msgtype, 80)}: record as MCAP, which does, or publish "
            "sensor_msgs/msg/JointState"
        ) from error
    except Exception as error:  # whatever the decoder meets in bytes that are none of its type
        raise ValueError(f"cannot be decoded: {shown(error)}") from error
    row = numbers_of(message)
    return None if row.keys() <= {"t_s"} and getattr(message, "name", None) == [] else row


def numbers_of(message: Any) -> dict[str, float]:
    """The numbers that a message names, `t_s` among them.

    Raises
    ------
    ValueError
        For a name that is there twice, or names without a number each; only no numbers at all are left out.
    """
    row: dict[str, float] = {}
    stamp: Any = getattr(getattr(message, "header", None), "stamp", None)
    if hasattr(stamp, "sec") and hasattr(stamp, "nanosec"):
        row["t_s"] = stamp.sec + 1e-9 * stamp.nanosec
    fields = vars(message) if hasattr(message, "__dict__") else {}
    for name, value in fields.items():
        if isinstance(value, bool | int | float | np.number):
            row[name] = float(value)
    names, values = getattr(message, "name", None), getattr(message, "position", None)
    if isinstance(names, list) and isinstance(values, np.ndarray) and all(isinstance(name, str) for name in names):
        if len(values) == 0 and not any(name.startswith("spot_") for name in names):
            return row
        if len(names) != len(values):
            raise ValueError(f"{len(names)} names and {len(values)} positions; a position for each name is expected")
        if len(set(names)) < len(names):
            twice, _ = Counter(names).most_common(1)[0]
            raise ValueError(f"the name '{shown(twice, 80)}' is there twice; give each number a name of its own")
        row |= dict(zip(names, map(float, values), strict=True))
    return row


def pose_covariance(covariance: Any) -> Stack:
    """Covariances (..., 6, 6) as ROS means them, position and turn about fixed axes, of docking states' (..., 12, 12).

    There the attitude's error turns the target, here it turns the chaser seen from it: the other sign.
    """
    picked = np.asarray(covariance)[..., _POSE, :][..., :, _POSE]
    return np.asarray(_OTHER_SIGN @ picked @ _OTHER_SIGN)


def poses(solution: Any, turned: FramedTrack | None = None) -> tuple[str, Matrix, Matrix, Stack]:
    """Frame, positions (n, 3), quaternions (n, 4), covariances (n, 6, 6) of a track.

    Of a marker track the chaser's port seen from the target's, target axes, whatever the frame; of a beacon track the
    chaser's centre of mass from the target's in `lvlh_ccsds`, or as turned, with an attitude that is not known.
    """
    if hasattr(solution, "docking_covariance") and hasattr(solution, "port_velocity_m_s"):
        from scipy.spatial.transform import Rotation

        turn = np.full((len(solution), 4), np.nan)
        known = np.isfinite(solution.state[:, 0])
        turn[known] = Rotation.from_matrix(solution.dcm_target_from_chaser[known]).as_quat(canonical=True)
        return "target_port", solution.port_m, turn, pose_covariance(solution.docking_covariance)
    at: Any = solution if turned is None else turned
    covariance = np.zeros((len(solution), 6, 6))
    covariance[:, :3, :3] = at.covariance[:, :3, :3]
    covariance[:, [3, 4, 5], [3, 4, 5]] = UNKNOWN_TURN_RAD2
    frame = OWN if turned is None else turned.frame
    return frame, at.state[:, :3], np.tile([0.0, 0.0, 0.0, 1.0], (len(solution), 1)), covariance


def check_bag(settings: dict[str, Any]) -> None:  # noqa: ARG001  (all formats take them)
    """Refuse what cannot be written, before there is a track.

    Raises
    ------
    UsageError
        If rosbags is missing.
    """
    require("rosbags", "ros", "A ROS bag needs rosbags")


def write_bag(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write a bag of ROS 2 (a folder, MCAP inside): /relnav/pose, a message an epoch with a state.

    Raises
    ------
    UsageError
        If rosbags is missing, or for times that a stamp cannot hold.
    """
    require("rosbags", "ros", "A ROS bag needs rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    t = np.asarray(solution.t_s)
    if len(t) and not (float(t.min()) >= 0.0 and float(t.max()) < LAST_S):
        had = f"{float(t.min()):.9g} to {float(t.max()):.9g} s"
        raise UsageError(f"a ROS bag has times from 0 to {LAST_S} s; the log has {had}")
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["geometry_msgs/msg/PoseWithCovarianceStamped"].__msgtype__
    frame, positions, turns, covariances = poses(solution, framed(solution, settings))
    with replacing(path) as temporary, Writer(temporary, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(TOPIC, kind, typestore=store)
        for e in np.flatnonzero(np.isfinite(np.asarray(solution.state)[:, 0])).tolist():
            stamp = round(float(t[e]) * 1e9)
            message = _message(store.types, stamp, frame, positions[e], turns[e], covariances[e])
            writer.write(connection, stamp, store.serialize_cdr(message, kind))


def _message(types: Any, stamp: int, frame: str, position: Any, turn: Any, covariance: Any) -> Any:
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9), frame)
    point = types["geometry_msgs/msg/Point"](*map(float, position))
    pose = types["geometry_msgs/msg/Pose"](point, types["geometry_msgs/msg/Quaternion"](*map(float, turn)))
    with_covariance = types["geometry_msgs/msg/PoseWithCovariance"](pose, np.ascontiguousarray(covariance).ravel())
    return types["geometry_msgs/msg/PoseWithCovarianceStamped"](header, with_covariance)
