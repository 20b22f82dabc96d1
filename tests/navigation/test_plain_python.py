"""`RELNAV_JIT=0` runs the same lines as plain Python: same outcomes, numbers equal to rounding."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.codegen.kernel import is_compiled
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.sensors.three_beacon.calibration import Calibration
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

CASES = ["spots", "fix", "unknown", "considered", "considered fix"]

LEFT = (2, (1e-4, 0.0), (3e-3, 3.2e-3), (1e-5, -2e-5, 1e-5, 0.0, 2e-5, 1e-5), (0.0,) * 6, 3e-6, 1e-3, 225, 1e-5)
"""A calibration, as arguments."""

# Compiled code may fuse a multiplication and an addition into one rounding; the closed form's iteration and six
# sequential updates then differ in the last digits only.
TOLERANCE_SIGMA = 1e-9

PLAIN = f"""
import sys
from dataclasses import replace
import numpy as np
import relnav
from relnav.codegen.kernel import is_compiled
from relnav.sensors.three_beacon.calibration import Calibration

assert not is_compiled()
given = np.load(sys.argv[1])
model = relnav.load_model("three_beacon_psd")
unknown = replace(model, attitude=replace(model.attitude, mode="unknown"))
tolerances = replace(model.tolerances, considered=True)
told = replace(model, tolerances=tolerances, calibration=Calibration(*{LEFT}))
out = {{}}
for case in {CASES}:
    solution = relnav.filter_epochs(
        unknown if case == "unknown" else told if "considered" in case else model,
        given["t"],
        given["spots"],
        acceleration_m_s2=given["acceleration"],
        delta_v_m_s=given["impulse"],
        method="fix" if "fix" in case else "spots",
    )
    for name in ("state", "factor", "innovation", "nis", "dof", "status", "measurement_status", "docking"):
        out[f"{{case}}_{{name}}"] = getattr(solution, name)
assert "numba" not in sys.modules
np.savez(sys.argv[2], **out)
"""


def nasty_log(model, drift, look):
    """Forty epochs: good ones, then one of every kind of trouble, a lock-out with restart, and a gap."""
    rng = np.random.default_rng(3)
    n = 40
    t = np.cumsum(rng.uniform(0.05, 0.3, size=n))
    t[35:] += 500.0
    acceleration, impulse = 1e-3 * rng.normal(size=(2, n, 3))
    impulse[::2] = 0.0
    truth = drift(model, t, [8.0, 0.1, -0.1, -0.01, 0.0, 0.0], acceleration, impulse)
    truth[35:] = truth[34]
    spots = look(model, truth, seed=2)
    spots[0] += [[1e-3, 0], [0, 1e-3], [-1e-3, 0]]  # a false start
    spots[8, 0] = np.nan
    spots[9, 1, 1] = np.nan
    spots[10] = np.nan
    spots[11, 2] += 5e-4
    spots[12, 0, 0] = np.inf
    spots[13, 1, 1] = 1e308
    spots[14] = 0.0
    spots[15] = spots[15, [1, 0, 2]]
    spots[16] = [[1e-3, 1e-3], [2e-3, 2e-3], [3e-3, 3e-3]]  # in line
    spots[18:24, :, 0] += 4e-4  # a false scene
    return t, spots, acceleration, impulse


@pytest.fixture(scope="module")
def shipped():
    """As the other process loads it, its attitude with an error."""
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def plain(shipped, drift, look, tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    t, spots, acceleration, impulse = nasty_log(shipped, drift, look)
    np.savez(folder / "given.npz", t=t, spots=spots, acceleration=acceleration, impulse=impulse)
    environment = os.environ | {"RELNAV_JIT": "0"}
    command = [sys.executable, "-W", "error", "-c", PLAIN, str(folder / "given.npz"), str(folder / "out.npz")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return np.load(folder / "out.npz")


@pytest.mark.skipif(not is_compiled(), reason="RELNAV_JIT=0 in this run: there is nothing compiled to compare with")
@pytest.mark.parametrize("case", CASES)
def test_compiled_equals_plain(shipped, unknown_attitude, drift, look, plain, case):
    t, spots, acceleration, impulse = nasty_log(shipped, drift, look)
    left = Calibration(*LEFT)
    told = replace(shipped, tolerances=replace(shipped.tolerances, considered=True), calibration=left)
    compiled = relnav.filter_epochs(
        unknown_attitude if case == "unknown" else told if "considered" in case else shipped,
        t,
        spots,
        acceleration_m_s2=acceleration,
        delta_v_m_s=impulse,
        method="fix" if "fix" in case else "spots",
    )
    for name in ("status", "dof", "measurement_status"):
        np.testing.assert_array_equal(plain[f"{case}_{name}"], getattr(compiled, name))
    running = np.isfinite(compiled.state).all(axis=1)
    assert 20 < running.sum() < len(t)
    np.testing.assert_array_equal(np.isfinite(plain[f"{case}_state"]).all(axis=1), running)
    deviation = np.abs(plain[f"{case}_state"] - compiled.state)[running] / compiled.sigma[running]
    assert deviation.max() < TOLERANCE_SIGMA
    np.testing.assert_allclose(plain[f"{case}_factor"], compiled.factor, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(plain[f"{case}_nis"], compiled.nis, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(plain[f"{case}_innovation"], compiled.innovation, rtol=1e-7, atol=1e-12)


def test_the_log_is_nasty_indeed(plain):
    """All outcomes occur, so that the comparison above compares them all."""
    assert set(plain["spots_status"].tolist()) == set(range(6))
    assert {0, 1, 2}.issubset(set(plain["fix_measurement_status"].tolist()))


PLAIN_MARKERS = """
import sys
import numpy as np
import relnav
from relnav.codegen.kernel import is_compiled
from relnav.navigation.pose_log import filter_marker_epochs

assert not is_compiled()
given = np.load(sys.argv[1])
solution = filter_marker_epochs(
    relnav.load_model("three_marker_vision"), given["t"], given["spots"], acceleration_m_s2=given["acceleration"]
)
np.savez(sys.argv[2], state=solution.state, covariance=solution.covariance, status=solution.status)
"""


def test_the_marker_filter_in_plain_python(tmp_path):
    """Its covariance after an update, which held the transition of the step before in place of a unit matrix."""
    mission = relnav.load_model("three_marker_vision")
    flight = simulate_flight(mission, Approach(3.0, 2.0, start_m=(10.0, 0.25, -0.15)), seed=1)
    given, out = tmp_path / "given.npz", tmp_path / "out.npz"
    np.savez(given, t=flight.t_s, spots=flight.spots_px, acceleration=flight.acceleration_m_s2)
    environment = os.environ | {"RELNAV_JIT": "0"}
    subprocess.run([sys.executable, "-c", PLAIN_MARKERS, given, out], env=environment, check=True)
    plain = np.load(out)
    compiled = filter_marker_epochs(mission, flight.t_s, flight.spots_px, acceleration_m_s2=flight.acceleration_m_s2)
    np.testing.assert_array_equal(plain["status"], compiled.status)
    sigma = np.sqrt(np.diagonal(compiled.covariance, axis1=1, axis2=2))[1:]
    assert (np.abs(plain["state"] - compiled.state)[1:] <= 1e-5 * sigma[:, :6]).all()
    difference = np.abs(plain["covariance"] - compiled.covariance)[1:]
    assert (difference <= 1e-5 * sigma[:, :, None] * sigma[:, None, :]).all()
