"""ROS bags: a log read from one, a track written to one, each through the rosbags package; poses as ROS means them."""

from pathlib import Path

import numpy as np
import pytest

import relnav
import relnav.cli
from relnav.errors import LogError, UsageError
from relnav.files import optional
from relnav.files.marker_logs import filter_marker_log, write_marker_log
from relnav.files.ros_bag import is_bag, numbers_of, pose_covariance, poses
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

EXAMPLE = Path(__file__).parents[2] / "examples" / "basilisk_approach" / "vbar_log.csv"
SPOTS = "std_msgs/Header header\n" + "".join(f"float64 spot_{b}_{a}_um\n" for b in "abc" for a in "xy")


@pytest.fixture(scope="module")
def rosbags():
    return pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "log.csv"
    path.write_text("".join(EXAMPLE.read_text().splitlines(keepends=True)[:61]))
    return path


def rows_of(log):
    head, *rows = [line for line in log.read_text().splitlines() if not line.startswith("#")]
    return head.split(","), [[float(cell) if cell else np.nan for cell in row.split(",")] for row in rows]


def write_rows(path, names, rows, *, own_type=False):
    """A bag of the log's rows, as a JointState each, or as a message type of one's own with the stamp as time."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/JointState"
    if own_type:
        kind = "camera_msgs/msg/Spots"
        store.register(get_types_from_msg(SPOTS, kind))
    stamp_of, header_of = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    with Writer(path, version=8) as writer:
        other = writer.add_connection("/rosout", "std_msgs/msg/String", typestore=store)
        connection = writer.add_connection("/camera/spots", kind, typestore=store)
        for k, row in enumerate(rows):
            stamp = round(row[0] * 1e9)
            header = header_of(stamp_of(stamp // 10**9, stamp % 10**9), "camera")
            nothing = np.zeros(0)
            message = (
                store.types[kind](header, *row[1:7])
                if own_type
                else store.types[kind](header, names, np.array(row), nothing, nothing)
            )
            writer.write(connection, k, store.serialize_cdr(message, kind))
            text = store.types["std_msgs/msg/String"]("hello")
            writer.write(other, k, store.serialize_cdr(text, "std_msgs/msg/String"))
    return path


@pytest.mark.usefixtures("rosbags")
def test_a_log_in_a_bag_gives_the_bits_of_its_table(log, tmp_path):
    bag = write_rows(tmp_path / "bag", *rows_of(log))
    assert is_bag(bag)
    whole, found = relnav.filter_log(log, "three_beacon_psd"), relnav.filter_log(bag, "three_beacon_psd")
    np.testing.assert_array_equal(found.state, whole.state)
    np.testing.assert_array_equal(found.factor, whole.factor)
    arguments = ["filter", str(bag), "--model", "three_beacon_psd", "--smooth", "--quiet", "--out"]
    assert relnav.cli.run([*arguments, str(tmp_path / "a.jsonl")]) == 0
    assert len((tmp_path / "a.jsonl").read_text().splitlines()) == 60


@pytest.mark.usefixtures("rosbags")
def test_messages_of_ones_own_type_and_their_stamps(log, tmp_path):
    names, rows = rows_of(log)
    found = relnav.filter_log(write_rows(tmp_path / "bag", names, rows, own_type=True), "three_beacon_psd")
    np.testing.assert_allclose(found.t_s, [row[0] for row in rows], atol=1e-9)
    assert np.isfinite(found.state[-1]).all()


@pytest.mark.usefixtures("rosbags")
def test_a_beacon_track_as_a_bag(rosbags, log, tmp_path, outside):
    solution = relnav.filter_log(log, "three_beacon_psd")
    assert relnav.cli.run(
        ["filter", str(log), "--model", "three_beacon_psd", "--quiet", "--out", str(tmp_path / "track.rosbag2")]
    ) == 0  # fmt: skip
    known = np.flatnonzero(np.isfinite(solution.state[:, 0]))
    with rosbags.AnyReader([tmp_path / "track.rosbag2"]) as reader:
        messages = [reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()]
        assert [connection.topic for connection in reader.connections] == ["/relnav/pose"]
        assert reader.connections[0].msgtype == "geometry_msgs/msg/PoseWithCovarianceStamped"
    assert len(messages) == len(known)
    for e, message in zip(known, messages, strict=True):
        pose, covariance = message.pose.pose, message.pose.covariance.reshape(6, 6)
        assert message.header.frame_id == "lvlh_ccsds"
        assert message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec == pytest.approx(
            solution.t_s[e], abs=1e-9
        )
        position = np.array([pose.position.x, pose.position.y, pose.position.z])
        outside("rosbags", "bag read back, positions, m", np.abs(position - solution.state[e, :3]).max(), 0.0)
        np.testing.assert_array_equal(covariance[:3, :3], solution.covariance[e, :3, :3])
        assert (covariance.diagonal()[3:] == 1e6).all()
    with pytest.raises(UsageError, match="is a folder"):
        relnav.write(solution, tmp_path / "track.rosbag2")
    relnav.write(solution, tmp_path / "rsw.rosbag2", frame="rsw")
    turned, last = solution.in_frame("rsw"), known[-1]
    with rosbags.AnyReader([tmp_path / "rsw.rosbag2"]) as reader:
        *_, message = (reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages())
    position = message.pose.pose.position
    assert [message.header.frame_id, position.x, position.y] == ["rsw", *turned.state[last, :2].tolist()]
    np.testing.assert_array_equal(message.pose.covariance.reshape(6, 6)[:3, :3], turned.covariance[last, :3, :3])


@pytest.mark.usefixtures("rosbags")
def test_its_mcap_is_read_by_the_mcap_package(log, tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    relnav.write(relnav.filter_log(log, "three_beacon_psd"), tmp_path / "track.rosbag2")
    (inside,) = (tmp_path / "track.rosbag2").glob("*.mcap")
    with inside.open("rb") as file:
        schemas, messages = zip(*((s, m) for s, _, m in reader.make_reader(file).iter_messages()), strict=True)
    assert {schema.name for schema in schemas} == {"geometry_msgs/msg/PoseWithCovarianceStamped"}
    assert len(messages) == 59


def test_poses_of_markers_turn_as_ros_means_it(tmp_path):
    """A turn by phi about fixed axes, of a thousand draws from the message's covariance, is where the truth may be."""
    from scipy.spatial.transform import Rotation

    mission = relnav.load_model("three_marker_vision")
    write_marker_log(simulate_flight(mission, Approach(duration_s=3.0, rate_hz=5.0), seed=2), tmp_path / "log.csv")
    solution = filter_marker_log(tmp_path / "log.csv", mission)
    frame, positions, turns, covariances = poses(solution)
    assert frame == "target_port"
    np.testing.assert_array_equal(positions, solution.port_m)
    np.testing.assert_allclose(
        Rotation.from_quat(turns[-1]).as_matrix(), solution.dcm_target_from_chaser[-1], atol=1e-12
    )
    # docking: the true chaser-from-target is dcm^T exp([theta x]); ROS: the true target-from-chaser is exp([phi x]) dcm
    theta = np.array([0.3, -0.2, 0.1])
    dcm = solution.dcm_target_from_chaser[-1]
    true = (dcm.T @ Rotation.from_rotvec(theta).as_matrix()).T
    np.testing.assert_allclose(Rotation.from_matrix(true @ dcm.T).as_rotvec(), -theta, atol=1e-12)
    docking = solution.docking_covariance[-1]
    np.testing.assert_array_equal(covariances[-1][:3, :3], docking[:3, :3])
    np.testing.assert_array_equal(covariances[-1][3:, 3:], docking[6:9, 6:9])
    np.testing.assert_array_equal(covariances[-1][:3, 3:], -docking[:3, 6:9])
    np.testing.assert_array_equal(pose_covariance(solution.docking_covariance)[-1], covariances[-1])


@pytest.mark.usefixtures("rosbags")
def test_bags_that_are_no_log(log, tmp_path):
    names, rows = rows_of(log)
    with pytest.raises(LogError, match=r"no spots; its topics are /"):
        relnav.filter_log(write_rows(tmp_path / "a", [f"x{n}" for n in names], rows), "three_beacon_psd")
    broken = [name.replace("a_x_um", "a_x_kg") for name in names]
    with pytest.raises(LogError, match=r"bag: column 'spot_a_x_kg': unknown unit 'kg'"):
        relnav.filter_log(write_rows(tmp_path / "bag", broken, rows), "three_beacon_psd")
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "metadata.yaml").write_text("none\n")
    with pytest.raises(LogError, match="not a readable ROS bag"):
        relnav.filter_log(tmp_path / "b", "three_beacon_psd")
    assert relnav.cli.run(["filter", str(tmp_path / "b"), "--model", "three_beacon_psd"]) == 3


def test_what_is_no_bag(tmp_path, log):
    assert not is_bag(log)
    assert not is_bag(tmp_path)
    assert relnav.cli.run(["filter", str(tmp_path), "--model", "three_beacon_psd"]) == 2


def test_a_missing_package_is_named_with_its_line(log, tmp_path, monkeypatch):
    def missing(name):
        raise ImportError(name)

    solution = relnav.filter_log(log, "three_beacon_psd")
    (tmp_path / "metadata.yaml").touch()
    monkeypatch.setattr(optional, "import_module", missing)
    for call in (
        lambda: relnav.write(solution, tmp_path / "a.rosbag2"),
        lambda: relnav.filter_log(tmp_path, "three_beacon_psd"),
    ):
        with pytest.raises(UsageError, match=r"A ROS bag needs rosbags: pip install 'relnav\[ros\]'"):
            call()


def test_numbers_of_any_message():
    class Message:
        def __init__(self):
            self.spot_a_x_px, self.seen, self.text = np.float32(0.5), True, "text"

    assert numbers_of(Message()) == {"spot_a_x_px": 0.5, "seen": 1.0}


@pytest.mark.usefixtures("rosbags")
def test_a_bag_that_is_too_long(log, tmp_path, monkeypatch):
    monkeypatch.setattr("relnav.files.ros_bag.MOST_ROWS", 20)
    with pytest.raises(LogError, match="more than 20 messages of /camera/spots; split the bag in time"):
        relnav.filter_log(write_rows(tmp_path / "bag", *rows_of(log)), "three_beacon_psd")


@pytest.mark.usefixtures("rosbags")
def test_times_that_no_stamp_holds(tmp_path):
    solution = relnav.filter_epochs(relnav.load_model("three_beacon_psd"), [-1.0, 0.0], np.full((2, 3, 2), np.nan))
    with pytest.raises(UsageError, match=r"a ROS bag has times from 0 to .* s; the log has -1 to 0 s"):
        relnav.write(solution, tmp_path / "track.rosbag2")


@pytest.mark.usefixtures("rosbags")
def test_messages_that_change_their_fields(log, tmp_path, monkeypatch):
    each = iter([{"t_s": 0.0, "spot_a_x_um": 1.0}, {"t_s": 0.1, "spot_b_x_um": 1.0}])
    monkeypatch.setattr("relnav.files.ros_bag.numbers_of", lambda said: next(each) if hasattr(said, "name") else {})
    with pytest.raises(LogError, match="message 2 of /camera/spots has other fields than the one before"):
        relnav.filter_log(write_rows(tmp_path / "bag", *rows_of(log)), "three_beacon_psd")
