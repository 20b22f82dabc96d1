"""An attitude that is stated more seldom than images are taken, and repeated until the next one comes: it is said."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.files.attitude_reading import stepped, turns_of

WORDS = "the attitude stays for 10 rows and then turns by 0.1 deg: it was stated more seldom than the images"
MARKERS, BEACONS = "469.3,553.7,553.7,553.7,511.5,511.5", "-1500,0,1500,0,0,0"


def turning(times, every=0.0):
    """Turns at 0.1 deg/s, as they were at the last multiple of `every` seconds."""
    at = times if not every else np.floor(times / every + 1e-9) * every
    return Rotation.from_rotvec(np.radians(0.1) * at[:, None] * [0.0, 0.6, 0.8])


def log(path, spots, letters, unit, name, held, every):
    """A log of spots that stay, seen from an attitude that turns."""
    times = np.arange(300) * 0.1
    quaternions = (Rotation.from_quat(held) * turning(times, every)).as_quat()
    head = ["t_s", *(f"spot_{one}_{axis}_{unit}" for one in letters for axis in "xy"), *(f"{name}_{p}" for p in "xyzw")]
    rows = [f"{t:.1f},{spots}," + ",".join(map(repr, q.tolist())) for t, q in zip(times, quaternions, strict=True)]
    path.write_text("\n".join([",".join(head), *rows]) + "\n")
    return path


def test_steps_are_told_by_what_they_are_beside_noise():
    times = np.arange(200) * 0.1
    steps = turns_of(turning(times, 1.0).as_quat())
    (note,) = stepped(steps, 0.0, 2e-4)
    assert "stays for 10 rows" in note
    assert f"in every image, {0.1 / math.sqrt(3.0):.2g} deg" in note
    assert stepped(steps, math.radians(0.1), 2e-4) == ()  # the model says so
    assert stepped(steps, 0.0, 0.1) == ()  # no spot would show it
    assert stepped(turns_of(turning(times).as_quat()), 0.0, 2e-4) == ()
    assert stepped(turns_of(np.tile([0.5, -0.5, 0.5, 0.5], (200, 1))), 0.0, 2e-4) == ()
    assert stepped(turns_of(turning(times[:40], 1.0).as_quat()), 0.0, 2e-4) == ()


def test_either_sign_of_a_quaternion():
    quaternions = turning(np.arange(100) * 0.1).as_quat()
    signs = np.where(np.arange(100) % 3 == 0, -1.0, 1.0)[:, None]
    np.testing.assert_array_equal(turns_of(signs * quaternions), turns_of(quaternions))


@pytest.mark.parametrize("every", [0.0, 1.0])
def test_of_beacons(run, tmp_path, every):
    held = [0.5, -0.5, -0.5, -0.5]
    path = log(tmp_path / "log.csv", BEACONS, "abc", "um", "q_cam_from_lvlh", held, every)
    for method in ("spots", "fix"):
        _, out, _ = run("filter", path, "--model", "three_beacon_psd", "--method", method)
        assert (WORDS in out) is (every > 0.0 and method == "spots")  # a fix does not take the attitude


@pytest.mark.parametrize("every", [0.0, 1.0])
def test_of_markers(run, tmp_path, every):
    held = [0.5, -0.5, 0.5, 0.5]
    path = log(tmp_path / "log.csv", MARKERS, "abc", "px", "q_chaser_from_lvlh", held, every)
    _, out, _ = run("filter", path, "--model", "three_marker_vision")
    assert (WORDS in out) is (every > 0.0)
