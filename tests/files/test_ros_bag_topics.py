"""ROS bags with more topics than the spots': what does not matter is passed over, what does is said."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest

import relnav
from relnav.errors import LogError

pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")

EXAMPLE = Path(__file__).parents[2] / "examples" / "basilisk_approach" / "vbar_log.csv"
JOINTS, POWER, SPOTS = "sensor_msgs/msg/JointState", "my/msg/Power", "my/msg/Spots"
DEFINED = {POWER: "float64 volts", SPOTS: "std_msgs/Header header\nfloat64 spot_a_x_um"}


@pytest.fixture(scope="module")
def store():
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    made = get_typestore(Stores.ROS2_HUMBLE)
    for kind, text in DEFINED.items():
        made.register(get_types_from_msg(text, kind))
    return made


@pytest.fixture(scope="module")
def joints(store):
    """joints(names, positions, velocities) -> a message at 0 s."""

    def of(names, positions=(), velocities=()):
        header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](0, 0), "")
        return store.types[JOINTS](header, list(names), np.array(positions), np.array(velocities), np.zeros(0))

    return of


@pytest.fixture(scope="module")
def images(joints):
    """The first thirty images of the example, as (topic, kind, message)."""
    lines = [line for line in EXAMPLE.read_text().splitlines() if not line.startswith("#")][:31]
    names = lines[0].split(",")
    rows = [[float(cell) if cell else np.nan for cell in line.split(",")] for line in lines[1:]]
    return [("/spots", JOINTS, joints(names, row)) for row in rows]


@pytest.fixture
def bag(store, tmp_path):
    """bag(messages, keep_types) -> a folder; without its types as ROS 2 Humble records it."""
    from rosbags.rosbag2 import Writer

    def of(messages, *, keep_types=True):
        path, topics = tmp_path / "bag", {}
        with Writer(path, version=8) as writer:
            for k, (topic, kind, message) in enumerate(messages):
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, typestore=store)
                raw = message if isinstance(message, bytes) else store.serialize_cdr(message, kind)
                writer.write(topics[topic], k, raw)
        if not keep_types:
            (file,) = path.glob("*.db3")
            with sqlite3.connect(file) as opened:
                opened.execute("delete from message_definitions")
        return path

    return of


@pytest.fixture(scope="module")
def whole(images, store, tmp_path_factory):
    """The state after the images alone."""
    from rosbags.rosbag2 import Writer

    path = tmp_path_factory.mktemp("alone") / "bag"
    with Writer(path, version=8) as writer:
        topic = writer.add_connection("/spots", JOINTS, typestore=store)
        for k, (_, kind, message) in enumerate(images):
            writer.write(topic, k, store.serialize_cdr(message, kind))
    return relnav.filter_log(path, "three_beacon_psd").state


def first_of(case, joints, store):
    """What stands before the images, or after them."""
    return {
        "an arm's velocities": ("/arm", JOINTS, joints(["j1", "j2"], [], [0.1, 0.2])),
        "an arm with two names for a number": ("/arm", JOINTS, joints(["j1", "j2"], [0.1])),
        "an arm's name twice": ("/arm", JOINTS, joints(["j1", "j1"], [0.1, 0.2])),
        "a type that the bag has not got": ("/power", POWER, store.types[POWER](28.0)),
        "bytes of another type": ("/arm", JOINTS, b"\x00\x01\x00\x00\xff"),
        "the spots' topic, nothing named yet": ("/spots", JOINTS, joints([])),
    }[case]


@pytest.mark.parametrize(
    "case",
    [
        "an arm's velocities",
        "an arm with two names for a number",
        "an arm's name twice",
        "a type that the bag has not got",
        "bytes of another type",
        "the spots' topic, nothing named yet",
    ],
)
def test_what_does_not_matter_is_passed_over(bag, images, joints, store, whole, case):
    found = relnav.filter_log(
        bag([first_of(case, joints, store), *images], keep_types=case != "a type that the bag has not got"),
        "three_beacon_psd",
    )
    np.testing.assert_array_equal(found.state, whole)
    assert np.isfinite(whole[-1]).all()


def refused(path):
    with pytest.raises(LogError) as caught:
        relnav.filter_log(path, "three_beacon_psd")
    return str(caught.value)


def test_a_type_of_the_spots_that_the_bag_has_not_got(bag, joints, store):
    header = joints([]).header
    path = bag(
        [("/arm", JOINTS, joints(["j1"], [0.1])), ("/spots", SPOTS, store.types[SPOTS](header, 1.0))], keep_types=False
    )
    assert refused(path) == (
        f"{path}: no spots; its topics are /spots (the bag does not hold its type my/msg/Spots: record as MCAP, which "
        "does, or publish sensor_msgs/msg/JointState), /arm: a log has columns t_s, spot_a_x_um, ... (docs/live.md)"
    )


@pytest.mark.parametrize(
    ("names", "positions", "said"),
    [
        (["spot_a_x_um", "spot_a_x_um"], [1.0, 2.0], "the name 'spot_a_x_um' is there twice; give each number a name"),
        (["spot_a_x_um", "spot_a_y_um"], [1.0], "2 names and 1 positions; a position for each name is expected"),
        (["spot_a_x_um", "spot_a_y_um"], [], "2 names and 0 positions"),
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_spots_that_are_not_named_once_each(bag, images, joints, names, positions, said, first):
    path = bag([*([] if first else images[:4]), ("/spots", JOINTS, joints(names, positions))])
    words = refused(path)
    assert ("no spots; its topics are /spots (" if first else "message 5 of /spots: ") + said in words


def test_bytes_among_the_spots(bag, images):
    words = refused(bag([*images[:4], ("/spots", JOINTS, b"\x00\x01\x00\x00\xff")]))
    assert "message 5 of /spots: cannot be decoded: " in words


def test_an_image_that_names_nothing_among_others(bag, images, joints):
    words = refused(bag([*images[:4], ("/spots", JOINTS, joints([]))]))
    assert "message 5 of /spots has other fields than the one before" in words


def test_topics_in_which_nothing_is_named(bag, joints):
    messages = [(f"/arm{k}", JOINTS, joints([f"j{k}"], [0.1])) for k in range(9)]
    words = refused(bag([*messages, ("/spots", JOINTS, joints([])), ("/spots", JOINTS, joints([]))]))
    assert "no spots; its topics are /spots (no message names anything), /arm0, /arm1, " in words
    assert "/arm6 and 2 more: a log has columns" in words
